"""Simulation-based calibration: what is wrong is seen, and what was broken off goes on."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm
from truths import rig_with_two_modes

from psafit.errors import ConvergenceError
from psafit.inference.candidate import FitSettings, candidate_at, fit, separate_modes
from psafit.inference.evidence import ImportanceSample, importance_sample
from psafit.records import read_json

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
sbc = import_module("sbc")


SOUND = {"lacks": 0.02, "lacks_error": 0.1, "effective": 1e6}


def calibrated(n: int = 300, narrower: float = 1.0, sets: int = 2) -> list[Any]:
    """Results of normal posteriors whose draws are narrower than they by a factor."""
    names = ["k_c", "c_s", "c_c", "sigma_rel", "sigma_abs", "nu", "log_likelihood"]
    z = np.random.default_rng(4).standard_normal((n, len(names)))
    found = norm.cdf(narrower * z)
    return [
        sbc.Result(
            k, ["gap"] * (k % sets), ranks=dict(zip(names, row.tolist(), strict=True)), away=0.02, rise=0.0, **SOUND
        )
        for k, row in enumerate(found)
    ]


def drawn(u: np.ndarray) -> ImportanceSample:
    n = len(u)
    return ImportanceSample(u, np.full(n, 1 / n), 0.0, 0.1, float(n), 0.1, u[0], 0.0)


def test_sound_posteriors_pass() -> None:
    text, worst = sbc.summary(calibrated())
    assert worst > 0.05
    assert "lack more than a tenth of the posterior: 0" in text
    held = sbc.coverage([sbc.parameters_of(r) for r in calibrated()], 0.9)
    assert abs(held.share - 0.9) < 3 * held.error


def test_posteriors_too_narrow_by_half_are_seen() -> None:
    found = calibrated(narrower=1.5)
    assert sbc.summary(found)[1] < 1e-3
    held = sbc.coverage([sbc.parameters_of(r) for r in found], 0.9)
    assert held.share == pytest.approx(2 * norm.cdf(norm.ppf(0.95) / 1.5) - 1, abs=0.03)
    assert held.share < 0.9 - 5 * held.error


def test_ranks_that_hang_together_have_a_larger_error() -> None:
    """Five equal ranks of a data set are one."""
    ranks = np.random.default_rng(1).uniform(size=200)
    one, five = (sbc.coverage([[r] * k for r in ranks], 0.9) for k in (1, 5))
    assert one.error == pytest.approx(five.error)
    apart = sbc.coverage([[r] for r in np.random.default_rng(2).uniform(size=1000)], 0.9)
    assert five.error > 2 * apart.error


def test_a_mode_that_the_draws_lack_is_seen() -> None:
    rng = np.random.default_rng(3)
    here, there = rng.standard_normal((2, 400, 3))
    there[:, 0] += 8.0
    chain = rng.standard_normal((300, 3))
    chain[:, 0] += 8.0
    both, one = drawn(np.concatenate([here, there])), drawn(here)
    assert sbc.compared(chain, both)[0] < 0.1
    away, differs = sbc.compared(chain, one)
    assert away > 0.9
    assert differs > 5
    found = calibrated(3)
    found[1] = replace(found[1], away=away, level=2.0, differs=differs)
    found[2] = replace(found[2], lacks_error=2.0, lacks=1.0)
    found[0] = replace(found[0], lacks=1.0)
    assert sbc.lost(found) == [found[0]]
    assert sbc.unsure(found) == [found[2]]
    text = sbc.summary(found)[0]
    assert "where there are no draws: 1\n  1 gap: 100% of the chain, level +2.0 nats" in text
    assert "not known to a fifth of a nat: 1\n  2 -: 1.00 +- 2.00 nats" in text


@pytest.mark.slow
def test_what_the_draws_lack_is_measured_by_the_mode_of_the_truth() -> None:
    """Two modes, of which the draws know the higher one, that holds a tenth of the posterior."""
    rig, _ = rig_with_two_modes(1)
    plain = fit(rig, (), seed=1, draws=4096, most=48, settings=FitSettings(readings=rig.observed.size))
    first, other = (candidate_at(rig, plain.modes[[k]]) for k in separate_modes(plain)[:2])
    alone, theirs = (importance_sample(one, seed=2) for one in (first, other))
    lacks, error = sbc.lacking(first, alone, other, 3)
    assert lacks == pytest.approx(np.logaddexp(alone.log_evidence, theirs.log_evidence) - alone.log_evidence, abs=0.3)
    found = calibrated(3)
    found[1] = replace(found[1], lacks=lacks, lacks_error=error)
    assert sbc.lost(found) == [found[1]]
    assert f"a tenth of the posterior: 1\n  1 gap: {1 - np.exp(-lacks):.0%}, {lacks:.2f} +- " in sbc.summary(found)[0]


def test_tails_that_end_too_early_are_seen() -> None:
    found = calibrated(50)
    found[7] = replace(found[7], ranks=found[7].ranks | {"c_c": 1e-12})
    text = sbc.summary(found)[0]
    # Of a hundred draws one in 101 has none below it.
    assert sbc.expected_beyond([replace(found[0], effective=100.0)]) == pytest.approx(6 * 2 / 101)
    assert "outermost thousandths of their draws: 1 of 300, 0.6 expected of as many exact draws\n  7 gap: c_c" in text


def test_a_dropped_mode_spoils_the_ranks() -> None:
    """Two modes, as probable as each other, of which the draws have the lower one."""
    rng = np.random.default_rng(5)
    found = []
    for k in range(200):
        centre = 6.0 * rng.integers(2)
        draws = drawn(rng.standard_normal((200, 1)))
        rank = sbc.below(draws.draws, draws.weights, rng.standard_normal(1) + centre)
        found.append(sbc.Result(k, [], ranks={"k_c": float(rank[0])}))
    assert sbc.summary(found)[1] < 1e-6


def test_a_data_set_that_cannot_be_sampled_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    def gives_up(problem: Any, seed: int) -> None:
        raise ConvergenceError("search for a finite posterior", reached=0, required=1)

    monkeypatch.setattr(sbc, "diagnosed", gives_up)
    result = sbc.solve(sbc.Plan(terms=""), 0)
    assert result.failed
    assert not result.ranks
    assert "not sampled: 1" in sbc.summary([*calibrated(20), result])[0]


def test_readings_are_those_of_the_likelihood() -> None:
    """Scatter of either sign, nothing rounded: else truth and readings are no joint draw."""
    plan = sbc.Plan(terms="")
    signs = [np.sign(sbc.truth(plan, k)[0].observed) for k in range(8)]
    assert (np.concatenate(signs) < 0).any()
    shown = sbc.truth(replace(plan, drawn="clipped"), 0)[0].observed
    assert (shown >= 0).all()
    assert np.allclose(shown, np.maximum(sbc.truth(plan, 0)[0].observed, 0), atol=0.0051)


def test_draws_reach_a_long_tail() -> None:
    """Where a contact hardly damps, less of it changes nothing: a chain of 4,000 steps has its hundredth at -1.92."""
    problem, _, _ = sbc.truth(sbc.Plan(terms=""), 15)
    of_seed = [sbc.diagnosed(problem, seed)[1] for seed in (15, 16, 17)]
    hundredth = [d.quantiles(d.draws[:, problem.names.index("c_c")], [0.01])[0] for d in of_seed]
    assert np.mean(hundredth) == pytest.approx(-1.92, abs=0.5)  # one of 300 effective draws is off by 0.45


def test_what_was_broken_off_goes_on(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    asked: list[int] = []

    def solve(plan: Any, number: int) -> Any:
        asked.append(number)
        if number == 2 and len(asked) == 3:
            raise KeyboardInterrupt
        return replace(calibrated(5)[number], number=number)

    monkeypatch.setattr(sbc, "solve", solve)
    plan = sbc.Plan()
    with pytest.raises(KeyboardInterrupt):
        sbc.results(plan, range(4), tmp_path, 1)
    found = sbc.results(plan, range(4), tmp_path, 1)
    assert asked == [0, 1, 2, 2, 3]
    assert [r.number for r in found] == [0, 1, 2, 3]
    assert sbc.results(plan, range(4), tmp_path, 1) == found
    assert len(asked) == 5


@pytest.mark.slow
def test_a_data_set_does_not_depend_on_the_number_of_workers(tmp_path: Path) -> None:
    """Run as a script, whose functions and classes are sent to the workers."""
    found = []
    for jobs in ("1", "2"):
        folder = tmp_path / jobs
        words = [
            "-n",
            "2",
            "--terms",
            "amplifier_lag",
            "--jobs",
            jobs,
            "--folder",
            str(folder),
            "--out",
            str(folder / "sbc.png"),
        ]
        done = subprocess.run([sys.executable, sbc.__file__, *words], capture_output=True, text=True, check=False)
        assert "all (2 data sets)" in done.stdout, done.stderr
        assert (folder / "sbc.png").exists()
        files = sorted(folder.glob("*/*.json"))
        read = [read_json(file, sbc.Result, sealed=True, remedy="") for file in files]
        found.append([replace(r, cpu_s=0.0) for r in read])
    assert repr(found[0]) == repr(found[1])
    assert len(found[0]) == 2
