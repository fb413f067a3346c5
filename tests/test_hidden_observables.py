"""One cause of thirty nats, or none, hidden in launch speeds, contact times or peak forces: a diagnosis finds it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rigs import TRUTH
from scipy.optimize import least_squares, minimize
from test_hidden_effects import FEW, blank

from psafit.challenge.campaign import read_diagnosis
from psafit.challenge.score import reported_set
from psafit.diagnose import diagnose
from psafit.diagnose.settings import Settings
from psafit.experiment import Experiment, read_experiment, write_experiment
from psafit.observables import OBSERVABLES
from psafit.physics import term, terms
from psafit.physics.term import Term
from psafit.simulate import Design, readings
from psafit.simulate.sensitivity import plausible

# Nats that a fit of the true model gains over that of the baseline; a search for it is content with a little more.
STRENGTH, ENOUGH = 30.0, 36.0
# Relative and absolute scatter of each observable, as instruments have them.
SCATTER = {
    "launch_range": (0.05, 0.1), "launch_speed": (0.05, 0.003),
    "contact_time": (0.01, 1.0), "peak_force": (0.05, 0.005),
}  # fmt: skip
READ = (("launch_speed",), ("contact_time",), ("launch_range", "contact_time"), ("peak_force",))


def planned(read: Sequence[str]) -> Experiment:
    """Three sweeps of twelve conditions, in each of which everything is read."""
    kinds = [k for k, o in enumerate(OBSERVABLES) if o.name in read]
    whole = blank(12)
    groups = []
    for g in whole.groups:
        many = np.tile(np.arange(g.n_points), len(kinds))
        groups.append(replace(g.at(many), row=many, measured=np.repeat(kinds, g.n_points), reading=np.ones(many.size)))
    return replace(whole, groups=tuple(groups))


def scatter(design: Design, exact: np.ndarray) -> np.ndarray:
    """Standard deviation of each reading."""
    relative, absolute = np.array([SCATTER[OBSERVABLES[k].name] for k in design.measured]).T
    return np.hypot(relative * exact, absolute)


def gain(design: Design, exact: np.ndarray) -> float:
    """What the baseline loses in the mean, refitted to exact readings by least squares, and its scatter after; nats."""
    s = scatter(design, exact)

    def residual(u: np.ndarray) -> np.ndarray:
        return (readings(design, np.exp(u))[0] - exact) / s

    # From some starts: the refitted baseline may lie far from the true one.
    starts = np.log(TRUTH) + np.vstack([np.zeros(3), np.random.default_rng(0).normal(0, 1, (5, 3))])
    bounds = np.log(TRUTH) - 6, np.log(TRUTH) + 6
    near = [least_squares(residual, u, bounds=bounds, loss="soft_l1", max_nfev=40).x for u in starts]
    ends = [least_squares(residual, u, bounds=bounds, max_nfev=40).x for u in near]
    r = min((residual(u) for u in ends), key=lambda r: float(r @ r))
    kinds = np.unique(design.measured)
    usual = np.log([SCATTER[OBSERVABLES[k].name] for k in kinds]).T.ravel()

    def lost(logs: np.ndarray) -> float:
        within = np.exp(np.clip(logs, usual - 3, usual + 6))
        relative, absolute = within.reshape(2, -1)[:, np.searchsorted(kinds, design.measured)]
        wider = np.square(np.hypot(relative * exact, absolute) / s)
        return 0.5 * float(np.sum(np.log(wider) + (1 + np.square(r)) / wider - 1))

    return float(minimize(lost, usual, method="Nelder-Mead", options={"maxiter": 2000}).fun)


def exact_readings(design: Design, hidden: Term | None) -> np.ndarray:
    """Without scatter; of a cause at the strength that is worth `STRENGTH`."""
    if hidden is None:
        return readings(design, TRUTH)[0]

    def at(share: float) -> np.ndarray:
        return readings(design, [*TRUTH, *plausible(hidden, share)], (hidden,))[0]

    # A gap that the tip never crosses shows nothing: the largest strength that does.
    shares = ((share, gain(design, at(share))) for share in (0.98, 0.5, 0.25, 0.1, 0.05))
    low, (high, most) = 0.0, next((share, gained) for share, gained in shares if gained > STRENGTH)
    while most > ENOUGH and high - low > 1e-3:
        middle = 0.5 * (low + high)
        if (gained := gain(design, at(middle))) > STRENGTH:
            high, most = middle, gained
        else:
            low = middle
    return at(high)


def measured(read: Sequence[str], hidden: Term | None, seed: int, folder: Path) -> Experiment:
    """Readings as a rig's file holds them: rounded, and blank where a launch failed."""
    plan = planned(read)
    design = Design.of(plan.constants, plan.groups)
    exact = exact_readings(design, hidden)
    drawn = exact + scatter(design, exact) * np.random.default_rng(seed).standard_normal(exact.size)
    made = plan.with_readings(np.maximum([float(f"{x:.4g}") for x in drawn], 0.0))
    kept = [g.at(np.flatnonzero((g.reading > 0) | [not OBSERVABLES[k].blank for k in g.measured])) for g in made.groups]
    write_experiment(replace(made, groups=tuple(kept)), folder)
    return read_experiment(folder)


def said_of(experiment: Experiment, folder: Path, catalogue: Sequence[Term]) -> dict[str, Any]:
    """What a quick diagnosis says."""
    settings = replace(Settings.usual(quick=True), simulated=99)
    diagnose(experiment, experiment.ids, folder, quick=True, seed=1, catalogue=catalogue, settings=settings)
    return read_diagnosis(folder / "diagnosis.json")


def is_right(hidden: str | None, said: dict[str, Any]) -> bool:
    """Whether nothing is adequate, and a cause is in the set; strengths are chosen by what they gain."""
    if hidden is None:
        return bool(said["verdict"] == "adequate")
    explained = said["verdict"] in ("explained", "ambiguous") or said["unexplained_by"] == "values"
    return explained and frozenset([hidden]) in reported_set(said)


CASES = [
    (read, hidden) for read, cause in zip(READ, ("start_phase", "gap") * 2, strict=True) for hidden in (None, cause)
]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("read", "hidden"), CASES, ids=lambda x: "+".join(x) if isinstance(x, tuple) else x or "nothing"
)
def test_what_is_hidden_is_found(read: tuple[str, ...], hidden: str | None, tmp_path: Path) -> None:
    experiment = measured(read, term(hidden) if hidden else None, 1, tmp_path / "rig")
    said = said_of(experiment, tmp_path / "run", terms(FEW))
    assert is_right(hidden, said), (said["verdict"], said["misfit"])
