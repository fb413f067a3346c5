"""The physics: the baseline and, one file each, the candidate causes."""

from psafit.physics import baseline

__all__ = ["baseline"]
