r"""An amplitude that is not what the display is taken to say.

.. math:: V \to c\, V.

A generator may show volts peak to peak: the amplitude is half of that (:math:`c = 1/2`). It may show volts RMS of a
sine (:math:`c = \sqrt 2`), or the voltage at a matched load: an open circuit, which a stack nearly is, gets the double
(:math:`c = 2`). Bias and idle level are set apart and stay. A recorded voltage is what it is: the cause does not act on
it. Assumed: one factor for all groups.

Where stroke and voltage are proportional this is `stroke_tolerance`, to the last digit, and only the priors distinguish
the two: that one is a tolerance, this one a few certain factors. Slew limits, saturation, a stroke that grows
with the field, a bias and an idle level see the voltage itself. A vibrometer on the free tip, or an oscilloscope at the
stack, settles it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from psafit.arrays import FloatArray
from psafit.parameters import Bounds, LogNormal, Mixture, Parameter
from psafit.physics.checks import plain_rig
from psafit.physics.term import Check, ReferenceRig, Setup, Symptom, Term


def setup(rig: Setup, p: FloatArray) -> Setup:
    """Scale the amplitude."""
    return rig.change(scale=rig.scale * p[:, 0])


def literal(rig: ReferenceRig, p: Sequence[float]) -> None:
    """Amplitude ``c V``."""
    rig.scale *= p[0]


TERM = Term(
    id="amplitude_scale",
    slot="drive",
    title="amplitude off by the display's factor",
    equation=r"V \to c V",
    description=__doc__ or "",
    probability=0.03,
    because="a display is misread now and then; who looks at an oscilloscope, or measures the free tip, sees it",
    parameters=(
        Parameter(
            name="amplitude_factor",
            symbol="c",
            unit="1",
            bounds=Bounds(0.1, 10.0),
            prior=Mixture(
                (
                    (0.35, LogNormal(0.5, 1.05)),
                    (0.15, LogNormal(math.sqrt(2.0), 1.05)),
                    (0.30, LogNormal(2.0, 1.05)),
                    (0.20, LogNormal(1.0, 2.0)),
                )
            ),
            description="amplitude over the stated one",
            source="peak to peak taken for peak 0.5; RMS for peak 1.41; the voltage at a matched load for that of an"
            " open circuit 2 (Keysight's and Tektronix' manuals of function generators call the setting output load;"
            " not read). Each to 5 %: what a meter and the generator's own amplitude leave. How often each occurs is an"
            " estimate, peak to peak most. The rest is for"
            " attenuators and amplifiers whose gain is not what its front says. A probe left at 10:1 is the worst that"
            " goes unseen",
            neutral=1.0,
        ),
    ),
    symptom=Symptom(
        "every launch range is scaled by the same factor, as if the stroke were another one; where the voltage itself"
        " matters, by a slew limit or saturation, the corner lies at another stated voltage",
        sign=1,
        frequency="flat",
        amplitude="flat",
    ),
    reference="elementary: a linear drive; P. Horowitz, The Art of Electronics, 3rd ed., 2015, ch. 1",
    checks=(
        Check(
            "20 V peak to peak are an amplitude of 10 V: c = 0.5",
            lambda: 20.0 * float(setup(plain_rig(), np.array([[0.5]])).scale[0]),
            10.0,
        ),
        Check(
            "factors multiply: 1.2 x 1.5 = 1.8",
            lambda: float(setup(plain_rig(scale=1.2), np.array([[1.5]])).scale[0]),
            1.8,
        ),
    ),
    look="the amplitude at the stack, on an oscilloscope",
    literal=literal,
    setup=setup,
    drives="stated",
)
