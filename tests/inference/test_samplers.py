"""The registry of samplers, and those other than emcee."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import psafit
from psafit import watch
from psafit.errors import InputError
from psafit.experiment import Experiment
from psafit.inference import identify, samplers
from psafit.inference.candidate import candidate_at
from psafit.inference.problem import Problem
from psafit.inference.run import fit
from psafit.inference.run_folder import load
from psafit.inference.sample import SampleSettings, sample
from psafit.inference.samplers import sampler
from psafit.inference.sampling import Progress, Target
from psafit.report.fit import _health

OWN = '''
"""The prior and nothing else: a sampler for a test."""
from dataclasses import dataclass
import numpy as np
from psafit.inference.sampling import Chain, Progress, SamplerSettings

@dataclass(frozen=True)
class Settings(SamplerSettings):
    size: int = 40

class Prior:
    about, libraries, chained, checked = "draws of the prior", (), False, True
    def settings(self, problem):
        return Settings()
    def draw(self, target, settings, progress):
        random, n = np.random.default_rng(target.seed), target.problem.n_dim
        draws = target.problem.prior_transform(random.uniform(size=(2, settings.size, n)))
        log_posterior = target.problem.log_posterior(draws.reshape(-1, n)).reshape(2, -1)
        best = np.unravel_index(log_posterior.argmax(), log_posterior.shape)
        target.path.write_bytes(b"7")
        progress(Progress(steps=7, steps_left=0, chunk=7, converged=True))
        top = float(log_posterior[best])
        return Chain(draws, log_posterior, np.ones(n), np.ones(n), 0, 1.0, True, draws[best], top)
    def look(self, path, settings, n_dim, values):
        return Progress(steps=int(path.read_bytes()), steps_left=0, chunk=7, converged=True) if path.exists() else None

SAMPLER = Prior()
'''


def test_what_is_not_there_is_one_line() -> None:
    assert {"emcee", "importance", "nautilus"} <= set(samplers.names())
    with pytest.raises(InputError, match="there is no sampler 'emce'") as reported:
        sampler("emce")
    assert reported.value.remedy == "choose of emcee"


def test_a_sampler_that_lacks_something_is_refused_before_it_draws(tmp_path: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    (tmp_path / "short.py").write_text(OWN.replace(", chained, checked", "").replace(", False, True", ""))
    monkeypatch.setattr(samplers, "__path__", [*samplers.__path__, str(tmp_path)])
    try:
        with pytest.raises(InputError, match="sampler 'short' lacks chained, checked"):
            sampler("short")
    finally:
        sys.modules.pop("psafit.inference.samplers.short", None)


def test_a_sampler_is_one_file(known: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing else is touched: a run draws by it, keeps its name and settings, is read back, and is watched."""
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "prior.py").write_text(OWN)
    monkeypatch.setattr(samplers, "__path__", [*samplers.__path__, str(tmp_path / "own")])
    monkeypatch.setattr(identify, "profiles", lambda problem, *a: [[]] * problem.n_physical)
    try:
        assert "prior" in samplers.names()
        run = fit(known, [1], tmp_path / "run", n_starts=2, sampled_by="prior")
        assert run.fit.sampled_by == "prior" and run.fit.sampler == {"size": 40}
        assert run.draws.values.shape == (2, 40, 6) and run.summary.converged
        assert run.summary.message == "80 independent draws"
        assert np.array_equal(load(tmp_path / "run").draws.values, run.draws.values)
        state = watch.look(tmp_path / "run")
        assert isinstance(state, watch.State) and (state.stage, state.wanted_r_hat) == ("done", None)
        assert (state.steps, state.walkers, state.r_hat) == (None, None, None), "independent draws have none"
        health = {row[0] for row in _health(run)}
        assert {"Sampler", "Kept"} < health and health.isdisjoint({"Chains", "Acceptance", "Largest R-hat"})
        (tmp_path / "run" / "posterior.json").unlink()
        state = watch.look(tmp_path / "run")
        assert isinstance(state, watch.State) and (state.stage, state.steps, state.r_hat) == ("profile", 7, None)
        with pytest.raises(InputError, match=r"\(what differs: sampler, sampler settings\)"):
            fit(known, [1], tmp_path / "run", n_starts=2, sampled_by="importance")
    finally:
        sys.modules.pop("psafit.inference.samplers.prior", None)


def test_nobody_knows_a_sampler_by_name() -> None:
    package = Path(psafit.__file__).parent
    inference = ("run.py", "run_folder.py", "summary.py", "sampling.py")
    parts = ["records.py", "watch.py", "progress.py", "cli/watching.py", *(f"inference/{name}" for name in inference)]
    pages = (path for path in (package / "report").rglob("fit*") if "__pycache__" not in path.parts)
    for path in [*(package / part for part in parts), *pages]:
        assert not re.search("emcee|importance_sampler|walkers that", path.read_text("utf-8")), path


FEW = SampleSettings.of(8, 16)


@pytest.fixture(scope="module")
def target(known: Experiment, tmp_path_factory: pytest.TempPathFactory) -> Target:
    found, draws = sample(Problem(known, (1,)), seed=1, settings=FEW)
    return Target(found, draws, 1, tmp_path_factory.mktemp("samplers") / "chain.h5", "x")


def test_importance_draws_are_as_many_as_they_are_worth(target: Target) -> None:
    own = sampler("importance")
    chain = own.draw(target, own.settings(target.problem), lambda state: None)
    n = chain.draws.shape[0] * chain.draws.shape[1]
    assert chain.converged and target.draws.effective - 4 < n <= target.draws.effective
    spread = chain.draws.std(axis=(0, 1))
    expected = target.draws.weights @ target.draws.draws
    assert (np.abs(chain.draws.mean(axis=(0, 1)) - expected) < 0.1 * spread).all()
    assert np.allclose(chain.log_posterior[0], target.problem.log_posterior(chain.draws[0]))
    poor = replace(target, draws=replace(target.draws, pareto_k=0.9))
    assert not own.draw(poor, own.settings(target.problem), lambda state: None).converged


@pytest.mark.slow
def test_a_nested_sampler_finds_the_same_and_goes_on(target: Target, tmp_path: Path) -> None:
    """From the prior alone; interrupted, it draws the same."""
    pytest.importorskip("nautilus")
    own, seen = sampler("nautilus"), list[Progress]()
    settings = replace(own.settings(target.problem), n_live=100, n_networks=1, effective_samples=100.0, chunk=1000)
    whole = own.draw(replace(target, path=tmp_path / "a.h5"), settings, seen.append)
    assert whole.converged and len(seen) > 1
    cut = replace(target, path=tmp_path / "b.h5")
    assert not own.draw(cut, replace(settings, max_steps=1000), lambda state: None).converged
    reported = own.look(cut.path, settings.determinants, target.problem.n_dim, 10**6)
    assert reported is not None and reported.steps >= 1000 and not reported.converged
    assert np.array_equal(own.draw(cut, settings, lambda state: None).draws, whole.draws)
    with pytest.raises(InputError, match="belongs to another run"):
        own.draw(replace(cut, identity="y"), settings, lambda state: None)
    spread = whole.draws.std(axis=(0, 1))
    expected = target.draws.weights @ target.draws.draws
    assert (np.abs(whole.draws.mean(axis=(0, 1)) - expected) < 0.3 * spread).all()


@pytest.mark.slow
def test_a_chain_and_draws_that_miss_a_part_are_distinguished(known: Experiment, tmp_path: Path) -> None:
    """Importance draws that lack what lies on one side of the median differ from the chain by more than chance."""
    run = fit(known, [1], tmp_path / "run", n_starts=4, sampled_by="importance")
    same = run.summary.importance
    assert same.furthest.apart <= 2 * same.by_chance
    from psafit.inference.summary import compared

    found = candidate_at(run.problem, run.problem.to_sampling(np.array([list(run.fit.minima[0].values.values())])))
    _, whole = sample(run.problem, [found], seed=3, settings=FEW)
    half = whole.draws[:, 0] < whole.quantiles(whole.draws[:, 0], [0.5])[0]
    lost = replace(whole, draws=whole.draws[half], weights=whole.weights[half] / whole.weights[half].sum())
    other = compared(run.problem, run.problem.to_sampling(run.draws.flat), lost, 500.0)
    assert other.furthest.name == run.problem.names[0] and other.furthest.apart > 2 * other.by_chance
