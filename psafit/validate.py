r"""Check a posterior against groups it never saw.

For every reading the posterior predictive distribution is the mixture, over posterior draws, of the noise law
around that draw's prediction. Its scores:

* `log_rmse`: root mean square of :math:`\ln\frac{\hat L + 0.3}{y + 0.3}` in um, :math:`\hat L` the posterior median;
* coverage of the central 50 and 90 % predictive intervals;
* CRPS, :math:`E|Y - y| - \tfrac12 E|Y - Y'|` (Gneiting and Raftery, JASA 102 (2007) 359), um;
* expected log predictive density, :math:`\sum_i \ln \tfrac1S \sum_s p(y_i|\theta_s)`, nats;
* PIT, the predictive probability below the reading: uniform on [0, 1] if the prediction is honest.
"""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp
from scipy.stats import kstest

from psafit.experiment import Group
from psafit.files import write_atomically
from psafit.inference import noise
from psafit.inference.run import Run
from psafit.records import GroupScore, Validation, write_json

FloatArray = NDArray[np.float64]

OFFSET_UM = 0.3
COLUMNS = (
    "group",
    "waveform",
    "frequency_hz",
    "amplitude_v",
    "launch_range_um",
    "predicted_um",
    "lower_um",
    "upper_um",
    "role",
)
# Verdict thresholds. A median off by less than a tenth is below the scatter between sessions of one rig; the PIT
# test is run once a group, so its level is set for six of them.
_GOOD, _FAIR = 0.10, 0.30
_PIT_LEVEL = 0.01


@dataclass(frozen=True)
class Prediction:
    """Posterior predictive of one group; arrays of shape (n_points,) unless said.

    Parameters
    ----------
    group : Group
        The measurements.
    role : {"fit", "holdout"}
    median : array, um
        Posterior median of the launch range.
    model_lower, model_upper : arrays, um
        Central 90 % of the launch range itself, without scatter.
    lower, upper : arrays, um
        Central 90 % predictive interval of a reading.
    lower_50, upper_50 : arrays, um
        Central 50 % predictive interval of a reading.
    log_density : array, 1/um
        Log predictive density of each reading.
    crps : array, um
    pit : array
    """

    group: Group
    role: str
    median: FloatArray
    model_lower: FloatArray
    model_upper: FloatArray
    lower: FloatArray
    upper: FloatArray
    lower_50: FloatArray
    upper_50: FloatArray
    log_density: FloatArray
    crps: FloatArray
    pit: FloatArray


def log_ratio(predicted: FloatArray, measured: FloatArray) -> FloatArray:
    """``ln((predicted + 0.3 um)/(measured + 0.3 um))``, the error whose root mean square is `log_rmse`."""
    return np.log((predicted + OFFSET_UM) / (measured + OFFSET_UM))


def crps(draws: FloatArray, observed: FloatArray) -> FloatArray:
    """Continuous ranked probability score of equally weighted draws.

    Parameters
    ----------
    draws : (n_draws, n_points) array
    observed : (n_points,) array

    Returns
    -------
    (n_points,) array, in the unit of `observed`
    """
    x = np.sort(draws, axis=0)
    n = len(x)
    weight = (2 * np.arange(1, n + 1) - n - 1)[:, None]  # sum_ij |x_i - x_j| / 2 = sum_i weight_i x_i
    return np.abs(x - observed).mean(axis=0) - (weight * x).sum(axis=0) / (n * (n - 1))


def predict(run: Run, *, n_draws: int = 1000, seed: int | None = None) -> list[Prediction]:
    """Posterior predictive of every group of the experiment.

    Parameters
    ----------
    run : Run
    n_draws : int
        Posterior draws used, evenly spread over the chains.
    seed : int, optional
        Of the simulated readings; the run's own by default.

    Returns
    -------
    list of Prediction
        In the order of the experiment.
    """
    problem = run.problem
    flat = problem.to_sampling(run.draws.flat)
    chosen = flat[np.linspace(0, len(flat) - 1, min(n_draws, len(flat))).astype(int)]
    scatter = problem.noise_values(chosen)
    rng = np.random.default_rng([run.fit.seed if seed is None else seed, 2])
    result = []
    for group in problem.experiment.groups:
        ranges = problem.predict(chosen, problem.design_of([group.id]))
        readings = noise.draw(ranges, scatter, group.sigma_um, rng)
        quantiles = np.quantile(readings, [0.05, 0.25, 0.75, 0.95], axis=0)
        density = noise.log_density(group.launch_range_um, ranges, scatter, group.sigma_um)
        below = noise.cumulative(group.launch_range_um, ranges, scatter, group.sigma_um)
        model_lower, median, model_upper = np.quantile(ranges, [0.05, 0.5, 0.95], axis=0)
        result.append(
            Prediction(
                group=group,
                role="fit" if group.id in problem.group_ids else "holdout",
                median=median,
                model_lower=model_lower,
                model_upper=model_upper,
                # A reading is never negative; the law's tail below zero is the reading zero.
                lower=np.maximum(quantiles[0], 0.0),
                upper=quantiles[3],
                lower_50=np.maximum(quantiles[1], 0.0),
                upper_50=quantiles[2],
                log_density=logsumexp(density, axis=0) - math.log(len(chosen)),
                crps=crps(readings, group.launch_range_um),
                pit=below.mean(axis=0),
            )
        )
    return result


def score(prediction: Prediction) -> GroupScore:
    """Scores of one group."""
    measured = prediction.group.launch_range_um
    error = log_ratio(prediction.median, measured)
    rmse = float(np.sqrt(np.mean(error**2)))
    inside_50 = (measured >= prediction.lower_50) & (measured <= prediction.upper_50)
    inside_90 = (measured >= prediction.lower) & (measured <= prediction.upper)
    # Readings of exactly zero pile up at one value and have no uniform transform.
    p_value = float(kstest(prediction.pit[measured > 0], "uniform").pvalue) if (measured > 0).any() else math.nan
    return GroupScore(
        group=prediction.group.id,
        role=prediction.role,
        n_points=measured.size,
        log_rmse=rmse,
        log_bias=float(np.mean(error)),
        coverage_50=float(np.mean(inside_50)),
        coverage_90=float(np.mean(inside_90)),
        crps_um=float(np.mean(prediction.crps)),
        elpd=float(np.sum(prediction.log_density)),
        elpd_per_point=float(np.mean(prediction.log_density)),
        pit_p_value=p_value,
        verdict=verdict(rmse, float(np.mean(error)), float(np.mean(inside_90)), measured.size, p_value),
    )


def verdict(rmse: float, bias: float, coverage: float, n: int, pit_p_value: float) -> str:
    """One plain sentence about a group."""
    if rmse <= _GOOD:
        size = "predicted well"
    elif abs(bias) > 0.7 * rmse:
        size = f"predicted too {'large' if bias > 0 else 'small'} by a factor of {math.exp(abs(bias)):.2f}"
    else:
        size = (
            f"{'roughly followed' if rmse <= _FAIR else 'missed'}, off by a factor of {math.exp(rmse):.2f} either way"
        )
    # Two standard deviations of a binomial count around 90 %.
    slack = 2 * math.sqrt(0.9 * 0.1 / n)
    if coverage < 0.9 - slack:
        band = f"its 90 % band holds only {100 * coverage:.0f} % of the readings"
    elif coverage > 0.9 + slack and pit_p_value < _PIT_LEVEL:
        band = f"its 90 % band is too wide ({100 * coverage:.0f} % of the readings inside)"
    elif pit_p_value < _PIT_LEVEL:
        band = "but the errors share a direction: its band is wide enough only because the scatter absorbed the misfit"
    else:
        band = "its band is honest"
    return f"{size}; {band}"


def validate(run: Run, *, n_draws: int = 1000) -> tuple[Validation, list[Prediction]]:
    """Score every group and write `validation.json` and `predictions.csv` into the run folder.

    Returns
    -------
    Validation, list of Prediction
    """
    predictions = predict(run, n_draws=n_draws)
    scores = [score(p) for p in predictions]
    held_out = [s.log_rmse for s in scores if s.role == "holdout"]
    record = Validation(
        identity=run.fit.identity,
        n_draws=min(n_draws, len(run.draws.flat)),
        seed=run.fit.seed,
        groups=scores,
        holdout_log_rmse=float(np.mean(held_out)) if held_out else None,
        pit={str(p.group.id): p.pit.tolist() for p in predictions},
    )
    write_json(run.folder / "validation.json", record)
    write_predictions(run.folder / "predictions.csv", predictions)
    return record, predictions


def write_predictions(path: Path, predictions: list[Prediction]) -> None:
    """Write `predictions.csv`: one row a reading."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(COLUMNS)
    for p in predictions:
        group = p.group
        columns = (group.frequency_hz, group.amplitude_v, group.launch_range_um, p.median, p.lower, p.upper)
        for row in zip(*columns, strict=True):
            table.writerow([group.id, group.waveform, *(float(x) for x in row), p.role])
    write_atomically(path, text.getvalue().encode())
