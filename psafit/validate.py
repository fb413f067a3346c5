r"""Check a posterior against groups it never saw.

For every reading the posterior predictive distribution is the mixture, over posterior draws, of the noise law
around that draw's prediction. Its scores:

* `log_rmse`: root mean square of :math:`\ln\frac{\hat L + 0.3}{y + 0.3}` in um, :math:`\hat L` the posterior median;
  other observables have an offset of their own, `psafit.observables.Observable.offset`;
* coverage of the central 50 and 90 % predictive intervals;
* CRPS, :math:`E|Y - y| - \tfrac12 E|Y - Y'|` (Gneiting and Raftery, JASA 102 (2007) 359), in the reading's unit;
* expected log predictive density, :math:`\sum_i \ln \tfrac1S \sum_s p(y_i|\theta_s)`, nats;
* PIT, the predictive probability below the reading: uniform on [0, 1] and without order along the sweep if the
  prediction is honest. Both are tested against groups simulated from the posterior, each from one draw, so that
  readings which share the error of a parameter are not taken for independent.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, ndtri
from scipy.stats import binomtest

from psafit.arrays import FloatArray
from psafit.experiment import Group, GroupId, Occasions, Plan, known_sessions
from psafit.files import write_atomically
from psafit.inference import noise
from psafit.inference.candidate import candidate_at
from psafit.inference.laws import broken
from psafit.inference.problem import Problem
from psafit.inference.run_folder import Run
from psafit.observables import LAUNCH_RANGE, OBSERVABLES, Observable, names, recorded_name
from psafit.records import GroupScore, Retested, Size, Validation, write_json
from psafit.simulate import Design
from psafit.simulate import readings as readings_of
from psafit.text import count, fixed

OFFSET_UM = LAUNCH_RANGE.offset
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
# Verdict thresholds on log_rmse. On a group it has not seen a perfect model should expect 0.10 to 0.13, known to a
# factor of two at best, and one that reaches 0.15 may be perfect; 0.3 is hard to put down to the data (docs/data.md).
GOOD, FAIR = 0.15, 0.30
# Of every test of one group. Statements about several groups are at this level together.
LEVEL = 0.01
# Readings of a group from which on its band and its order are judged.
JUDGED = 5


@dataclass(frozen=True)
class Prediction:
    """Posterior predictive of one group, or of one of its observables; arrays of shape (n_points,) in its unit.

    Parameters
    ----------
    group : Group
        The measurements, of one observable.
    role : {"fit", "holdout"}
    median : array
        Posterior median of what is read, without scatter.
    model_lower, model_upper : arrays
        Central 90 % of the same.
    lower, upper : arrays
        Central 90 % predictive interval of a reading.
    lower_50, upper_50 : arrays
        Central 50 % predictive interval of a reading.
    log_density : array
        Log predictive density of each reading, per unit.
    crps : array
    pit : array
        Probability integral transforms, without a unit; those of readings of zero lie anywhere in what the law has
        below zero.
    pit_p_value, drift_p_value : float
        Share of groups simulated from the posterior whose PIT is as far from uniform, and as correlated between
        neighbours in the sweep; NaN where too few readings are above zero, or nothing drives them.
    inside : (n_simulated,) array
        Readings of each of these groups that lie in the central 90 %; empty where the p values are NaN.
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
    pit_p_value: float
    drift_p_value: float
    inside: FloatArray


def log_ratio(
    predicted: FloatArray,
    measured: FloatArray,
    offset: float | FloatArray = OFFSET_UM,
    signed: bool | NDArray[np.bool_] = False,
) -> FloatArray:
    """``ln((predicted + offset)/(measured + offset))``, the error whose root mean square is `log_rmse`.

    The offset is that of the observable: 0.3 um for launch ranges. Samples of a trace are `signed`: the difference of
    ``arsinh(x / 2 offset)``, which is that of ``ln(x / offset)`` where they are large, stands for it.
    """
    with np.errstate(invalid="ignore", divide="ignore"):  # of what is signed
        plain = np.log((predicted + offset) / (measured + offset))
    if not np.any(signed):
        return plain
    return np.where(signed, np.arcsinh(0.5 * predicted / offset) - np.arcsinh(0.5 * measured / offset), plain)


def neighbours_redrawn(group: Group, times: int, rng: np.random.Generator, most: int = 5) -> NDArray[np.intp]:
    """Rows drawn with replacement, in blocks of `most` neighbours in the sweep: its readings are not independent.

    Returns
    -------
    (times, n_points) array
    """
    n = group.n_points
    # A block of all readings would be the same readings again; errors along a trace last for many samples.
    block = max(n // 6, 1) if group.time_us is not None else min(most, max(n // 3, 1))
    begin = rng.integers(0, n, (times, math.ceil(n / block), 1))
    return group.in_sweep[((begin + np.arange(block)) % n).reshape(times, -1)[:, :n]]


def root_mean_square(error: FloatArray) -> float:
    """The root mean square of errors; that of `log_ratio` is `log_rmse`."""
    return float(np.sqrt(np.mean(error**2)))


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


def departures(pit: FloatArray) -> tuple[FloatArray, FloatArray]:
    """How far transforms are from uniform, and how correlated between neighbours.

    Parameters
    ----------
    pit : (n_sets, n_points) array
        In the order of the sweep.

    Returns
    -------
    (n_sets,) array
        Kolmogorov's distance.
    (n_sets,) array
        Autocorrelation of the normal scores at lag one.
    """
    n = pit.shape[1]
    ordered = np.sort(pit, axis=1)
    steps = np.arange(n + 1) / n
    distance = np.maximum(steps[1:] - ordered, ordered - steps[:-1]).max(axis=1)
    z = ndtri(np.clip(pit, 1e-3, 1 - 1e-3))  # no reading counts for more than three standard deviations
    z = z - z.mean(axis=1, keepdims=True)
    return distance, (z[:, 1:] * z[:, :-1]).sum(axis=1) / np.maximum((z**2).sum(axis=1), 1e-12)


def p_values(group: Group, pit: FloatArray, simulated: FloatArray) -> tuple[float, float]:
    """Ranks of a group's `departures` among those of simulated groups, whose transforms are (n_sets, n_points)."""
    if why_uninformative(group):
        return math.nan, math.nan
    n, sweep = len(simulated), group.in_sweep
    simulated = simulated[:, sweep]
    found = zip(departures(pit[None, sweep]), departures(simulated), strict=True)
    uniformity, drift = (float((1 + np.sum(others >= one[0])) / (1 + n)) for one, others in found)
    return uniformity, drift


def _transforms(
    group: Group, readings: FloatArray, ranges: FloatArray, scatter: FloatArray, most: int = 50
) -> FloatArray:
    """Probability integral transforms of simulated groups, (n_sets, n_points), under all of them.

    A sample of a trace is judged given those before it, by `most` of the draws.
    """
    if group.time_us is None:
        return (np.argsort(np.argsort(readings, axis=0), axis=0) + 0.5) / len(readings)
    some = range(0, len(ranges), -(-len(ranges) // most))
    each = [noise.cumulative(readings, ranges[k : k + 1], scatter[k : k + 1], group.sigma) for k in some]
    return np.asarray(np.mean(each, axis=0))


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
    return predictive(run.problem, some_draws(run, n_draws), run.fit.seed if seed is None else seed)


def some_draws(run: Run, n_draws: int) -> FloatArray:
    """Posterior draws of a run, evenly spread over its chains: sampling coordinates, at most (n_draws, n_dim)."""
    flat = run.problem.to_sampling(run.draws.flat)
    return flat[np.linspace(0, len(flat) - 1, min(n_draws, len(flat))).astype(int)]


def predictive(problem: Problem, draws: FloatArray, seed: int) -> list[Prediction]:
    """Posterior predictive of every group of the problem's experiment, from any equally weighted draws.

    A group of several observables has one of each.

    Parameters
    ----------
    problem : Problem
    draws : (n_draws, n_dim) array
        Sampling coordinates.
    seed : int
        Of the simulated readings.
    """
    rng, chance = np.random.default_rng([seed, 2]), np.random.default_rng([seed, 3])
    looks = sum(len(whole.parts) for whole in problem.experiment.groups)
    n_simulated = math.ceil(looks / LEVEL)  # with fewer, no p value could be small enough for so many looks
    result = []
    for whole in problem.experiment.groups:
        everything = problem.predict(draws, [whole.id], rng)
        for group in whole.parts:
            ranges = everything[:, whole.measured == group.measured[0]]
            result.append(_predicted(problem, group, draws, ranges, rng, chance, n_simulated))
    return result


def intervals(run: Run, plan: Plan, *, n_draws: int = 1000) -> FloatArray:
    """Ends of the central 90 % predictive interval of each reading of a plan, in its unit; (2, n_points).

    They hold what the posterior leaves open, and the scatter of a reading. What sessions have for themselves is drawn
    from its prior, but for sessions of which the plan holds a group with the very readings that were fitted.

    Parameters
    ----------
    run : Run
    plan : Plan
    n_draws : int
        Posterior draws used.
    """
    problem, rng = run.problem, np.random.default_rng([run.fit.seed, 5])
    draws, ends = some_draws(run, n_draws), []
    measured = known_sessions(plan.groups, problem.experiment.select(problem.group_ids))
    for group in plan.groups:
        design = Design.of(plan.constants, [group])
        own = group if group.session_id in measured else replace(group, session="a session to come")
        exact = readings_of(design, problem.theta(draws, Occasions.of([own]), rng), problem.terms)
        kinds = np.unique(group.measured).tolist()
        scatter = noise.by_reading({k: problem.scatter_to_come(draws, k) for k in kinds}, design)
        usual = {k: problem.sigma_to_come(k) or 0.0 for k in kinds}  # where none is usual, none is stated
        known = np.array([usual[k] for k in group.measured.tolist()]) if group.sigma is None else group.sigma
        drawn = noise.draw(exact, scatter, known, rng)
        ends.append(np.quantile(np.maximum(drawn, group.floor), [0.05, 0.95], axis=0))
    return np.concatenate(ends, axis=1)


def _predicted(
    problem: Problem,
    group: Group,
    draws: FloatArray,
    ranges: FloatArray,
    rng: np.random.Generator,
    chance: np.random.Generator,
    n_simulated: int,
) -> Prediction:
    """Posterior predictive of readings of one observable; `ranges` are the predictions, (n_draws, n_points).

    Its tests simulate `n_simulated` groups at least, as many from each draw.
    """
    scatter = problem.noise_values(draws, group)
    readings = noise.draw(ranges, scatter, group.sigma, rng)
    quantiles = np.quantile(readings, [0.05, 0.25, 0.75, 0.95], axis=0)
    density = noise.log_density(group.reading, ranges, scatter, group.sigma)
    below = noise.cumulative(group.reading, ranges, scatter, group.sigma)
    pit = below.mean(axis=0)
    # Readings of zero are all that the law has below it: they lie anywhere there.
    pit = np.where(group.reading > group.floor, pit, pit * chance.uniform(size=pit.size))
    # What is met more closely than any instrument reads says nothing of a band.
    quiet = noise.too_fine(np.median(scatter, axis=0)[None], ndtri(np.clip(pit, 1e-9, 1 - 1e-9)), LEVEL)
    pit_p_value, drift_p_value, inside = math.nan, math.nan, np.empty(0)
    # A reading is never negative; the law's tail below zero is the reading zero.
    lower, upper = np.maximum(quantiles[0], group.floor), quantiles[3]
    if not (quiet or why_uninformative(group)):
        more = -(-n_simulated // len(draws)) - 1
        others = [noise.draw(ranges, scatter, group.sigma, chance) for _ in range(more)]
        simulated = np.concatenate([readings, *others])
        transforms = _transforms(group, simulated, ranges, scatter)
        pit_p_value, drift_p_value = p_values(group, pit, transforms)
        inside = _held(group, np.maximum(simulated, group.floor), lower, upper, transforms).sum(axis=-1).astype(float)
    model_lower, median, model_upper = np.quantile(ranges, [0.05, 0.5, 0.95], axis=0)
    return Prediction(
        group=group,
        role="fit" if group.id in problem.group_ids else "holdout",
        median=median,
        model_lower=model_lower,
        model_upper=model_upper,
        lower=lower,
        upper=upper,
        lower_50=np.maximum(quantiles[1], group.floor),
        upper_50=quantiles[2],
        log_density=logsumexp(density, axis=0) - math.log(len(draws)),
        crps=crps(readings, group.reading),
        pit=pit,
        pit_p_value=pit_p_value,
        drift_p_value=drift_p_value,
        inside=inside,
    )


def _held(
    group: Group, readings: FloatArray, lower: FloatArray, upper: FloatArray, pit: FloatArray, share: float = 0.9
) -> NDArray[np.bool_]:
    """Which readings, of one set or many, lie in a central share of the law, whose ends are given.

    Neighbours of a trace are in it together, or out of it: each given those before is what counts.
    """
    if group.observable.traced:
        return np.asarray(np.abs(pit - 0.5) <= 0.5 * share)
    return (readings >= lower) & (readings <= upper)


def without_each(problem: Problem, draws: FloatArray, group_ids: Sequence[GroupId]) -> dict[str, FloatArray]:
    """What each cause does in a model: what would be read without it, all else left as it is.

    Parameters
    ----------
    problem : Problem
    draws : (n_draws, n_dim) array
        Sampling coordinates.
    group_ids : sequence of group ids

    Returns
    -------
    dict of str to (n_points,) array
        By cause: the median over the draws, each in the unit of its reading.
    """
    found = {}
    for gone in problem.terms:
        rest, kept = problem.without(gone)
        found[gone.id] = np.median(rest.predict(draws[:, kept], group_ids), axis=0)
    return found


def why_uninformative(group: Group, least: int = 3) -> str:
    """Why a group cannot separate a good prediction from a bad one; empty where it can."""
    if not group.driven.any():
        return "nothing drives it"
    few = np.count_nonzero(group.reading) < least
    return f"fewer than {least} of its readings are above zero" if few else ""


def scores_of(predictions: Sequence[Prediction]) -> list[GroupScore]:
    """Scores of all groups; drifts and bands are judged at one level, whatever the number of groups."""
    return [score(p, looks=_looks(predictions, p.role)) for p in predictions]


def score(prediction: Prediction, *, looks: int = 1) -> GroupScore:
    """Scores of one group; its errors and its band are one of so many `looks`."""
    measured = prediction.group.reading
    read = prediction.group.observable
    error = log_ratio(prediction.median, measured, *read.metric)
    silent = why_uninformative(prediction.group)
    inside_50 = _held(prediction.group, measured, prediction.lower_50, prediction.upper_50, prediction.pit, share=0.5)
    inside_90 = _inside(prediction)
    held, fitted = float(np.mean(inside_90)), prediction.role == "fit"
    uniform, drift, chance = (
        prediction.pit_p_value, prediction.drift_p_value, _as_odd(inside_90.sum(), prediction.inside)
    )  # fmt: skip
    size, said = verdict(error, held, uniform, drift, coverage_p_value=chance, fitted=fitted, looks=looks)
    if silent:
        size, said = "says nothing", f"says nothing of the model: {silent}; left out of every mean"
    return GroupScore(
        group=prediction.group.id,
        observable=recorded_name(read),
        unit=None if read is LAUNCH_RANGE else read.unit,
        role=prediction.role,
        n_points=measured.size,
        log_rmse=root_mean_square(error),
        log_bias=float(np.mean(error)),
        coverage_50=float(np.mean(inside_50)),
        coverage_90=held,
        crps=float(np.mean(prediction.crps)),
        elpd=float(np.sum(prediction.log_density)),
        elpd_per_point=float(np.mean(prediction.log_density)),
        pit_p_value=uniform,
        drift_p_value=drift,
        coverage_p_value=chance,
        informative=not silent,
        verdict=said,
        size=size,
    )


def _inside(prediction: Prediction) -> NDArray[np.bool_]:
    """Which readings lie in the central 90 %."""
    p = prediction
    return _held(p.group, p.group.reading, p.lower, p.upper, p.pit)


def _as_odd(inside: float, simulated: FloatArray) -> float:
    """Chance of a count as far to its side of the median as `inside`; NaN where nothing was simulated."""
    few, many = ((1 + np.sum(side)) / (1 + simulated.size) for side in (simulated <= inside, simulated >= inside))
    return float(min(few, many)) if simulated.size else math.nan


def _of_all(predictions: Sequence[Prediction]) -> float:
    """Chance that the bands of all groups which were held out hold as few readings together, or as many.

    Groups that are simulated from one draw share its errors.
    """
    unseen = [p for p in predictions if p.role == "holdout" and p.inside.size]
    if not unseen:
        return math.nan
    return _as_odd(sum(_inside(p).sum() for p in unseen), np.sum([p.inside for p in unseen], axis=0))


def _factor(error: float) -> str:
    """A log error as the factor that a sentence gives."""
    return f"×{math.exp(error):.2f}"


def _direction(error: FloatArray, one_sign: float = 0.70) -> str:
    """Whether errors lie on one side: they have this share, or chance would rarely part them so."""
    large, small = int((error > 0).sum()), int((error < 0).sum())
    most = max(large, small)
    if most == 0 or (most <= one_sign * error.size and binomtest(large, large + small).pvalue >= LEVEL):
        return "either way"
    side, bias = ("large", float(np.mean(error))) if large > small else ("small", -float(np.mean(error)))
    # A few large errors of the other sign may outweigh the many in the mean.
    shown = bias > 0 and _factor(bias) != _factor(0.0)
    return f"mostly too {side}" + (f" (by {_factor(bias)} on average)" if shown else "")


def drifting(validation: Validation) -> bool:
    """Whether errors of what was fitted drift: the parameters may then stand in for what the model lacks."""
    return any(s.role == "fit" for s in trends(validation.groups))


def trends(scores: Sequence[GroupScore]) -> list[GroupScore]:
    """Return the scores, each of one group and observable, whose errors drift.

    Chance finds any among what was fitted in one case of a hundred, and any among what was not. Bonferroni's bound:
    each is judged at the level over the number of those that can be judged.
    """
    return [s for s in scores if s.drift_p_value * _looks(scores, s.role) < LEVEL]


def _looks(found: Sequence[GroupScore] | Sequence[Prediction], role: str) -> int:
    """How many groups of a role were tested."""
    return sum(math.isfinite(one.drift_p_value) for one in found if one.role == role)


Predicts = Literal["not tested", "yes", "not everywhere", "too sure", "too unsure", "misses a trend", "roughly", "no"]
"""Whether a fit predicts the groups it has not seen."""


def predicts(validation: Validation) -> tuple[Predicts, list[GroupScore]]:
    """Whether a fit predicts what it has not seen, and which groups speak against that, where it is not all of them.

    It does where errors, bands and trends of no group speak against it.
    """
    mean, unseen = validation.holdout_log_rmse, _unseen(validation.groups)
    if mean is None or not unseen:
        return "not tested", []
    if mean > GOOD:
        return "roughly" if mean <= FAIR else "no", []
    if off := _off(unseen):
        return "not everywhere", off
    if too_narrow(validation):
        return "too sure", []
    if narrow := _of_band("narrow", unseen):
        return "too sure", narrow
    if wide := _of_band("wide", unseen):
        return "too unsure", wide
    trend = trends(unseen)
    return ("misses a trend", trend) if trend else ("yes", [])


def caution(validation: Validation) -> str:
    """Why the values of a fit may stand in for what the model lacks; empty where nothing says so."""
    if validation.laws:
        return f"the best values break a law ({validation.laws[0].text})"
    if drifting(validation):
        return "the errors of what was fitted drift"
    unseen = _unseen(validation.groups)
    if too_narrow(validation):
        return "its 90 % band holds too few of the unseen readings"
    if narrow := _of_band("narrow", unseen):
        return f"its 90 % band holds too few of the readings of unseen group {_ids(narrow)}"
    if trend := trends(unseen):
        return f"the errors of unseen group {_ids(trend)} drift"
    if off := _off(unseen):
        return f"unseen group {_ids(off)} is {'missed' if max(s.log_rmse for s in off) > FAIR else 'roughly followed'}"
    if wide := _of_band("wide", unseen):
        return f"its 90 % band holds too many of the readings of unseen group {_ids(wide)}"
    mean = validation.holdout_log_rmse
    if mean is not None and mean > GOOD:
        return f"the groups it has not seen are {'missed' if mean > FAIR else 'roughly followed'}"
    return objection(validation)


def objection(validation: Validation) -> str:
    """What speaks against the model where it is fitted to all groups together; empty where nothing does."""
    whole = validation.all_groups
    if whole is None or not whole.objection:
        return ""
    return f"fitted to all readings, the model {_OBJECTIONS[whole.objection]} (p = {whole.p_value:.3f})"


_OBJECTIONS = {
    "tests": "fails the tests of misfit",
    "together": "misses readings of several groups at one condition",
    "tails": "passes the tests of misfit by heavy tails alone",
}


def _ids(scores: Iterable[GroupScore]) -> str:
    return ", ".join(dict.fromkeys(names((s.group, s.observable) for s in scores)))


def _unseen(scores: Iterable[GroupScore]) -> list[GroupScore]:
    """Groups that were held out and can show a failure."""
    return [s for s in scores if s.role == "holdout" and s.informative]


def _of_band(band: str, scores: Sequence[GroupScore]) -> list[GroupScore]:
    looks = _looks(scores, "holdout")
    return [s for s in scores if band == _band(s.coverage_90, s.n_points, s.pit_p_value, s.coverage_p_value, looks)]


Band = Literal["", "narrow", "wide"]
"""What is wrong with a band of 90 %."""


def _band(coverage: float, n: int, pit_p_value: float, coverage_p_value: float, looks: int) -> Band:
    """Whether a band holds fewer readings than chance allows, or all but a few and the PIT is not uniform.

    If there are readings enough; chance finds any of so many `looks` in one case of a hundred.
    """
    if n < JUDGED:
        return ""
    if coverage < 0.9:
        return "narrow" if coverage_p_value * looks < LEVEL else ""
    return "wide" if coverage > 0.9 + _slack(n) and pit_p_value * looks < LEVEL else ""


def _off(scores: Iterable[GroupScore]) -> list[GroupScore]:
    """Groups with readings enough whose errors are not small."""
    return [s for s in scores if s.n_points >= JUDGED and s.log_rmse > GOOD]


def shows_trends(score: GroupScore) -> bool:
    """Whether a sweep has readings enough to show a trend that the model misses."""
    return score.n_points >= JUDGED and math.isfinite(score.drift_p_value)


def coverage(scores: Sequence[GroupScore]) -> float:
    """Fraction of all readings of some groups inside the 90 % predictive interval."""
    return sum(s.coverage_90 * s.n_points for s in scores) / sum(s.n_points for s in scores)


def too_narrow(validation: Validation) -> bool:
    """Whether the 90 % band holds fewer readings of all unseen groups together than chance allows."""
    unseen = _unseen(validation.groups)
    return bool(unseen) and coverage(unseen) < 0.9 and validation.coverage_p_value < LEVEL


def _slack(n: int) -> float:
    """Two standard deviations of the share of `n` readings that a 90 % band holds."""
    return 2 * math.sqrt(0.9 * 0.1 / n)


def size_of(log_rmse: float, *, sound: bool, fitted: bool) -> Size:
    """How well a group is met, in a word or two.

    By its error, and by whether it is `sound`: its band could be judged, and holds, and its errors do not drift.
    """
    if log_rmse > GOOD:
        return "roughly followed" if log_rmse <= FAIR else "missed"
    if not sound:
        return "followed closely"
    return "fitted well" if fitted else "predicted well"


def verdict(
    error: FloatArray,
    coverage: float,
    pit_p_value: float,
    drift_p_value: float,
    *,
    coverage_p_value: float = math.nan,
    fitted: bool = False,
    looks: int = 1,
) -> tuple[Size, str]:
    """How well a group is met, and one plain sentence that begins with that.

    From its log errors and the scores of its band, and whether it was fitted.

    Of so many `looks` chance finds any drift in one case of a hundred, and any band that is too narrow.
    """
    rmse, n = root_mean_square(error), error.size
    band = _band(coverage, n, pit_p_value, coverage_p_value, looks)
    drifts = drift_p_value * looks < LEVEL
    size = size_of(rmse, sound=n >= JUDGED and band != "narrow" and not drifts, fitted=fitted)
    worst = int(np.argmax(np.abs(error)))
    ruled = n > 2 and error[worst] ** 2 > 0.5 * np.sum(error**2)
    factor = _factor(rmse)
    other = _factor(root_mean_square(np.delete(error, worst))) if ruled else factor
    rest = f" ({other} but for one reading)" if other != factor else ""
    parts = [f"{size}, typically off by {factor}{rest}, {_direction(error)}"]
    if n < JUDGED:
        return size, f"{parts[0]}; too few readings to judge its band"
    if band == "narrow":
        parts.append(f"its 90 % band holds only {fixed(coverage, per_cent=True)} % of the readings")
    elif band == "wide":
        parts.append(f"its 90 % band is too wide ({fixed(coverage, per_cent=True)} % of the readings inside)")
    elif coverage < 0.9 - _slack(n):
        chance = f" (p = {coverage_p_value:.2g}, of {count(looks, 'test')})" if math.isfinite(coverage_p_value) else ""
        parts.append(f"its 90 % band holds {fixed(coverage, per_cent=True)} % of the readings{chance}")
    elif pit_p_value * looks < LEVEL:
        parts.append("its 90 % band is wide enough, but the readings are not spread over it as predicted")
    elif not drifts:
        parts.append("nothing speaks against its band")
    if drifts:
        absorbed = "" if band == "narrow" else " that the scatter absorbs"
        parts.append(f"its errors drift along the sweep: the model misses a trend{absorbed}")
    return size, "; ".join(parts)


Retest = Callable[[Run], Retested | None]
"""Tests a fit's model on all groups; `psafit.diagnose.retest` has one."""


def validate(
    run: Run, *, n_draws: int = 1000, retest: Retest = lambda run: None
) -> tuple[Validation, list[Prediction]]:
    """Score every group and write `validation.json` and `predictions.csv` into the run folder.

    Parameters
    ----------
    run : Run
    n_draws : int
        Posterior draws used, evenly spread over the chains.
    retest : callable
        Tests the model on all groups, too.

    Returns
    -------
    Validation, list of Prediction
    """
    record, predictions = scored(run, n_draws, retest)
    write_json(run.folder / "validation.json", record)
    write_predictions(run.folder / "predictions.csv", predictions)
    return record, predictions


def scored(run: Run, n_draws: int = 1000, retest: Retest = lambda run: None) -> tuple[Validation, list[Prediction]]:
    """Score every group, as `validate` does, and write nothing."""
    predictions = predict(run, n_draws=n_draws)
    scores = scores_of(predictions)
    held_out = [s.log_rmse for s in _unseen(scores)]
    record = Validation(
        identity=run.fit.identity,
        n_draws=min(n_draws, len(run.draws.flat)),
        seed=run.fit.seed,
        groups=scores,
        holdout_log_rmse=float(np.mean(held_out)) if held_out else None,
        pit={p.group.label: p.pit.tolist() for p in predictions},
        laws=broken(candidate_at(run.problem, run.problem.to_sampling(run.best)[None])),
        all_groups=retest(run),
        coverage_p_value=_of_all(predictions),
    )
    return record, predictions


def write_predictions(path: Path, predictions: list[Prediction]) -> None:
    """Write a table of the launch ranges, a row for each, and one of each other observable: ``<stem>-<name>.csv``.

    The first is there without a launch range, too: then it has a header alone.
    """
    for k, observable in enumerate(OBSERVABLES):
        here = [p for p in predictions if p.group.measured[0] == k]
        rows = (row for p in here for row in prediction_rows(p.group, p.median, p.lower, p.upper, p.role))
        if here or observable is LAUNCH_RANGE:
            write_table(path.with_name(table_name(path.stem, observable)), columns_of(observable), rows)


def table_name(stem: str, observable: Observable) -> str:
    """File of predictions of an observable; the launch range has no mark."""
    return f"{stem}.csv" if observable is LAUNCH_RANGE else f"{stem}-{observable.name}.csv"


def tables_at(path: Path) -> dict[Observable, Path]:
    """The tables of predictions that are there, by observable; `path` is that of the launch ranges."""
    files = {o: path.with_name(table_name(path.stem, o)) for o in OBSERVABLES}
    return {o: file for o, file in files.items() if file.is_file()}


def columns_of(observable: Observable) -> tuple[str, ...]:
    """`COLUMNS` with an observable's column and unit in the place of the launch range's; of a trace, with `time_us`."""
    unit = observable.column.removeprefix(observable.name)
    return tuple(
        observable.column
        if name == LAUNCH_RANGE.column
        else name.removesuffix("_um") + unit
        if name.endswith("_um")
        else name
        for name in timed(COLUMNS, observable)
    )


def timed(columns: Sequence[str], observable: Observable) -> tuple[str, ...]:
    """`COLUMNS`, for a trace with the time behind the conditions."""
    at = columns.index("amplitude_v") + 1
    return (*columns[:at], *(["time_us"] if observable.traced else []), *columns[at:])


def prediction_rows(
    group: Group, median: FloatArray, lower: FloatArray, upper: FloatArray, role: str
) -> Iterator[list[object]]:
    """Cells of `COLUMNS` for each reading of a group; of a trace, with the time behind the conditions.

    Parameters
    ----------
    group : Group
    median, lower, upper : (n_points,) arrays
        See `Prediction`.
    role : {"fit", "holdout"}
    """
    time = () if group.time_us is None else (group.time_us,)
    columns = (group.frequency_hz, group.amplitude_v, *time, group.reading, median, lower, upper)
    for row in zip(*columns, strict=True):
        yield [group.id, group.waveform, *(float(x) for x in row), role]


def write_table(path: Path, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a CSV file in one step."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(columns)
    table.writerows(rows)
    write_atomically(path, text.getvalue().encode())
