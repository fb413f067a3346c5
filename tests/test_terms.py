"""Causes in the fit: columns, search, prediction of sessions never seen, and the run that carries them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from psafit import numerics
from psafit.errors import InputError
from psafit.experiment import Constants, Experiment, Group, fingerprint
from psafit.inference.emcee_adaptor import Settings
from psafit.inference.optimise import gradient, optimise
from psafit.inference.problem import Problem
from psafit.inference.run import fit, load
from psafit.numerics import audit, refine
from psafit.physics import terms
from psafit.simulate import Design, simulate

RIG = Constants(M=0.027, m=0.005, q=1.2e-7, l=0.09, k_s=4.89e7, g=9.81)
TRUTH = (8e5, 3000.0, 150.0)


def rig(ids: list[str], values: list[float], seed: int, scatter: float = 0.02) -> Experiment:
    """Two sweeps by frequency and one by voltage, with causes at work."""
    frequency, amplitude = np.geomspace(200, 8000, 16), np.linspace(2, 20, 12)
    conditions = [(frequency, np.full(16, 20.0)), (frequency, np.full(16, 10.0)), (np.full(12, 1200.0), amplitude)]
    rng = np.random.default_rng(seed)
    groups = []
    for id, (f, v) in enumerate(conditions, start=1):
        clean = simulate(Design.sweep(RIG, "sine", f, v), [*TRUTH, *values], terms(ids)).launch_range[0] * 1e6
        read = np.maximum(clean * (1 + scatter * rng.standard_normal(f.size)), 0.0)
        groups.append(Group(id, "sine", f"g{id}.csv", f, v, read))
    return Experiment("made up", "a simulation", RIG, tuple(groups), Path("made-up"), fingerprint(RIG, groups))


def test_columns_are_baseline_causes_sessions_scatter() -> None:
    problem = Problem(rig([], [], 1), (1, 3), terms(["reading_gain", "gap"]))
    assert problem.names == (
        "k_c", "c_s", "c_c", "gap_width", "reading_gain_spread", "reading_gain_z_1", "reading_gain_z_3",
        "sigma_rel", "sigma_abs", "nu",
    )  # fmt: skip
    assert (problem.n_physical, problem.n_dim) == (5, 10)


def test_each_session_reads_with_its_own_gain() -> None:
    experiment = rig([], [], 1)
    problem = Problem(experiment, (1, 3), terms(["reading_gain"]))
    plain = Problem(experiment, (1, 3))
    u = problem.prior_transform(np.full((1, problem.n_dim), 0.5))
    x = problem.to_physical(u)
    x[0, problem.names.index("reading_gain_spread")] = 0.2
    x[0, problem.names.index("reading_gain_z_1")] = 1.0
    x[0, problem.names.index("reading_gain_z_3")] = -2.0
    u = problem.to_sampling(x)
    without = plain.predict(plain.to_sampling(x[:, [0, 1, 2, 6, 7, 8]]))
    ratio = problem.predict(u)[0] / without[0]
    assert ratio[:16] == pytest.approx(np.exp(0.2)) and ratio[16:] == pytest.approx(np.exp(-0.4))
    # A session never seen reads with a gain drawn from the prior, and with the median one where none is drawn.
    many = np.repeat(u, 4000, axis=0)
    unseen = problem.predict(many, [2], np.random.default_rng(3))[:, 0]
    assert np.std(np.log(unseen)) == pytest.approx(0.2, rel=0.05)
    assert np.ptp(problem.predict(many[:5], [2])[:, 0]) == 0


@pytest.mark.parametrize(
    ("ids", "values"), [(["flight_friction"], [0.06]), pytest.param(["hertz_exponent"], [1.5], marks=pytest.mark.slow)]
)
def test_search_finds_the_cause_that_is_there(ids: list[str], values: list[float]) -> None:
    experiment = rig(ids, values, seed=5)
    problem = Problem(experiment, (1, 2), terms(ids))
    found = optimise(problem, seed=1, n_starts=8).best
    without = optimise(replace(problem, terms=()), seed=1, n_starts=8).best
    assert found.log_posterior > without.log_posterior + 10
    # The third group, never fitted, is predicted to its scatter.
    predicted = problem.predict(problem.to_sampling(found.values)[None, :], [3])[0]
    assert np.sqrt(np.mean(np.log(predicted / experiment.group(3).launch_range_um) ** 2)) < 0.06
    strength = found.values[problem.names.index(problem.terms[0].strength.name)]
    assert strength == pytest.approx(values[0], rel=0.5)


def test_a_cause_never_fits_worse_than_none() -> None:
    experiment = rig([], [], seed=2)
    nothing = optimise(Problem(experiment, (1,)), seed=1, n_starts=8).best.log_posterior
    for id in ("amplifier_lag", "preload"):
        problem = Problem(experiment, (1,), terms([id]))
        strength = problem.terms[0].strength
        neutral = float(strength.log_prior(strength.to_sampling(strength.neutral)))
        assert optimise(problem, seed=1, n_starts=8).best.log_posterior > nothing + neutral - 1.0


def test_gradient_is_one_sided_at_a_bound() -> None:
    slope = gradient(lambda u: np.sqrt(u[:, 0]) + 2 * u[:, 1], np.array([1.0, 0.0]), np.array([[0.0, 1.0], [0.0, 5.0]]))
    assert slope == pytest.approx([0.5, 2.0], rel=1e-3)


def test_an_audit_is_of_the_steps_that_were_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """At the problem's own tolerance, and not converged where its error is more than would do."""
    model = Problem(rig(["hertz_exponent"], [1.5], seed=1), (1,), terms(["hertz_exponent"]), tolerance=1e-3)
    u = model.prior_transform(np.full((1, model.n_dim), 0.5))
    told = refine(model, u, "me")
    exact = replace(model, tolerance=1e-10).predict(u, model.experiment.ids)
    error = np.abs(model.predict(u, model.experiment.ids) / exact - 1).max()
    assert told.engine == "stepper" and told.tolerance == 1e-3 and told.converged
    assert told.error == pytest.approx(error, rel=0.05) and told.error > 1e-9
    monkeypatch.setattr(numerics, "REQUIRED", 0.5 * error)
    monkeypatch.setattr(numerics, "_OF_SCATTER", 0.0)
    assert not refine(model, u, "me").converged


def test_run_carries_its_causes(tmp_path: Path) -> None:
    experiment = rig(["swing_drag"], [3.0], seed=4)
    quick = Settings(n_walkers=24, chunk=100, r_hat=1.5, effective_samples=50, autocorrelation_times=5, max_steps=300)
    chosen = terms(["swing_drag"])
    fit(experiment, [1], tmp_path / "run", terms=chosen, n_starts=4, settings=quick)
    run = load(tmp_path / "run")
    assert (run.fit.terms, run.fit.engine, run.problem.terms) == (["swing_drag"], "closed form", chosen)
    assert "swing_drag_rate" in [p.name for p in run.summary.parameters]
    told = audit(run)
    assert told.converged and told.engine == "closed form" and (tmp_path / "run" / "numerics.json").exists()
    worst = [r.worst for r in told.refinement]
    assert worst == sorted(worst, reverse=True) and worst[-1] < 1e-3 * worst[0]
    with pytest.raises(InputError, match="another run"):
        fit(experiment, [1], tmp_path / "run", n_starts=4, settings=quick)
