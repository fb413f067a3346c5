"""How often the whole search finds as much where nothing is hidden.

Probabilities of models rest on priors and on a likelihood; a search through thousands of combinations also has its
luck. So the search is run on readings in which nothing is hidden, and the best of all models with causes that it finds
there is compared with what it found in the measured readings.

Such searches stand in a table that comes with psafit (`NULL_LEADS`; `make null-leads` works it out). They are of drawn
designs, baselines and scatters, with the whole catalogue. Those of designs with at most as many readings are counted:
where more readings show more, chance leads less. On request the search is repeated on readings simulated from the
fitted baseline instead.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from psafit.diagnose.searching import searched
from psafit.inference import noise
from psafit.inference.candidate import Candidate
from psafit.inference.memory import Memory, shared_out
from psafit.model_search import ModelSet, SearchSettings
from psafit.model_search.model_set import at_even_odds, log_prior
from psafit.physics.term import Term
from psafit.records import plain, read_json

NULL_LEADS = Path(__file__).parent / "null_leads.json"
"""The stored table."""


@dataclass(frozen=True)
class NullLead:
    """One search where nothing is hidden.

    Parameters
    ----------
    seed : int
        Of the challenge whose readings were searched, and of the search.
    asked : int
        Readings asked of the design.
    readings, sessions : int
        Of the design.
    lead : float
        As of `lead`.
    """

    seed: int
    asked: int
    readings: int
    sessions: int
    lead: float


@dataclass(frozen=True)
class NullLeads:
    """Leads of searches where nothing is hidden.

    Parameters
    ----------
    version : str
        Of psafit.
    seed : int
        From which all others are drawn.
    catalogue : list of str
        Causes that were looked at.
    settings : SearchSettings
    leads : list of NullLead
    """

    version: str
    seed: int
    catalogue: list[str]
    settings: SearchSettings
    leads: list[NullLead]


Missing = Literal["", "catalogue", "settings", "readings"]
"""Why the stored table says nothing; empty where it does."""

OTHERWISE: dict[Missing, str] = {
    "catalogue": "the stored searches are of another catalogue",
    "settings": "the stored searches have other settings",
    "readings": "the stored searches are of more readings",
}
"""Why it is not known, in words."""


@dataclass(frozen=True)
class Significance:
    """The best model with causes against the baseline, in measured readings and where nothing is hidden.

    Parameters
    ----------
    lead : float
        As of the function `lead`.
    null : list of float
        The same for each search where nothing is hidden.
    p_value : float, optional
        Share of the searches, the measured one counted in, that find at least as much; None without any.
    stored : bool
        Whether these searches come from the stored table, and not from readings simulated from the fitted baseline.
    readings : list of int
        Fewest and most readings of the designs that were searched.
    missing : {"", "catalogue", "settings", "readings"}
        Why the stored table says nothing: it is of other causes, of another search, or of larger designs.
    """

    lead: float
    null: list[float]
    p_value: float | None
    stored: bool = False
    readings: list[int] = field(default_factory=list)
    missing: Missing = ""


def lead(model_set: ModelSet) -> float:
    """Log posterior odds of the best model with causes against the baseline, nats.

    A cause that is more probable than not before any reading counts as even: what was believed anyway is no find.
    """
    even = at_even_odds(model_set.beliefs)
    log_posterior = {ids: value + log_prior(ids, even) for ids, value in model_set.log_evidence.items()}
    return max(value for ids, value in log_posterior.items() if ids) - log_posterior[()]


def looked_up(
    model_set: ModelSet, catalogue: Sequence[Term], settings: SearchSettings, file: Path = NULL_LEADS
) -> Significance:
    """Compare a search with those of the stored table.

    Parameters
    ----------
    model_set : ModelSet
        Of the measured readings.
    catalogue : sequence of Term
        Causes that were looked at.
    settings : SearchSettings
        Those of the search.
    file : Path
        The table.

    Returns
    -------
    Significance
        Without a p value where the table is of other causes or settings, or holds larger designs only.
    """
    table, own = read_json(file, NullLeads), lead(model_set)
    n = model_set.baseline.problem.observed.size
    usable = [one for one in table.leads if one.readings <= n]
    missing: Missing = ""
    if {t.id for t in catalogue} != {*table.catalogue} or any(t.plugin for t in catalogue):
        missing = "catalogue"
    elif plain(settings) != plain(table.settings):
        missing = "settings"
    elif not usable:
        missing = "readings"
    if missing:
        return Significance(own, [], None, stored=True, missing=missing)
    sizes = [one.readings for one in usable]
    null = [one.lead for one in usable]
    return Significance(own, null, _p_value(own, null), stored=True, readings=[min(sizes), max(sizes)])


def _p_value(own: float, null: Sequence[float]) -> float:
    return (1 + sum(x >= own for x in null)) / (len(null) + 1)


def significance(
    model_set: ModelSet,
    catalogue: Sequence[Term],
    n_searches: int,
    *,
    seed: int,
    memory: Memory,
    settings: SearchSettings | None = None,
    jobs: int = 1,
    scheduler: str | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Significance:
    """Repeat the search on readings simulated from the fitted baseline.

    Parameters
    ----------
    model_set : ModelSet
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
    scheduler : str, optional
        Address of a Dask scheduler whose workers share them instead.
    progress : callable
        Called with (repetitions done, repetitions).

    Returns
    -------
    Significance
    """
    settings = settings or SearchSettings()
    baseline, own = model_set.baseline, lead(model_set)
    again = partial(_again, baseline=baseline, catalogue=catalogue, seed=seed, settings=settings)
    null = shared_out(again, memory, range(n_searches), jobs=jobs, scheduler=scheduler, progress=progress)
    n = int(baseline.problem.observed.size)
    return Significance(own, null, _p_value(own, null), readings=[n, n])


def _again(
    memory: Memory, k: int, *, baseline: Candidate, catalogue: Sequence[Term], seed: int, settings: SearchSettings
) -> float:
    """The lead that one search finds where nothing is hidden."""

    def make() -> dict[str, np.ndarray]:
        rng = np.random.default_rng([seed, 29, k])
        known = baseline.problem.known_sigma
        readings = np.maximum(
            noise.draw(baseline.predicted[None], baseline.noise, known, rng)[0], baseline.problem.floor
        )
        simulated = baseline.problem.experiment.with_readings(readings)
        found = searched(replace(baseline.problem, experiment=simulated), catalogue, seed=seed, settings=settings)
        return {"lead": np.array(lead(found))}

    about = [seed, k, asdict(settings), [t.determinants for t in catalogue]]
    return float(memory.recall("null", baseline.problem, about, make)["lead"])
