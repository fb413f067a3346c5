"""Posterior draws by importance sampling alone: fast, and as good as the proposals that it has found."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from psafit.inference import store
from psafit.inference.evidence import TRUSTED
from psafit.inference.problem import Problem
from psafit.inference.sampling import Chain, Progress, SamplerSettings, Target, dealt


@dataclass(frozen=True)
class Settings(SamplerSettings):
    """What is asked of the draws.

    Parameters
    ----------
    chains : int
        To which draws are dealt out.
    effective_samples : float
        Draws that they are to be worth.
    """

    chains: int = 4
    effective_samples: float = 100.0


class Importance:
    """The importance draws that every run has, equally weighted."""

    about = "importance sampling from an emulated posterior"
    libraries = ()
    chained = checked = False

    def settings(self, problem: Problem) -> Settings:
        """Its settings for a problem."""
        return Settings()

    def draw(self, target: Target, settings: Settings, progress: Callable[[Progress], None]) -> Chain:
        """As many draws as the weighted ones are worth."""
        own, random = target.draws, np.random.default_rng([target.seed, 7])
        u = random.permutation(own.resampled(max(int(own.effective), 4 * settings.chains)))
        sound = own.effective >= settings.effective_samples and own.pareto_k < TRUSTED
        progress(Progress(steps=len(u), steps_left=0, chunk=len(u), converged=sound, log_posterior=own.log_posterior))
        draws = dealt(u, settings.chains)
        log_posterior = target.problem.log_posterior(draws.reshape(-1, draws.shape[2])).reshape(draws.shape[:2])
        ones = np.ones(draws.shape[2])
        acceptance = own.effective / len(own.draws)
        return Chain(
            draws, log_posterior, ones, store.r_hat(draws), 0, acceptance, sound, own.top, own.log_posterior
        )  # fmt: skip

    def look(self, path: Path, settings: Mapping[str, int | float], n_dim: int, values: int) -> Progress | None:
        """Nothing: it keeps no checkpoint."""
        return None


SAMPLER = Importance()
