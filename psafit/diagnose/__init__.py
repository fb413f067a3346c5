"""Diagnosis: show what the simulation gets wrong, name the cause, and measure what the extension gains.

Nothing here names a cause, a group or a rig: it works on any experiment and any catalogue.
"""

from psafit.diagnose.diagnosis import diagnose
from psafit.diagnose.record import Diagnosis

__all__ = ["Diagnosis", "diagnose"]
