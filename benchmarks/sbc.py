"""`make sbc`: simulation-based calibration of the posteriors (Talts et al., arXiv:1804.06788), over sets of causes.

A data set is a joint draw: a set of causes from the prior over sets, parameters from their priors, readings from the
likelihood. Its model is fitted and sampled as a diagnosis does it. If fit, weights and draws are sound, these ranks of
the truth among the weighted draws are uniform:

- every parameter, those of causes pooled as strengths and others;
- the log likelihood and the log posterior, which see a mode that is missing (Modrak et al., arXiv:2211.02383);
- the mode on which the truth lies, where the draws have several.

From the truth, an exact draw of the posterior, an optimisation leads to its mode. Draws are made again with this mode:
what the log evidence gains is what the first draws lacked. A short chain begins at the truth, too. Where most of it
stays away from the draws, it is listed; a chain from a truth in a far tail does so, too. Nothing is selected: what
cannot be simulated is drawn again, and counted, and so is what cannot be sampled.

Results are kept in fits/sbc, one file a data set, for this state of the sources: a run that was broken off goes on.
They do not depend on the number of workers. Draws docs/figures/sbc.png, prints a p-value (Kolmogorov and Smirnov) and
the coverage of 50 and 90 % intervals, and exits with 1 if a p-value is below 0.05 divided by their number.

``--terms gap,preload`` takes these causes always, ``--terms ''`` none, ``--size 3`` any three. ``--sampler emcee``
draws as `psafit fit` does, by emcee until the chain has converged or has taken ``--steps``.
``--drawn clipped`` enters readings as an instrument shows them, rounded to 0.01 um and zero where scatter took them
below. ``--drawn asked`` takes strengths evenly from their bounds. Neither is a joint draw: they show what that costs.
"""

from __future__ import annotations

import argparse
import os

# A data set on each core.
if __name__ == "__main__":
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ.setdefault(name, "1")

import math
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import emcee
import numpy as np
from scipy.spatial import cKDTree
from scipy.stats import binom, kstest

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "benchmarks")]

from search_sets import get

from psafit.arrays import FloatArray
from psafit.errors import InputError, PsafitError
from psafit.experiment import Experiment, read_experiment
from psafit.files import digest, locked, sha256
from psafit.inference import noise
from psafit.inference.candidate import (
    Candidate,
    built_up,
    candidate_at,
    principal,
    separate_modes,
    united,
    within_bounds,
)
from psafit.inference.evidence import ImportanceSample, importance_sample, quantiles
from psafit.inference.memory import Memory, code
from psafit.inference.mixture import StudentMixture
from psafit.inference.optimiser import expansion, maximise, slopes
from psafit.inference.problem import Problem
from psafit.inference.sample import SampleSettings, sample
from psafit.inference.samplers import USUAL, sampler
from psafit.inference.sampling import Target
from psafit.model_search import SearchSettings
from psafit.model_search.fitter import ProblemFitter
from psafit.physics import TERMS, baseline, terms
from psafit.records import read_json, write_json
from psafit.report.style import PALETTE, figure_style
from psafit.workers import processes, reach, scratch, unordered


@dataclass(frozen=True)
class Plan:
    """What determines a data set and what is made of it, apart from its number and the code.

    Parameters
    ----------
    seed : int
    rig : str
        Data set of benchmarks/search_sets.jsonl whose conditions are used, or an experiment folder.
    groups : tuple of str
        Of its groups; all if empty.
    terms : str, optional
        Causes, comma separated; drawn from the prior over sets if None.
    size : int, optional
        Number of causes, if it is not drawn.
    sampler : {"evidence", "emcee"}
    steps : int
        Of emcee as the sampler, at most.
    drawn : {"joint", "clipped", "asked"}
        Joint draws; or what campaigns differ by, to see what it does: readings as an instrument shows them, or
        strengths of causes drawn evenly over their bounds, as if asked for.
    walkers, chain : int
        Walkers of the chain from the truth, at least, and its steps, of which the second half is kept.
    """

    seed: int = 1
    rig: str = "gap_and_slew"
    groups: tuple[str, ...] = ()
    terms: str | None = None
    size: int | None = None
    sampler: str = "evidence"
    steps: int = 8000
    drawn: str = "joint"
    walkers: int = 32
    chain: int = 80


@dataclass(frozen=True)
class Result:
    """What one data set says.

    Parameters
    ----------
    number : int
    causes : list of str
        Of the true model.
    redrawn : int
        Truths that could not be simulated.
    failed : str
        Why it could not be sampled; empty as a rule.
    ranks : dict
        Share of the posterior below the truth, of every parameter by its name, ``log_likelihood``, ``log_posterior``
        and, where the draws have several, ``mode``.
    away : float
        Share of the chain from the truth that is where there are no draws.
    level : float, nats
        Mean log posterior of the chain above that of the draws.
    differs : float
        Largest difference of the two medians of a parameter, in standard deviations of the draws.
    rise : float, nats
        Top of an optimisation from the truth above the top that was found.
    lacks, lacks_error : float, nats
        What the log evidence gains where that top is one of the modes that draws begin from, and the standard error of
        the difference, by the numbers of effective draws. (That of a sample also has what its looks may have missed:
        here it is measured.)
    effective, pareto_k : float
        Of the draws.
    cpu_s : float
        Of fit and draws; unlike all else not the same every time.
    """

    number: int
    causes: list[str]
    redrawn: int = 0
    failed: str = ""
    ranks: dict[str, float] = field(default_factory=dict)
    away: float = math.nan
    level: float = math.nan
    differs: float = math.nan
    rise: float = math.nan
    lacks: float = math.nan
    lacks_error: float = math.nan
    effective: float = math.nan
    pareto_k: float = math.nan
    cpu_s: float = math.nan

    @property
    def title(self) -> str:
        """Number and causes."""
        return f"{self.number} {','.join(self.causes) or '-'}"


@dataclass(frozen=True, eq=False)
class Signed(Problem):
    """A problem whose readings may be negative, as the likelihood has them."""

    readings: FloatArray | None = None

    @property  # a cached one has a lock, and could not be sent to workers
    def observed(self) -> FloatArray:
        assert self.readings is not None and self.readings.size == self.design.n_points
        return self.readings

    def thinned(self, every: int) -> Signed:
        numbered = self.experiment.with_readings(np.arange(self.design.n_points, dtype=float)).thinned(every)
        rows = np.concatenate([g.reading for g in numbered.groups]).astype(int)
        return replace(self, experiment=self.experiment.thinned(every), readings=self.observed[rows])


def conditions(plan: Plan) -> Experiment:
    """The experiment whose conditions are simulated."""
    folder = Path(plan.rig)
    experiment = read_experiment(folder) if folder.is_dir() else get(plan.rig).experiment
    if not plan.groups:
        return experiment
    return replace(experiment, groups=tuple(experiment.group(g) for g in plan.groups))


def truth(plan: Plan, number: int) -> tuple[Problem, FloatArray, int]:
    """A joint draw: the problem with its readings, the true coordinates, and how many draws came before it."""
    rng = np.random.default_rng([plan.seed, number])
    if plan.terms is None:
        if plan.size is None:
            ids = [t.id for t in TERMS if rng.random() < t.probability]
        else:
            ids = [TERMS[i].id for i in rng.choice(len(TERMS), size=plan.size, replace=False)]
    else:
        ids = [id for id in plan.terms.split(",") if id]
    experiment = conditions(plan)
    problem = Signed(experiment, experiment.ids, terms(ids), SearchSettings().tolerance)
    read, redrawn = np.array([math.nan]), -1
    asked = [problem.names.index(t.strength.name) for t in problem.terms] if plan.drawn == "asked" else []
    while not np.isfinite(read).all():
        u = problem.prior_transform(rng.uniform(size=(1, problem.n_dim)))
        u[0, asked] = rng.uniform(*problem.bounds[asked].T)
        read = noise.draw(problem.predict(u), problem.noise_values(u), problem.known_sigma, rng)[0]
        redrawn += 1
    if plan.drawn == "clipped":
        read = np.maximum(np.round(read, 2), 0.0) + 0.0
    # An experiment holds no negative readings: it has the magnitudes, and the problem what was read.
    return replace(problem, experiment=experiment.with_readings(np.abs(read)), readings=read), u[0], redrawn


def diagnosed(problem: Problem, seed: int) -> tuple[Candidate, ImportanceSample]:
    """Modes and draws as a diagnosis makes them: short fits from the best of the parts, then a sample."""
    fitter = ProblemFitter(replace(problem, terms=()), TERMS, SearchSettings(), seed, Memory(None))
    (best,) = fitter.short([()], {})
    while left := [id for id in problem.ids if id not in best.ids]:
        larger = [tuple(t.id for t in terms([*best.ids, id])) for id in left]
        best = max(fitter.short(larger, {best.ids: best}), key=lambda model: model.log_evidence)
    found = fitter.sample(best).content
    assert found.draws is not None
    return found.candidate, found.draws


def fitted(problem: Problem, seed: int, steps: int) -> tuple[Candidate, ImportanceSample]:
    """Modes and draws as `psafit fit` makes them; Pareto's k is infinite where the chain has not converged."""
    known, own = [built_up(problem, seed=seed)] if problem.terms else [], sampler(USUAL)
    found, draws = sample(problem, known, seed=seed, settings=SampleSettings.of())
    with scratch() as folder:
        target = Target(found, draws, seed, folder / "chain.h5", "")
        chain = own.draw(target, replace(own.settings(problem), max_steps=steps), lambda state: None)
    flat = chain.draws.reshape(-1, problem.n_dim)
    log_posterior = problem.log_posterior(flat)
    top = int(np.argmax(log_posterior))
    k = 0.0 if chain.converged else math.inf
    same = np.full(len(flat), 1 / len(flat))
    return found, ImportanceSample(
        flat, same, math.nan, math.nan, float(len(flat)), k, flat[top], float(log_posterior[top])
    )


def below(values: FloatArray, weights: FloatArray, true: FloatArray) -> FloatArray:
    """Share of the draws below the truth; `values` is (n, k), the result (k,)."""
    return np.asarray(weights @ (values < true))


def ranked(
    problem: Problem, found: Candidate, draws: ImportanceSample, u: FloatArray, random: float
) -> dict[str, float]:
    """Ranks of a truth; `random`, between 0 and 1, is its place on its mode."""
    ranks = dict(zip(problem.names, below(draws.draws, draws.weights, u).tolist(), strict=True))
    rows = np.vstack([u, draws.draws])
    likelihood = problem.log_likelihood(rows)
    for name, value in (("log_likelihood", likelihood), ("log_posterior", likelihood + problem.log_prior(rows))):
        ranks[name] = float(below(value[1:, None], draws.weights, value[:1])[0])
    tops = separate_modes(found)
    if len(tops) > 1:
        parts = [(found.modes[k], found.covariance[k], 1.0) for k in tops]
        mode = np.argmax(StudentMixture.of(parts).each(rows), axis=0)
        share = np.bincount(mode[1:], draws.weights, len(tops))
        ranks["mode"] = float(share[: mode[0]].sum() + random * share[mode[0]])
    return ranks


def chain_from(problem: Problem, u: FloatArray, walkers: int, steps: int, seed: int) -> FloatArray:
    """Draws of a short chain that begins at an exact draw of the posterior; (n, n_dim).

    One walker stands at the draw. The others are spread about it by the curvature there.
    """
    random = np.random.default_rng([seed, 7])
    predicted = problem.predict(u[None])
    slope = slopes(problem, u[None], predicted)
    _, curvature = expansion(problem, u[None], predicted, slope, problem.observed[None])
    root = np.linalg.cholesky(np.linalg.inv(within_bounds(problem, curvature[0])))
    n = max(walkers, 2 * problem.n_dim + 2)
    start = np.repeat(u[None], n, axis=0)
    low, high = problem.bounds.T
    least = problem.log_posterior(u[None])[0] - problem.n_dim
    for shrink in 0.7 ** np.arange(20):  # until each is about as probable as the draw
        near = np.clip(u + shrink * random.standard_normal((n, u.size)) @ root.T, low, high)
        poor = ~(start != u).any(axis=1)
        poor[0] = False
        if not poor.any():
            break
        start[poor] = np.where((problem.log_posterior(near[poor]) > least)[:, None], near[poor], u)
    moves = [(emcee.moves.DEMove(), 0.8), (emcee.moves.DEMove(gamma0=1.0), 0.1), (emcee.moves.DESnookerMove(), 0.1)]
    sampler = emcee.EnsembleSampler(n, u.size, problem.log_posterior, moves=moves, vectorize=True)
    sampler.random_state = np.random.RandomState(seed % 2**32).get_state()  # its own seed, else the global one
    sampler.run_mcmc(start, steps, skip_initial_state_check=True)
    return np.asarray(sampler.get_chain(discard=steps // 2, thin=5, flat=True))


def compared(chain: FloatArray, draws: ImportanceSample) -> tuple[float, float]:
    """`Result.away` and `Result.differs`.

    A place holds no draws if it is further from the nearest one than 99 % of the draws are from each other, in
    coordinates in which they have unit covariance.
    """
    centre = draws.weights @ draws.draws
    apart = draws.draws - centre
    covariance = (apart * draws.weights[:, None]).T @ apart
    width = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(width, width))
    whiten = vectors / np.sqrt(np.maximum(values, 1e-6))
    ours = np.unique(draws.resampled(500), axis=0)
    tree = cKDTree((ours - centre) / width @ whiten)
    usual = np.quantile(tree.query(tree.data, k=2)[0][:, 1], 0.99)
    away = float(np.mean(tree.query((chain - centre) / width @ whiten)[0] > usual))
    median = quantiles(draws.draws, draws.weights, [0.5])[0]
    return away, float(np.max(np.abs(np.median(chain, axis=0) - median) / width))


def lacking(found: Candidate, draws: ImportanceSample, own: Candidate, seed: int) -> tuple[float, float]:
    """`Result.lacks` and its error, by the mode `own` of the truth; nan of draws that give no evidence."""
    if math.isnan(draws.log_evidence):
        return math.nan, math.nan
    both = importance_sample(principal(united(found, own)), seed=seed)
    return both.log_evidence - draws.log_evidence, math.sqrt(1 / both.effective + 1 / draws.effective)


def solve(plan: Plan, number: int) -> Result:
    """Make one data set, sample its model, and rank the truth."""
    problem, u, redrawn = truth(plan, number)
    result = Result(number, list(problem.ids), redrawn)
    begun = time.process_time()
    try:
        found, draws = diagnosed(problem, number) if plan.sampler == "evidence" else fitted(problem, number, plan.steps)
        seconds = time.process_time() - begun
        own = candidate_at(problem, maximise(problem, u[None]).u)
        lacks, lacks_error = lacking(found, draws, own, number)
    except PsafitError as error:
        return replace(result, failed=str(error))
    chain = chain_from(problem, u, plan.walkers, plan.chain, number)
    away, differs = compared(chain, draws)
    level = problem.log_posterior(chain).mean() - draws.weights @ problem.log_posterior(draws.draws)
    return replace(
        result,
        ranks=ranked(problem, found, draws, u, np.random.default_rng([plan.seed, number, 3]).uniform()),
        away=away,
        level=float(level),
        differs=differs,
        rise=own.log_posterior - max(draws.log_posterior, found.log_posterior),
        lacks=lacks,
        lacks_error=lacks_error,
        effective=draws.effective,
        pareto_k=draws.pareto_k,
        cpu_s=round(seconds, 2),
    )


def sent(plan: Plan, number: int) -> dict[str, Any]:
    """A result as workers send it: classes of a script would come back as others of the same name."""
    return asdict(solve(plan, number))


def results(plan: Plan, wanted: Iterable[int], folder: Path, jobs: int, scheduler: str | None = None) -> list[Result]:
    """Results of data sets, those that the folder has not yet worked out by workers."""
    numbers = list(wanted)
    if scheduler is not None:
        reach(scheduler)
    with locked(folder):
        files = {n: folder / f"{n:04d}.json" for n in numbers}
        left = [n for n, file in files.items() if not file.exists()]
        with processes(jobs, scheduler) as usable:
            for done, result in enumerate(unordered(usable, sent, ((plan, n) for n in left)), 1):
                write_json(files[result["number"]], Result(**result), sealed=True)
                print(f"\r{len(numbers) - len(left) + done} of {len(numbers)}", end="", file=sys.stderr, flush=True)
    # Read back: the same to the last digit whether fresh or of an earlier run.
    return [read_json(file, Result, sealed=True, remedy="remove it and repeat") for file in files.values()]


# --- the summary ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Coverage:
    """How often a central interval holds the truth; `error` is the standard error between data sets."""

    level: float
    share: float
    error: float

    def __str__(self) -> str:
        return f"{self.level:.0%}: {self.share:6.1%} +- {self.error:.1%}"


def coverage(ranks: Sequence[Sequence[float]], level: float) -> Coverage:
    """Coverage of central intervals; `ranks` has those of each data set, of which some may have none."""
    held = [np.abs(np.array(of) - 0.5) < level / 2 for of in ranks if len(of)]
    share = np.concatenate(held).mean() if held else math.nan
    # Ranks of one data set hang together: the error is that of a ratio of sums over data sets.
    off = [np.sum(h - share) for h in held]
    n = sum(map(len, held))
    # At least what a binomial count expects: few data sets may agree by chance.
    expected = math.sqrt(level * (1 - level) * len(held)) * n / len(held) if held else math.nan
    return Coverage(level, float(share), max(float(np.linalg.norm(off)), expected) / n if n else math.nan)


OF_ALL = ("log_likelihood", "log_posterior", "mode")
"""Ranks that are not of a parameter."""


def kind(name: str) -> str:
    """What a rank is counted with: a cause's strength, another parameter of causes, or itself."""
    if name in {p.name for p in (*baseline.PARAMETERS, *noise.PARAMETERS)} | {
        "log_likelihood",
        "log_posterior",
        "mode",
    }:
        return name
    return "strength" if name in {t.strength.name for t in TERMS} else "other of causes"


KINDS = (
    *(p.name for p in baseline.PARAMETERS), "strength", "other of causes", *(p.name for p in noise.PARAMETERS),
    *OF_ALL,
)  # fmt: skip


def by_kind(found: Sequence[Result]) -> dict[str, list[list[float]]]:
    """Ranks of each kind, data set by data set."""
    return {k: [[rank for name, rank in r.ranks.items() if kind(name) == k] for r in found] for k in KINDS}


def uniform(ranks: Sequence[Sequence[float]]) -> float:
    """p-value of their uniformity by Kolmogorov and Smirnov; 1 if there are none."""
    flat = [rank for of in ranks for rank in of]
    return float(kstest(flat, "uniform").pvalue) if flat else 1.0


def parameters_of(result: Result) -> list[float]:
    """Ranks of the parameters alone."""
    return [rank for name, rank in result.ranks.items() if name not in OF_ALL]


def lost(found: Sequence[Result], share: float = 0.1, errors: float = 2.0) -> list[Result]:
    """Data sets whose draws lack more than a share of the posterior, by so many standard errors."""
    least = -math.log1p(-share)
    return [r for r in found if r.lacks > max(least, errors * r.lacks_error)]


def unsure(found: Sequence[Result], error: float = 0.2) -> list[Result]:
    """Data sets whose `lacks` has too large an error to judge, or was not measured."""
    return [r for r in found if not r.lacks_error <= error]


def astray(found: Sequence[Result], share: float = 0.5) -> list[Result]:
    """Data sets of which most of a chain from the truth stays where there are no draws."""
    return [r for r in found if r.away > share]


def beyond(found: Sequence[Result], share: float = 1e-3) -> list[tuple[Result, list[str]]]:
    """Data sets with a truth in the outermost parts of its draws: tails that end too early, or a mode that is missing.

    Of sound ranks one in 500 lies there, and more where the draws are few: see `expected_beyond`.
    """
    outer = {
        r.number: [name for name, rank in r.ranks.items() if name not in OF_ALL and abs(rank - 0.5) > 0.5 - share]
        for r in found
    }
    return [(r, outer[r.number]) for r in found if outer[r.number]]


def expected_beyond(found: Sequence[Result], share: float = 1e-3) -> float:
    """Truths that `beyond` has of exact draws, as many as are effective: n of them have none below one in n + 1."""
    return float(sum(len(parameters_of(r)) * 2 * max(share, 1 / (r.effective + 1)) for r in found))


def summary(found: Sequence[Result]) -> tuple[str, float]:
    """What was found, in words, and the smallest p-value times the number of them."""
    sampled = [r for r in found if not r.failed]
    worst = 1.0
    lines = [f"{'':16}{'ranks':>6}{'p':>8}"]
    for name, ranks in by_kind(sampled).items():
        n, p = sum(map(len, ranks)), uniform(ranks)
        worst = min(worst, p * len(KINDS))
        lines.append(f"{name:16}{n:6}{p:8.3f}   {coverage(ranks, 0.5)}   {coverage(ranks, 0.9)}")
    lines.append("all parameters, by number of causes:")
    for size in sorted({len(r.causes) for r in sampled}):
        some = [parameters_of(r) for r in sampled if len(r.causes) == size]
        lines.append(f"{size:3} ({len(some)} data sets) {'':12}{coverage(some, 0.5)}   {coverage(some, 0.9)}")
    every = [parameters_of(r) for r in sampled]
    lines.append(f"all ({len(every)} data sets) {'':12}{coverage(every, 0.5)}   {coverage(every, 0.9)}")
    lines.append(
        f"drawn again, for they could not be simulated: {sum(r.redrawn for r in found)}; "
        f"not sampled: {len(found) - len(sampled)}; Pareto's k above 0.7: {sum(r.pareto_k > 0.7 for r in sampled)}; "
        f"fewer than 100 effective draws: {sum(r.effective < 100 for r in sampled)}; "
        f"CPU seconds of one: {np.mean([r.cpu_s for r in sampled] or [math.nan]):.2f}"
    )
    lines += [f"  {r.title}: {r.failed}" for r in found if r.failed]
    higher = [r for r in sampled if r.rise > SearchSettings().better]
    better = SearchSettings().better
    lines.append(f"an optimisation from the truth ends higher by more than {better} nats: {len(higher)}")
    lines += [f"  {r.title}: {r.rise:.1f} nats" for r in higher]
    tails = beyond(sampled)
    n, some = sum(len(names) for _, names in tails), sum(map(len, every))
    lines.append(
        f"truths in the outermost thousandths of their draws: {n} of {some}, "
        f"{expected_beyond(sampled):.1f} expected of as many exact draws"
    )
    lines += [f"  {r.title}: {', '.join(names)}" for r, names in tails]
    lines.append(f"the draws lack more than a tenth of the posterior: {len(lost(sampled))}")
    lines += [
        f"  {r.title}: {-math.expm1(-r.lacks):.0%}, {r.lacks:.2f} +- {r.lacks_error:.2f} nats of evidence"
        for r in lost(sampled)
    ]
    lines.append(f"what they lack is not known to a fifth of a nat: {len(unsure(sampled))}")
    lines += [f"  {r.title}: {r.lacks:.2f} +- {r.lacks_error:.2f} nats" for r in unsure(sampled)]
    lines.append(f"most of a chain from the truth stays where there are no draws: {len(astray(sampled))}")
    lines += [
        f"  {r.title}: {r.away:.0%} of the chain, level {r.level:+.1f} nats, {r.differs:.1f} standard deviations apart"
        for r in astray(sampled)
    ]
    return "\n".join(lines), worst


def draw(found: Sequence[Result], out: Path, bins: int = 10) -> None:
    """One panel a kind of rank: how often the truth had which."""
    panels = {name: [x for of in ranks for x in of] for name, ranks in by_kind(found).items()}
    panels = {name: flat for name, flat in panels.items() if flat}
    edges = np.linspace(0, 1, bins + 1)
    with figure_style():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(9.6, 2.3 * math.ceil(len(panels) / 3)), layout="constrained")
        axes = figure.subplots(math.ceil(len(panels) / 3), 3, squeeze=False).flat
        for (name, flat), ax in zip(panels.items(), axes, strict=False):
            counts, _ = np.histogram(flat, edges)
            ax.axhspan(*binom.ppf([0.005, 0.995], len(flat), 1 / bins), color=PALETTE["faint"])
            ax.stairs(counts, edges, color=PALETTE["blue"], fill=False, linewidth=1.8)
            ax.set(title=f"{name.replace('log_', 'log ')}, p = {kstest(flat, 'uniform').pvalue:.2f}", xlim=(0, 1))
            ax.set_ylim(bottom=0)
        for ax in list(axes):
            ax.set_visible(False)
        figure.supxlabel("rank of the truth among the draws")
        figure.supylabel("truths")
        out.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(out, dpi=150)


def main() -> int:
    """Calibrate, draw, judge."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    usual = Plan()
    options.add_argument("-n", type=int, default=500, help="data sets")
    options.add_argument("--seed", type=int, default=usual.seed)
    options.add_argument("--experiment", dest="rig", default=usual.rig, help="folder, or a stored data set's name")
    options.add_argument("--group", default="", help="of its groups, these: 1,2,3")
    options.add_argument("--terms", help="causes added to the baseline; by default drawn from the prior over sets")
    options.add_argument("--size", type=int, help="number of causes, where that is not drawn")
    options.add_argument("--sampler", choices=["evidence", "emcee"], default=usual.sampler)
    options.add_argument("--steps", type=int, default=usual.steps, help="of --sampler emcee, at most")
    options.add_argument("--drawn", choices=["joint", "clipped", "asked"], default=usual.drawn)
    options.add_argument("--jobs", type=int, default=2, help="processes")
    options.add_argument("--scheduler", metavar="ADDRESS", help="Dask scheduler that shares the work out")
    options.add_argument("--folder", type=Path, default=ROOT / "fits" / "sbc", help="where results are kept")
    options.add_argument("--out", type=Path, default=ROOT / "docs" / "figures" / "sbc.png")
    given = options.parse_args()
    groups = tuple(g for g in given.group.split(",") if g)
    plan = Plan(given.seed, given.rig, groups, given.terms, given.size, given.sampler, given.steps, given.drawn)
    identity = digest([code(), sha256(Path(__file__)), repr(plan), conditions(plan).fingerprint])[:12]
    try:
        found = results(plan, range(given.n), given.folder / identity, given.jobs, given.scheduler)
    except InputError as error:
        print(f"sbc: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("sbc: interrupted; repeat the same command to go on where it stopped", file=sys.stderr)
        return 2
    text, worst = summary(found)
    draw([r for r in found if not r.failed], given.out)
    sound = worst > 0.05
    print(f"\n{text}\n{'sound' if sound else 'NOT sound'}: smallest p, times their number: {worst:.3f}")
    return 0 if sound else 1


if __name__ == "__main__":
    sys.exit(main())
