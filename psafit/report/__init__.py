"""Figures and pages: results in, one self-contained HTML file out."""
