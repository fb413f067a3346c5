"""`make bench`: speed as ratios, measured side by side in one run on one core, and the limits the project keeps.

Prints a table and writes `benchmarks/latest.json`; with `--only NAME` some of its rows, and not that file. The rows
`recorded` and `diagram` put their tables into docs/numerics.md.
Peers are timed on a sample of the same trajectories, in turns with psafit, since machines are noisy. Speed counts at
equal accuracy only: every method runs at the loosest tolerance that reaches the accuracy asked for.
"""

from __future__ import annotations

import argparse
import contextlib
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
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import cases
import peers
import work_precision
from cases import Case

from psafit.drives import Drive, Table
from psafit.errors import ConvergenceError
from psafit.inference.candidate import Candidate, built_up, united
from psafit.inference.polish import polish
from psafit.inference.problem import Problem
from psafit.inference.sample import SampleSettings, first, second
from psafit.simulate import Design, simulate
from psafit.simulate.stepper import TOLERANCE
from psafit.simulate.threads import n_threads, set_n_threads

RIG = cases.RIG
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
    return {"what": what, "value": None if value != value else value, "target": target, "holds": bool(holds)}


def simulator(rows: list[dict[str, object]]) -> None:
    set_n_threads(1)
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
        rows.append(row("the same against diffrax: not installed", float("nan"), "at least 150", None))
    try:
        case = Case(())
        compiled = peers.Numbalsoda(RIG, case.trajectories)
        compiled(1e-6)
        theirs = best(lambda: compiled(1e-6), 3) / len(case.sample)
        print(f"    numbalsoda {1e6 * theirs:.1f} us a trajectory; {quality(case.peer_errors(compiled(1e-6)))}")
        rows.append(row("the same against numbalsoda LSODA, rtol 1e-6, sampled for the event",
                        theirs / ours, "at least 30", theirs / ours >= 30))  # fmt: skip
    except ImportError:
        rows.append(row("the same against numbalsoda: not installed", float("nan"), "at least 30", None))
    costs = []
    for n in (1, 8, 64, 512, 4096):
        many = parameter_sets(n)
        simulate(DESIGN, many)
        costs.append(best(lambda many=many: simulate(DESIGN, many), 5) / (n * 64))  # type: ignore[misc]
    print("    us a trajectory, 1 to 4096 sets:", " ".join(f"{1e6 * c:.2f}" for c in costs))
    rising = max(b / a for a, b in itertools.pairwise(costs))
    rows.append(row("cost per trajectory from 1 to 4096 sets: largest rise from one size to the next",
                    rising, "at most 1.15", rising <= 1.15))  # fmt: skip


# What a nonlinear launch range must agree to, and the tolerances tried for it, the loosest first.
ACCURACY = 1e-5
OURS = (1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5)
THEIRS = (1e-4, 3e-5, 1e-5, 3e-6, 1e-6, 3e-7, 1e-7, 3e-8, 1e-8)
LANES = 16


@contextlib.contextmanager
def one_core() -> Iterator[None]:
    """Keep this thread and those it starts on one core, the one it runs on best, and share no batch."""
    threads, cores = n_threads(), None
    if hasattr(os, "sched_getaffinity"):
        cores = os.sched_getaffinity(0)
        os.sched_setaffinity(0, {max(cores)})
    set_n_threads(1)
    try:
        yield
    finally:
        set_n_threads(threads)
        if cores is not None:
            os.sched_setaffinity(0, cores)


def seconds(work: Callable[[], object], clock: Callable[[], float] = time.perf_counter) -> float:
    begin = clock()
    work()
    return clock() - begin


def in_turns(
    works: list[Callable[[], object]], repeats: int, clock: Callable[[], float] = time.perf_counter
) -> np.ndarray:
    """Times, s, of several things done in turns, by the wall's clock or another; (repeats, works)."""
    return np.array([[seconds(work, clock) for work in works] for _ in range(repeats)])


def spread(values: np.ndarray) -> tuple[float, str]:
    """Median, and the range as text."""
    return float(np.median(values)), f"{values.min():.3g}-{values.max():.3g}"


def quality(errors: np.ndarray) -> str:
    return f"errors: median {np.median(errors):.0e}, 95 % {np.quantile(errors, 0.95):.0e}, largest {errors.max():.0e}"


def loosest(run: Callable[[float], np.ndarray], tolerances: tuple[float, ...]) -> tuple[float, np.ndarray] | None:
    """The first tolerance tried at which 95 % of the errors that `run` returns are below the accuracy asked for."""
    for tolerance in tolerances:
        errors = run(tolerance)
        if np.quantile(errors, 0.95) <= ACCURACY:
            return tolerance, errors
    return None


NONLINEAR = {
    "hertz_exponent": ("hertz_exponent",),
    "slew_limit + hunt_crossley + hysteresis": ("slew_limit", "hunt_crossley", "hysteresis"),
}


def nonlinear(rows: list[dict[str, object]]) -> None:
    for title, names in NONLINEAR.items():
        with one_core():
            _versus_peers(rows, title, Case(names))


def _versus_peers(rows: list[dict[str, object]], title: str, case: Case) -> None:
    found = loosest(lambda x: case.errors(case.run(x)), OURS)
    if found is None:
        raise ConvergenceError("accuracy of the stepper", reached=1.0, required=ACCURACY)
    loose, errors = found
    print(f"    {title}: tight stepper and literal reference differ by {case.reference_gap():.0e} at most")
    print(f"    psafit at tolerance {loose:g}: {quality(errors)}")
    print(f"    psafit at its default tolerance {TOLERANCE:g}: {quality(case.errors(case.run(TOLERANCE)))}")
    contest = {"SciPy LSODA": (500, _lsoda(case))}
    for name, target, others in (("numbalsoda", 3, _numbalsoda(case)), ("diffrax", 30, _diffrax(case))):
        contest |= {peer: (target, work) for peer, work in others.items()}
        if not others:
            rows.append(row(f"{title}: against {name}: not installed", float("nan"), f"at least {target}", None))
    times = in_turns(
        [partial(case.run, loose), partial(case.run, TOLERANCE), *(work for _, work in contest.values())], 7
    )
    ours, default = times[:, 0] / case.size, times[:, 1] / case.size
    (cost, about), (more, wide) = spread(1e6 * ours), spread(1e6 * default)
    print(f"    psafit: {cost:.3g} us a trajectory ({about}), at its default tolerance {more:.3g} ({wide})")
    for k, (peer, (target, _)) in enumerate(contest.items()):
        theirs = times[:, 2 + k] / len(case.sample)
        (cost, about), (ratio, within), (plain, plainly) = (
            spread(x) for x in (1e3 * theirs, theirs / ours, theirs / default)
        )
        print(f"    {peer}: {cost:.3g} ms a trajectory ({about}), {within} times ours;"
              f" at our default tolerance {plain:.0f} times ({plainly})")  # fmt: skip
        rows.append(row(f"{title}: times faster than {peer}, 95 % of errors below 1e-5",
                        ratio, f"at least {target}", ratio >= target))  # fmt: skip


def _lsoda(case: Case) -> Callable[[], np.ndarray]:
    """SciPy's LSODA on a case's sample, at its best choice of tolerances."""

    def run(rtol: float, absolute: float) -> np.ndarray:
        return np.array([peers.scipy_launch(RIG, one, "LSODA", rtol, absolute) for one in case.trajectories])

    return _tuned("SciPy LSODA", case, run)


def _numbalsoda(case: Case) -> dict[str, Callable[[], np.ndarray]]:
    """LSODA in machine code on a case's sample, at its best choice of tolerances; nothing where it is not installed."""
    try:
        return {"numbalsoda LSODA": _tuned("numbalsoda LSODA", case, peers.Numbalsoda(RIG, case.trajectories))}
    except ImportError:
        return {}


def _tuned(name: str, case: Case, run: Callable[[float, float], np.ndarray]) -> Callable[[], np.ndarray]:
    """A peer that takes a relative and an absolute tolerance, at the fastest that reach the accuracy."""
    tried = []
    for absolute in (1e-3, 1e-5):
        reached = loosest(lambda x, a=absolute: case.peer_errors(run(x, a)), THEIRS)  # type: ignore[misc]
        if reached:
            cost = min(seconds(partial(run, reached[0], absolute)) for _ in range(3))
            tried.append((cost, reached[0], absolute, reached[1]))
    _, rtol, absolute, errors = min(tried, key=lambda t: t[0])
    print(f"    {name} at rtol {rtol:g}, atol {absolute:g} rtol times the scale: {quality(errors)}")
    return partial(run, rtol, absolute)


def _diffrax(case: Case) -> dict[str, Callable[[], np.ndarray]]:
    """The fastest of diffrax's methods on a case's sample; nothing where diffrax is not installed."""
    tried = []
    for solver in ("Kvaerno5", "Kvaerno4", "Tsit5"):
        try:
            batch = peers.Diffrax(RIG, case.trajectories, solver, LANES)
        except ImportError:
            return {}
        reached = loosest(lambda x, b=batch: case.peer_errors(b(x)), THEIRS)  # type: ignore[misc]
        if reached is None:
            print(f"    diffrax {solver}: does not reach the accuracy")
            continue
        rtol, errors = reached
        cost = min(seconds(partial(batch, rtol)) for _ in range(3))
        print(f"    diffrax {solver} at rtol {rtol:g}: {1e3 * cost / len(case.sample):.3g} ms a trajectory;"
              f" {quality(errors)}")  # fmt: skip
        tried.append((cost, f"diffrax {solver}", partial(batch, rtol)))
    return dict([min(tried, key=lambda t: t[0])[1:]]) if tried else {}


def recordings(n_samples: int = 1000, frequency: float = 1e3, volt: float = 20.0) -> dict[str, Drive]:
    """Two periods of a sine, as an oscilloscope with 1 % of noise records them, from above and from below the rest."""
    time = np.linspace(0.0, 2.0 / frequency, n_samples)
    sine = volt * np.sin(2 * np.pi * frequency * time)
    noise = 0.01 * volt * np.random.default_rng(5).standard_normal(n_samples)
    noise[0] = 0.0
    noise[1] = abs(noise[1])
    return {
        "that first rises": Drive("table", table=Table(time, sine + noise, True)),
        "that first dips below its rest": Drive("table", table=Table(time, -sine - noise, True)),
    }


def measured_at() -> str:
    """Return which commit a table is of."""
    asked = ["git", "describe", "--always", "--dirty", "--exclude=*"]
    commit = subprocess.run(asked, capture_output=True, text=True, check=False, cwd=ROOT).stdout.strip()
    return f"Measured at commit `{commit}`.\n"


def recorded(rows: list[dict[str, object]]) -> None:
    """The processor's time for a trajectory under recorded drives, in units of a sine's."""
    drives = {"": Drive("sine"), **recordings()}
    designs = [Design.sweep(RIG, drive, FREQUENCY, 20.0) for drive in drives.values()]
    sets, ratios = parameter_sets(64), {}
    for title, theta in (("baseline", sets), ("hertz_exponent", np.column_stack([sets, np.full(64, 1.5)]))):
        causes = cases.terms(*() if title == "baseline" else (title,))
        works = [partial(simulate, design, theta, causes) for design in designs]
        for work in works:
            work()
        with one_core():
            times = in_turns(works, 5, time.process_time)  # type: ignore[arg-type]
        for k, kind in enumerate(drives):
            if kind:
                ratio, within = spread(times[:, k] / times[:, 0])
                print(f"    {title}, a recorded drive {kind}: {within} sines")
                ratios[title, kind] = ratio
                rows.append(row(f"{title}: a recorded drive of 1,000 samples {kind}: times a sine's cost",
                                ratio, "below 20", ratio < 20))  # fmt: skip
    text = "| recorded drive of 1,000 samples | `baseline` | `hertz_exponent` |\n|---|---|---|\n" + "".join(
        f"| {kind} | {ratios['baseline', kind]:.1f} | {ratios['hertz_exponent', kind]:.1f} |\n" for kind in recordings()
    )
    page, text = ROOT / "docs" / "numerics.md", f"{text}\n{measured_at()}"
    page.write_text(work_precision.publish(text, page.read_text("utf-8"), "make bench, recorded"), "utf-8")


def threads(rows: list[dict[str, object]]) -> None:
    what = "hertz_exponent, 64 sets, all points: 2 threads, times faster than 1"
    if len(getattr(os, "sched_getaffinity", lambda _: range(os.cpu_count() or 1))(0)) < 2:
        rows.append(row(what, float("nan"), "at least 1.8", None))
        return
    case = Case(("hertz_exponent",), n_sets=64)

    def on(n: int) -> Callable[[], object]:
        def work() -> None:
            set_n_threads(n)
            case.run(TOLERANCE)

        return work

    on(2)()
    times = in_turns([on(1), on(2)], 15)
    ratio, within = spread(times[:, 0] / times[:, 1])
    print(
        f"    1 thread {1e3 * np.median(times[:, 0]):.0f} ms, 2 threads {1e3 * np.median(times[:, 1]):.0f} ms;"
        f" ratio {within}"
    )
    rows.append(row(what, ratio, "at least 1.8", ratio >= 1.8))


def likelihood(rows: list[dict[str, object]]) -> None:
    for title, names, limit in (
        ("nonlinear (hertz_exponent)", ("hertz_exponent",), 10.0),
        ("linear (baseline)", (), 2.0),
    ):
        of = cases.problem(*names)
        sets = cases.draws(of, 64, 7)
        of.log_likelihood(sets)
        cost = {}
        for cores in ("one core", "all cores"):
            with one_core() if cores == "one core" else contextlib.nullcontext():
                times = in_turns(
                    [lambda: [of.log_likelihood(u[None]) for u in sets], lambda: of.log_likelihood(sets)], 7  # noqa: B023
                )  # fmt: skip
            cost[cores] = np.median(1e3 * times / len(sets), axis=0), spread(times[:, 0] / times[:, 1])
            (single, batch), (gain, within) = cost[cores]
            print(f"    {title}, {cores}: one set {single:.3g} ms, of a batch of 64 {batch:.3g} ms a set:"
                  f" {gain:.2f} times cheaper ({within})")  # fmt: skip
        single, (gain, _) = float(cost["one core"][0][0]), cost["all cores"][1]
        rows.append(row(f"one likelihood of the study's 288 points, {title}, one set, ms",
                        single, f"below {limit:g}", single < limit))  # fmt: skip
        rows.append(row(f"the same in a batch of 64, {title}, all cores: times cheaper per set",
                        gain, "at least 3", gain >= 3))  # fmt: skip


SEARCHES = ("preload", "hertz_exponent", "amplifier_lag")


def both(problem: Problem, seed: int, starts: int) -> Candidate:
    """Both first looks at a model, with so many starts each."""
    known, how = [built_up(problem, seed=seed)], SampleSettings.of(2 * starts)
    return united(*(look(problem, known, seed=seed, settings=how) for look in (first, second)))


def search(rows: list[dict[str, object]]) -> None:
    set_n_threads(int(os.environ["NUMBA_NUM_THREADS"]))
    for name in SEARCHES:
        of: Problem = cases.problem(name, groups=(1,))
        of.log_posterior(cases.draws(of, 8, 1))
        log_posteriors, times = [], []
        for seed in range(10):
            begin = time.perf_counter()
            found = both(of, seed, 16)
            log_posteriors.append(max(polish(of, u)[1] for u in found.modes))
            times.append(time.perf_counter() - begin)
        wide = both(of, 1000, 256).log_posterior
        top = max(*log_posteriors, wide)
        found = sum(log_posterior >= top - 0.1 for log_posterior in log_posteriors)
        median, within = spread(np.array(times))
        print(f"    baseline + {name}: {within} s; 512 starts end {top - wide:.2g} below the best, the seeds "
              + " ".join(f"{top - log_posterior:.2g}" for log_posterior in log_posteriors))  # fmt: skip
        rows.append(row(f"lmfit search, baseline + {name}, group 1, 2 cores: seconds, median of 10 seeds",
                        median, "below 10", median < 10))  # fmt: skip
        rows.append(row("the same: seeds of 10 that found the best minimum (within 0.1 of the highest known)",
                        found, "at least 9", found >= 9))  # fmt: skip


def diagram(rows: list[dict[str, object]]) -> None:
    with one_core():
        curves = work_precision.measure()
    work_precision.draw(curves, ROOT / "docs" / "figures" / "work_precision.png")
    page, text = ROOT / "docs" / "numerics.md", f"{work_precision.table(curves)}\n{measured_at()}"
    page.write_text(work_precision.publish(text, page.read_text("utf-8")), "utf-8")
    worst = work_precision.worst_margin(curves)
    rows.append(row("work-precision diagram, four models: times faster than the best peer at equal error, smallest",
                    worst, "above 1", worst > 1))  # fmt: skip


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


ROWS: dict[str, Callable[[list[dict[str, object]]], None]] = {
    "memory": memory,
    "closed-form": simulator,
    "recorded": recorded,
    "nonlinear": nonlinear,
    "threads": threads,
    "likelihood": likelihood,
    "search": search,
    "diagram": diagram,
    "commands": commands,
}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", metavar="NAME", action="append", choices=ROWS, help=f"some of {', '.join(ROWS)}")
    only = parser.parse_args().only
    rows: list[dict[str, object]] = []
    print(f"{'what':<88} {'value':>10}   {'target':<18}")
    simulate(DESIGN, parameter_sets(32))  # compiled and cached from here on
    for name, measure in ROWS.items():
        if not only or name in only:
            measure(rows)
    if not only:
        (ROOT / "benchmarks" / "latest.json").write_text(json.dumps(rows, indent=2) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
