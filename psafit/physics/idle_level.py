r"""A drive that rests at another voltage than is said before it starts.

.. math:: u(t) = u_\mathrm{idle} + u_0 \quad (t < 0), \qquad u(0^+) = V_\mathrm{cmd}(0).

A generator in burst mode may hold the last level of its waveform, an amplifier that is switched on with the burst
comes from 0 V while its output has an offset, a bias stays on between bursts. Stack and ball rest in equilibrium under
that voltage, and the drive begins with a jump of :math:`-u_0`: a square wave of 20 V that rests at -20 V kicks twice as
hard. What is stated as `idle_v` is where :math:`u_0` counts from. A recorded voltage shows where it starts: the
cause does not act on it. Assumed: the same in every group, whatever its amplitude.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from psafit.arrays import FloatArray
from psafit.parameters import Bounds, Normal, Parameter, Tailed
from psafit.physics.checks import plain_rig
from psafit.physics.term import Check, ReferenceRig, Setup, Symptom, Term


def setup(rig: Setup, p: FloatArray) -> Setup:
    """Rest at another voltage."""
    return rig.change(idle=rig.idle + p[:, 0])


def literal(rig: ReferenceRig, p: Sequence[float]) -> None:
    """Idle voltage ``u_0``."""
    rig.idle += p[0]


TERM = Term(
    id="idle_level",
    slot="drive",
    title="drive rests at another voltage",
    equation=r"u(t < 0) = u_\mathrm{idle} + u_0",
    description=__doc__ or "",
    probability=0.03,
    because="a burst begins and ends at 0 V by default; few look at the voltage between bursts",
    parameters=(
        Parameter(
            name="idle_u0",
            symbol="u_0",
            unit="V",
            bounds=Bounds(-100.0, 100.0),
            prior=Tailed(Normal(0.0, 0.5)),
            description="voltage at which the drive rests, above what is stated",
            source="offsets of amplifiers and generators: some 10 mV to some 0.1 V (makers' usual figures, not"
            " verified); a level that a burst or a bias leaves is some volts, which is the tail. 100 V is beyond any"
            " stack driven by tens of volts",
            neutral=0.0,
        ),
    ),
    symptom=Symptom(
        "the drive begins with a jump: slow sines launch the ball by it, as square waves do, and weak ones most; square"
        " waves are kicked harder or less by the same voltage at every amplitude",
        sign=-1,
        frequency="mixed",
        amplitude="falls",
    ),
    reference="elementary: initial value of a gated drive",
    checks=(
        Check(
            "a rest at -3 V below a stated one of 1 V: -2 V",
            lambda: float(setup(plain_rig(idle=1.0), np.array([[-3.0]])).idle[0]),
            -2.0,
        ),
        Check(
            "first jump of a square wave of 20 V that rests at -20 V: 20 V - (-20 V) = 40 V",
            lambda: 20.0 - float(setup(plain_rig(), np.array([[-20.0]])).idle[0]),
            40.0,
        ),
    ),
    look="the voltage at the stack before the drive begins, with a voltmeter",
    literal=literal,
    setup=setup,
    drives="stated",
)
