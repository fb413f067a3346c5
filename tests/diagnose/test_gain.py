"""The gain on data that no choice has seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigs import RIG
from truths import CHEAP, FEW, experiment, problem

from psafit.diagnose.discrepancy import Discrepancy
from psafit.diagnose.gain import over_groups, split, summarise
from psafit.experiment import fingerprint
from psafit.model_search import search_models


@pytest.mark.slow
def test_gain_does_not_see_what_it_scores(tmp_path):
    e = experiment(["amplifier_lag"], [4e-5])
    # Other readings in the groups held out must not change what is predicted for them.
    other = replace(e, groups=(e.groups[0], *(replace(g, reading=g.reading + 9) for g in e.groups[1:])))
    found = []
    for data in (e, other):
        model_set = search_models(problem(data, ("a",)), FEW[:2], seed=1, settings=CHEAP)
        found.append(split(model_set, ("b", "c"), 1))
    for one, two in zip(found[0].after, found[1].after, strict=True):
        assert one.median == pytest.approx(two.median)
    result = summarise("strict", found[:1], tmp_path, 1)
    for g in result.groups:
        assert g.log_rmse_interval[0] < g.log_rmse_after - g.log_rmse_before < g.log_rmse_interval[1]
        assert g.elpd_interval[0] < g.elpd_after - g.elpd_before < g.elpd_interval[1]
    assert result.log_rmse_after < result.log_rmse_before
    assert [g.group for g in result.groups] == ["b", "c"]
    assert all("b" not in entry.saw for entry in result.ledger)
    rows = (tmp_path / result.predictions).read_text().splitlines()
    assert rows[0].endswith("role,model")
    assert len(rows) == 1 + 2 * 48


def test_a_discrepancy_widens_and_moves_nothing(monkeypatch):
    """Where a group was not seen; half a unit of the logarithm makes a band about exp(0.8) wide to either side."""
    model_set = search_models(problem(experiment(relative=0.01), ("a",)), FEW[:1], seed=1, settings=CHEAP)
    found = []
    for size in (0.0, 0.5):
        monkeypatch.setattr(
            Discrepancy, "elsewhere", lambda self, scatter, measured, rng, size=size: np.full(scatter.shape, size)
        )
        found.append(split(model_set, ("b",), 1).before[0])
    exact, vague = found
    assert (exact.median == vague.median).all() and (exact.median > 1).any()
    clear = exact.median > 3  # elsewhere the absolute scatter adds
    assert np.log(vague.upper / vague.median)[clear] == pytest.approx(0.5 * 1.645, rel=0.25)
    assert np.log(vague.median / vague.lower)[clear] == pytest.approx(0.5 * 1.645, rel=0.25)
    assert (np.log(exact.upper / exact.median)[clear] < 0.2).all()
    assert (vague.log_density < exact.log_density)[clear].mean() > 0.8


def test_a_group_that_cannot_show_it_is_in_no_mean(tmp_path):
    e = experiment(["amplifier_lag"], [4e-5])
    still = replace(e.groups[1], amplitude_v=np.zeros(24), reading=np.full(24, 0.02))
    groups = (e.groups[0], still, e.groups[2])
    e = replace(e, groups=groups, fingerprint=fingerprint(RIG, groups))
    model_set = search_models(problem(e, ("a",)), FEW[:1], seed=1, settings=CHEAP)
    result = summarise("strict", [split(model_set, ("b", "c"), 1)], tmp_path, 1)
    b, c = result.groups
    assert (b.silent, c.silent) == ("nothing drives it", "")
    assert (result.log_rmse_before, result.log_rmse_after) == (c.log_rmse_before, c.log_rmse_after)
    assert (result.elpd_after, result.coverage_after) == (c.elpd_after, c.coverage_after)
    assert c.elpd_interval[0] < result.elpd_interval[0] + 5 and c.elpd_interval[1] > result.elpd_interval[1] - 5


@pytest.mark.parametrize("n", [2, 3, 6, 12])
@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_nine_in_ten_intervals_of_a_gain_hold_it(n, noise):
    """However few the groups are; without the stretch it is half of them for two groups, three quarters for three."""
    rng = np.random.default_rng([n, int(noise)])
    inside = []
    for _ in range(1000):
        truth = rng.standard_normal(n)
        found = truth + noise * rng.standard_normal(n)
        low, high = over_groups(found[:, None] + noise * rng.standard_normal((n, 200)), found, rng)
        inside.append(low < 0.0 < high)
    # Where readings scatter, the groups' spread holds that already.
    assert 0.84 < np.mean(inside) < (0.93 if not noise else 0.98)


def test_of_one_group_the_readings_alone_show_how_sure_a_gain_is():
    rng = np.random.default_rng(1)
    redrawn = 2.0 + rng.standard_normal((1, 1000))
    assert over_groups(redrawn, np.array([2.0]), rng) == pytest.approx([2.0 - 1.645, 2.0 + 1.645], abs=0.25)
