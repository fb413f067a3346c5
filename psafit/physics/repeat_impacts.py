r"""A tip that strikes the launched ball again.

.. math:: \text{contacts count within } N_\mathrm{cyc}/f \text{ of the start}.

A ball that has moved by less than the stroke when the tip returns is struck once more. The study counts the first
contact only; its generator may have gone on. Assumed: the drive lasts :math:`N_\mathrm{cyc}` periods, and the launch
range is the largest excursion after the last contact within them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from psafit.arrays import FloatArray
from psafit.parameters import Bounds, Parameter, Uniform
from psafit.physics.checks import plain_rig
from psafit.physics.term import Check, Setup, Symptom, Term, World


def setup(rig: Setup, p: FloatArray) -> Setup:
    """Let the drive go on."""
    return rig.change(cycles=rig.cycles + p[:, 0])


def literal(world: World, p: Sequence[float]) -> None:
    """Periods ``N_cyc``."""
    world.cycles = p[0]


TERM = Term(
    id="repeat_impacts",
    slot="contact",
    title="repeated impacts",
    equation=r"\text{contacts count within } N_\mathrm{cyc}/f",
    description=__doc__ or "",
    probability=0.8,
    because="a generator runs on unless it is told not to, and the study mentions no burst",
    parameters=(
        Parameter(
            "repeat_cycles",
            r"N_\mathrm{cyc}",
            "1",
            Bounds(0.0, 5.0),
            Uniform(),
            "periods of the drive within which the tip may strike again",
            "generators send bursts of one to a few periods; the study speaks of the first contact (Section 2), 0",
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
    literal=literal,
    setup=setup,
)
