r"""An amplifier whose current limit bounds the rate of the voltage.

.. math:: |\dot u| \le S = i_\mathrm{max}/C.

A stack is a capacitor: the amplifier charges it with at most :math:`i_\mathrm{max}`. A sine needs :math:`\pi f U`
for a swing `U` from its lowest to its highest voltage (20 V to both sides, 40 V in all, at 5 kHz: 0.63 V/us), a jump an
infinite rate. Assumed: the same limit for both signs, a constant capacity, and a
voltage that runs at the limit until it meets the command. Sampled as :math:`1/S`, which vanishes where the limit does.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from psafit.arrays import FloatArray
from psafit.parameters import Bounds, Normal, Parameter, Tailed
from psafit.physics.checks import plain_rig
from psafit.physics.term import Check, ReferenceRig, Setup, Symptom, Term


def setup(rig: Setup, p: FloatArray) -> Setup:
    """Let the tighter limit hold."""
    return rig.change(inverse_slew=np.maximum(rig.inverse_slew, p[:, 0]))


def literal(rig: ReferenceRig, p: Sequence[float]) -> None:
    """Largest rate ``S``."""
    if p[0] > 0:
        rig.slew = min(rig.slew, 1 / p[0])


TERM = Term(
    id="slew_limit",
    slot="drive",
    title="slew-limited amplifier",
    equation=r"|\dot u| \le S = i_\mathrm{max}/C",
    description=__doc__ or "",
    because=(
        "a resistance lags before a current limit is met, and a sine that has become a triangle is seen on any "
        "oscilloscope"
    ),
    parameters=(
        Parameter(
            name="slew_limit_inverse",
            symbol="1/S",
            unit="s/V",
            bounds=Bounds(0.0, 1e-3),
            prior=Tailed(Normal(0.0, 2e-5)),
            description="one over the largest rate of the voltage",
            source="current limits of piezo amplifiers, 20 mA (bench-top controllers) to 1 A (power amplifiers), into"
            " 1.5 uF (Table 1): S = 1.3e4-6.7e5 V/s, 1/S = 1.5e-6-7.5e-5 s/V. Beyond 1e-3 s/V, 1.5 mA, the rise to 20"
            " V takes 20 ms and no reading would depend on the waveform",
            neutral=0.0,
            reciprocal="V/s",
        ),
    ),
    symptom=Symptom(
        "sines that swing by U, lowest to highest voltage, become triangles above f = S/(pi U), and jumps become ramps"
        " of U/S. It sets in at a threshold"
        " that moves to lower frequencies as the voltage grows: first a loss, then a gain, where the voltage cannot"
        " come back before the ball leaves. With square waves an amplitude sweep may begin with a gain and end in a"
        " loss",
        sign=0,
        frequency="mixed",
        amplitude="mixed",
    ),
    reference="A. J. Fleming and K. K. Leang, Design, Modeling and Control of Nanopositioning Systems, 2014, ch. 14",
    checks=(
        Check(
            "0.3 A into 1.5 uF: S = 0.2 V/us, 1/S = 5 us/V, above a rig's own 2 us/V",
            lambda: float(setup(plain_rig(inverse_slew=2e-6), np.array([[1.5e-6 / 0.3]])).inverse_slew[0]),
            5e-6,
        ),
        Check(
            "the tighter limit holds: 5 us/V asked of a rig at 8 us/V leaves 8 us/V",
            lambda: float(setup(plain_rig(inverse_slew=8e-6), np.array([[5e-6]])).inverse_slew[0]),
            8e-6,
        ),
    ),
    look="the steepest rise of the voltage at the stack, at full amplitude, on an oscilloscope",
    literal=literal,
    setup=setup,
)
