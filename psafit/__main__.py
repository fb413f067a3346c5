"""`python -m psafit`."""

from psafit.cli import main

main()
