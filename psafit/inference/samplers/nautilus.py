"""Evidence and draws by nautilus, an importance nested sampler: slow, and independent of fits and emulators.

J. U. Lange, Mon. Not. R. Astron. Soc. 525 (2023) 3181. It begins from the prior alone, so that it would also find a
posterior's part that all optimisations have missed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from psafit.arrays import FloatArray
from psafit.errors import InputError
from psafit.files import read_error, replacing
from psafit.inference import store
from psafit.inference.evidence import systematic
from psafit.inference.problem import Problem
from psafit.inference.sampling import Chain, Progress, SamplerSettings, Target, dealt


@dataclass(frozen=True)
class NestedEvidence:
    """What the nested sampler says of a model.

    Parameters
    ----------
    log_evidence : float
    effective_draws : float
    calls : int
        Parameter sets simulated.
    """

    log_evidence: float
    effective_draws: float
    calls: int


def require() -> Any:
    """Nautilus's sampler.

    Raises
    ------
    InputError
        If it is not installed.
    """
    try:
        from nautilus import Sampler
    except ImportError as error:
        raise InputError("nautilus is not installed", "pip install nautilus-sampler") from error
    return Sampler


def nested_evidence(
    problem: Problem,
    *,
    seed: int,
    n_live: int = 1000,
    effective: float = 2000,
    n_networks: int = 4,
    progress: Callable[[int], None] = lambda calls: None,
) -> NestedEvidence:
    """Evidence of a model by nested sampling.

    Parameters
    ----------
    problem : Problem
    seed : int
    n_live : int
        Points that bound the likelihood's shells.
    effective : float
        Effective draws at the end: the evidence's error is far below the half nat that matters.
    n_networks : int
        Neural networks that bound each shell: most of the time goes into training them.
    progress : callable
        Called with the number of sets simulated so far.

    Returns
    -------
    NestedEvidence

    Raises
    ------
    InputError
        If nautilus is not installed.
    """
    sampler = _sampler(problem, seed, n_live, n_networks, progress)
    sampler.run(n_eff=effective, verbose=False)
    return NestedEvidence(float(sampler.log_z), float(sampler.n_eff), int(sampler.n_like))


def _sampler(
    problem: Problem,
    seed: int,
    n_live: int,
    n_networks: int,
    progress: Callable[[int], None],
    path: Path | None = None,
    *,
    batch: int = 256,
    impossible: float = -1e30,
) -> Any:
    """Nautilus's sampler of a model, as it was kept at `path`.

    Sets are simulated a `batch` at once. The logarithm of an impossible likelihood is called `impossible`: minus
    infinity would end the sampler.
    """
    calls = 0

    def log_likelihood(u: FloatArray) -> FloatArray:
        nonlocal calls
        calls += len(u)
        progress(calls)
        value = problem.log_likelihood(u)
        return np.where(np.isfinite(value), value, impossible)

    def prior(quantiles: FloatArray) -> FloatArray:
        return problem.prior_transform(np.clip(quantiles, 1e-12, 1 - 1e-12))

    return require()(
        prior, log_likelihood, n_dim=problem.n_dim, n_live=n_live, n_networks=n_networks, n_batch=batch,
        vectorized=True, pass_dict=False, seed=seed, filepath=path,
    )  # fmt: skip


@dataclass(frozen=True)
class Settings(SamplerSettings):
    """Settings of the nested sampler; a step is a simulated set.

    Parameters
    ----------
    n_live : int
        Live points.
    n_networks : int
        Neural networks that bound each shell.
    effective_samples : float
        Draws that are wanted at the end.
    chunk : int
        Sets between checkpoints.
    chains : int
        To which draws are dealt out.
    """

    max_steps: int = 2_000_000
    n_live: int = 1000
    n_networks: int = 4
    effective_samples: float = 2000
    chunk: int = 20_000
    chains: int = 4


class Nautilus:
    """Draws by nested sampling: from the prior inwards, without any mode that is known."""

    about = "nautilus: importance nested sampling"
    libraries = ("nautilus-sampler",)
    chained, checked = False, True

    def settings(self, problem: Problem) -> Settings:
        """Its settings for a problem."""
        require()
        return Settings()

    def draw(self, target: Target, settings: Settings, progress: Callable[[Progress], None]) -> Chain:
        """Draw until there are enough effective draws, going on from the checkpoint where there is one."""
        sampler = self._begun(target, settings)
        while True:
            until = min(sampler.n_like + settings.chunk, settings.max_steps)
            enough = sampler.run(n_eff=settings.effective_samples, n_like_max=until, verbose=False)
            with replacing(target.path) as temporary:
                whole = temporary.with_suffix(".h5")  # the only name that nautilus writes to
                sampler.write(whole, overwrite=True)
                with h5py.File(whole, "r+") as f:
                    f.attrs["identity"] = target.identity
                    f.attrs["sets"], f.attrs["converged"] = sampler.n_like, enough
                whole.replace(temporary)
            progress(_progress(int(sampler.n_like), bool(enough), settings))
            if enough or sampler.n_like >= settings.max_steps:
                return self._chain(target, settings, sampler, bool(enough))

    def _begun(self, target: Target, settings: Settings) -> Any:
        if not target.path.exists():
            return _sampler(target.problem, target.seed, settings.n_live, settings.n_networks, lambda calls: None)
        remedy = "choose another --out, or move it elsewhere to draw anew"
        try:
            with h5py.File(target.path, "r") as f:
                found = str(f.attrs["identity"])
            sampler = _sampler(
                target.problem, target.seed, settings.n_live, settings.n_networks, lambda calls: None, target.path
            )
        except (OSError, KeyError, ValueError, TypeError, RuntimeError, AttributeError) as error:
            raise read_error(error, target.path, "not draws kept by psafit, or damaged", remedy) from error
        if found != target.identity:
            raise InputError("belongs to another run", remedy, file=target.path)
        sampler.filepath = None  # what is kept is replaced in one step, by us
        return sampler

    def _chain(self, target: Target, settings: Settings, sampler: Any, enough: bool) -> Chain:
        problem, random = target.problem, np.random.default_rng([target.seed, 8])
        u, log_weight, log_likelihood = sampler.posterior()
        weights = np.exp(log_weight - log_weight.max())
        weights /= weights.sum()
        chosen = random.permutation(systematic(weights, max(int(sampler.n_eff), 4 * settings.chains)))
        draws, log_posterior = dealt(u[chosen], settings.chains), problem.log_prior(u) + log_likelihood
        best = int(np.argmax(np.where(weights > 0, log_posterior, -np.inf)))
        return Chain(
            draws,
            dealt(log_posterior[chosen, None], settings.chains)[..., 0],
            np.ones(problem.n_dim),
            store.r_hat(draws),
            0,
            float(sampler.n_eff / sampler.n_like),
            enough,
            u[best],
            float(log_posterior[best]),
        )

    def look(self, path: Path, settings: Mapping[str, int | float], n_dim: int, values: int) -> Progress | None:
        """How many sets a checkpoint holds."""
        try:
            with h5py.File(path, "r", locking=False) as f:
                steps, converged = int(f.attrs["sets"]), bool(f.attrs["converged"])
        except (OSError, KeyError, ValueError, TypeError, RuntimeError):
            return None
        return _progress(steps, converged, Settings(**settings))  # type: ignore[arg-type]


def _progress(steps: int, converged: bool, settings: Settings) -> Progress:
    """How far it is; nobody knows how many more sets it takes."""
    return Progress(
        steps=steps, steps_left=0 if converged else settings.chunk, chunk=settings.chunk, converged=converged
    )


SAMPLER = Nautilus()
