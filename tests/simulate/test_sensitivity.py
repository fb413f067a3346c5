"""Effects of causes, and their likeness."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scripts import loaded

from psafit.experiment import Constants, read_experiment
from psafit.physics import TERMS, term
from psafit.simulate import Design, simulate
from psafit.simulate.sensitivity import REFERENCE, effect, in_scatter, plausible, reading_slopes, share_of

ROOT = Path(__file__).parents[2]
PSA = read_experiment(ROOT / "experiments" / "psa")
RIG: Constants = PSA.constants
SIX = Design.of(RIG, PSA.groups)


def test_plausible_strengths() -> None:
    half_normal = term("gap")  # sd 1 um: half of the mass within 0.674 um, and a little further for its tail
    assert plausible(half_normal)[0] == pytest.approx(0.7028e-6, rel=1e-3)
    assert plausible(half_normal, 0.6827)[0] == pytest.approx(1.0497e-6, rel=1e-3)
    lean_to_one_side = term("modal_mass")  # log-normal about 0.3, neutral 1: below
    assert plausible(lean_to_one_side)[0] == pytest.approx(0.3, rel=0.02)
    assert plausible(lean_to_one_side, side=1)[0] == pytest.approx(3.0)  # the bound
    strength, other = plausible(term("hysteresis"))
    assert strength == pytest.approx(0.1359, rel=1e-3) and other == pytest.approx(30, rel=1e-3)


def test_effects_where_nothing_is_launched() -> None:
    """A gap wider than the stroke: no launch, whose logarithm is not finite, but whose size in scatter is."""
    found = effect(term("gap"), Design.sweep(RIG, "sine", [1200.0, 1200.0], [1.0, 0.0]), values=[1e-5])
    assert found.launch_range.tolist() == [[0.0, 0.0]] and found.neutral[0] > 0 and found.neutral[1] == 0
    assert found.log_change[0, 0] == -math.inf and math.isnan(found.log_change[0, 1])
    assert found.deviation[0].tolist() == [-in_scatter(found.neutral[0]), 0.0]
    assert reading_slopes(Design.sweep(RIG, "sine", 1200.0, 0.0), REFERENCE).tolist() == [[0.0], [0.0], [0.0]]


def test_scatter_coordinate() -> None:
    L, h = np.array([0.0, 1e-7, 1e-6, 1e-4]), 1e-11
    slope = (in_scatter(L + h) - in_scatter(L - h)) / (2 * h)
    np.testing.assert_allclose(slope, 1 / np.hypot(0.3e-6, 0.05 * L), rtol=1e-6)


def test_confounding() -> None:
    """The page's angles against the definition, and what must come out: two of a kind, and causes a refit takes in."""
    page = loaded(ROOT / "docs" / "make_causes.py")
    found = page.six_groups()
    at = {id: i for i, id in enumerate(found.ids)}
    seen = [i for i, s in enumerate(found.status) if s == "visible"]
    angles = found.angle[np.ix_(seen, seen)]
    np.testing.assert_allclose(angles, angles.T, atol=1e-6)
    np.testing.assert_allclose(np.diag(angles), 0.0, atol=1e-6)
    assert ((angles >= 0) & (angles <= 90)).all()
    unseen = [i for i in at.values() if i not in seen]
    assert np.isnan(found.angle[unseen]).all() and np.isnan(found.angle[:, unseen]).all()
    # A ball that must first overcome a lean, or a friction, loses the same launches.
    assert found.angle[at["preload"], at["sliding_support"]] < 25
    assert found.status[at["stack_stiffness"]] == "absorbed" and found.status[at["separation_height"]] == "idle"

    one = Design.of(RIG, PSA.groups[:1])
    found = page.first_group()
    size = simulate(one, REFERENCE).launch_range[0] * 1e6
    slopes = reading_slopes(one, REFERENCE) / np.hypot(0.3, 0.05 * size)
    rest = []
    for cause in (term("gap"), term("no_tension")):
        shift = effect(cause, one).deviation[0]
        rest.append(shift - slopes.T @ np.linalg.lstsq(slopes.T, shift, rcond=None)[0])
    cosine = abs(rest[0] @ rest[1]) / np.prod(np.linalg.norm(rest, axis=1))
    angle = found.angle[at["gap"], at["no_tension"]]
    assert angle == pytest.approx(np.degrees(np.arccos(cosine)), abs=1e-4)
    assert found.status[at["reading_gain"]] == "absorbed"  # that of a single session is the baseline's to imitate


def test_share_is_the_prior_closer_to_neutral() -> None:
    for t in TERMS:
        assert share_of(t, float(plausible(t, 0.5)[0])) == pytest.approx(0.5, abs=0.01)
