"""Scores against formulas and laws known elsewhere."""

from __future__ import annotations

import csv
import math
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from psafit import validate
from psafit.diagnose.residuals import normal_scores
from psafit.experiment import Experiment, Group
from psafit.inference import noise
from psafit.inference.optimiser import log_posteriors
from psafit.inference.problem import Problem
from psafit.inference.run_folder import load
from psafit.physics import terms
from psafit.records import Broken, Retested, Validation, read_json


@pytest.fixture(scope="module")
def checked(by_importance: Path, tmp_path_factory: pytest.TempPathFactory):  # type: ignore[no-untyped-def]
    run = load(shutil.copytree(by_importance, tmp_path_factory.mktemp("run") / "r"))
    return run, *validate.validate(run)


def test_crps_of_a_normal_law() -> None:
    """Gneiting and Raftery (2007), eq. 21: sigma (z (2 Phi(z) - 1) + 2 phi(z) - 1/sqrt(pi))."""
    draws = stats.norm.ppf((np.arange(20_000) + 0.5) / 20_000)[:, None] * 2 + 1
    for y in (-3.0, 1.0, 2.5):
        z = (y - 1) / 2
        exact = 2 * (z * (2 * stats.norm.cdf(z) - 1) + 2 * stats.norm.pdf(z) - 1 / math.sqrt(math.pi))
        assert validate.crps(draws, np.array([y]))[0] == pytest.approx(exact, rel=1e-3)


def test_log_rmse_by_hand(checked) -> None:  # type: ignore[no-untyped-def]
    assert validate.log_ratio(np.array([0.7]), np.array([0.2]))[0] == pytest.approx(math.log(2))
    _, record, predictions = checked
    for s, p in zip(record.groups, predictions, strict=True):
        by_hand = [math.log((a + 0.3) / (b + 0.3)) ** 2 for a, b in zip(p.median, p.group.reading, strict=True)]
        assert s.log_rmse == pytest.approx(math.sqrt(sum(by_hand) / len(by_hand)), rel=1e-12)


def test_the_truth_predicts_what_it_never_saw(checked) -> None:  # type: ignore[no-untyped-def]
    _, record, predictions = checked
    assert [s.role for s in record.groups] == ["fit", "holdout", "holdout"]
    for s in record.groups[1:]:
        assert s.log_rmse < 0.25 and s.coverage_90 > 0.7 and s.pit_p_value >= 1e-3, s
    assert record.holdout_log_rmse == pytest.approx(np.mean([s.log_rmse for s in record.groups[1:]]))
    for p in predictions:
        assert (p.lower <= p.lower_50).all() and (p.lower_50 <= p.upper_50).all() and (p.upper_50 <= p.upper).all()
        assert (p.model_lower <= p.median).all() and (p.median <= p.model_upper).all()
        assert ((p.pit >= 0) & (p.pit <= 1)).all()


def test_log_density_is_a_mean_over_draws(checked) -> None:  # type: ignore[no-untyped-def]
    """Straight from the definition, with SciPy's Student law, for the draws the module takes."""
    run, _, predictions = checked
    flat = run.draws.flat
    chosen = flat[np.linspace(0, len(flat) - 1, min(1000, len(flat))).astype(int)]
    group = run.problem.experiment.groups[2]
    ranges = run.problem.predict(run.problem.to_sampling(chosen), [3])
    s = np.sqrt((chosen[:, 3:4] * ranges) ** 2 + chosen[:, 4:5] ** 2)
    density = stats.t.pdf(group.reading, chosen[:, 5:6], ranges, s)
    assert predictions[2].log_density == pytest.approx(np.log(density.mean(axis=0)), rel=1e-9)


def test_stated_errors_reach_fit_and_bands(known: Experiment) -> None:
    """Readings of groups 1 and 3 state theirs: likelihood, optimisations, scores, bands and densities are Student's of
    all parts of the scatter."""
    sigma = {1: 3.0, 2: 0.0, 3: 5.0}
    groups = (replace(g, sigma=np.full(g.n_points, sigma[int(g.id)]) if g.id != 2 else None) for g in known.groups)
    problem = Problem(replace(known, groups=tuple(groups)), (1, 2))
    u = problem.to_sampling(np.array([[4e5, 9e3, 60.0, 0.05, 0.05, 6.0]]))

    def law(ids: tuple[int, ...]):  # type: ignore[no-untyped-def]
        ranges = problem.predict(u, ids)[0]
        own = np.concatenate([np.full(known.group(i).n_points, sigma[i]) for i in ids])
        return stats.t(6, ranges, np.sqrt(0.05**2 + (0.05 * ranges) ** 2 + own**2))

    seen = law((1, 2))
    assert problem.log_likelihood(u)[0] == pytest.approx(seen.logpdf(problem.observed).sum())
    predicted = problem.predict(u)
    assert log_posteriors(problem, u, predicted, problem.observed)[0] == pytest.approx(problem.log_posterior(u)[0])
    scores = normal_scores(problem, u, predicted, problem.observed)[0]
    expected = stats.norm.ppf(seen.cdf(problem.observed))
    assert scores[np.abs(expected) < 4] == pytest.approx(expected[np.abs(expected) < 4])
    for reported, group in zip(validate.predictive(problem, np.repeat(u, 4000, axis=0), 1), known.groups, strict=True):
        own = law((int(group.id),))
        assert reported.log_density == pytest.approx(own.logpdf(group.reading))
        width = own.kwds.get("scale", own.args[2])
        for found, q in (
            (reported.lower, 0.05),
            (reported.lower_50, 0.25),
            (reported.upper_50, 0.75),
            (reported.upper, 0.95),
        ):
            # (Bands begin at zero; a quantile of 4,000 draws errs by a tenth of the width or less.)
            assert (np.abs(found - np.maximum(own.ppf(q), 0.0)) < 0.2 * width).all(), q


def test_bands_are_judged_against_groups_that_share_an_error(known: Experiment) -> None:
    """A right model whose posterior is wide misses readings in runs: with binomial odds half its fits look too sure."""
    problem = Problem(known, (1,))
    rng = np.random.default_rng(5)
    truth = np.array([4.0e5, 9.0e3, 60.0, 0.05, 0.3, 50.0])
    # Each parameter of the contact is known to a tenth, and the truth is one of what is believed.
    draws = np.repeat(truth[None], 400, axis=0)
    draws[:, :3] *= np.exp(0.1 * rng.standard_normal((400, 3)))
    u = problem.to_sampling(draws)
    ranges, scatter = problem.predict(u, [2]), problem.noise_values(u)
    looks_odd, is_odd, too_narrow = [], [], []
    for k in range(60):
        y = np.maximum(noise.draw(ranges, scatter, None, rng)[k], 0.0)
        group = replace(known.groups[1], reading=y)
        reported = replace(problem, experiment=replace(known, groups=(known.groups[0], group)))
        p = validate.predictive(reported, np.delete(u, k, axis=0), seed=k)[1]
        s = validate.score(p)
        looks_odd.append(as_few(s.coverage_90, s.n_points) < 0.05)
        is_odd.append(s.coverage_p_value < 0.05)
        one = validate.predictive(reported, np.repeat(u[k + 1 : k + 2], 400, axis=0), seed=k)[1]
        too_narrow.append(validate.score(one).coverage_p_value < 0.05)
    assert np.mean(is_odd) < 0.12 < np.mean(looks_odd)
    assert np.mean(too_narrow) > 0.3  # as a fit that is surer than it may be


def sentence(*args: Any, **how: Any) -> str:
    """What is said of a group, by `validate.verdict`."""
    _, said = validate.verdict(*args, **how)
    return said


def as_few(coverage: float, n: int) -> float:
    """Chance of a band of 90 % that holds as few of n readings which have no error in common."""
    return float(stats.binom.cdf(round(coverage * n), n, 0.9))


def test_coverage_is_the_share_inside(checked) -> None:  # type: ignore[no-untyped-def]
    _, record, predictions = checked
    for s, p in zip(record.groups, predictions, strict=True):
        y = p.group.reading
        assert s.coverage_90 == pytest.approx(np.mean((p.lower <= y) & (y <= p.upper)))
        assert s.coverage_50 == pytest.approx(np.mean((p.lower_50 <= y) & (y <= p.upper_50)))
        assert s.coverage_50 < s.coverage_90


def test_a_cause_is_taken_out_by_its_neutral_value(known: Experiment) -> None:
    """All else stays as it is: the others' parameters, the sessions' gains, and what no group was fitted to."""
    both = Problem(known, (1, 2), terms(["amplifier_lag", "flight_friction", "reading_gain"]))
    draws = both.prior_transform(np.random.default_rng(3).uniform(0.3, 0.7, (9, both.n_dim)))
    for groups in ([1, 2], [3]):
        found = validate.without_each(both, draws, groups)
        assert set(found) == set(both.ids)
        neutral = both.to_physical(draws)
        neutral[:, both.names.index("flight_friction_a")] = 0.0
        assert found["flight_friction"] == pytest.approx(
            np.median(both.predict(both.to_sampling(neutral), groups), axis=0), rel=1e-9
        )
        assert not np.allclose(found["flight_friction"], np.median(both.predict(draws, groups), axis=0), rtol=1e-3)
    assert validate.without_each(Problem(known, (1,)), draws[:, :6], [1]) == {}


def test_predictions_csv_keeps_the_contract(checked) -> None:  # type: ignore[no-untyped-def]
    run, _, predictions = checked
    with (run.folder / "predictions.csv").open() as f:
        rows = list(csv.DictReader(f))
    assert list(rows[0]) == [
        "group", "waveform", "frequency_hz", "amplitude_v", "launch_range_um", "predicted_um", "lower_um", "upper_um",
        "role",
    ]  # fmt: skip
    assert len(rows) == sum(g.n_points for g in run.problem.experiment.groups)
    assert {r["role"] for r in rows} == {"fit", "holdout"}
    assert float(rows[0]["predicted_um"]) == predictions[0].median[0]
    assert all(float(r["lower_um"]) <= float(r["predicted_um"]) <= float(r["upper_um"]) for r in rows)


@pytest.mark.parametrize(
    "large, error, coverage, uniform, drift, words",
    [
        (50, 0.05, 0.9, 0.5, 0.5, "predicted well, typically off by ×1.05, either way; nothing speaks against its"
         " band"),
        (95, 0.8, 0.3, 1e-3, 0.5, "missed, typically off by ×2.23, mostly too large (by ×2.05 on average); its 90 %"
         " band holds only 30 % of the readings"),
        (5, 0.8, 0.95, 1e-3, 0.5, "mostly too small (by ×2.05 on average); its 90 % band is wide enough, but the"
         " readings are not spread over it as predicted"),
        (65, 0.2, 0.9, 0.5, 0.5, "roughly followed, typically off by ×1.22, mostly too large (by ×1.06 on average)"),
        (60, 0.2, 0.9, 0.5, 0.5, "off by ×1.22, either way; nothing speaks against its band"),
        (50, 0.5, 1.0, 1e-3, 0.5, "its 90 % band is too wide"),
        (50, 0.25, 0.9, 0.5, 1e-3, "either way; its errors drift along the sweep: the model misses a trend that the"
         " scatter absorbs"),
        (50, 0.25, 0.5, 0.5, 1e-3, "the model misses a trend"),
        (50, 0.05, 0.68, 1e-3, 0.5, "followed closely, typically off by ×1.05, either way; its 90 % band holds"),
    ],
)  # fmt: skip
def test_verdicts_in_words(large: int, error: float, coverage: float, uniform: float, drift: float, words: str) -> None:
    errors = np.where(np.arange(100) < large, error, -error)
    said = sentence(errors, coverage, uniform, drift, coverage_p_value=as_few(coverage, 100))
    assert words in said
    assert ("speaks against" in said) == (coverage == 0.9 and uniform == drift == 0.5)


def test_a_fit_predicts_only_with_errors_and_coverage_that_are_known() -> None:
    """Small errors of readings too few for a band, or outside it, are followed closely, and no more."""
    for n, coverage, well in ((4, 1.0, False), (40, 0.6, False), (40, 0.9, True)):
        how = {"coverage_p_value": as_few(coverage, n)}
        assert ("predicted well" in sentence(np.full(n, 0.05), coverage, 0.5, 0.5, **how)) is well


def test_a_band_that_holds_few_is_given_with_the_chance_of_that() -> None:
    """One of ten groups: what happens once in 800 is no news yet, and no reading of it is hidden."""
    errors, p = np.full(40, 0.05), 0.0012
    said = sentence(errors, 0.6, 0.5, 0.5, coverage_p_value=p, looks=10)
    assert said.endswith("its 90 % band holds 60 % of the readings (p = 0.0012, of 10 tests)")
    assert "holds only 60 %" in sentence(errors, 0.6, 0.5, 0.5, coverage_p_value=p, looks=8)
    assert sentence(errors, 0.6, 0.5, 0.5).endswith("its 90 % band holds 60 % of the readings")
    assert "wide enough" not in sentence(errors, 0.6, 1e-4, 0.5, coverage_p_value=p, looks=10)


def test_unseen_groups_are_simulated_together(checked) -> None:  # type: ignore[no-untyped-def]
    """Group by group from one draw: counts of a row add up."""
    _, record, predictions = checked
    unseen = [p for p in predictions if p.role == "holdout"]
    inside = sum(np.sum((p.lower <= p.group.reading) & (p.group.reading <= p.upper)) for p in unseen)
    simulated = np.sum([p.inside for p in unseen], axis=0)
    assert simulated.size >= 100 and simulated.max() <= sum(p.group.n_points for p in unseen)
    few, many = ((1 + np.sum(x)) / (1 + simulated.size) for x in (simulated <= inside, simulated >= inside))
    assert record.coverage_p_value == pytest.approx(min(few, many))
    assert math.isnan(validate._of_all([replace(p, role="fit") for p in predictions]))


def test_errors_that_drift_in_what_was_fitted_put_its_values_in_doubt(checked) -> None:  # type: ignore[no-untyped-def]
    """Of what was only predicted they say that the model fails, not that a value stands in for something."""
    found = checked[1]
    for role, p, doubt in (("fit", 0.001, True), ("fit", 0.5, False), ("holdout", 0.001, False)):
        one = replace(found.groups[0], role=role, drift_p_value=p)
        assert validate.drifting(replace(found, groups=[one])) is doubt


@pytest.mark.parametrize("looks", [1, 6, 18])
def test_many_groups_raise_no_more_alarms_than_one(looks: int, checked) -> None:  # type: ignore[no-untyped-def]
    """Of a right model p values are even: so many groups and observables drift together in one case of a hundred."""
    found = checked[1]
    rng = np.random.default_rng(5)
    alarms = 0
    for p_values in rng.uniform(size=(2000, looks)):
        groups = [replace(found.groups[0], role="fit", drift_p_value=p) for p in p_values]
        alarms += validate.drifting(replace(found, groups=groups))
    assert 5 <= alarms <= 35  # 20 expected, within 3.4 standard deviations


def test_a_drift_shows_among_many_groups(checked) -> None:  # type: ignore[no-untyped-def]
    """However many are looked at, as many groups are simulated as it takes; and what is fitted is judged by itself."""
    run = checked[0]
    experiment = run.problem.experiment
    first = experiment.groups[0]
    error = np.exp(1.5 * np.sin(np.linspace(0, 2 * np.pi, first.n_points)))[np.argsort(first.in_sweep)]
    groups = [replace(first, id=k) for k in range(1, 19)]
    odd = replace(first, id=19, reading=first.reading * error)
    problem = replace(run.problem, experiment=replace(experiment, groups=(*groups, odd)))
    record, _ = validate.validate(replace(run, problem=problem, folder=run.folder.parent / "many"), n_draws=100)
    assert [s.group for s in validate.trends(record.groups)] == [19]
    unheard = [replace(s, drift_p_value=math.nan) for s in record.groups[:-1]]
    assert len(validate.trends([*unheard, replace(record.groups[-1], drift_p_value=0.009)])) == 1


def test_values_are_doubted_where_the_fit_does_not_predict(checked) -> None:  # type: ignore[no-untyped-def]
    found = checked[1]
    fitted, unseen = (replace(found.groups[0], role=role, n_points=77, drift_p_value=0.5, informative=True)
                      for role in ("fit", "holdout"))  # fmt: skip
    for coverage, error, why in (
        (0.9, 0.1, ""),
        (0.75, 0.1, "its 90 % band holds too few of the unseen readings"),
        (0.9, 0.4, "the groups it has not seen are missed"),
    ):
        groups = [fitted, replace(unseen, coverage_90=coverage)]
        one = replace(found, groups=groups, holdout_log_rmse=error, coverage_p_value=as_few(coverage, 77))
        assert validate.caution(one) == why
    assert validate.caution(replace(found, groups=[fitted], holdout_log_rmse=None)) == ""


def test_a_fit_that_breaks_a_law_is_doubted(checked, monkeypatch: pytest.MonkeyPatch) -> None:  # type: ignore[no-untyped-def]
    """The best values of a fit are asked; what they break is on record, and the first thing that is said."""
    run, found = checked[0], checked[1]
    law = Broken("energy", [], 1, 200.0, 20.0, 2.0, 1.0, 3, "group 1, 200 Hz, 20 V: more than the drive gives")
    asked = []
    monkeypatch.setattr(validate, "broken", lambda candidate: asked.append(candidate) or [law])
    broken, _ = validate.validate(run)
    assert asked[0].values == pytest.approx(list(run.fit.minima[0].values.values()))
    assert validate.caution(broken) == "the best values break a law (group 1, 200 Hz, 20 V: more than the drive gives)"
    monkeypatch.undo()
    assert found.laws == validate.validate(run)[0].laws == []


def test_a_fit_whose_model_fails_on_all_readings_is_doubted(checked) -> None:  # type: ignore[no-untyped-def]
    """It is asked with the run, kept, and said where nothing else speaks against its values."""
    run, found = checked[0], checked[1]
    asked = []
    answers = Retested("tests", 0.005, 199)
    run = replace(run, folder=run.folder.parent / "retested")
    record, _ = validate.validate(run, n_draws=100, retest=lambda one: asked.append(one) or answers)
    assert asked == [run] and read_json(run.folder / "validation.json", Validation).all_groups == answers
    assert found.all_groups is None and not validate.objection(found)
    good = [replace(found.groups[0], role="holdout", n_points=60, coverage_90=0.9, drift_p_value=0.5, log_rmse=0.05)]
    model = "fitted to all readings, the model"
    for objection, why in (
        ("", ""),
        ("tests", f"{model} fails the tests of misfit (p = 0.005)"),
        ("together", f"{model} misses readings of several groups at one condition (p = 0.005)"),
        ("tails", f"{model} passes the tests of misfit by heavy tails alone (p = 0.005)"),
    ):
        judged = replace(record, groups=good, holdout_log_rmse=0.05, all_groups=replace(answers, objection=objection))
        assert validate.caution(judged) == why
        assert validate.caution(replace(judged, holdout_log_rmse=1.0)).startswith("the groups it has not seen")


def test_one_unseen_group_that_fails_is_not_averaged_away(checked) -> None:  # type: ignore[no-untyped-def]
    found = checked[1]
    good = replace(found.groups[0], role="holdout", n_points=60, coverage_90=0.9, drift_p_value=0.5, informative=True)
    for change, word, why in (
        ({}, "yes", ""),
        ({"coverage_90": 0.65}, "too sure", "its 90 % band holds too few of the readings of unseen group 7"),
        ({"drift_p_value": 0.001}, "misses a trend", "the errors of unseen group 7 drift"),
        ({"log_rmse": validate.GOOD + 0.01}, "not everywhere", "unseen group 7 is roughly followed"),
        ({"log_rmse": validate.FAIR + 0.01}, "not everywhere", "unseen group 7 is missed"),
        (
            {"coverage_90": 1.0, "n_points": 60, "pit_p_value": 0.001},
            "too unsure",
            "its 90 % band holds too many of the readings of unseen group 7",
        ),
        ({"coverage_90": 1.0, "n_points": 60, "pit_p_value": 0.5}, "yes", ""),
        ({"coverage_90": 0.7}, "yes", ""),  # once in 88 right ones, and two were looked at
        ({"coverage_90": 0.5, "n_points": 4}, "yes", ""),  # too few readings to judge
        ({"coverage_90": 0.7, "drift_p_value": 0.001, "informative": False}, "yes", ""),
    ):
        bad = replace(good, group=7, n_points=20) if change else good
        bad = replace(bad, **change)
        bad = replace(bad, coverage_p_value=as_few(bad.coverage_90, bad.n_points))
        groups = [replace(good, n_points=300), bad]
        one = replace(found, groups=groups, holdout_log_rmse=0.1)
        said, against = validate.predicts(one)
        assert (said, validate.caution(one)) == (word, why)
        assert [s.group for s in against] == ([] if word == "yes" else [7])
    assert validate.predicts(replace(found, groups=[good], holdout_log_rmse=None)) == ("not tested", [])
    for mean, word, why in (
        (validate.GOOD + 0.01, "roughly", "the groups it has not seen are roughly followed"),
        (validate.FAIR + 0.01, "no", "the groups it has not seen are missed"),
    ):
        off = replace(found, groups=[replace(good, n_points=4)], holdout_log_rmse=mean)
        assert (validate.predicts(off), validate.caution(off)) == ((word, []), why)
    few = {"coverage_90": 0.65, "coverage_p_value": as_few(0.65, 20)}
    times = replace(good, group=7, n_points=20, observable="contact_time", **few)
    mixed = replace(found, groups=[replace(good, n_points=300), times], holdout_log_rmse=0.1)
    assert validate.caution(mixed).endswith("of unseen group 7 (contact time)")


def test_what_was_fitted_is_not_called_predicted() -> None:
    assert sentence(np.full(50, 0.05), 0.9, 0.5, 0.5, fitted=True).startswith("fitted well, ")
    assert validate.size_of(0.05, sound=True, fitted=False) == "predicted well"


def test_a_group_whose_errors_drift_is_not_met_well() -> None:
    for fitted in (True, False):
        said = sentence(np.full(50, 0.05), 0.9, 0.5, 1e-4, fitted=fitted)
        assert said.startswith("followed closely, ") and "its errors drift along the sweep" in said


def test_the_record_holds_the_size_that_the_sentence_names(checked) -> None:  # type: ignore[no-untyped-def]
    """One of twenty groups drifts by chance where it would be news of one."""
    _, _, (fitted, *_) = checked
    assert fitted.group.n_points >= validate.JUDGED
    exact = replace(fitted, group=replace(fitted.group, reading=fitted.median), pit_p_value=0.5)
    for drift, looks, size in ((0.5, 1, "fitted well"), (0.002, 1, "followed closely"), (0.002, 20, "fitted well")):
        found = validate.score(replace(exact, drift_p_value=drift), looks=looks)
        assert found.size == size and found.verdict.startswith(f"{size}, ")


def test_many_small_errors_against_few_large_ones() -> None:
    """The mean must not contradict the count."""
    said = sentence(np.append(np.full(90, 0.05), np.full(10, -3.0)), 0.9, 0.5, 0.5)
    assert "mostly too large;" in said and "on average" not in said


def test_no_factor_is_given_that_says_nothing() -> None:
    large = sentence(np.full(50, 0.004), 0.9, 0.5, 0.5)
    assert "typically off by ×1.00, mostly too large;" in large
    one = sentence(np.append(np.full(50, 1e-4), -0.015), 0.9, 0.5, 0.5)
    assert "typically off by ×1.00, mostly too " in one and "one reading" not in one and "average" not in one


def test_a_group_that_cannot_show_it_enters_no_mean(checked) -> None:  # type: ignore[no-untyped-def]
    run, _, predictions = checked
    held_out = predictions[1].group
    for silent, why in (
        (replace(held_out, amplitude_v=np.zeros(held_out.n_points)), "nothing drives it"),
        (replace(held_out, reading=np.eye(1, held_out.n_points)[0]), "fewer than 3 of its readings"),
    ):
        score = validate.score(replace(predictions[1], group=silent))
        assert not score.informative and why in score.verdict and "left out of every mean" in score.verdict
    groups = (*run.problem.experiment.groups[:2], replace(held_out, id=9, amplitude_v=np.zeros(held_out.n_points)))
    problem = replace(run.problem, experiment=replace(run.problem.experiment, groups=groups))
    record, _ = validate.validate(replace(run, problem=problem, folder=run.folder.parent / "silent"))
    assert [s.informative for s in record.groups] == [True, True, False]
    assert record.holdout_log_rmse == record.groups[1].log_rmse


def test_no_word_of_the_band_of_a_few_readings() -> None:
    said = sentence(np.full(4, 0.05), 1.0, 1e-3, 1e-3)
    assert said.endswith("too few readings to judge its band") and "speaks against" not in said


def test_a_validation_without_p_values_reads_back(checked, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    from psafit.records import Validation, read_json, write_json

    _, record, _ = checked
    without = replace(record.groups[0], pit_p_value=math.nan, drift_p_value=math.nan)
    write_json(tmp_path / "v.json", replace(record, groups=[without], holdout_log_rmse=None))
    again = read_json(tmp_path / "v.json", Validation)
    assert math.isnan(again.groups[0].pit_p_value) and again.holdout_log_rmse is None


def simulated(rng: np.random.Generator, n: int, shared: float, memory: float) -> np.ndarray:
    """Sets of standard scatter around a shared error of the whole set; `memory` is that of neighbours."""
    z = rng.standard_normal((n, 60))
    for i in range(1, 60):
        z[:, i] = memory * z[:, i - 1] + math.sqrt(1 - memory**2) * z[:, i]
    return z + shared * rng.standard_normal((n, 1))


@pytest.mark.parametrize("shared", [0.0, 1.5])
def test_false_alarms_and_power_of_the_tests_of_the_band(shared: float) -> None:
    """Honest groups pass, also where all readings share a parameter's error; a drift is seen."""
    rng = np.random.default_rng(0)
    draws = simulated(rng, 1000, shared, 0.0)
    group = Group(1, "sine", "x", np.arange(1.0, 61.0)[::-1].copy(), np.full(60, 5.0), np.full(60, 9.0))

    def alarms(truth: np.ndarray) -> np.ndarray:
        pit = (draws[:, None, :] < truth).mean(axis=0)
        return np.mean([np.array(validate.p_values(group, row, draws)) < 0.01 for row in pit], axis=0)

    assert (alarms(simulated(rng, 200, shared, 0.0)) < 0.04).all()
    drifting = alarms(simulated(rng, 50, shared, 0.7))
    assert drifting[1] > 0.9


def test_the_order_of_the_file_is_not_the_order_of_the_sweep() -> None:
    rng = np.random.default_rng(1)
    draws = simulated(rng, 400, 0.0, 0.0)
    ascending = np.arange(1.0, 61.0)
    pit = 0.5 + 0.4 * np.sin(ascending / 8)
    for order in (np.arange(60), rng.permutation(60)):
        group = Group(1, "sine", "x", ascending[order], np.full(60, 5.0), np.full(60, 9.0))
        assert validate.p_values(group, pit[order], draws)[1] < 0.01
    for volts, reading in ((5.0, 0.0), (0.0, 9.0)):
        nothing = Group(1, "sine", "x", ascending, np.full(60, volts), np.full(60, reading))
        assert np.isnan(validate.p_values(nothing, pit, draws)).all()


def test_validation_reads_back(checked) -> None:  # type: ignore[no-untyped-def]
    from psafit.records import Validation, read_json

    run, record, _ = checked
    assert read_json(run.folder / "validation.json", Validation) == record


def test_many_zeros_are_no_departure_where_they_are_predicted(known: Experiment) -> None:
    """A rig so weakly driven that a third of the readings is zero, and the law that made them."""
    conditions = known.groups[0]
    weak = replace(conditions, amplitude_v=np.full(conditions.n_points, 0.02), reading=np.ones(30))
    problem = Problem(replace(known, groups=(weak,)), (1,))
    truth = problem.to_sampling(np.array([4.0e5, 9.0e3, 60.0, 0.05, 0.3, 50.0]))[None]
    ranges, scatter = problem.predict(truth), problem.noise_values(truth)
    rng = np.random.default_rng(0)
    p = []
    for k in range(40):
        y = np.maximum(noise.draw(ranges, scatter, None, rng)[0], 0.0)
        assert 0.05 < np.mean(y == 0) < 0.95
        reported = replace(problem, experiment=problem.experiment.with_readings(y))
        p.append(validate.predictive(reported, np.repeat(truth, 300, axis=0), seed=k)[0].pit_p_value)
    assert np.mean(np.array(p) < 0.05) < 0.2 and 0.3 < np.mean(p) < 0.7


def test_a_sweep_is_ordered_by_what_it_sweeps() -> None:
    """Frequencies that are read back scatter a little: they do not order a sweep of the voltage."""
    rng = np.random.default_rng(1)
    volts = rng.permutation(np.linspace(2, 20, 12))
    group = Group(1, "sine", "1.csv", 1000 + 0.3 * rng.standard_normal(12), volts, np.ones(12))
    assert group.swept == "amplitude" and (np.diff(volts[group.in_sweep]) > 0).all()
    other = replace(group, frequency_hz=volts * 100, amplitude_v=10 + 1e-3 * rng.standard_normal(12))
    assert other.swept == "frequency" and (np.diff(other.frequency_hz[other.in_sweep]) > 0).all()
    rows = validate.neighbours_redrawn(group, 3, rng)
    assert np.isin(np.diff(np.argsort(group.in_sweep)[rows], axis=1), [1, -11]).mean() > 0.6


def test_one_reading_that_rules_a_group_is_distinguished():
    off = np.full(20, 0.1)
    assert "but for one reading" not in sentence(off, 0.9, 0.5, 0.5)
    off[7] = -2.0
    assert "off by ×1.58 (×1.11 but for one reading), " in sentence(off, 0.9, 0.5, 0.5)
    assert "but for one reading" not in sentence(off[6:8], 0.9, 0.5, 0.5)  # which of two?
