r"""How often is such a verdict right here? Posterior simulation-based calibration of the whole diagnosis.

Data sets are drawn from what a diagnosis reports: a model :math:`M` by its probability, its parameters and scatter from
their posterior, and readings at the user's own conditions,

.. math:: M \sim p(M \mid y), \qquad \theta \sim p(\theta \mid M, y), \qquad \tilde y \sim p(\tilde y \mid \theta, M).

Each is diagnosed by the same search and judged by the same rules. What made it is known, so that it can be counted how
often it is named or reported, what printed probabilities are worth, and how often 90 % intervals hold the truth (A.
Gelman et al., Bayesian Workflow, arXiv:2011.01808, section 4; M. Modrák et al., Bayesian Analysis 20 (2025) 461).

The truths drawn have names: what no cause describes is not among them. Of an unexplained verdict they are the best
models of the catalogue, none of which explains the readings.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial

import numpy as np

from psafit.arrays import FloatArray
from psafit.diagnose.judging import judge
from psafit.diagnose.searching import searched
from psafit.diagnose.settings import Settings
from psafit.diagnose.trials import Calibration, Trial, stands, summed
from psafit.experiment import Experiment
from psafit.inference import noise
from psafit.inference.memory import Memory, shared_out
from psafit.inference.problem import Problem
from psafit.model_search import ModelSet
from psafit.physics.term import Term
from psafit.records import plain


@dataclass(frozen=True, eq=False)
class Truth:
    """What makes a data set: causes, values by parameter, and the readings, (n_points,)."""

    ids: tuple[str, ...]
    values: dict[str, float]
    readings: FloatArray


def drawn(model_set: ModelSet, n: int, *, seed: int) -> list[Truth]:
    """Draw data sets from a model set's posterior; the first of them do not depend on how many are asked for."""
    ids = list(model_set.probability)
    shares = np.array([model_set.probability[i] for i in ids])
    chosen = [ids[np.random.default_rng([seed, 37, k]).choice(len(ids), p=shares / shares.sum())] for k in range(n)]
    posterior = {i: model_set.draws(i, seed) for i in dict.fromkeys(chosen)}
    found = []
    for k, one in enumerate(chosen):
        rng, problem, draws = np.random.default_rng([seed, 41, k]), model_set.of(one).problem, posterior[one]
        u = draws.draws[rng.choice(len(draws.draws), size=1, p=draws.weights)]
        made = noise.draw(problem.predict(u), problem.noise_values(u), problem.known_sigma, rng)[0]
        values = dict(zip(problem.names, problem.to_physical(u)[0].tolist(), strict=True))
        found.append(Truth(one, values, np.maximum(made, problem.floor)))
    return found


def calibrate(
    model_set: ModelSet,
    catalogue: Sequence[Term],
    n: int,
    *,
    seed: int,
    memory: Memory,
    settings: Settings,
    jobs: int = 1,
    scheduler: str | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Calibration:
    """Draw data sets from an answer, and diagnose each.

    Parameters
    ----------
    model_set : ModelSet
        Of the measured readings.
    catalogue : sequence of Term
        Causes that were looked at.
    n : int
        Data sets.
    seed : int
    memory : Memory
        Data sets that are there already are not diagnosed again.
    settings : Settings
        Of the diagnosis.
    jobs : int
        Processes that share the data sets, where the memory lasts.
    scheduler : str, optional
        Address of a Dask scheduler whose workers share them instead.
    progress : callable
        Called with (data sets done, data sets).

    Returns
    -------
    Calibration
    """
    again = partial(
        _again, experiment=model_set.baseline.problem.experiment, groups=model_set.baseline.problem.group_ids,
        catalogue=catalogue, seed=seed, settings=settings,
    )  # fmt: skip
    truths = drawn(model_set, n, seed=seed)
    trials = shared_out(again, memory, truths, jobs=jobs, scheduler=scheduler, progress=progress)
    progress(n, n)
    return summed(trials)


def _again(
    memory: Memory,
    truth: Truth,
    *,
    experiment: Experiment,
    groups: tuple[object, ...],
    catalogue: Sequence[Term],
    seed: int,
    settings: Settings,
) -> Trial:
    """Diagnose one data set, unless the memory has it."""
    problem = Problem(experiment.with_readings(truth.readings), groups)  # type: ignore[arg-type]

    def make() -> dict[str, np.ndarray]:
        found = json.dumps(plain(tried(problem, truth, catalogue, seed, settings)))
        return {"trial": np.frombuffer(found.encode(), np.uint8)}

    about = [seed, asdict(settings), [t.determinants for t in catalogue], list(truth.ids), truth.values]
    return Trial(**json.loads(bytes(memory.recall("calibration", problem, about, make)["trial"])))


def tried(problem: Problem, truth: Truth, catalogue: Sequence[Term], seed: int, settings: Settings) -> Trial:
    """Search and judge, as the diagnosis does."""
    model_set = searched(problem, catalogue, seed=seed, settings=settings.search)
    judgement = judge(model_set, catalogue, settings, seed=seed)
    verdict, adopted = judgement.verdict, judgement.adopted
    draws = model_set.draws(adopted.ids, seed)
    lower, upper = draws.quantiles(adopted.problem.to_physical(draws.draws), (0.05, 0.95))
    names = adopted.problem.names[: adopted.problem.n_physical]
    shared = [k for k, name in enumerate(names) if name in truth.values]
    return Trial(
        truth=list(truth.ids),
        verdict=verdict.verdict,
        named=list(verdict.named),
        alternatives=[list(ids) for ids in verdict.alternatives],
        printed=verdict.probability[adopted.ids] if stands(verdict.verdict, verdict.unexplained_by) else None,
        held=sum(bool(lower[k] <= truth.values[names[k]] <= upper[k]) for k in shared),
        intervals=len(shared),
        why=verdict.unexplained_by,
    )
