"""What a run asks of a sampler, and what it gets: the same for all of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, Protocol, Self

import numpy as np

from psafit.arrays import FloatArray
from psafit.errors import InputError
from psafit.experiment.text import did_you_mean, shown
from psafit.inference.candidate import Candidate
from psafit.inference.evidence import ImportanceSample
from psafit.inference.problem import Problem


@dataclass(frozen=True)
class SamplerSettings:
    """Options of every sampler; each adds its own.

    These say when a run gives up or begins again, and what it keeps. They are no part of its identity: a run that gave
    up can be continued.

    Parameters
    ----------
    max_steps : int
        Gives up here, and says so.
    stored : int
        Pointwise log likelihoods kept in `posterior.nc` (32 MB by default); of more draws, some are left out.
    missed : float, nats
        A draw whose log posterior is this much higher than that of the best mode shows that the search has missed one.
    restarts : int
        Times at most that sampling begins again with such a mode.
    thin : float, autocorrelation times
        Distance between the draws that are kept: denser ones add bytes, not information.
    """

    max_steps: int = 40_000
    stored: int = 2**23
    missed: float = 1.0
    restarts: int = 5
    thin: float = 0.5

    @property
    def determinants(self) -> dict[str, int | float]:
        """The sampler's own settings, which determine the draws."""
        shared = {field.name for field in fields(SamplerSettings)}
        return {name: value for name, value in asdict(self).items() if name not in shared}

    def with_options(self, options: Mapping[str, Any]) -> Self:
        """The same settings, but for some options by name.

        Raises
        ------
        InputError
            If a name is none of the sampler's options, or its value is no positive number.
        """
        usual = asdict(self)
        for name, value in options.items():
            if name not in usual:
                raise InputError(f"{shown(name)} is no option of this sampler", did_you_mean(name, usual))
            whole = isinstance(usual[name], int)
            if not (isinstance(value, int) or (isinstance(value, float) and not whole)) or not 0 < value < math.inf:
                raise InputError(
                    f"the sampler's option {name} is {value!r}", f"give a {'whole' if whole else 'positive'} number"
                )
        return replace(self, **options)


@dataclass(frozen=True, eq=False)
class Target:
    """What a sampler draws from, and what is known of it.

    Parameters
    ----------
    found : Candidate
        The model, and its modes.
    draws : ImportanceSample
        Of its posterior, by importance sampling.
    seed : int
        Same seed, same draws.
    path : Path
        Checkpoint: a sampler goes on from there.
    identity : str
        Of the run; a checkpoint of another is refused.
    ceiling : float
        A log posterior: what has been higher is handed back at once.
    """

    found: Candidate
    draws: ImportanceSample
    seed: int
    path: Path
    identity: str
    ceiling: float = math.inf

    @property
    def problem(self) -> Problem:
        """The model."""
        return self.found.problem


@dataclass(frozen=True)
class Chain:
    """Draws of a posterior.

    Parameters
    ----------
    draws : (n_chains, n_draws, n_dim) array
        In the sampling coordinate, without burn-in. Independent draws are dealt out to chains.
    log_posterior : (n_chains, n_draws) array
    autocorrelation_time : (n_dim,) array
        Draws of a chain; one where they are independent.
    r_hat : (n_dim,) array
    burn_in : int
        Steps discarded.
    acceptance : float
        Mean fraction of proposals accepted, or that independent draws are worth.
    converged : bool
        Whether the sampler's own rule was met.
    highest : (n_dim,) array
        The draw of highest posterior, burn-in included.
    highest_log_posterior : float
        Its log posterior.
    """

    draws: FloatArray
    log_posterior: FloatArray
    autocorrelation_time: FloatArray
    r_hat: FloatArray
    burn_in: int
    acceptance: float
    converged: bool
    highest: FloatArray
    highest_log_posterior: float


@dataclass(frozen=True, kw_only=True)
class Convergence:
    """How far chains have come; None where a sampler has no such thing, or has not reported it yet.

    Parameters
    ----------
    walkers : int, optional
        That take each step.
    acceptance : float, optional
        Share of the moves that were accepted.
    autocorrelation_time : float, optional
        Of the slowest parameter, steps.
    autocorrelation_times, wanted_times : float, optional
        How many of them there are after burn-in, and should be.
    r_hat, wanted_r_hat : float, optional
        The largest.
    log_posterior : float, optional
        The highest.
    """

    walkers: int | None = None
    acceptance: float | None = None
    autocorrelation_time: float | None = None
    autocorrelation_times: float | None = None
    wanted_times: float | None = None
    r_hat: float | None = None
    wanted_r_hat: float | None = None
    log_posterior: float | None = None


@dataclass(frozen=True, kw_only=True)
class Progress(Convergence):
    """State of a running sampler, for whoever shows it: its `Convergence`, and how far it is.

    Parameters
    ----------
    steps : int
        Done.
    steps_left : int
        What it would take if nothing changed.
    chunk : int
        Steps between checkpoints.
    converged : bool
    """

    steps: int
    steps_left: int
    chunk: int
    converged: bool


class Sampler(Protocol):
    """A way to draw from a posterior; `psafit.inference.samplers` holds one a file.

    It draws the same with the same seed, interrupted or not, and says when it has not converged.
    """

    @property
    def about(self) -> str:
        """How it draws, in a few words."""

    @property
    def libraries(self) -> tuple[str, ...]:
        """Distributions that it needs, whose versions shape what it draws."""

    @property
    def chained(self) -> bool:
        """Whether its draws are steps of chains, which have a burn-in, an acceptance and a length."""

    @property
    def checked(self) -> bool:
        """Whether the importance draws that every run has are another way than its own."""

    def settings(self, problem: Problem) -> Any:
        """Its settings for a problem: a `SamplerSettings` with fields of its own."""

    def draw(self, target: Target, settings: Any, progress: Callable[[Progress], None]) -> Chain:
        """Draw until its rule is met or `settings.max_steps` are done; `progress` is called after every checkpoint."""

    def look(self, path: Path, settings: Mapping[str, int | float], n_dim: int, values: int) -> Progress | None:
        """How far a checkpoint is, None where there is none that can be read.

        Nothing is locked. Of a file with more than `values` numbers, some are left out.
        """


def dealt(draws: FloatArray, chains: int) -> FloatArray:
    """Independent draws, (n, n_dim), dealt out to chains of one length; what is left over is left out."""
    length = len(draws) // chains
    return np.ascontiguousarray(draws[: chains * length].reshape(chains, length, -1))
