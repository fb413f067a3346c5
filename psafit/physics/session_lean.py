r"""A ball that leans on the tip, in every session by another length.

.. math:: x_{0g} = \min\left(x_0\, e^{s z_g},\ \tfrac l2\right), \qquad z_g \sim \mathcal N(0, 1).

`preload` with a lean of its own in each session (a group of the experiment): whoever hangs the ball anew or moves the
frame sets another :math:`x_0`. Where ranges go with :math:`v^2 l/(2 g x_0)` it looks like a gain of the session and is
its mechanical reason; small launches, which a lean cuts down more than large ones, distinguish it from `reading_gain`.
A string at 30 degrees, :math:`l/2`, is no pendulum any more. With `preload` the leans add.

As :math:`x_0 \to 0` the place at separation stays in the energy, as in `preload`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from psafit.arrays import FloatArray
from psafit.parameters import Bounds, Normal, Parameter, Tailed
from psafit.physics.checks import plain_rig
from psafit.physics.term import Check, OfSession, ReferenceRig, Setup, Symptom, Term


def length(p: FloatArray) -> FloatArray:
    """A session's lean, m, however long the string; `p` holds the middle, the spread and the session's number."""
    return p[:, 0] * np.exp(p[:, 1] * p[:, 2])


def setup(rig: Setup, p: FloatArray) -> Setup:
    """Lean further by the session's length."""
    return rig.change(lean=np.minimum(rig.lean + length(p), 0.5 * rig.l))


def literal(rig: ReferenceRig, p: Sequence[float]) -> None:
    """Equilibrium further behind the contact plane by ``x_0 exp(s z)``; `p` ends with the `z` of the session."""
    x_0, spread, z = p
    rig.lean = min(rig.lean + x_0 * math.exp(spread * z), rig.l / 2)


def _lean(x_0: float, spread: float, z: float) -> float:
    return float(setup(plain_rig(), np.array([[x_0, spread, z]])).lean[0])


TERM = Term(
    id="session_lean",
    slot="contact",
    title="lean that differs by session",
    equation=r"x_{0g} = x_0 e^{s z_g}, \quad z_g \sim \mathcal{N}(0, 1)",
    description=__doc__ or "",
    probability=0.04,
    because="of balls that lean, a quarter are hung anew between sessions (an estimate)",
    parameters=(
        Parameter(
            name="session_lean_offset",
            symbol="x_0",
            unit="m",
            bounds=Bounds(0.0, 0.5),
            prior=Tailed(Normal(0.0, 4e-3)),
            description="middle of the sessions' leans",
            source="as of the lean of `preload`, and its bounds: 4 mm is 2.5 degrees of a 90 mm string (an estimate)",
            neutral=0.0,
        ),
        Parameter(
            name="session_lean_spread",
            symbol="s",
            unit="1",
            bounds=Bounds(0.0, 1.0),
            prior=Tailed(Normal(0.0, 0.3)),
            description="spread of the sessions' leans, in logarithms",
            source="a frame set by hand comes back to some tenths of a few millimetres (an estimate); beyond 1 the"
            " sessions have no common lean",
        ),
    ),
    symptom=Symptom(
        "sessions lie above or below by a factor of their own, which is nearer to one for large launches, and every"
        " range grows with the square of the speed",
        sign=-1,
        frequency="mixed",
        amplitude="mixed",
    ),
    reference="elementary: energy of a pendulum started off its equilibrium; A. Gelman et al., Bayesian Data Analysis,"
    " 3rd ed., 2013, ch. 5 (hierarchical models)",
    checks=(
        Check(
            "2 mm, spread ln 2, z = -1: 1 mm",
            lambda: _lean(2e-3, math.log(2), -1.0),
            1e-3,
        ),
        Check(
            "3 mm, spread 0.5 ln 3, z = 2: 9 mm",
            lambda: _lean(3e-3, 0.5 * math.log(3), 2.0),
            9e-3,
        ),
        Check(
            "40 mm, spread 1, z = 3 on a string of 90 mm: no more than 45 mm",
            lambda: _lean(4e-2, 1.0, 3.0),
            4.5e-2,
        ),
    ),
    look="how far the resting ball is from the plumb line below its holder, on a photograph from the side, each time"
    " that it is hung anew",
    literal=literal,
    setup=setup,
    of_session=OfSession("a session's lean", "m", length),
    latent=Parameter(
        name="session_lean_z",
        symbol="z",
        unit="1",
        bounds=Bounds(-5.0, 5.0),
        prior=Normal(0.0, 1.0),
        description="a session's lean, in units of the spread",
        source="standard normal by definition of the spread",
    ),
    limit=("separation_height", (1.0,)),
)
