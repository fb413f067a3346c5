"""One cause of thirty nats, or none, hidden in two short traces: a diagnosis finds it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from psafit.challenge.campaign import read_diagnosis
from psafit.challenge.score import reported_set
from psafit.diagnose import diagnose
from psafit.diagnose.settings import Settings
from psafit.drives import Drive
from psafit.experiment import Conditions, Experiment, Plan, read_experiment, write_experiment
from psafit.inference import noise
from psafit.inference.candidate import candidate_at
from psafit.inference.problem import Problem
from psafit.observables import DISPLACEMENT, OBSERVABLES, VELOCITY
from psafit.physics import term, terms
from psafit.physics.term import Term
from psafit.simulate.contract import STUDY
from psafit.simulate.sensitivity import plausible

STRENGTH = 30.0  # nats that the true model gains over the baseline, refitted with its scatter
FEW = ("amplifier_lag", "gap", "hertz_exponent", "stroke_tolerance")


def planned(n: int) -> Experiment:
    """A displacement under a sine and a velocity under a square wave, `n` samples each."""
    groups = [
        Conditions(
            i, Drive(form), f"{i}.csv", np.full(n, f), np.full(n, 20.0),
            measured=np.full(n, OBSERVABLES.index(o)), time_us=np.round(np.linspace(0.0, end, n), 1),
        )
        for i, form, f, o, end in ((1, "sine", 1200.0, DISPLACEMENT, 500.0), (2, "square", 1500.0, VELOCITY, 300.0))
    ]  # fmt: skip
    return Plan(STUDY, tuple(groups), ()).with_readings(np.ones(2 * n), "made")


def hidden_at(problem: Problem, hidden: Term) -> np.ndarray:
    """Samples without scatter, of a cause at the strength that is worth `STRENGTH`."""
    u = problem.prior_transform(np.full((1, problem.n_dim), 0.5))
    around, n = candidate_at(problem, u), problem.observed.size
    enough = 0.5 * n * math.expm1(2 * STRENGTH / n)  # a wider scatter takes up some of it

    def effect(share: float) -> np.ndarray:
        large = replace(problem, terms=(hidden,))
        at = around.within(large)[0]
        at[[large.names.index(p.name) for p in hidden.parameters]] = [
            p.to_sampling(x) for p, x in zip(hidden.parameters, plausible(hidden, share), strict=True)
        ]
        return large.predict(at[None])[0]

    low, high = 0.0, 0.98
    for _ in range(12):
        middle = 0.5 * (low + high)
        left = around.project_out((effect(middle) - around.predicted)[None])
        low, high = (low, middle) if 0.5 * float(np.sum(left**2)) > enough else (middle, high)
    return effect(high)


def measured(hidden: Term | None, seed: int, folder: Path, n: int = 40) -> Experiment:
    """Traces as a file holds them: rounded."""
    plan = planned(n)
    problem = Problem(plan, plan.ids)
    u = problem.prior_transform(np.full((1, problem.n_dim), 0.5))
    exact = problem.predict(u)[0] if hidden is None else hidden_at(problem, hidden)
    drawn = noise.draw(exact[None], problem.noise_values(u), None, np.random.default_rng(seed))[0]
    write_experiment(plan.with_readings(np.array([float(f"{x:.5g}") for x in drawn])), folder)
    return read_experiment(folder)


@pytest.mark.slow
@pytest.mark.parametrize("hidden", [None, "amplifier_lag"], ids=lambda id: id or "nothing")
def test_what_is_hidden_in_traces_is_found(hidden: str | None, tmp_path: Path) -> None:
    experiment = measured(term(hidden) if hidden else None, 1, tmp_path / "rig")
    settings = replace(Settings.usual(quick=True), simulated=99)
    diagnose(experiment, experiment.ids, tmp_path / "run", quick=True, seed=1, catalogue=terms(FEW), settings=settings)
    said = read_diagnosis(tmp_path / "run" / "diagnosis.json")
    if hidden is None:
        assert said["verdict"] == "adequate", said["misfit"]
    else:
        assert said["verdict"] in ("explained", "ambiguous") and frozenset([hidden]) in reported_set(said)
