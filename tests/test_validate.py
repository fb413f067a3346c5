"""Scores against formulas and laws known elsewhere."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from psafit import validate
from psafit.experiment import Experiment
from psafit.inference import run as running
from psafit.inference.emcee_adaptor import Settings


@pytest.fixture(scope="module")
def checked(known: Experiment, tmp_path_factory: pytest.TempPathFactory):  # type: ignore[no-untyped-def]
    folder = tmp_path_factory.mktemp("run") / "r"
    run = running.fit(known, [1], folder, seed=1, n_starts=8, settings=Settings(n_walkers=24, max_steps=750))
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
        by_hand = [math.log((a + 0.3) / (b + 0.3)) ** 2 for a, b in zip(p.median, p.group.launch_range_um, strict=True)]
        assert s.log_rmse == pytest.approx(math.sqrt(sum(by_hand) / len(by_hand)), rel=1e-12)


def test_the_truth_predicts_what_it_never_saw(checked) -> None:  # type: ignore[no-untyped-def]
    _, record, predictions = checked
    assert [s.role for s in record.groups] == ["fit", "holdout", "holdout"]
    for s in record.groups[1:]:
        assert s.log_rmse < 0.25 and s.coverage_90 > 0.7 and s.pit_p_value > 1e-5, s
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
    ranges = run.problem.predict(run.problem.to_sampling(chosen), run.problem.design_of([3]))
    s = np.sqrt((chosen[:, 3:4] * ranges) ** 2 + chosen[:, 4:5] ** 2)
    density = stats.t.pdf(group.launch_range_um, chosen[:, 5:6], ranges, s)
    assert predictions[2].log_density == pytest.approx(np.log(density.mean(axis=0)), rel=1e-9)


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
    "rmse, bias, coverage, p, words",
    [
        (0.05, 0.01, 0.9, 0.5, "predicted well; its band is honest"),
        (0.8, 0.75, 0.3, 1e-9, "predicted too large by a factor of 2.12; its 90 % band holds only 30 %"),
        (0.8, -0.75, 0.95, 1e-9, "predicted too small by a factor of 2.12; but the errors share a direction"),
        (0.2, 0.0, 0.9, 0.5, "roughly followed"),
        (0.5, 0.0, 1.0, 1e-9, "its 90 % band is too wide"),
    ],
)
def test_verdicts_in_words(rmse: float, bias: float, coverage: float, p: float, words: str) -> None:
    assert words in validate.verdict(rmse, bias, coverage, 100, p)


def test_pit_of_an_honest_prediction_is_uniform() -> None:
    """The verdict's test has the false alarm rate it claims."""
    rng = np.random.default_rng(0)
    p = [stats.kstest(rng.uniform(size=50), "uniform").pvalue for _ in range(400)]
    assert np.mean(np.array(p) < 0.01) < 0.03


def test_validation_reads_back(checked, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    from psafit.records import Validation, read_json

    run, record, _ = checked
    assert read_json(run.folder / "validation.json", Validation) == record
