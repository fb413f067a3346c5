r"""A sine that does not start at its zero.

.. math:: V_\mathrm{cmd} = V_a \sin(2\pi f t + \phi_0).

A generator that is switched on rather than triggered, or gated by a relay, starts anywhere: the voltage jumps by
:math:`V_a \sin\phi_0` and the burst has part of the character of a square wave. Assumed: the same phase in every
launch; one that varies is scatter. It acts on sines and triangles: jumps start where a trigger puts them, and a table
has its own start.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from psafit.arrays import FloatArray
from psafit.parameters import Bounds, Normal, Parameter, Tailed
from psafit.physics.checks import plain_rig
from psafit.physics.term import Check, ReferenceRig, Setup, Symptom, Term


def setup(rig: Setup, p: FloatArray) -> Setup:
    """Add the phase."""
    return rig.change(phase=rig.phase + p[:, 0])


def literal(rig: ReferenceRig, p: Sequence[float]) -> None:
    """Phase ``phi_0``."""
    rig.phase += p[0]


TERM = Term(
    id="start_phase",
    slot="drive",
    title="sine starts off its zero",
    equation=r"V_\mathrm{cmd} = V_a \sin(2\pi f t + \phi_0)",
    description=__doc__ or "",
    because=(
        "a triggered burst starts at its set phase, 0 by default; a start at random would be scatter, not the same "
        "in every launch"
    ),
    parameters=(
        Parameter(
            name="start_phase_phi",
            symbol=r"\phi_0",
            unit="rad",
            bounds=Bounds(-math.pi, math.pi),
            prior=Tailed(Normal(0.0, 0.3)),
            description="phase at which the sine starts",
            source="generators in burst mode start at a set phase, 0 by default; output filters and trigger delays of"
            " some 10 us turn a 1 kHz sine by 0.1 rad; a free-running generator would start anywhere, so that"
            " no phase is excluded",
            neutral=0.0,
        ),
    ),
    symptom=Symptom(
        "slow sines, which hardly launch the ball from rest, launch it by their initial jump: the low-frequency side"
        " of the curve fills up for phi_0 > 0; square waves stay as they are",
        sign=0,
        frequency="mixed",
        amplitude="flat",
        waveforms=("sine",),
    ),
    reference="elementary: initial value of a gated sine",
    checks=(
        Check(
            "initial jump of 20 V at phi_0 = pi/6: 20 V x 0.5 = 10 V",
            lambda: float(20.0 * np.sin(setup(plain_rig(), np.array([[math.pi / 6]])).phase[0])),
            10.0,
        ),
        Check(
            "phases add: 0.25 rad + (-0.4 rad) = -0.15 rad",
            lambda: float(setup(plain_rig(phase=0.25), np.array([[-0.4]])).phase[0]),
            -0.15,
        ),
    ),
    look="the voltage at the stack as the drive begins, on an oscilloscope",
    literal=literal,
    setup=setup,
    drives="shifting",
)
