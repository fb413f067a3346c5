r"""Which measurement would distinguish tied causes, or a weakly determined parameter best.

A proposal is a sweep, with a drive that the rig has, within the limits that the experiment states for frequency,
amplitude and each constant of the rig that can be changed; where it states none, between the frequencies and up to the
amplitude that were measured, or the same with a string or a ball of half or twice the size. It is read with the fitted
scatter and the usual uncertainty of the readings, where they state one. On the rig as it is, every other observable is
tried as well: a contact time may distinguish what launch ranges cannot. So is a trace of one launch over time: each
sample counts what it says beyond the one before (`psafit.inference.noise`). For models with posterior draws, readings
are simulated from one, and the log ratio of its posterior predictive density of these readings (a mixture over its
draws) to the mean of the others' is what the readings would add to its log odds. The mean over many simulated
experiments is the expected separation; the share of them in which the right model wins by three nats is how often the
proposal works: measured data drawn from each tied model, judged again. Of more than two it also says which pairs a
proposal separates apart, since one may settle one question and leave another. What is printed comes from simulated
experiments that had no part in the choice of a proposal.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from psafit.arrays import FloatArray
from psafit.diagnose.explanations import KINDS, Explanation, Explanations, compared
from psafit.diagnose.possible import Possible, TraceSettings, contact_times, may_be_read, near, proposals, traces
from psafit.diagnose.words import PLAIN, Words
from psafit.drives import TABLE, Drive
from psafit.experiment import Conditions, Experiment, GroupId, Occasions
from psafit.inference import noise
from psafit.inference.candidate import Candidate
from psafit.inference.evidence import ImportanceSample
from psafit.inference.problem import Problem
from psafit.observables import OBSERVABLES
from psafit.physics import meaning
from psafit.records import ABSENT
from psafit.simulate import Design, readings, simulate
from psafit.text import fixed

_Item = TypeVar("_Item")

# Log ratios of densities count up to here: beyond, nobody doubts any more.
CLEAR = 50.0


@dataclass(frozen=True)
class ProposalSettings:
    """How proposals are simulated, and which of them are made.

    Parameters
    ----------
    draws : int
        Posterior draws of a model behind every forecast.
    glance : int
        Those of the first look at everything that the rig allows.
    closer : int
        Proposals looked at again with all draws.
    trials : int
        Simulated experiments with each model as the truth.
    wins : float, nats
        Log ratio from which on a simulated experiment counts as a success.
    changed_rig : float
        What a changed rig or another instrument must do more than what is there, as a part of it, to be worth its
        price.
    trace : TraceSettings
    """

    draws: int = 150
    glance: int = 40
    closer: int = 12
    trials: int = 200
    wins: float = 3.0
    changed_rig: float = 0.1
    trace: TraceSettings = field(default_factory=TraceSettings)


@dataclass(frozen=True)
class Proposal:
    """A measurement.

    Parameters
    ----------
    text : str
    waveform : str
    frequency_hz, amplitude_v : list of float
    constants : dict
        Changed constants of the rig, SI; empty for none.
    separation : float
        Expected gain of the right model in log odds (nats) against all others, the least over the models that may be
        right; for one model alone, the expected fall of a weakly determined parameter's log standard deviation.
    success : float, optional
        Share of simulated experiments in which the right model wins by three nats; None for one model alone.
    error : float
        Standard error of the separation.
    pairs : list of Pair
        How far it separates each two of the models; empty for one model alone.
    drive : dict
        What else the drive has of a group's keys, such as `bias_v`, or `drive`, the file of a table; empty for a plain
        waveform.
    observable : str, optional
        What is to be read, where that is not the first of what launches were read for, or else launch ranges.
    other : bool
        Whether that was not read before.
    time_us : list of float, optional
        Samples of a trace, from the start of the drive; its one launch has one frequency and one amplitude.
    """

    text: str
    waveform: str
    frequency_hz: list[float]
    amplitude_v: list[float]
    constants: dict[str, float]
    separation: float
    success: float | None
    error: float
    pairs: list[Pair] = field(default_factory=list)
    drive: dict[str, Any] = field(default_factory=dict)
    observable: str | None = field(default=None, metadata=ABSENT)
    time_us: list[float] | None = field(default=None, metadata=ABSENT)
    other: bool = field(default=False, metadata=ABSENT)

    @property
    def n_readings(self) -> int:
        """Number of launches, or of the samples of a trace."""
        return len(self.time_us or self.frequency_hz)

    @property
    def counted(self) -> float:
        """The separation as far as it counts: single log ratios count up to a limit."""
        return min(self.separation, 0.9 * CLEAR)

    @property
    def lead(self) -> str:
        """The separation with its error."""
        if self.separation > self.counted:
            return f"over {self.counted:.0f} nats"
        return f"{fixed(self.separation, 1)} +- {fixed(self.error, 1)} nats"

    @property
    def needs(self) -> tuple[str, ...]:
        """What has to be had for it: constants that are changed, and an observable that was not read before."""
        return (*sorted(self.constants), *([self.observable or ""] if self.other else []))

    @property
    def as_it_is(self) -> bool:
        """Whether it needs neither another rig nor another instrument."""
        return not self.needs

    def does_more_than(self, other: Proposal) -> bool:
        """Whether it does more than another by a part of what it does, and by more than both err."""
        error = 2 * math.hypot(self.error, other.error)
        return self.separation - other.separation > max(ProposalSettings.changed_rig * self.separation, error)

    def measured(self, problem: Problem) -> int:
        """Number of what is to be read, as `psafit.observables.OBSERVABLES` counts."""
        named = [k for k, o in enumerate(OBSERVABLES) if o.name == self.observable]
        return named[0] if named else problem.design.usually_measured


@dataclass(frozen=True)
class Pair:
    """How far a measurement separates two models.

    Parameters
    ----------
    first, second : list of str
        Causes.
    separation : float
        Nats, the smaller of the two ways round.
    """

    first: list[str]
    second: list[str]
    separation: float


@dataclass(frozen=True)
class Purpose:
    """What measurements are for.

    Parameters
    ----------
    kind : {"separate", "narrow", "explain"}
        To distinguish sets of causes, to determine a parameter, or to show what a misfit follows.
    sets : list of lists of str
        The first is to be distinguished from the others.
    parameter : str
        To be determined.
    explanations : list of Explanation, optional
        What the misfit may follow, the most probable first.
    """

    kind: Literal["separate", "narrow", "explain"]
    sets: list[list[str]] = field(default_factory=list)
    parameter: str = ""
    explanations: list[Explanation] | None = field(default=None, metadata=ABSENT)

    def say(self, words: Words) -> str:
        """Return the purpose in words, without what the sets to be distinguished share."""
        if self.kind == "narrow":
            means = f" ({known})" if (known := meaning(self.parameter)) else ""
            return words.put("determines {}{}", words.parameter(self.parameter), means)
        if self.explanations:
            each = (words.put("{} ({})", KINDS[e.kind], words.per_cent(e.probability)) for e in self.explanations)
            return words.put("shows whether what is left {}", words.joined(" or ", each))
        shared = set.intersection(*map(set, self.sets))
        if any(shared.issuperset(ids) for ids in self.sets):  # one holds nothing else
            shared = set()
        one, *rest = (words.causes([id for id in ids if id not in shared]) for ids in self.sets)
        apart = " (apart from what they share)" if shared else ""
        return words.put("separates {} from {}{}", one, words.listed(rest), apart)


@dataclass(frozen=True)
class NextExperiment:
    """Measurements to make next.

    Parameters
    ----------
    about : str
        The purpose in words; empty where nothing is proposed.
    proposals : list of Proposal
        Best first.
    purpose : Purpose, optional
    weak : bool, optional
        Of a parameter to be determined: whether the readings leave it at least half as wide as its prior.
    rehearsals : list of Rehearsal, optional
    """

    about: str = ""
    proposals: list[Proposal] = field(default_factory=list)
    purpose: Purpose | None = field(default=None, metadata=ABSENT)
    weak: bool | None = field(default=None, metadata=ABSENT)
    rehearsals: list[Rehearsal] | None = field(default=None, metadata=ABSENT)

    @classmethod
    def of(
        cls, found: Sequence[Proposal], purpose: Purpose, weak: bool | None = None, *, most: int = 5
    ) -> NextExperiment:
        """Return the best of some proposals, `most` of them, one that leaves the rig as it is among them.

        Those that are worth the measurement come first. What needs a changed rig or another instrument is left out
        unless it does more than what needs neither, or is worth the measurement alone. A second one of what needs the
        same is there only where what needs something else leaves room.
        """
        every = cls(purpose.say(PLAIN), list(found), purpose, weak)
        worth = every.worth_measuring
        ranked = sorted(found, key=lambda p: not worth(p))
        # The first in rank, not the largest: what is reported had no part in the ranking.
        here = next((p for p in ranked if p.as_it_is), None)
        if here:
            ranked = [p for p in ranked if p.as_it_is or p.does_more_than(here) or worth(p) > worth(here)]
        best = _best_of_each_need(ranked, lambda p: p.needs)
        chosen = sorted(ranked, key=lambda p: (p is not here, p not in best))[:most]
        return replace(every, proposals=[p for p in ranked if p in chosen])

    @property
    def separates(self) -> bool:
        """Whether the proposals are to distinguish models or explanations, not to narrow a parameter."""
        return self.purpose is not None and self.purpose.kind != "narrow"

    @property
    def recommended(self) -> Proposal | None:
        """The best of the proposals if it is worth the measurement."""
        best = next(iter(self.proposals), None)
        return best if best and self.worth_measuring(best) else None

    def worth_measuring(self, proposal: Proposal, *, apart: float = 0.5, narrower: float = 0.1) -> bool:
        """Whether a proposal does more than its estimate errs, and enough.

        Parameters
        ----------
        proposal : Proposal
        apart : float, nats
            Separation from which on it is enough: odds half as large again.
        narrower : float, nats
            The same of a parameter to be determined: a standard deviation a tenth smaller.
        """
        return proposal.separation - 2 * proposal.error > (apart if self.separates else narrower)

    @property
    def as_good(self) -> int:
        """Number of other proposals that the first does not exceed by two standard errors, as far as nats count."""
        best, *others = self.proposals
        return sum(best.counted - p.counted <= 2 * math.hypot(best.error, p.error) for p in others)

    def promise(self, proposal: Proposal, words: Words = PLAIN) -> str:
        """Return what a proposal is expected to do, in words, and whether that is little."""
        about = self.purpose.say(words) if self.purpose else self.about
        if self.separates:
            does = words.put("{}, with an expected lead of {}", about, words.number(proposal.lead))
        else:
            fall = words.per_cent(-math.expm1(-proposal.separation))
            does = words.put("{}, whose standard deviation falls by about {}", about, fall)
        little = so_far = ""
        if not self.worth_measuring(proposal):
            little = ", hardly worth the measurement"
        elif self.separates and proposal.separation < ProposalSettings.wins:
            little = ", hardly enough to decide"
        if self.weak is not None:
            known = "no better than to" if self.weak else "to less than"
            so_far = f"; so far it is known {known} half its prior's width"
        return words.put("{}{}{}", does, little, so_far)


@dataclass(frozen=True)
class Rehearsal:
    """How a measurement did, in simulation.

    Parameters
    ----------
    proposal : str
        The measurement.
    truth : list of lists of str
        Causes that made the readings, once for each rehearsal.
    before, after : list of float
        Probability of the truth among the tied models, without and with the new readings, once for each rehearsal.
    first : int
        Rehearsals in which the truth came out first.
    """

    proposal: str
    truth: list[list[str]]
    before: list[float]
    after: list[float]
    first: int


# Separation, success and the separation's standard error, as `Proposal` holds them.
_Judgement = tuple[float, float | None, float]


def proposal_of(possible: Possible, found: _Judgement, usual: int = 0, pairs: Iterable[Pair] = ()) -> Proposal:
    """A measurement with what it would do; `usual` is what is read where nothing else is said."""
    d = possible.design
    drive, traced = d.drives[d.drive[0]], bool(d.traced.any())
    some = slice(0, 1) if traced else slice(None)
    separation, success, error = found
    return Proposal(
        possible.text, drive.waveform, d.frequency[some].tolist(), d.amplitude[some].tolist(), possible.changed,
        separation, success, error, list(pairs), drive.settings,
        None if d.measured[0] == usual else OBSERVABLES[d.measured[0]].name,
        np.round(d.time * 1e6, 9).tolist() if traced else None, possible.other,
    )  # fmt: skip


def possible_measurements(candidate: Candidate, settings: TraceSettings) -> list[Possible]:
    """Sweeps and traces that could be measured on the rig of a model, of what was read and what may be read, too."""
    problem, experiment = candidate.problem, candidate.problem.experiment
    rig = experiment.constants, experiment.groups, experiment.limits
    usual = problem.design.usually_measured
    found = proposals(*rig)
    read = set(problem.design.measured.tolist())
    may = may_be_read(experiment.readable, read)
    of = sorted((k for k in may if not OBSERVABLES[k].traced), key=lambda k: k != usual)
    of_launches = [p.reading(k, usual, read) for k in of for p in found if k == usual or not p.changed]
    theta = problem.theta(candidate.modes[:1], Occasions.one("a session to come"))

    def contact(design: Design) -> FloatArray:
        return contact_times(simulate(design, theta, problem.terms))[0]

    of_traces = [p for p in traces(*rig, contact, settings) if p.design.measured[0] in may]
    return [*of_launches, *(replace(p, other=p.design.measured[0] not in read) for p in of_traces)]


def separating(tied: Sequence[tuple[Candidate, ImportanceSample]], *, seed: int) -> list[Proposal]:
    """Measurements by how well they would separate two models or more; best first."""
    settings = ProposalSettings()
    rng = np.random.default_rng([seed, 17])
    possible, usual = possible_measurements(tied[0][0], settings.trace), tied[0][0].problem.design.usually_measured
    forecasts: list[list[PredictedReadings]] = []
    # A glance at all of them, then a closer look at the best.
    for n_draws in (settings.glance, settings.draws):
        models = [_Model.of(c, draws.resampled(n_draws), rng) for c, draws in tied]
        forecasts = [legible([one.forecast(p.design) for one in models], p) for p in possible]
        kept = best_of(possible, [separation_of(each, rng, settings)[0][0] for each in forecasts], settings.closer)
        possible, forecasts = [possible[k] for k in kept], [forecasts[k] for k in kept]
    found = []
    for p, each in zip(possible, forecasts, strict=True):
        # The best of several is best by luck, too: what is reported of them comes from other trials.
        judgement, apart = separation_of(each, rng, settings)
        ids = [list(c.ids) for c, _ in tied]
        two = itertools.combinations(range(len(tied)), 2)
        found.append(proposal_of(p, judgement, usual, [Pair(ids[i], ids[j], float(apart[i, j])) for i, j in two]))
    return found


def determine(best_model: Candidate, draws: ImportanceSample, *, seed: int) -> tuple[str, list[Proposal]]:
    """Measurements by how much they would narrow a weakly determined parameter, and which one that is; best first.

    It is the one of which a measurement can show most.
    """
    settings = ProposalSettings()
    rng = np.random.default_rng([seed, 17])
    possible, weak = possible_measurements(best_model, settings.trace), weakly_determined(best_model, draws)
    usual = best_model.problem.design.usually_measured
    model = _Model.of(best_model, draws.resampled(settings.glance), rng)
    falls = np.array([narrowing(legible([model.forecast(p.design)], p)[0], model.u[:, weak])[0] for p in possible])
    which = int(np.argmax(falls.max(axis=0)))
    possible = [possible[k] for k in best_of(possible, falls[:, which], settings.closer)]

    def judged(possible: Sequence[Possible], rows: FloatArray) -> list[Proposal]:
        model = _Model.of(best_model, rows, rng)
        found = [narrowing(legible([model.forecast(p.design)], p)[0], model.u[:, [weak[which]]]) for p in possible]
        each = zip(possible, found, strict=True)
        return [proposal_of(p, (float(f[0]), None, float(e[0])), usual) for p, (f, e) in each]

    every = draws.resampled(2 * settings.draws)
    ranked = best_of(possible, [p.separation for p in judged(possible, every[::2])], settings.closer)
    # As above, what is reported of them comes from other draws.
    found = judged([possible[k] for k in ranked], every[1::2])
    return best_model.problem.names[weak[which]], found


def explaining(
    explanations: Explanations,
    places: Iterable[tuple[GroupId, str, float, float]],
    *,
    seed: int,
) -> list[Proposal]:
    """Measurements by how well they would show what a misfit follows; best first.

    Parameters
    ----------
    explanations : Explanations
        To be distinguished.
    places : tuples of group id, "frequency" or "amplitude", and two ends
        Where the misfit stands out: it is measured again there, too.
    seed : int
    """
    settings = ProposalSettings()
    experiment = explanations.candidate.problem.experiment
    rig = experiment.constants, experiment.groups, experiment.limits
    design = explanations.candidate.problem.design
    usual, read = design.usually_measured, set(design.measured.tolist())
    possible = [p.reading(usual, usual, read) for p in (*near(*rig, places), *proposals(*rig))]
    laws = [explanations.ahead(p.design) for p in possible]

    def judged(k: int, rng: np.random.Generator) -> _Judgement:
        n = len(laws[k])
        return min(_judged(compared(laws[k], truth, settings.trials, rng), truth, settings)[0] for truth in range(n))

    first, second = (np.random.default_rng([seed, 17, k]) for k in range(2))
    kept = best_of(possible, [judged(k, first)[0] for k in range(len(possible))], settings.closer)
    # As above, what is reported of them comes from other trials.
    return [proposal_of(possible[k], judged(k, second), usual) for k in kept]


def best_of(possible: Sequence[Possible], separation: Sequence[float] | FloatArray, n: int) -> list[int]:
    """Indices of those worth a closer look, best first: the first `n`, and the best of what each needs."""
    order = sorted(range(len(possible)), key=lambda k: -separation[k])
    kept = {*order[:n], *_best_of_each_need(order, lambda k: possible[k].needs)}
    return [k for k in order if k in kept]


def _best_of_each_need(ranked: Sequence[_Item], needs: Callable[[_Item], tuple[str, ...]]) -> list[_Item]:
    """The first of what each needs, in their order."""
    found: dict[tuple[str, ...], _Item] = {}
    for one in ranked:
        found.setdefault(needs(one), one)
    return list(found.values())


def weakly_determined(best_model: Candidate, draws: ImportanceSample, *, share: float = 0.5) -> list[int]:
    """Indices of the physical parameters that the readings leave a `share` as wide as the prior, or wider.

    If there is none, of the widest. Spreads of sessions are left aside: more sessions determine those, not more
    readings.
    """
    ratio = _width_left(best_model, draws)
    return np.flatnonzero(ratio >= min(share, ratio.max())).tolist()


def is_weak(best_model: Candidate, draws: ImportanceSample, name: str, *, share: float = 0.5) -> bool:
    """Whether the readings leave a physical parameter a `share` as wide as its prior, or wider."""
    return bool(_width_left(best_model, draws)[best_model.problem.names.index(name)] >= share)


def _width_left(best_model: Candidate, draws: ImportanceSample, n_draws: int = ProposalSettings.draws) -> FloatArray:
    """What the readings leave of the priors' widths, (n_physical,); less than nothing for spreads of sessions."""
    problem = best_model.problem
    u = draws.resampled(n_draws)[:, : problem.n_physical]
    prior = 0.5 * problem.prior_widths[: problem.n_physical]
    hyper = {t.strength.name for t in best_model.terms if t.latent}
    return np.where([name in hyper for name in problem.names[: problem.n_physical]], -1.0, u.std(axis=0) / prior)


@dataclass(frozen=True, eq=False)
class _Model:
    """Posterior draws of a model in the columns that the simulator takes for a session to come."""

    problem: Problem
    theta: FloatArray  # (n_draws, n_columns)
    u: FloatArray  # the draws themselves, (n_draws, n_dim), no two equal
    weight: FloatArray  # (n_draws,)

    @classmethod
    def of(cls, candidate: Candidate, draws: FloatArray, rng: np.random.Generator) -> _Model:
        """Make the predictions of a model from equally weighted draws, (n_draws, n_dim)."""
        problem = candidate.problem
        # Without duplicates: leaving one draw out would otherwise keep its copy among the judges.
        u, counts = np.unique(draws, axis=0, return_counts=True)
        # What belongs to sessions is drawn from its prior, not taken over.
        theta = problem.theta(u, Occasions.one("a session to come"), rng)
        return cls(problem, theta, u, counts / len(draws))

    def forecast(self, design: Design) -> PredictedReadings:
        """What it says of a measurement."""
        measured = int(design.measured[0])
        sigma = self.problem.sigma_to_come(measured)
        return PredictedReadings(
            readings(design, self.theta, self.problem.terms),
            noise.along(self.problem.scatter_to_come(self.u, measured), design.elapsed),
            self.weight,
            None if sigma is None else np.array([sigma]),
            -math.inf if OBSERVABLES[measured].traced else 0.0,
        )


@dataclass(frozen=True, eq=False)
class PredictedReadings:
    """What a model's posterior draws say of a measurement."""

    ranges: FloatArray  # readings without scatter, in the observable's unit, (n_draws, n_points)
    scatter: FloatArray  # (n_draws, 3), of a trace (n_draws, 4, n_points)
    weight: FloatArray  # (n_draws,), adds up to one
    known: FloatArray | None = None  # likewise
    floor: float = 0.0  # what the instrument shows no less of

    def log_density(self, readings: FloatArray, but: NDArray[np.intp] | None = None) -> FloatArray:
        """Log density of each row of readings, the mean over the draws but one that may be left out; (n_rows,)."""
        each = noise.log_density(readings[:, None, :], self.ranges, self.scatter, self.known).sum(axis=2)
        weight = np.broadcast_to(self.weight, each.shape)
        if but is not None:
            own = but[:, None] == np.arange(self.weight.size)
            rest = 1.0 - self.weight[but][:, None]
            weight = np.where(rest > 0, np.where(own, 0.0, weight) / np.where(rest > 0, rest, 1.0), weight)
        return np.asarray(logsumexp(each, axis=1, b=weight))


def legible(models: Sequence[PredictedReadings], possible: Possible) -> list[PredictedReadings]:
    """What models say of a measurement, where the observable is read for sure: of a launch that fails some are not."""
    if not OBSERVABLES[possible.design.measured[0]].blank:
        return list(models)
    sure = np.all([(m.ranges > 0).all(axis=0) for m in models], axis=0)
    return [replace(m, ranges=m.ranges[:, sure]) for m in models]


def separation_of(
    models: Sequence[PredictedReadings], rng: np.random.Generator, settings: ProposalSettings
) -> tuple[_Judgement, FloatArray]:
    """What a measurement does for models, whichever of them is right, and for each two of them, (n, n)."""
    trials = [_trial(models, k, rng, settings) for k in range(len(models))]
    each = np.array([pairs for _, pairs in trials])
    return min(judgement for judgement, _ in trials), np.minimum(each, each.T)


def _trial(
    models: Sequence[PredictedReadings], truth: int, rng: np.random.Generator, settings: ProposalSettings
) -> tuple[_Judgement, FloatArray]:
    """Mean log ratio of predictive densities when one model makes the readings, how often it wins clearly, the error.

    Against all others together, which are equally likely; the means against each of them, (n,), come with it.
    """
    right = models[truth]
    chosen = rng.choice(len(right.ranges), settings.trials, p=right.weight)
    readings = np.maximum(noise.draw(right.ranges[chosen], right.scatter[chosen], right.known, rng), right.floor)
    # The draw that made the readings is not among those that judge them.
    own = right.log_density(readings, chosen)
    each = own - np.array([own if m is right else m.log_density(readings) for m in models])  # (n, trials)
    return _judged(each, truth, settings)


def _judged(each: FloatArray, truth: int, settings: ProposalSettings) -> tuple[_Judgement, FloatArray]:
    """Judge by the log ratios of the right model's density to those of all, (n, trials)."""
    ratio = math.log(len(each) - 1) - logsumexp(-np.delete(each, truth, axis=0), axis=0)
    clipped = np.clip(ratio, -CLEAR, CLEAR)
    error = float(clipped.std() / math.sqrt(settings.trials))
    judgement = float(clipped.mean()), float(np.mean(ratio > settings.wins)), error
    return judgement, np.clip(each, -CLEAR, CLEAR).mean(axis=1)


def narrowing(forecast: PredictedReadings, u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Expected fall of the log standard deviation of each parameter `u` (n_draws, n), and its standard error.

    By regression on the readings, judged by draws that it has not seen: sixteen readings explain anything of forty
    draws.
    """
    w = forecast.weight[:, None]
    s = np.sum(w * noise.scale(forecast.ranges, forecast.scatter, forecast.known), axis=0)
    shared = np.tensordot(forecast.weight, forecast.scatter, axes=1)[None]
    x = noise.whitened((forecast.ranges - np.sum(w * forecast.ranges, axis=0)) / s, shared)
    y = u - np.sum(w * u, axis=0)
    # The scatter of a reading has unit variance here, which is what a ridge of one stands for.
    solved = np.linalg.solve(x.T @ (w * x) + np.eye(x.shape[1]), (w * x).T)
    beta, leverage = solved @ y, np.einsum("ij,ji->i", x, solved)
    missed = ((y - x @ beta) / (1 - leverage)[:, None]) ** 2
    spread = np.sum(w * y**2, axis=0)
    known = spread > 0  # a parameter that all draws agree on has nothing to lose
    left = np.where(known, np.sum(w * missed, axis=0) + np.sum(beta**2, axis=0), 1.0) / np.where(known, spread, 1.0)
    error = np.sqrt(np.sum(w**2 * (missed - np.sum(w * missed, axis=0)) ** 2, axis=0)) / np.where(known, spread, 1.0)
    return -0.5 * np.log(np.clip(left, 1e-3, 1.0)), 0.5 * error / np.clip(left, 1e-3, None)


def proposed(waveform: str, settings: Mapping[str, Any], groups: Iterable[Conditions]) -> Drive:
    """The drive of a proposal to groups that hold the tables.

    Raises
    ------
    ValueError
        If none of them has the table.
    """
    if waveform != TABLE:
        return Drive.with_settings(waveform, settings)
    for group in groups:
        if group.drive.table and group.drive.settings == settings:
            return group.drive
    raise ValueError(f"no group has the drive {settings.get('drive')!r}")


def planned(proposal: Proposal, id: GroupId, measured: Experiment) -> Conditions:
    """The sweep that a proposal asks for, as a group of what was measured.

    In numbers that can be set on a generator, and with the readings' usual uncertainty where each states one.
    """
    f, v = (np.resize(_settable(x), proposal.n_readings) for x in (proposal.frequency_hz, proposal.amplitude_v))
    problem = Problem(measured, measured.ids)
    kind = proposal.measured(problem)
    usual = problem.sigma_to_come(kind)
    taken = {g.file.casefold() for g in measured.groups}
    names = itertools.chain(["planned.csv"], (f"planned{k}.csv" for k in itertools.count(2)))
    return Conditions(
        id,
        proposed(proposal.waveform, proposal.drive, measured.groups),
        next(name for name in names if name not in taken),
        f,
        v,
        changed=tuple(proposal.constants.items()),
        sigma=None if usual is None else np.full(f.size, usual),
        measured=np.full(f.size, kind, np.int8),
        time_us=None if proposal.time_us is None else _settable(proposal.time_us),
    )


def _settable(values: Sequence[float], fewest: int = 4, most: int = 6) -> FloatArray:
    """The fewest digits of each by which those that differ still do.

    None is beyond the least or the greatest by more than the last digits of its computation.
    """
    given = rounded = np.array(values)
    for digits in range(fewest, most + 1):
        rounded = np.array([float(f"{x:.{digits}g}") for x in values])
        if np.unique(rounded).size == np.unique(given).size:
            break
    within = np.clip(rounded, given.min(), given.max())
    return np.where(np.isclose(rounded, within, rtol=1e-9, atol=0.0), rounded, within)
