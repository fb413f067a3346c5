r"""What the extension is worth on data that no choice has seen.

*strict*: search and fit see the training groups only; every other group is scored. *nested*: for each group, search and
fit see all the others; that group is scored. The nested searches begin at the sets that all groups have led to, which
saves computation and gives no set a probability. The extended model of a split predicts with Bayesian model averaging
over the models that its own search found, weighted by their probabilities: averaging is what a reader should do who
cannot distinguish them, and no hindsight chooses among them. The prediction is the median of that mixture (the error
metric) and its predictive density (the log score). A ledger says which groups each choice saw.

A model that cannot be distinguished from the truth in one session may err in the next. The predictive density therefore
holds the discrepancy (`psafit.diagnose.discrepancy`) before and after: as large as the fitted groups
allow where they determine it, as large as its prior where they do not, which is the level of a session when only one
has been seen. It widens intervals and moves no median.

Uncertainty: readings of one group are not independent, so groups are drawn with replacement, and within each group
blocks of five neighbours in the sweep. A bootstrap over few groups is too narrow, for it knows their spread from the
same few and takes that for the truth: the groups' deviations are stretched as Student's law asks
(T. Hesterberg, The American Statistician 69 (2015) 371).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.special import logsumexp
from scipy.stats import norm
from scipy.stats import t as student_t

from psafit.arrays import FloatArray
from psafit.diagnose.discrepancy import Discrepancy, discrepancy
from psafit.experiment import Experiment, Group, GroupId
from psafit.inference import noise
from psafit.inference.evidence import quantiles
from psafit.model_search import Ids, ModelSet
from psafit.model_search.model_set import key_of
from psafit.observables import LAUNCH_RANGE
from psafit.records import ABSENT
from psafit.validate import (
    columns_of,
    log_ratio,
    neighbours_redrawn,
    prediction_rows,
    root_mean_square,
    table_name,
    why_uninformative,
    write_table,
)


@dataclass(frozen=True, eq=False)
class Forecast:
    """A model's predictions of one group it has not seen, or of one of its observables; arrays (n_points,).

    Parameters
    ----------
    group : Group
        Readings of one observable.
    median, lower, upper : arrays, in the observable's unit
        Of what is read without scatter; of the 90 % predictive interval of a reading.
    log_density : array, in the unit inverted
    """

    group: Group
    median: FloatArray
    lower: FloatArray
    upper: FloatArray
    log_density: FloatArray

    @property
    def measured(self) -> FloatArray:
        """The readings."""
        return self.group.reading


@dataclass(frozen=True)
class GroupGain:
    """Scores of one held-out group, before and after.

    Parameters
    ----------
    group : group id
    named : list of str
        The leading causes of the search that had not seen it.
    seen : list of group ids
    log_rmse_before, log_rmse_after, elpd_before, elpd_after, coverage_before, coverage_after : float
    log_rmse_interval, elpd_interval : list of float
        90 % intervals of the changes (after minus before), blocks of its readings drawn with replacement.
    silent : str
        Why the group is left out of every mean; empty where it is not.
    """

    group: GroupId
    named: list[str]
    seen: list[GroupId]
    log_rmse_before: float
    log_rmse_after: float
    elpd_before: float
    elpd_after: float
    coverage_before: float
    coverage_after: float
    log_rmse_interval: list[float]
    elpd_interval: list[float]
    silent: str = ""


@dataclass(frozen=True)
class Choice:
    """Which data a choice saw: a line of the ledger.

    Parameters
    ----------
    choice : str
    saw, scored_on : list of group ids
    models : dict, optional
        Probability of each model that was averaged, by its causes: see `psafit.model_search.model_set.key_of`.
    led_to, begun_led_to : list of str, optional
        Of a search repeated from nothing: its leading set, and that of the search that began at known sets.
    log_posterior_below_begun : float, optional
        By how much the first exceeds the second, nats.
    """

    choice: str
    saw: list[GroupId]
    scored_on: list[GroupId]
    models: dict[str, float] | None = field(default=None, metadata=ABSENT)
    led_to: list[str] | None = field(default=None, metadata=ABSENT)
    begun_led_to: list[str] | None = field(default=None, metadata=ABSENT)
    log_posterior_below_begun: float | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True)
class Gain:
    """A protocol's result.

    Parameters
    ----------
    protocol : {"strict", "nested"}
    groups : list of GroupGain
    log_rmse_before, log_rmse_after : float
        Means over the groups, those aside that cannot show it (`psafit.validate.why_uninformative`); so with all that
        follows.
    log_rmse_interval : list of float
        90 % interval of the mean's change (after minus before): `over_groups`.
    elpd_before, elpd_after : float
        Sums over the groups, nats.
    elpd_interval : list of float
        90 % interval of the change.
    coverage_before, coverage_after : float
        Share of all held-out readings inside their 90 % predictive intervals.
    ledger : list of Choice
        What each choice saw.
    predictions : str
        The CSV file in the folder of the result.
    """

    protocol: str
    groups: list[GroupGain]
    log_rmse_before: float
    log_rmse_after: float
    log_rmse_interval: list[float]
    elpd_before: float
    elpd_after: float
    elpd_interval: list[float]
    coverage_before: float
    coverage_after: float
    ledger: list[Choice]
    predictions: str

    @property
    def names_nothing(self) -> bool:
        """Whether the groups that were seen named no cause, so that nothing was gained or lost on the others."""
        return not self.shows and not any(g.named for g in self.groups)

    @property
    def shows(self) -> bool:
        """Whether the change of log RMSE shows in the three decimals that are printed."""
        return abs(self.log_rmse_after - self.log_rmse_before) >= 0.5e-3

    @property
    def worse(self) -> list[GroupGain]:
        """Groups that the extension predicts worse than the baseline, beyond chance."""
        return [g for g in self.groups if not g.silent and g.log_rmse_interval[0] > 0]


@dataclass(frozen=True, eq=False)
class Split:
    """One training set, its model set, and the forecasts of what it left out, before and after."""

    seen: tuple[GroupId, ...]
    named: Ids
    mixture: dict[Ids, float]
    before: list[Forecast]
    after: list[Forecast]


def split(
    model_set: ModelSet, held_out: Sequence[GroupId], seed: int, n_draws: int = 400, negligible: float = 0.02
) -> Split:
    """Forecast groups that a model set has not seen.

    Parameters
    ----------
    model_set : ModelSet
    held_out : sequence of group ids
    seed : int
    n_draws : int
        Posterior draws behind each interval.
    negligible : float
        Models with less than this share of the best's probability are left out of the mixture.
    """
    best = max(model_set.probability.values())
    shares = {
        ids: p
        for ids in (c.ids for c in model_set.candidates)
        if (p := model_set.probability[ids]) >= negligible * best
    }
    # Once for all groups: a model without an importance sample of the search gets one here.
    draws = model_set.drawn({(): 0.0, **shares}, seed)
    total = sum(p for ids, p in shares.items() if ids in draws)
    mixture = {ids: p / total for ids, p in shares.items() if ids in draws}
    before: dict[Ids, FloatArray] = {(): draws[()].resampled(n_draws)}
    after = {ids: draws[ids].resampled(max(round(n_draws * p), 16)) for ids, p in mixture.items()}
    left = {ids: discrepancy(model_set.of(ids)) for ids in draws}
    return Split(
        seen=model_set.baseline.problem.group_ids,
        named=model_set.best_model.ids,
        mixture=mixture,
        before=[f for g in held_out for f in _forecasts(model_set, {(): 1.0}, before, left, g, seed)],
        after=[f for g in held_out for f in _forecasts(model_set, mixture, after, left, g, seed)],
    )


def _forecasts(
    model_set: ModelSet,
    mixture: dict[Ids, float],
    drawn: dict[Ids, FloatArray],
    left: dict[Ids, Discrepancy],
    group_id: GroupId,
    seed: int,
) -> list[Forecast]:
    """Forecasts of a group, one for each of its observables."""
    ranges, readings, density, weight = [], [], [], []
    for k, (ids, share) in enumerate(mixture.items()):
        problem = model_set.of(ids).problem
        draws = drawn[ids]
        group = problem.experiment.group(group_id)
        rng = np.random.default_rng([seed, 11, k, problem.experiment.groups.index(group)])
        found = problem.predict(draws, [group_id], rng)
        scatter = problem.noise_values(draws, group)
        ranges.append(found)
        spread = left[ids].elsewhere(noise.columns(scatter)[0], group.measured, rng)
        each = rng.standard_normal(found.shape)
        # A trace is off as a whole.
        found = found * np.exp(spread * (each if group.time_us is None else each[:, :1]))
        readings.append(noise.draw(found, scatter, group.sigma, rng))
        density.append(noise.log_density(group.reading, found, scatter, group.sigma))
        weight.append(np.full(len(draws), share / len(draws)))
    w = np.concatenate(weight)
    lower, upper = quantiles(np.concatenate(readings), w, (0.05, 0.95))
    median = quantiles(np.concatenate(ranges), w, (0.5,))[0]
    scored = logsumexp(np.concatenate(density) + np.log(w)[:, None], axis=0)
    rows = [group.measured == part.measured[0] for part in group.parts]
    return [
        Forecast(part, median[some], np.maximum(lower[some], part.floor), upper[some], scored[some])
        for part, some in zip(group.parts, rows, strict=True)
    ]


def _inside(f: Forecast) -> FloatArray:
    return np.asarray((f.measured >= f.lower) & (f.measured <= f.upper), dtype=float)


def changes(
    group: Group,
    errors: Sequence[FloatArray],
    densities: Sequence[FloatArray],
    rng: np.random.Generator,
    n_bootstraps: int = 1000,
) -> tuple[FloatArray, FloatArray]:
    """Changes of a group's log_rmse and log score from one prediction to another, its readings drawn again.

    Parameters
    ----------
    group : Group
    errors : two (n_points,) arrays
        `psafit.validate.log_ratio` of either prediction.
    densities : two (n_points,) arrays, 1/um
        Log predictive densities.
    rng : Generator
    n_bootstraps : int

    Returns
    -------
    two (n_bootstraps,) arrays
        The second's score minus the first's.
    """
    chosen = neighbours_redrawn(group, n_bootstraps, rng)
    rmse = [np.sqrt(np.mean(error[chosen] ** 2, axis=1)) for error in errors]
    return rmse[1] - rmse[0], (densities[1] - densities[0])[chosen].sum(axis=1)


def interval(values: FloatArray) -> list[float]:
    """Central 90 % of redrawn values."""
    return [float(q) for q in np.quantile(values, (0.05, 0.95))]


def over_groups(redrawn: FloatArray, found: FloatArray, rng: np.random.Generator) -> list[float]:
    """90 % interval of a change's mean over groups, groups and readings drawn again.

    Parameters
    ----------
    redrawn : (n_groups, n_bootstraps) array
        The change in each group, its readings drawn again.
    found : (n_groups,) array
        The change in each group.
    rng : Generator

    Returns
    -------
    list of float
        Of a single group, what its readings alone leave open: nothing shows how groups differ.
    """
    n, times = redrawn.shape
    group, again = rng.integers(0, n, (n, times)), rng.integers(0, times, (n, times))
    stretch = math.sqrt(n / (n - 1)) * student_t.ppf(0.95, n - 1) / norm.ppf(0.95) if n > 1 else 1.0
    apart = (float(stretch) - 1.0) * (found - found.mean())
    return interval((redrawn[group, again] + apart[group]).mean(axis=0))


def summarise(protocol: str, splits: Sequence[Split], folder: Path, seed: int) -> Gain:
    """Score forecasts and write them to `folder`."""
    rng = np.random.default_rng([seed, 13])
    silences = {f.group.label: why_uninformative(f.group) for one in splits for f in one.after}
    if all(silences.values()):  # better what says little than no number
        silences = dict.fromkeys(silences, "")
    rows: list[GroupGain] = []
    heard: list[tuple[Forecast, Forecast]] = []
    redrawn: list[tuple[FloatArray, FloatArray]] = []
    for one in splits:
        for before, after in zip(one.before, one.after, strict=True):
            group, silent = before.group, silences[before.group.label]
            errors = [log_ratio(f.median, f.measured, *group.observable.metric) for f in (before, after)]
            change = changes(group, errors, [before.log_density, after.log_density], rng)
            rows.append(
                GroupGain(
                    group.id, list(one.named), list(one.seen),
                    root_mean_square(errors[0]), root_mean_square(errors[1]),
                    float(before.log_density.sum()), float(after.log_density.sum()),
                    float(_inside(before).mean()), float(_inside(after).mean()),
                    interval(change[0]), interval(change[1]), silent,
                )
            )  # fmt: skip
            if not silent:
                heard.append((before, after))
                redrawn.append(change)
    name = f"predictions-{protocol}.csv"
    for observable in dict.fromkeys([LAUNCH_RANGE, *(f.group.observable for one in splits for f in one.after)]):
        table = (
            [*row, model]
            for one in splits
            for model, forecasts in (("baseline", one.before), ("extended", one.after))
            for f in forecasts
            if f.group.observable is observable
            for row in prediction_rows(f.group, f.median, f.lower, f.upper, "holdout")
        )
        file = folder / table_name(f"predictions-{protocol}", observable)
        write_table(file, (*columns_of(observable), "model"), table)
    every = [np.concatenate([_inside(p[k]) for p in heard]) for k in (0, 1)]
    informative = [r for r in rows if not r.silent]
    rmse, elpd = (np.array(each) for each in zip(*redrawn, strict=True))
    found = np.array([[r.log_rmse_after - r.log_rmse_before, r.elpd_after - r.elpd_before] for r in informative])
    return Gain(
        protocol=protocol,
        groups=rows,
        log_rmse_before=float(np.mean([r.log_rmse_before for r in informative])),
        log_rmse_after=float(np.mean([r.log_rmse_after for r in informative])),
        log_rmse_interval=over_groups(rmse, found[:, 0], rng),
        elpd_before=float(sum(r.elpd_before for r in informative)),
        elpd_after=float(sum(r.elpd_after for r in informative)),
        elpd_interval=[len(informative) * end for end in over_groups(elpd, found[:, 1], rng)],
        coverage_before=float(every[0].mean()),
        coverage_after=float(every[1].mean()),
        ledger=[
            Choice(
                "causes, parameters and scatter",
                list(one.seen),
                list(dict.fromkeys(f.group.id for f in one.after)),
                {key_of(ids): share for ids, share in one.mixture.items()},
            )
            for one in splits
        ],
        predictions=name,
    )


def protocols(
    experiment: Experiment, training: tuple[GroupId, ...]
) -> dict[str, list[tuple[tuple[GroupId, ...], tuple[GroupId, ...]]]]:
    """(seen, held out) of every split of both protocols."""
    others = tuple(g for g in experiment.ids if g not in training)
    found = {"strict": [(training, others)] if others else []}
    found["nested"] = (
        [(tuple(o for o in experiment.ids if o != g), (g,)) for g in experiment.ids] if len(experiment.ids) > 1 else []
    )
    return found


def audit(begun: ModelSet, anew: ModelSet, every: Sequence[GroupId], seen: Sequence[GroupId]) -> list[Choice]:
    """Lines of the ledger on where the searches of the nested protocol began, and what that has changed in one."""
    log_posterior = [
        found.log_evidence[found.best_model.ids] + found.log_prior(found.best_model.ids) for found in (begun, anew)
    ]
    return [
        Choice("sets at which the searches began", list(every), []),
        Choice(
            "the same search from nothing",
            list(seen),
            [],
            led_to=list(anew.best_model.ids),
            begun_led_to=list(begun.best_model.ids),
            log_posterior_below_begun=log_posterior[0] - log_posterior[1],
        ),
    ]
