r"""Sessions that read with different gains.

.. math:: L_\mathrm{read} = L\, e^{s z_g}, \qquad z_g \sim \mathcal N(0, 1).

Each session hangs the ball and aims the laser anew: an angle :math:`\theta` between beam and motion reads
:math:`\cos\theta`, an impact off the ball's centre sends part of it sideways, a decoder has a calibration. Assumed: one
gain for a whole session (a group of the experiment, or several that name it), whose spread `s` is to be found; a gain
common to all is not this cause. Where a drive's amplitude differs by session, whole sessions lie above or below, too: a
voltmeter at the stack distinguishes the two. What one instrument reads of the ball's motion in a session has one gain:
ranges, speeds and traces of the ball; contact times and forces have none. ``[instruments]`` in ``experiment.toml``
names others; each has a gain of its own in each session.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from psafit.arrays import FloatArray
from psafit.parameters import Bounds, Normal, Parameter, Tailed
from psafit.physics.term import Check, OfSession, ReferenceRig, Symptom, Term


def reading(L: FloatArray, p: FloatArray, group: NDArray[np.int64]) -> FloatArray:
    """Multiply by the reader's gain; `p` holds the spread, then one number for each reader."""
    return L * np.exp(p[:, :1] * p[:, 1 + group])


def gain(p: FloatArray) -> FloatArray:
    """A session's gain; `p` is the spread and the session's number."""
    return np.exp(p[:, 0] * p[:, 1])


def literal(rig: ReferenceRig, p: Sequence[float]) -> None:
    """Reading times ``exp(s z)``; `p` is the spread and the `z` of the session in question."""
    before, spread, z = rig.reading, p[0], p[1]
    rig.reading = lambda L, group: before(L, group) * math.exp(spread * z)


def _read(L: float, spread: float, z: Sequence[float], group: int) -> float:
    return float(reading(np.array([[L]]), np.array([[spread, *z]]), np.array([group]))[0, 0])


TERM = Term(
    id="reading_gain",
    slot="reading",
    title="gain of each session",
    equation=r"L_\mathrm{read} = L e^{s z_g}, \quad z_g \sim \mathcal{N}(0, 1)",
    description=__doc__ or "",
    probability=0.08,
    because="sessions differ: a ball hung anew, a laser aimed anew",
    parameters=(
        Parameter(
            name="reading_gain_spread",
            symbol="s",
            unit="1",
            bounds=Bounds(0.0, 0.5),
            prior=Tailed(Normal(0.0, 0.1)),
            description="spread of the sessions' gains, in logarithms",
            source="decoder 1 %, beam 5-15 degrees off 0.4-3 %; a ball hung anew, struck off centre or with other"
            " tape, some 10 % (the study: the range depends strongly on the load conditions, Section 2.2). At 0.5 a"
            " usual session reads 0.6 of the motion, as a beam 53 degrees off it would",
            neutral=0.0,
        ),
    ),
    symptom=Symptom(
        "whole sessions lie above or below by a factor of their own, and points measured twice, in two sessions,"
        " disagree",
        sign=0,
        frequency="flat",
        amplitude="flat",
    ),
    reference="A. Gelman et al., Bayesian Data Analysis, 3rd ed., 2013, ch. 5 (hierarchical models); ISO 16063-41:2011",
    checks=(
        Check(
            "spread ln 2, session 1 of z = (0.3, -1): 60 um x 2^-1 = 30 um",
            lambda: _read(60e-6, math.log(2), (0.3, -1.0), 1),
            30e-6,
        ),
        Check(
            "spread 0.5 ln 3, session 2 of z = (1, -1, 2): 20 um x 3 = 60 um",
            lambda: _read(20e-6, 0.5 * math.log(3), (1.0, -1.0, 2.0), 2),
            60e-6,
        ),
    ),
    look="what the instrument reads of a known motion of the ball, in each session",
    literal=literal,
    reading=reading,
    reads=("launch_range", "launch_speed", "displacement", "velocity"),
    of_session=OfSession("a session's gain", "1", gain),
    latent=Parameter(
        name="reading_gain_z",
        symbol="z",
        unit="1",
        bounds=Bounds(-5.0, 5.0),
        prior=Normal(0.0, 1.0),
        description="a session's gain, in units of the spread",
        source="standard normal by definition of the spread",
    ),
)
