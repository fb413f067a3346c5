"""The reproduction page: what a study printed, and what its model gives with and without its step.

Figures receive results and compute nothing beyond units.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from psafit.arrays import FloatArray
from psafit.report.page import figure_data_uri, render
from psafit.report.style import HEIGHT, MEASURED, PALETTE, figure_style, new_figure, plain_log_ticks
from psafit.report.wording import typeset
from psafit.reproduce import (
    NOT_REPRODUCED,
    ONLY_WITH_STEP,
    REPRODUCED,
    Claim,
    Convergence,
    Reproduction,
    Sweep,
)

STUDY: dict[str, Any] = {"color": PALETTE["vermillion"], "zorder": 4}
CONVERGED: dict[str, Any] = {"color": PALETTE["blue"], "zorder": 4}
_SHORT = {REPRODUCED: "yes", ONLY_WITH_STEP: "only with its step", NOT_REPRODUCED: "no"}
_KINDS = {REPRODUCED: "good", ONLY_WITH_STEP: "warn", NOT_REPRODUCED: "bad"}


def _sweep_figure(sweep: Sweep, study_label: str) -> Figure:
    figure, axes = new_figure()
    axes.plot(sweep.measured_frequency, sweep.measured, **MEASURED, label="measured")
    axes.plot(sweep.frequency, sweep.study_step, **STUDY, lw=1.4, label=study_label)
    axes.plot(sweep.frequency, sweep.converged, **CONVERGED, label="converged")
    axes.set_xscale("log")
    plain_log_ticks(axes, x=True)
    axes.set_ylim(0, 1.06 * float(np.nanmax([sweep.converged.max(), sweep.measured.max()])))
    axes.set_xlabel("Drive frequency (Hz)")
    axes.set_ylabel("Launch range (µm)")
    axes.set_title(f"{sweep.waveform.capitalize()}, {sweep.amplitude:g} V")
    if sweep.waveform == "sine":
        axes.legend(loc="upper right")
    else:  # between the measured plateau and the converged one
        axes.legend(loc="center left", bbox_to_anchor=(0.0, 0.66))
    return figure


def _stability_figure(result: Reproduction) -> Figure:
    s = result.stability
    figure, axes = new_figure()
    colors = [PALETTE[name] for name in ("vermillion", "green", "purple", "purple")]
    for k, value in enumerate(s.eigenvalues):
        if value.imag < 0:
            continue  # the conjugate grows as fast
        rate = f"{value.real / 1e3:.4g}".replace("-", "\N{MINUS SIGN}")
        label = f"{rate} /ms" if value.imag == 0 else f"{rate} ± {value.imag / 1e3:.3g}i /ms"
        axes.plot(1e6 * s.step, s.growth[k], color=colors[k], label=label)
    axes.axhline(1.0, color=PALETTE["ink"], lw=0.8)
    limit, step = 1e6 * s.largest_stable_step, 1e6 * s.study_step
    axes.axvspan(limit, 1e6 * float(s.step[-1]), color=PALETTE["vermillion"], alpha=0.10, lw=0)
    axes.plot(step, s.study_growth[0], "o", color=PALETTE["vermillion"], ms=6, zorder=5)
    axes.annotate(
        f"study: {step:g} µs,\n×{s.study_growth[0]:.3f} per step",
        (step, float(s.study_growth[0])), (0.57 * step, 1.36), fontsize=9,
        arrowprops={"arrowstyle": "-", "color": PALETTE["grey"], "lw": 0.8},
    )  # fmt: skip
    axes.annotate(f"stable up to\n{limit:.4f} µs", (limit, 0.0), (0.96 * limit, 0.08), fontsize=9, ha="right")
    axes.set_xlim(0, 1e6 * float(s.step[-1]))
    axes.set_ylim(0, 1.7)
    axes.set_xlabel("Time step (µs)")
    axes.set_ylabel("Growth per step |R(λh)|")
    axes.set_title("Stability of Runge-Kutta 4")
    axes.legend(loc="upper left", title="eigenvalue λ", title_fontsize=9, fontsize=8.5)
    return figure


def _fast_mode_figure(result: Reproduction) -> Figure:
    figure, axes = new_figure()
    colors = (PALETTE["vermillion"], PALETTE["orange"], PALETTE["green"])
    for mode, color in zip(result.fast_modes, colors, strict=False):
        shown = mode.error > 0
        axes.plot(
            1e6 * mode.time[shown], 1e6 * mode.error[shown], color=color, lw=1.5,
            label=f"error, step {1e6 * mode.step:g} µs",
        )  # fmt: skip
    fine = result.fast_modes[-1]
    there = fine.indentation > 0
    axes.plot(
        1e6 * fine.time[there], 1e6 * fine.indentation[there], color=PALETTE["grey"], ls="--",
        lw=1.3, label="the indentation itself",
    )  # fmt: skip
    first = result.fast_modes[0]
    axes.plot(1e6 * first.time[-1], 1e6 * first.error[-1], "x", color=colors[0], ms=8, mew=2)
    axes.annotate(
        f"false separation\nat {1e6 * first.time[-1]:.0f} µs",
        (1e6 * float(first.time[-1]), 1e6 * float(first.error[-1])), (338, 8e-6), fontsize=9,
        arrowprops={"arrowstyle": "-", "color": PALETTE["grey"], "lw": 0.8},
    )  # fmt: skip
    axes.set_yscale("log")
    axes.set_ylim(1e-11, 1e4)
    axes.set_xlabel("Time (µs)")
    axes.set_ylabel("Indentation (µm)")
    axes.set_title("The fast mode, 1.2 kHz, 20 V")
    axes.legend(loc="upper left", ncols=2, fontsize=8, columnspacing=1.0)
    return figure


def _convergence_figure(cases: tuple[Convergence, ...], limit: float) -> Figure:
    figure, axes = new_figure()
    for case, name in zip(cases, ("purple", "blue", "green"), strict=False):
        error = 100.0 * np.abs(case.launch_range / case.exact - 1.0)
        axes.plot(
            1e6 * case.step, error, "o", color=PALETTE[name], ms=3.6,
            label=f"{case.frequency / 1e3:g} kHz, exact {1e6 * case.exact:.4g} µm",
        )  # fmt: skip
    guide = np.array([1e-2, 0.9])
    axes.plot(guide, 4.0 * guide, color=PALETTE["grey"], lw=1.0, ls="--", label="first order")
    right = 1e6 * float(max(cases[0].step)) * 1.25
    axes.axvspan(1e6 * limit, right, color=PALETTE["vermillion"], alpha=0.10, lw=0)
    axes.annotate(
        "unstable:\nthe study", (1e6 * limit, 40.0), (0.88e6 * limit, 20.0), fontsize=9, ha="right",
        color=PALETTE["vermillion"],
    )  # fmt: skip
    axes.set_xscale("log")
    axes.set_yscale("log")
    plain_log_ticks(axes, x=True, y=True)
    axes.set_xlim(9e-3, right)
    axes.set_ylim(1e-4, 1e4)
    axes.set_yticks([1e-3, 1e-2, 1e-1, 1e0, 1e1, 1e2])
    axes.set_xlabel("Time step (µs)")
    axes.set_ylabel("Error of launch range (%)")
    axes.set_title("Refining the step, sine, 20 V")
    axes.legend(loc="upper left", fontsize=8.5)
    return figure


def _displacement_figure(result: Reproduction) -> Figure:
    figure, axes = new_figure()
    for path in result.trajectories:
        if path.frequency != 1200.0:
            continue
        look = STUDY if path.label != "converged" else CONVERGED
        axes.plot(path.time, path.tip, **look, label=f"tip, {path.label}")
        axes.plot(path.time, path.ball, **look, ls="--", label=f"ball, {path.label}")
        top = int(np.argmax(path.tip))
        axes.plot(path.time[top], path.tip[top], "v", color=look["color"], ms=6, zorder=5)
    axes.axvline(275.0, color=PALETTE["grey"], lw=1.0, ls=":")
    axes.annotate("275 µs, as printed", (275.0, 0.06), xytext=(281.0, 0.06), fontsize=9)
    axes.set_xlabel("Time (µs)")
    axes.set_ylabel("Displacement (µm)")
    axes.set_title("As Fig. 13a: 1.2 kHz, 20 V")
    axes.set_ylim(-0.05, 1.85)
    axes.legend(loc="upper left", ncols=2, fontsize=8.5)
    return figure


def _force_figure(result: Reproduction) -> Figure:
    figure, axes = new_figure()
    shades = ("#08306b", "#08519c", "#2171b5", "#4292c6", "#6baed6", "#9ecae1")
    exact = [path for path in result.trajectories if path.label == "converged"]
    for path, shade in zip(exact, shades, strict=False):
        axes.plot(path.time, path.force, color=shade, lw=1.5, label=f"{path.frequency / 1e3:g} kHz")
        top = int(np.argmax(path.force))
        axes.plot(path.time[top], path.force[top], "o", color=shade, ms=4)
    axes.axhline(0.0, color=PALETTE["ink"], lw=0.8)
    axes.set_xlabel("Time (µs)")
    axes.set_ylabel("Contact force (N)")
    axes.set_title("As Fig. 14a, converged, 20 V")
    axes.legend(loc="upper right", ncols=2, fontsize=8.5)
    return figure


def _restitution_figure(result: Reproduction) -> Figure:
    figure, axes = new_figure()
    r = result.restitution
    axes.plot(r.frequency, r.elastic_study_step, **STUDY, label="study's time step")
    axes.plot(r.frequency, r.elastic_converged, **CONVERGED, label="converged")
    known = [(row.frequency, row.published) for row in _definitions(result)]
    unknown = [c.published for c in result.claims if c.id.startswith("fig15_restitution_0") and not c.id.endswith("hz")]
    if known:
        axes.plot(*zip(*known, strict=True), **MEASURED | {"marker": "s", "zorder": 6}, label="published")
    for k, value in enumerate(unknown):
        axes.hlines(
            value, 3500.0, float(r.frequency[-1]), color=PALETTE["ink"], ls=":", lw=1.2,
            label="" if k else "published, frequency not given",
        )  # fmt: skip
    axes.set_xscale("log")
    plain_log_ticks(axes, x=True)
    axes.set_ylim(0, 1.05)
    axes.set_xlabel("Drive frequency (Hz)")
    axes.set_ylabel("Coefficient of restitution")
    axes.set_title("As Fig. 15: impulses of k$_c$δ, 20 V")
    axes.legend(loc="lower right", fontsize=8.5)
    return figure


def _tall(figure: Figure) -> Figure:
    figure.set_figheight(1.12 * HEIGHT)
    return figure


def figures(result: Reproduction) -> dict[str, Figure]:
    """All figures of the page, by name."""
    with figure_style():
        sweeps = {s.waveform: s for s in result.sweeps}
        drawn = {
            "stability": _stability_figure(result),
            "fast_mode": _fast_mode_figure(result),
            "convergence": _convergence_figure(result.convergence, result.stability.largest_stable_step),
            "displacement": _displacement_figure(result),
            "force": _force_figure(result),
            "restitution": _restitution_figure(result),
        }
        if "sine" in sweeps:
            drawn["sine"] = _tall(_sweep_figure(sweeps["sine"], "study's time step"))
        if "square" in sweeps:
            drawn["square"] = _sweep_figure(sweeps["square"], "study's step, third reading")
        return drawn


def _number(value: float, unit: str) -> str:
    if not math.isfinite(value):
        return "none: overflow"
    digits = {"um": 2, "us": 1, "Hz": 0, "%": 2}.get(unit, 3 if value != round(value) else 0)
    return typeset(f"{value:,.{digits}f} {'' if unit == '1' else unit}".replace(",", "\N{THIN SPACE}").strip())


def count_text(result: Reproduction) -> str:
    """How many claims come out, in one sentence."""
    only, step = result.count(ONLY_WITH_STEP), 1e6 * result.stability.study_step
    given_back = only + result.count(REPRODUCED)
    return (
        f"With its published parameters and its time step of {step:g} µs, the study's scheme gives back {given_back} of"
        f" {len(result.claims)} published claims, {only} of them only with that step."
    )


def claims_table(result: Reproduction) -> str:
    """Every claim as aligned text, under the count."""
    rows = [["claim", "published", "study's step", "converged", "reproduced"]]
    for c in result.claims:
        name = textwrap.shorten(c.statement.replace(", sine, 20 V", ""), 52, placeholder=" …")
        values = [_number(value, c.unit) for value in (c.published, c.study_step, c.converged)]
        rows.append([typeset(name), *values, _SHORT[c.verdict]])
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = [
        "  ".join([row[0].ljust(widths[0]), *map(str.rjust, row[1:4], widths[1:4]), row[4]]) for row in rows
    ]  # fmt: skip
    return "\n".join([count_text(result), *lines])


def _range(values: FloatArray) -> str:
    if np.isnan(values).any():
        return "none: overflow"
    low, nominal, high = values
    return f"{nominal:.2f} µm ({low:.2f} to {high:.2f})"


def _row(claim: Claim) -> list[Any]:
    return [
        typeset(f"{claim.place}: {claim.statement[0].lower()}{claim.statement[1:]}"),
        _number(claim.published, claim.unit),
        _number(claim.study_step, claim.unit),
        _number(claim.converged, claim.unit),
        {"text": claim.verdict, "kind": _KINDS[claim.verdict]},
    ]


class _Definitions(NamedTuple):
    frequency: float
    published: float
    values: tuple[float, ...]


def _definitions(result: Reproduction) -> list[_Definitions]:
    """Every definition of the restitution at the frequencies the study names."""
    r, out = result.restitution, []
    for claim in result.claims:
        if not (claim.id.startswith("fig15_restitution_") and claim.id.endswith("hz")):
            continue
        frequency = float(claim.id.split("_")[-1][:-2])
        k = int(np.argmin(np.abs(r.frequency - frequency)))
        curves = (
            r.elastic_study_step,
            r.elastic_study_sums,
            r.elastic_converged,
            r.force_converged,
            r.peak_force_converged,
        )
        out.append(_Definitions(frequency, claim.published, tuple(float(c[k]) for c in curves)))
    return out


def write_reproduction(result: Reproduction, out_path: str | Path, provenance: Mapping[str, str] | None = None) -> Path:
    """Write the reproduction page.

    Parameters
    ----------
    result : Reproduction
    out_path : path-like
        The HTML file.
    provenance : mapping of str to str, optional
        Footer: version, command and the like.

    Returns
    -------
    Path
    """
    uris = {name: figure_data_uri(figure) for name, figure in figures(result).items()}
    sine = next((s for s in result.sweeps if s.waveform == "sine"), None)
    at_readings = None if sine is None else np.isin(sine.frequency, sine.measured_frequency)
    example = next((c for c in result.convergence if c.frequency == 1200.0), result.convergence[0])
    return render(
        "reproduction.html.j2",
        out_path,
        provenance=dict(provenance or {}),
        result=result,
        uris=uris,
        rows=[_row(claim) for claim in result.claims],
        square_rows=[
            [
                attempt.reading,
                _number(attempt.largest, "um"),
                f"{attempt.diverged} of {attempt.n_frequencies}",
                _number(attempt.sine_check, "um"),
            ]
            for attempt in result.square_attempts
        ],
        agreement_rows=[
            [
                group.group,
                "none: overflow" if math.isnan(group.study_step) else f"{group.study_step:.2f}",
                f"{group.converged:.2f}",
                f"{group.diverged} of {group.n_points}",
            ]
            for group in result.agreement
        ],
        rounding_rows=[
            [row.condition, *(_range(x) for x in (row.study_step, row.converged))] for row in result.rounding
        ],
        restitution_rows=[
            [
                f"{claim.frequency / 1e3:g} kHz",
                f"{claim.published:.3f}",
                *(typeset(f"{value:.3f}") for value in claim.values),
            ]
            for claim in _definitions(result)
        ],
        number=_number,
        typeset=typeset,
        count_text=count_text(result),
        counts={
            "reproduced": result.count(REPRODUCED),
            "only": result.count(ONLY_WITH_STEP),
            "not": result.count(NOT_REPRODUCED),
        },
        limit_us=1e6 * result.stability.largest_stable_step,
        step_us=1e6 * result.stability.study_step,
        growth=float(result.stability.study_growth[0]),
        example={
            "study": 1e6 * float(example.launch_range[0]),
            "exact": 1e6 * example.exact,
        },
        peak=None
        if sine is None
        else {
            "measured": float(sine.measured.max()),
            "exact": float(sine.converged.max()),
            "exact_at": float(sine.frequency[int(np.argmax(sine.converged))]),
            "exact_measured": float(np.max(sine.converged[at_readings])),
            "exact_measured_at": float(sine.frequency[at_readings][int(np.argmax(sine.converged[at_readings]))]),
        },
    )
