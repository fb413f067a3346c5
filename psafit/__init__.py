"""psafit: fit contact-impact drives, and find what the simulation gets wrong."""

__version__ = "0.1.0"
