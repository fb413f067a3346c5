r"""A tip that strikes the launched ball again, because the drive runs on.

.. math:: \text{the first hop: a flight that reaches its apex uncaught, or outlasts } N_\mathrm{cyc}/f.

A ball that has moved by less than the stroke when the tip returns is struck once more. What is read is the *first hop*:
the first flight in which the ball's speed falls to zero before the tip catches it. A ball that leans or rubs has its
apex after some milliseconds; what strikes it later is another launch, however long the drive runs on. The study's model
ends with the first contact. Assumed: the tip may catch the ball within :math:`N_\mathrm{cyc}` periods of the start;
more than some eight of them give the same ranges.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from psafit.arrays import FloatArray
from psafit.parameters import Bounds, Parameter, Uniform
from psafit.physics.checks import plain_rig
from psafit.physics.term import Check, ReferenceRig, Setup, Symptom, Term


def setup(rig: Setup, p: FloatArray) -> Setup:
    """Let the drive go on."""
    return rig.change(cycles=rig.cycles + p[:, 0])


def literal(rig: ReferenceRig, p: Sequence[float]) -> None:
    """Periods ``N_cyc``."""
    rig.cycles += p[0]


TERM = Term(
    id="repeat_impacts",
    slot="contact",
    title="repeated impacts",
    equation=r"\text{first hop within } N_\mathrm{cyc}/f",
    description=__doc__ or "",
    probability=0.8,
    because="a generator runs on unless it is set otherwise, and whoever sets a burst says so",
    parameters=(
        Parameter(
            name="repeat_cycles",
            symbol=r"N_\mathrm{cyc}",
            unit="1",
            bounds=Bounds(0.0, 10.0),
            prior=Uniform(),
            description="periods of the drive within which the tip may strike again",
            source="generators send bursts of one to a few periods, or run on, which from about 8 periods is the same;"
            " the study speaks of the first contact (Section 2), 0",
            neutral=0.0,
        ),
    ),
    symptom=Symptom(
        "at high frequency, where one period moves the ball by less than the stroke, further strikes add speed; at low"
        " frequency the ball is gone before the tip returns, unless a stack with little damping rings and catches it",
        sign=1,
        frequency="grows",
        amplitude="flat",
    ),
    reference="W. Goldsmith, Impact, 1960; P. J. Holmes, J. Sound Vib. 84 (1982) 173 (ball on a vibrating table)",
    checks=(
        Check(
            "periods add, 0.5 + 1.75 = 2.25; at 1.2 kHz they last 2.25/1200 Hz = 1.875 ms",
            lambda: float(setup(plain_rig(cycles=0.5), np.array([[1.75]])).cycles[0]) / 1200.0,
            1.875e-3,
        ),
    ),
    look="the ball's speed over the first periods of the drive, with a vibrometer or a fast camera",
    literal=literal,
    setup=setup,
)
