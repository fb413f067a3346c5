"""Error against time per trajectory under four models, psafit and its peers: docs/figures/work_precision.png.

Times are the processor's, on one core: what else the machine does would bend the curves of the slower methods.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path

import cases
import numpy as np
import peers
from cases import Case
from numpy.typing import NDArray

from psafit.report.style import PALETTE, figure_style

Curve = NDArray[np.float64]  # rows: error (95 % quantile), seconds a trajectory

MODELS: dict[str, tuple[str, ...]] = {
    "baseline": (),
    "hertz_exponent": ("hertz_exponent",),
    "slew_limit + hunt_crossley + hysteresis": ("slew_limit", "hunt_crossley", "hysteresis"),
    "gap + no_tension": ("gap", "no_tension"),
}
# One point of every group, at voltages that close a gap.
_POINTS_PER_GROUP, _SETS, _LEAST_VOLT = 1, 8, 10.0
_RTOL = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
_TOLERANCE = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
# Past this many seconds a curve ends: the next tolerance would take longer.
_PATIENCE = 12.0
_LOOK = {
    "psafit": ("blue", "o", "-"),
    "psafit, stepped": ("sky", "h", "-"),
    "SciPy LSODA": ("vermillion", "s", "--"),
    "SciPy Radau": ("orange", "^", "--"),
    "SciPy DOP853": ("purple", "v", ":"),
    "numbalsoda LSODA": ("vermillion", "X", "-"),
    "diffrax Kvaerno5": ("green", "D", "-."),
    "diffrax Tsit5": ("ink", "P", "-."),
}


def _points() -> tuple[int, ...]:
    design = cases.problem().design
    rng = np.random.default_rng(11)
    found: list[int] = []
    for group in np.unique(design.group):
        able = np.flatnonzero((design.group == group) & (design.amplitude >= _LEAST_VOLT))
        found += rng.choice(able, _POINTS_PER_GROUP, replace=False).tolist()
    return tuple(found)


def _curve(run: Callable[[float], np.ndarray], tolerances: tuple[float, ...], n: int, repeats: int) -> Curve:
    """`run` maps a tolerance to errors."""
    rows = []
    for tolerance in tolerances:
        times = []
        while len(times) < repeats and sum(times) < 0.5 * _PATIENCE:
            begin = time.process_time()
            errors = run(tolerance)
            times.append(time.process_time() - begin)
        rows.append((max(float(np.quantile(errors, 0.95)), 1e-16), min(times) / n))
        if min(times) > _PATIENCE:
            break
    return np.array(rows)


def measure() -> dict[str, dict[str, Curve]]:
    """Curves of every method under every model: the same trajectories for all."""
    found: dict[str, dict[str, Curve]] = {}
    for title, names in MODELS.items():
        case = Case(names, n_sets=_SETS, points=_points(), everywhere=True)
        n, many = case.size, case.trajectories
        exact = case.literal.reshape(case.theta.shape[0], -1)

        def ours(tolerance: float, path: str | None = None, case: Case = case, exact: np.ndarray = exact) -> np.ndarray:
            speed = case.speed(tolerance, path)
            return np.abs(np.square(speed / exact) - 1.0)

        ours(1e-5)
        curves = {}
        if names:
            curves["psafit"] = _curve(ours, _TOLERANCE, n, 9)
        else:
            curves["psafit"] = _curve(ours, (1e-5,), n, 9)
            curves["psafit, stepped"] = _curve(lambda x, ours=ours: ours(x, "stepper"), _TOLERANCE, n, 9)  # type: ignore[misc]
        for method in ("LSODA", "Radau", "DOP853"):

            def peer(rtol: float, method: str = method, case: Case = case) -> np.ndarray:
                launches = [peers.scipy_launch(cases.RIG, one, method, rtol) for one in case.trajectories]
                return case.peer_errors(np.array(launches))

            curves[f"SciPy {method}"] = _curve(peer, _RTOL, n, 2)
        compiled: dict[str, Callable[[], Callable[[float], np.ndarray]]] = {
            "numbalsoda LSODA": lambda many=many: peers.Numbalsoda(cases.RIG, many),  # type: ignore[misc]
            "diffrax Kvaerno5": lambda many=many: peers.Diffrax(cases.RIG, many, "Kvaerno5", 16),  # type: ignore[misc]
            "diffrax Tsit5": lambda many=many: peers.Diffrax(cases.RIG, many, "Tsit5", 16),  # type: ignore[misc]
        }
        for name, make in compiled.items():
            try:
                batch = make()
            except ImportError:
                continue
            batch(1e-3)
            curves[name] = _curve(
                lambda x, batch=batch, case=case: case.peer_errors(batch(x)), _RTOL, n, 3  # type: ignore[misc]
            )  # fmt: skip
        found[title] = curves
        print(f"    {title}: " + "; ".join(f"{k} {1e6 * v[:, 1].min():.3g} us at best" for k, v in curves.items()))
    return found


def _time_at(curve: Curve, error: float) -> float:
    """Least time, s, of a point of a curve with at most this error; infinite where there is none."""
    able = curve[curve[:, 0] <= error, 1]
    return float(able.min()) if able.size else float("inf")


def worst_margin(found: dict[str, dict[str, Curve]]) -> float:
    """Smallest ratio of a peer's time to ours over all models and all points of the peers' curves below 1 % error."""
    ratios = []
    for curves in found.values():
        own = [curve for name, curve in curves.items() if name.startswith("psafit")]
        for name, curve in curves.items():
            if not name.startswith("psafit"):
                for error, seconds in curve[curve[:, 0] <= 1e-2]:
                    ratios.append(seconds / min(_time_at(c, error) for c in own))
    return min(ratios)


def _digits(value: float, n: int) -> str:
    """A number to so many digits, without an exponent."""
    return f"{float(f'{value:.{n}g}'):,.6g}"


def table(found: dict[str, dict[str, Curve]], error: float = 1e-5) -> str:
    """CPU time a trajectory (us) at which each method reaches an error, and ours as launches a second, in Markdown."""
    methods = list(dict.fromkeys(name for curves in found.values() for name in curves))
    rows = [["CPU time a launch, µs", *(f"`{title}`".replace(" + ", "` + `") for title in found)]]
    for name in methods:
        least = [_time_at(curves[name], error) if name in curves else math.inf for curves in found.values()]
        rows.append([name, *(_digits(1e6 * t, 3) if math.isfinite(t) else "" for t in least)])
    ours = [min(_time_at(c, error) for name, c in curves.items() if name == "psafit") for curves in found.values()]
    rows.append(["psafit: launches a second and core", *(_digits(1 / t, 2) for t in ours)])
    head, *body = (f"| {' | '.join(row)} |\n" for row in rows)
    return head + "|---" * len(rows[0]) + "|\n" + "".join(body)


def publish(text: str, page: str, by: str = "make bench") -> str:
    """The page with a text in the place of what stands between its marks, the first of which names who made it."""
    before, mark, rest = page.partition(f"<!-- {by} -->\n")
    _, end, after = rest.partition("<!-- end -->\n")
    if not (mark and end):
        raise ValueError(f"the page has no <!-- {by} --> before an <!-- end -->")
    return before + mark + "\n" + text + "\n" + end + after


def draw(found: dict[str, dict[str, Curve]], path: Path) -> None:
    """Four panels with common axes."""
    from matplotlib.figure import Figure

    with figure_style():
        figure = Figure(figsize=(9.0, 7.4), layout="constrained")
        panels = figure.subplots(2, 2, sharex=True, sharey=True)
        lines = {}
        for axes, (title, curves) in zip(panels.flat, found.items(), strict=True):
            for name, curve in curves.items():
                colour, marker, style = _LOOK[name]
                (lines[name],) = axes.loglog(
                    curve[:, 0], 1e6 * curve[:, 1], color=PALETTE[colour], marker=marker, linestyle=style,
                    markersize=5.5, linewidth=2.4 if name == "psafit" else 1.4,
                )  # fmt: skip
            axes.set_title(title)
            axes.axvline(1e-5, color=PALETTE["grey"], linewidth=0.8, linestyle=(0, (4, 4)))
        axes.set_xlim(1e-1, 1e-15)
        for axes in panels[1]:
            axes.set_xlabel("relative error of the launch range (95 % quantile)")
        for axes in panels[:, 0]:
            axes.set_ylabel("CPU time per trajectory, µs")
        figure.legend(lines.values(), lines.keys(), loc="outside lower center", ncols=4, fontsize=10)
        figure.savefig(path, dpi=150, metadata={"Software": None})
