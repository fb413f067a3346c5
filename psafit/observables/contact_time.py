"""Contact time: from the drive's start to the separation after which the ball flies, us."""

from __future__ import annotations

import numpy as np

from psafit.arrays import FloatArray
from psafit.observables.observable import Launches, Observable, scatter
from psafit.parameters import Bounds, LogNormal

_CALLED = (
    "contact time", "time of contact", "contact duration", "t contact", "contact t", "kontaktzeit", "kontaktdauer",
    "t kontakt",
)  # fmt: skip


def _of(launches: Launches) -> FloatArray:
    """A ball that does not leave the tip has no such time. Zero stands for it, far from any reading."""
    return np.nan_to_num(launches.separation_time)


CONTACT_TIME = Observable(
    name="contact_time",
    column="contact_time_us",
    unit="us",
    scale=1e6,
    title="contact time",
    called=_CALLED,
    of=_of,
    scatter=scatter(
        "contact_time",
        "us",
        LogNormal(0.01, 3.0),
        LogNormal(1.0, 3.0),
        Bounds(1e-2, 1e3),
        (
            "triggers and time bases are exact; launches repeat their time better than their range",
            "a microsecond of sampling, trigger and threshold",
        ),
    ),
    offset=1.0,
    limits=(0.0, 1e9),
    still=0.0,
    usual=(1.0, 1e6),
    mistaken=(("ms", "s"), ("ns",)),
    blank=True,
    grows=False,
)
