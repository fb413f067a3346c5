"""`make bench`: speed as ratios, measured side by side in one run on one core, and the limits the project keeps.

Prints a table and writes `benchmarks/latest.json`. Peers are timed on a sample of the same trajectories, with the best
of several repeats on both sides, since machines are noisy.
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("NUMBA_NUM_THREADS", "2")
os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1")
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import itertools
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
from scipy.integrate import solve_ivp

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from psafit.experiment import read_experiment
from psafit.simulate import Design, simulate

RIG = read_experiment(ROOT / "experiments" / "psa").constants
FREQUENCY = np.geomspace(100, 25_000, 64)
DESIGN = Design.sweep(RIG, "sine", FREQUENCY, 20.0)


def parameter_sets(n: int) -> np.ndarray:
    """Sets around the plausible: what a fit evaluates."""
    rng = np.random.default_rng(1)
    return np.exp(rng.uniform(np.log([1e5, 1e3, 10]), np.log([1e7, 3e4, 300]), (n, 3)))


def best(work: Callable[[], object], repeats: int = 7) -> float:
    """Shortest of several wall times, s."""
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return min(times)


def lsoda(theta: np.ndarray, frequency: float) -> float:
    """One launch as a user of SciPy would code it; returns the speed at separation."""
    k_c, c_s, c_c = (float(x) for x in theta)
    m, ball, k_s, drive = RIG.m, RIG.M, RIG.k_s, RIG.k_s * RIG.q * 20.0
    omega = 2 * np.pi * float(frequency)
    from math import sin

    def slope(t: float, y: Any) -> list[float]:
        x1, v1, x2, v2 = y.tolist()
        force = k_c * (x1 - x2) + c_c * (v1 - v2)
        return [v1, (drive * sin(omega * t) - c_s * v1 - k_s * x1 - force) / m, v2, force / ball]

    def apart(t: float, y: Any) -> float:
        return (y[0] - y[2]) if t > 0 else 1e-12

    apart.terminal, apart.direction = True, -1  # type: ignore[attr-defined]
    scale = RIG.q * 20.0
    found = solve_ivp(
        slope, (0, 0.08), np.zeros(4), "LSODA", events=apart, rtol=1e-6,
        atol=[scale * 1e-9, scale * 1e-5, scale * 1e-9, scale * 1e-5],
    )  # fmt: skip
    return float(found.y_events[0][0][3]) if found.y_events[0].size else 0.0


def diffrax_batch(sets: np.ndarray) -> tuple[Callable[[], np.ndarray], int]:
    """The whole batch in one jitted vmap of diffrax's Kvaerno5 with an event."""
    import diffrax
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    m, ball, k_s, drive = RIG.m, RIG.M, RIG.k_s, RIG.k_s * RIG.q * 20.0
    scale = RIG.q * 20.0

    def slope(t: Any, y: Any, args: Any) -> Any:
        (k_c, c_s, c_c), omega = args
        force = k_c * (y[0] - y[2]) + c_c * (y[1] - y[3])
        return jnp.array([y[1], (drive * jnp.sin(omega * t) - c_s * y[1] - k_s * y[0] - force) / m, y[3], force / ball])

    def apart(t: Any, y: Any, args: Any, **_: Any) -> Any:
        return jnp.where(t > 1e-9, y[0] - y[2], 1e-12)

    def one(theta: Any, frequency: Any) -> Any:
        import optimistix

        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(slope), diffrax.Kvaerno5(), 0.0, 0.08, 1e-7, jnp.zeros(4),
            args=(theta, 2 * jnp.pi * frequency),
            stepsize_controller=diffrax.PIDController(
                rtol=1e-6, atol=jnp.array([scale * 1e-9, scale * 1e-5, scale * 1e-9, scale * 1e-5])
            ),
            event=diffrax.Event(apart, optimistix.Newton(1e-8, 1e-8), direction=False),
            max_steps=100_000, throw=False,
        )  # fmt: skip
        return solution.ys[-1, 3]

    batch = jax.jit(jax.vmap(jax.vmap(one, (None, 0)), (0, None)))
    theta, frequency = jnp.asarray(sets), jnp.asarray(FREQUENCY)
    return lambda: np.asarray(batch(theta, frequency).block_until_ready()), sets.shape[0] * FREQUENCY.size


def row(what: str, value: float, target: str, holds: bool | None) -> dict[str, object]:
    mark = {True: "holds", False: "MISSED", None: "not measured"}[holds]
    print(f"{what:<88} {value:>10.4g}   {target:<18} {mark}", flush=True)
    return {"what": what, "value": value, "target": target, "holds": bool(holds)}


def simulator(rows: list[dict[str, object]]) -> None:
    numba.set_num_threads(1)
    sets = parameter_sets(32)
    speeds = simulate(DESIGN, sets).separation_speed
    ours = best(lambda: simulate(DESIGN, sets)) / speeds.size
    rng = np.random.default_rng(2)
    sample = [(int(i), int(j)) for i, j in zip(rng.integers(0, 32, 60), rng.integers(0, 64, 60), strict=True)]
    peer = best(lambda: [lsoda(sets[i], FREQUENCY[j]) for i, j in sample], 3) / len(sample)
    agree = np.median([abs(lsoda(sets[i], FREQUENCY[j]) / speeds[i, j] - 1) for i, j in sample])
    print(
        f"    closed form {1e6 * ours:.2f} us a trajectory, LSODA {1e3 * peer:.2f} ms (median difference {agree:.1e})"
    )
    rows.append(row("closed form, 32 sets x 64 points: times faster than SciPy LSODA, rtol 1e-6, event",
                    peer / ours, "at least 3000", peer / ours >= 3000))  # fmt: skip
    try:
        few = parameter_sets(32)[:8]
        batch, n = diffrax_batch(few)
        result = batch()
        theirs = best(batch, 3) / n
        close = np.median(np.abs(result / simulate(DESIGN, few).separation_speed - 1))
        print(f"    diffrax {1e6 * theirs:.1f} us a trajectory (median difference {close:.1e})")
        rows.append(row("the same against diffrax, Kvaerno5, rtol 1e-6, event, vmap, jit, float64",
                        theirs / ours, "at least 150", theirs / ours >= 150))  # fmt: skip
    except ImportError:
        rows.append(
            row("the same against diffrax: not installed", float("nan"), "at least 150", None) | {"value": None}
        )
    costs = []
    for n in (1, 8, 64, 512, 4096):
        many = parameter_sets(n)
        simulate(DESIGN, many)
        costs.append(best(lambda many=many: simulate(DESIGN, many), 5) / (n * 64))  # type: ignore[misc]
    print("    us a trajectory, 1 to 4096 sets:", " ".join(f"{1e6 * c:.2f}" for c in costs))
    rising = max(b / a for a, b in itertools.pairwise(costs))
    rows.append(row("cost per trajectory from 1 to 4096 sets: largest rise from one size to the next",
                    rising, "at most 1.15", rising <= 1.15))  # fmt: skip


def memory(rows: list[dict[str, object]]) -> None:
    """In a process of its own, before any peer is loaded: a child's peak begins with its parent's memory."""
    code = (
        "import resource, sys; sys.path[:0] = [sys.argv[1], sys.argv[1] + '/benchmarks']; import run; "
        "run.simulate(run.DESIGN, run.parameter_sets(4096)); "
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
    )
    said = subprocess.run([sys.executable, "-c", code, str(ROOT)], capture_output=True, text=True, check=True)
    megabytes = int(said.stdout.split()[-1]) / 1024
    rows.append(row("peak memory of the process with 4096 sets, MB", megabytes, "below 500", megabytes < 500))


def commands(rows: list[dict[str, object]]) -> None:
    program = [sys.executable, "-m", "psafit"]
    help_time = best(lambda: subprocess.run([*program, "--help"], capture_output=True, check=True, cwd=ROOT), 5)
    rows.append(row("psafit --help, s", help_time, "at most 0.5", help_time <= 0.5))
    threads = {**os.environ, "NUMBA_NUM_THREADS": str(os.cpu_count() or 1)}
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        begin = time.perf_counter()
        subprocess.run([*program, "fit", str(ROOT / "experiments/psa"), "--group", "1", "--out", str(out)],
                       check=True, capture_output=True, cwd=ROOT, env=threads)  # fmt: skip
        seconds = time.perf_counter() - begin
        summary = json.loads((out / "posterior.json").read_text())
    effective = min(p["ess_bulk"] for p in summary["parameters"])
    enough = summary["autocorrelation_times"] >= 50 and effective >= 1000
    print(
        f"    {summary['autocorrelation_times']:.0f} autocorrelation times, {effective:.0f} effective samples at least"
    )
    rows.append(row("make fit GROUP=1 once set up, to 50 autocorrelation times and 1000 effective samples, s",
                    seconds, "at most 60", seconds <= 60 and enough))  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.parse_args()
    rows: list[dict[str, object]] = []
    print(f"{'what':<88} {'value':>10}   {'target':<18}")
    simulate(DESIGN, parameter_sets(32))  # compiled and cached from here on
    memory(rows)
    simulator(rows)
    commands(rows)
    (ROOT / "benchmarks" / "latest.json").write_text(json.dumps(rows, indent=2) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
