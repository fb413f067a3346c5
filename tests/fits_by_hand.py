"""A fit, its predictions and its scores, made by hand: no simulation, no sampling."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from psafit.experiment import Constants, Experiment, Group, fingerprint
from psafit.inference.identify import describe
from psafit.inference.problem import Problem
from psafit.inference.run_folder import Run
from psafit.inference.samplers import USUAL
from psafit.inference.store import Draws
from psafit.observables import CONTACT_TIME, LAUNCH_RANGE, LAUNCH_SPEED, OBSERVABLES, VELOCITY
from psafit.records import (
    Fit,
    ImportanceEntry,
    ImportanceSummary,
    MinimumEntry,
    Numerics,
    ParameterEntry,
    ParameterSummary,
    PosteriorSummary,
    ProfilePoint,
    Refinement,
    Validation,
)
from psafit.report.fit import write_report
from psafit.simulate.stability import contact_matrix, largest_stable_step
from psafit.validate import Prediction, scores_of

CONSTANTS = Constants(M=0.0272, m=0.107, q=0.25e-6, l=0.15, k_s=25e6, g=9.8)


def make_group(group_id, frequency, amplitude, measured, waveform="sine", sigma=None):
    n = len(measured)
    return Group(
        group_id,
        waveform,
        f"{group_id}.csv",
        np.broadcast_to(np.asarray(frequency, float), n).copy(),
        np.broadcast_to(np.asarray(amplitude, float), n).copy(),
        np.asarray(measured, float),
        sigma=sigma,
    )


def sweep_groups():
    """A frequency sweep out of order with a replicate, an amplitude sweep with zeros and uncertainties, a grid."""
    frequency = np.array([100.0, 1000, 300, 3000, 500, 10000, 500, 2000])
    rising = np.array([0.0, 0.0, 0.4, 1.2, 3.0, 8.0, 20.0, 60.0])
    return (
        make_group(1, frequency, 20.0, 5 + 4 * np.log10(frequency)),
        make_group("amps", 1200.0, np.arange(1.0, 9.0), rising, "square", sigma=0.1 + 0.05 * rising),
        make_group("grid_3", [500, 500, 900, 900], [10, 20, 10, 20], [3.0, 6.0, 4.0, 9.0]),
    )


def mixed_groups():
    """Two sweeps of five launches read in ranges, speeds and contact times, and the velocity along one launch."""
    kinds = np.repeat([OBSERVABLES.index(o) for o in (LAUNCH_RANGE, LAUNCH_SPEED, CONTACT_TIME)], 5)
    f = np.tile(np.geomspace(800.0, 3000.0, 5), 3)
    readings = [np.linspace(30.0, 20.0, 5), np.linspace(0.3, 0.2, 5), np.linspace(400.0, 150.0, 5)]
    row, v = np.tile(np.arange(5), 3), np.full(15, 20.0)

    def sweep(group_id, factor):
        y = factor * np.concatenate(readings)
        return Group(group_id, "sine", f"{group_id}.csv", f, v, y, measured=kinds.astype(np.int8), row=row)

    t = np.linspace(0.0, 110.0, 12)
    velocity = np.full(12, OBSERVABLES.index(VELOCITY), np.int8)
    trace = Group("trace", "square", "t.csv", np.full(12, 1200.0), np.full(12, 20.0), 0.1 * t - 0.5, measured=velocity,
                  time_us=t)  # fmt: skip
    return sweep(1, 1.0), trace, sweep(2, 1.1)


def make_run(
    folder: Path, groups=None, fitted=(1,), *, title="Made-up rig", source="nowhere", converged=True, n_chains=6
) -> Run:
    groups = sweep_groups() if groups is None else groups
    experiment = Experiment(
        title, source, CONSTANTS, tuple(groups), folder / "experiment", fingerprint(CONSTANTS, groups), ("a.csv: odd",)
    )
    problem = Problem(experiment, tuple(fitted))
    rng = np.random.default_rng(5)
    middle = np.array([np.mean(p.prior_quantile([0.3, 0.6])) for p in problem.parameters])
    middle[1] = problem.parameters[1].sampling_bounds.upper - 1.0  # far out in its prior
    values = problem.to_physical(middle + 0.2 * rng.standard_normal((n_chains, 40, problem.n_dim)))
    draws = Draws(problem.names, values, np.zeros(values.shape[:2]), "ab" * 32)
    verdicts = ["determined", "determined", "bounded above", "determined", "not determined", "not determined"]
    verdicts += ["determined"] * (problem.n_dim - len(verdicts))
    summaries = []
    for i, p in enumerate(problem.parameters):
        low, median, high = (float(q) for q in np.quantile(draws.flat[:, i], [0.05, 0.5, 0.95]))
        ends = p.to_physical(p.prior_quantile([0.05, 0.95]))
        steps = np.array([-0.6, -0.3, 0.0, 0.3, 0.6])
        drop = 9.0 * np.where(steps > 0, steps, 0.0 if verdicts[i] == "bounded above" else steps) ** 2
        points = [ProfilePoint(float(median * np.exp(u)), float(d)) for u, d in zip(steps, drop, strict=True)]
        points = points if i < problem.n_physical else []
        text = describe(p.name, p.unit, median, (low, high), points, verdicts[i])
        summaries.append(
            ParameterSummary(p.name, median, low, high, float(ends[0]), float(ends[1]), 0.9, 1.004 + i / 1e3, 900.0 + i,
                             800.0 + i, 12.0, verdicts[i], text, points, p.is_implausible(median))
        )  # fmt: skip
    best = {s.name: s.median for s in summaries}
    record = Fit(
        identity="ab" * 32, title=title, source=source, fingerprint=experiment.fingerprint, groups=list(fitted),
        terms=[],
        engine="closed form", seed=7,
        parameters=[
            ParameterEntry(p.name, p.symbol, p.unit, p.description, p.bounds.lower, p.bounds.upper,
                           p.prior.describe(), p.source)
            for p in problem.parameters
        ],
        n_physical=problem.n_physical,
        minima=[MinimumEntry(best, -12.5, 9), MinimumEntry({k: 2 * v for k, v in best.items()}, -20.25, 3)],
        n_starts=12, n_followed=14, n_failed=0, n_evaluations=345, n_missed=0, sampled_by=USUAL, sampler={},
        lmfit_report="[[Fit Statistics]]\n  <made up>",
        versions={"psafit": "0.1.0", "python": "3.11.7"},
        command="psafit fit experiments/made-up --group 1 --seed 7",
    )  # fmt: skip
    message = "40 autocorrelation times, R-hat at most 1.009"
    message = message if converged else f"not converged after 90 steps ({message}): repeat the command to draw on"
    others = [ImportanceEntry(s.name, 1.02 * s.median, s.lower, s.upper, 0.01 * i) for i, s in enumerate(summaries)]
    importance = ImportanceSummary(-20.5, 0.03, 480.0, 0.2, 0.06, others)
    summary = PosteriorSummary(
        "ab" * 32, converged, message, n_chains, 90, 10, 2, 0.31, 40.0, summaries, importance, {}
    )  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    return Run(folder, problem, record, summary, draws)


def make_predictions(run: Run) -> list[Prediction]:
    found = []
    for group in (part for whole in run.problem.experiment.groups for part in whole.parts):
        y = group.reading
        middle = 1.3 * y + 0.4
        found.append(
            Prediction(
                group=group,
                role="fit" if group.id in run.fit.groups else "holdout",
                median=middle,
                model_lower=0.9 * middle,
                model_upper=1.1 * middle,
                lower=np.maximum(0.6 * middle - 0.3, 0),
                upper=1.4 * middle,
                lower_50=0.8 * middle,
                upper_50=1.2 * middle,
                log_density=np.full(y.size, -2.0),
                crps=0.2 * middle,
                pit=np.linspace(0.02, 0.6, y.size),
                pit_p_value=0.04,
                drift_p_value=0.002,
                inside=np.random.default_rng(1).binomial(y.size, 0.9, 999).astype(float),
            )
        )
    return found


def make_validation(run: Run, predictions: list[Prediction]) -> Validation:
    scores = scores_of(predictions)
    unseen = [s.log_rmse for s in scores if s.role == "holdout" and s.informative]
    mean = float(np.mean(unseen)) if unseen else None
    return Validation(
        run.fit.identity, 240, 7, scores, mean, {str(p.group.id): p.pit.tolist() for p in predictions}, 0.5
    )


def make_numerics(run: Run) -> Numerics:
    best = run.fit.minima[0].values
    matrix = contact_matrix([best[name] for name in ("k_c", "c_s", "c_c")], CONSTANTS)
    limit = largest_stable_step(np.linalg.eigvals(matrix).astype(complex))
    steps = [Refinement(1e-3, 2e-4, 1e-6), Refinement(1e-5, 3.1e-7, 1e-9)]
    return Numerics(
        run.fit.identity, run.fit.engine, None, 9, 240, steps, 3.1e-7, 1e-5, True, 2.8e6, limit, 1e-6, 1.035
    )  # fmt: skip


def build(run: Run) -> Path:
    predictions = make_predictions(run)
    return write_report(run, make_validation(run, predictions), predictions, make_numerics(run))
