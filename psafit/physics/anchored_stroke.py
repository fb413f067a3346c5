r"""A stroke that grows faster than the voltage, ends at the data sheet's, and leaves a loop behind.

.. math::
    S(u) = \frac{q\,(u + \alpha u |u|)}{1 + \alpha U} \ \text{ on the first rise}, \qquad
    S = S_t + \frac{q}{1 + \alpha U} \left(w + \tfrac{\alpha}{2} w |w|\right), \quad w = u - u_t
    \ \text{ after a turn at } u_t .

Rayleigh's law of ferroelectrics: the field moves domain walls across pinning centres, so that the coefficient grows
linearly with the amplitude. The growth is of the irreversible part, whose loop therefore belongs to it: between
:math:`\pm V` it opens by :math:`x/(2(1+x))` of its stroke, :math:`x = \alpha V`. A data sheet states the stroke at full
voltage :math:`U`; near zero the stroke per volt is lower than :math:`q` by :math:`1 + \alpha U`.

With the first rise taken as the stroke, what the loop lacks is a state :math:`z = \zeta\, q \alpha/(1 + \alpha U)`,
which for a falling voltage (a rising one is its mirror image) obeys

.. math:: \frac{\mathrm d\zeta}{\mathrm du} = 4u - \sqrt{4u^2 - 2\zeta} \ (u > 0), \qquad
    -\sqrt{-2\zeta} \ (u < 0,\ \zeta < 0), \qquad -u \ (u < 0,\ \zeta > 0):

the turn :math:`u_t` is recovered from :math:`\zeta` and :math:`u`. A loop closes at :math:`-u_t`, or, where the voltage
came back to zero and no further, at :math:`u_t` (the third case, mirrored: a unipolar drive). Beyond it the first rise
goes on. Assumed: no creep; of turns inside a loop only what :math:`\zeta` keeps is remembered. The first rise and the
first fall are exact under any drive, and so are loops between :math:`\pm V` and between 0 and :math:`V`. Under a drive
with a bias loops end where those of a larger first rise would.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from psafit.parameters import Bounds, LogNormal, Normal, Parameter, Tailed
from psafit.physics.term import Check, ReferenceRig, Symptom, Term


def stack_factor(size: float, p: Any) -> float:
    """Return ``(1 + alpha |u|)/(1 + alpha U)``."""
    return (1.0 + float(p[0]) * size) / (1.0 + float(p[0]) * float(p[1]))


def branch(z0: float, u0: float, u: float, q: float, p: Any) -> float:
    """Follow the state from `u0` to `u`: as for a falling voltage, mirrored where it rises."""
    alpha = float(p[0])
    if alpha == 0.0 or u == u0:
        return z0
    scale = q * alpha / (1.0 + alpha * float(p[1]))
    side = -1.0 if u > u0 else 1.0
    zeta, now, end = side * z0 / scale, side * u0, side * u
    if now > 0.0:
        # 4 u^2 - 2 zeta is the square of u + u_t, and constant where it is none.
        stop = max(end, 0.0)
        square = 4.0 * now * now - 2.0 * zeta
        if square > 0.0:
            turn = math.sqrt(square) - now
            zeta = (stop - turn) * (1.5 * stop + 0.5 * turn)
        else:
            zeta = 2.0 * stop * stop - 0.5 * square
        now = stop
    if end < 0.0 and zeta < 0.0:
        left = max(math.sqrt(-2.0 * zeta) + (end - now), 0.0)
        zeta = -0.5 * left * left
    elif end < 0.0:
        zeta = max(zeta - 0.5 * (end * end - now * now), 0.0)
    return side * zeta * scale


def literal(rig: ReferenceRig, p: Sequence[float], closed: float = 1e-6) -> None:
    """Stroke of the first rise, and the rate of what the loop lacks; one that is open by `closed` at most is closed."""
    stroke, (alpha, full) = rig.stroke, p
    rig.stroke = lambda u: stroke(u) * (1 + alpha * abs(u)) / (1 + alpha * full)
    if alpha == 0:
        return

    def rate(z: float, u: float, du: float) -> float:
        scale = rig.q * alpha / (1 + alpha * full)
        sign = 1.0 if du < 0 else -1.0
        zeta, v = sign * z / scale, sign * u
        if v > 0:
            slope = 4 * v - math.sqrt(max(4 * v * v - 2 * zeta, 0.0))
        elif zeta > closed * v * v:
            slope = -v
        else:
            slope = -math.sqrt(max(-2 * zeta, 0.0))
        return scale * slope * du

    rig.memories.append(rate)


def _stroke(u: float, *turns: float, alpha: float = 0.01, full: float = 100.0, q: float = 1e-7) -> float:
    """Stroke at `u` after a first rise and further turns."""
    z, p = 0.0, [alpha, full]
    for before, now in pairwise([0.0, *turns, u]):
        z = branch(z, before, now, q, p)
    return q * u * stack_factor(abs(u), p) - z


TERM = Term(
    id="anchored_stroke",
    slot="stack",
    title="stroke rises to the data sheet's, with its loop",
    equation=r"S(u) = q u \, (1 + \alpha |u|)/(1 + \alpha U) \text{ and Rayleigh's loop}",
    description=__doc__ or "",
    probability=0.3,
    because="a data sheet states the stroke at full voltage, and soft PZT has less per volt at a tenth of it",
    parameters=(
        Parameter(
            name="anchored_alpha",
            symbol=r"\alpha",
            unit="1/V",
            bounds=Bounds(0.0, 0.1),
            prior=Tailed(Normal(0.006, 0.004)),
            description="relative growth of the stroke per volt, for each volt",
            source="loops of 2 % at small signals and 10-15 % at full voltage (Physik Instrumente, Piezo tutorial,"
            " read). Of a drive of both signs the loop is x/(2 (1 + x)), x = alpha U: 0.1-0.15 are 0.0125-0.021 1/V"
            " if full voltage is 20 V, and 0.0017-0.003 if it is 150 V. From 0 to U, as such stacks are driven, it is"
            " x/(4 + 2 x): 0.0033-0.0057 at 150 V. From memory, 0.003-0.015 by Rayleigh's law (that it holds for PZT:"
            " Damjanovic and Demartin 1996, abstract read). At 0.1 1/V a stack would have a sixteenth of its stroke"
            " per volt near zero",
            neutral=0.0,
        ),
        Parameter(
            name="anchored_voltage",
            symbol="U",
            unit="V",
            bounds=Bounds(5.0, 5000.0),
            prior=LogNormal(150.0, 2.0),
            description="voltage at which the stroke per volt is the data sheet's",
            source="rated voltage of a stack: of co-fired ones 60 to 200 V, of stacked discs 500 to 1000 V (an"
            " estimate); 150 V for AE0505D16DF (its data sheet, read, states the stroke there). At 1 kV/mm 5 V are"
            " layers of 5 um and 5000 V discs of 5 mm, of which no stack is made (an estimate)",
        ),
    ),
    symptom=Symptom(
        "the launch range is below what the data sheet's stroke gives and grows faster than the voltage, by the factor"
        " 1 + alpha V_a, at every frequency; the return of the tip lags behind",
        sign=-1,
        frequency="mixed",
        amplitude="falls",
    ),
    reference="D. Damjanovic and M. Demartin, J. Phys. D 29 (1996) 2057; D. A. Hall, J. Mater. Sci. 36 (2001) 4575",
    checks=(
        Check(
            "alpha = 0.01 1/V, U = 100 V, q = 0.1 um/V, first rise to 20 V: 2 um x 1.2/2 = 1.2 um",
            lambda: _stroke(20.0),
            1.2e-6,
        ),
        Check(
            "back at 0 V from there: 1.2 um - 0.05 um/V x (20 V + 0.005 x 400 V) = 1.2 - 1.1 = 0.1 um",
            lambda: _stroke(0.0, 20.0),
            1e-7,
            tolerance=1e-9,
        ),
        Check(
            "at -10 V: 1.2 um - 0.05 um/V x (30 V + 0.005 x 900 V) = 1.2 - 1.725 = -0.525 um",
            lambda: _stroke(-10.0, 20.0),
            -5.25e-7,
            tolerance=1e-9,
        ),
        Check(
            "beyond -20 V the first rise goes on: at -30 V, 0.05 um/V x (30 V + 0.01 x 900 V) = 1.95 um",
            lambda: -_stroke(-30.0, 20.0),
            1.95e-6,
            tolerance=1e-9,
        ),
        Check(
            "up again from 0 V to 10 V: 0.1 um + 0.05 um/V x (10 V + 0.005 x 100 V) = 0.625 um",
            lambda: _stroke(10.0, 20.0, 0.0),
            6.25e-7,
            tolerance=1e-9,
        ),
        Check(
            "a loop between 0 and 20 V closes: 1.2 um again at 20 V",
            lambda: _stroke(20.0, 20.0, 0.0, 20.0, 0.0),
            1.2e-6,
            tolerance=1e-9,
        ),
        Check(
            "beyond 20 V the first rise goes on: at 30 V, 0.05 um/V x (30 V + 0.01 x 900 V) = 1.95 um",
            lambda: _stroke(30.0, 20.0, 0.0),
            1.95e-6,
            tolerance=1e-9,
        ),
    ),
    look="the free tip's stroke per volt, at small amplitudes and at the rated voltage",
    literal=literal,
    stack_factor=stack_factor,
    branch=branch,
)
