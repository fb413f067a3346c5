"""How often the whole search finds as much where nothing is hidden.

Probabilities of models rest on priors and on a likelihood; a search through thousands of combinations also has its
luck. So readings are simulated from the fitted baseline, the whole search is run on them, and the best of all models
with causes that it finds is compared with what it found in the measured readings.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from psafit.diagnose.misfit import passes
from psafit.inference import noise
from psafit.inference.candidate import Candidate
from psafit.inference.memory import Memory
from psafit.model_search import Ladder, SearchSettings, climb
from psafit.physics.term import Term
from psafit.workers import ahead


@dataclass(frozen=True)
class Significance:
    """The best model with causes against the baseline, in measured readings and in simulated ones.

    Parameters
    ----------
    lead : float
        Log posterior odds of the best model with causes against the baseline, nats.
    null : list of float
        The same for each set of readings simulated from the fitted baseline.
    p_value : float
        Share of the searches, the measured one counted in, that find at least as much.
    """

    lead: float
    null: list[float]
    p_value: float


def lead(ladder: Ladder) -> float:
    """Log posterior odds of the best model with causes against the baseline, nats."""
    worth = {ids: value + ladder.log_prior(ids) for ids, value in ladder.log_evidence.items()}
    return max(value for ids, value in worth.items() if ids) - worth[()]


def significance(
    ladder: Ladder,
    catalogue: Sequence[Term],
    n_searches: int,
    *,
    seed: int,
    memory: Memory,
    settings: SearchSettings | None = None,
    jobs: int = 1,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Significance:
    """Repeat the search on readings simulated from the fitted baseline.

    Parameters
    ----------
    ladder : Ladder
        Of the measured readings.
    catalogue : sequence of Term
    n_searches : int
        Repetitions; the p-value is at least ``1 / (n_searches + 1)``.
    seed : int
    memory : Memory
        Repetitions already there are not run again.
    settings : SearchSettings, optional
        Those of the search.
    jobs : int
        Processes that share the repetitions, where the memory lasts.
    progress : callable
        Called with (repetitions done, repetitions).

    Returns
    -------
    Significance
    """
    settings = settings or SearchSettings()
    baseline, own = ladder.baseline, lead(ladder)
    if memory.lasts:
        ahead(_again, [(baseline, catalogue, seed, memory, settings, k) for k in range(n_searches)], jobs, progress)
    null = []
    for k in range(n_searches):
        progress(k, n_searches)
        null.append(_again(baseline, catalogue, seed, memory, settings, k))
    return Significance(own, null, (1 + sum(x >= own for x in null)) / (n_searches + 1))


def _again(
    baseline: Candidate, catalogue: Sequence[Term], seed: int, memory: Memory, settings: SearchSettings, k: int
) -> float:
    """The lead that one search finds where nothing is hidden."""

    def make() -> dict[str, np.ndarray]:
        rng = np.random.default_rng([seed, 29, k])
        known = baseline.problem.known_sigma
        readings = np.maximum(noise.draw(baseline.predicted[None], baseline.noise, known, rng)[0], 0.0)
        simulated = baseline.problem.experiment.with_readings(readings)
        found = climb(
            replace(baseline.problem, experiment=simulated), catalogue, seed=seed, settings=settings,
            passes=lambda candidate: passes(candidate, catalogue, seed=seed),
        )  # fmt: skip
        return {"lead": np.array(lead(found))}

    about = [seed, k, asdict(settings), [t.determinants for t in catalogue]]
    return float(memory.recall("null", baseline.problem, about, make)["lead"])
