r"""An amplifier that follows its command with a first-order lag.

.. math:: \dot u = (V_\mathrm{cmd} - u)/\tau_a, \qquad u(0) = 0.

The output resistance of the amplifier and the stack's capacity make an RC low-pass filter. Assumed: the capacity
is constant (it grows by some tens of per cent with the field) and the amplifier itself is much faster.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from psafit.arrays import FloatArray
from psafit.parameters import Bounds, Normal, Parameter, Tailed
from psafit.physics.checks import plain_rig
from psafit.physics.term import Check, ReferenceRig, Setup, Symptom, Term


def setup(rig: Setup, p: FloatArray) -> Setup:
    """Add the time constant."""
    return rig.change(lag=rig.lag + p[:, 0])


def literal(rig: ReferenceRig, p: Sequence[float]) -> None:
    """Time constant ``tau_a``."""
    rig.lag += p[0]


TERM = Term(
    id="amplifier_lag",
    slot="drive",
    title="lagging amplifier",
    equation=r"\dot u = (V_\mathrm{cmd} - u)/\tau_a",
    description=__doc__ or "",
    probability=0.2,
    because=(
        "every source has an output resistance, and 1.5 uF is a heavy load; of a power amplifier nothing of it shows"
    ),
    parameters=(
        Parameter(
            name="amplifier_lag_tau",
            symbol=r"\tau_a",
            unit="s",
            bounds=Bounds(0.0, 1e-2),
            prior=Tailed(Normal(0.0, 1e-4)),
            description="time constant of the amplifier",
            source="the 50 ohm of a function generator into 1.5 uF (Table 1), the most common case: 75 us; a power"
            " amplifier of 1-10 ohm: 1.5-15 us. Beyond 10 ms, 7 kohm, a square wave of 1 kHz would hardly reach the"
            " stack",
            neutral=0.0,
        ),
    ),
    symptom=Symptom(
        "the voltage falls short of the command above 1/(2 pi tau_a), a loss that grows with frequency; where the drive"
        " turns several times during contact, the voltage swings about a positive mean instead and pushes more",
        sign=0,
        frequency="mixed",
        amplitude="flat",
    ),
    reference="A. J. Fleming and K. K. Leang, Design, Modeling and Control of Nanopositioning Systems, 2014, ch. 14",
    checks=(
        Check(
            "lags add: one of 15 us that a rig has, and tau_a = 20 us, make 35 us",
            lambda: float(setup(plain_rig(lag=15e-6), np.array([[20e-6]])).lag[0]),
            35e-6,
        ),
        Check(
            "10 ohm on 1.5 uF: tau_a = 15 us, corner frequency 1/(2 pi 15 us) = 10.610 kHz",
            lambda: float(1 / (2 * np.pi * setup(plain_rig(), np.array([[10 * 1.5e-6]])).lag[0])),
            10610.3,
            tolerance=1e-5,
        ),
    ),
    look="the voltage at the stack after a step of the command, on an oscilloscope",
    literal=literal,
    setup=setup,
)
