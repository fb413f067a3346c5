"""Numbers and figures of docs/data.md, from the measurements in experiments/psa alone.

Run `python docs/make_data_figures.py`; it writes data_*.png and data.json to docs/figures.
Every number that docs/data.md quotes from the measurements is in that JSON file.
"""

from __future__ import annotations

import json
import sys
from itertools import combinations
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))  # runs from a checkout, installed or not

from psafit.experiment import Group, read_experiment  # noqa: E402

Array = NDArray[np.float64]

FIGURES = ROOT / "docs" / "figures"
OFFSET_UM = 0.3  # of the error metric log_rmse
# Okabe-Ito colours; the marker distinguishes the groups without colour.
LOOK = {
    1: ("#0072B2", "o", "1: sine 20 V"),
    2: ("#E69F00", "s", "2: sine 15 V"),
    3: ("#009E73", "^", "3: sine 1.2 kHz"),
    4: ("#CC79A7", "v", "4: sine 3 kHz"),
    5: ("#D55E00", "D", "5: square 1.2 kHz"),
    6: ("#000000", "P", "6: square 20 V"),
}
# What the study states apart from its appendix.
TABLE_2_RANGE_UM = {
    1: (0.67, 76.0),
    2: (0.90, 34.2),
    3: (0.37, 76.0),
    4: (0.4, 34.4),
    5: (0.09, 93.2),
    6: (0.0, 94.8),
}
TABLE_4 = {  # amplitude V: (theory 1.2 kHz, measured 1.2 kHz, theory 3 kHz, measured 3 kHz), um
    16.0: (60.60, 46.40, 28.97, 18.40),
    17.0: (64.40, 52.00, 30.70, 21.20),
    18.0: (68.18, 59.20, 32.60, 24.40),
    19.0: (72.96, 68.40, 34.41, 27.70),
    20.0: (75.75, 76.00, 36.22, 34.40),
}
# 5 % and 95 % quantiles of chi-squared, so that the script needs no scipy.
CHI2 = {3: (0.352, 7.815), 5: (1.145, 11.070)}


def swept(group: Group) -> Array:
    """Return the variable a group sweeps."""
    return group.amplitude_v if np.ptp(group.frequency_hz) == 0 else group.frequency_hz


def at(group: Group, x: float) -> float:
    """Return the reading at one value of the swept variable."""
    (index,) = np.flatnonzero(swept(group) == x)
    return float(group.reading[index])


def log_range(group: Group) -> Array:
    """ln(L + 0.3 um): differences of it are what log_rmse averages."""
    return np.log(group.reading + OFFSET_UM)


def rms(x: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(x))))


def scatter(group: Group, reach: int) -> tuple[NDArray[np.int64], Array]:
    """Deviation of each reading from the curve through its neighbours, as a standard deviation.

    The curve is the polynomial through `reach` neighbours on each side, in ln(L + 0.3 um) against
    the logarithm of the swept variable: a line for 1, a cubic for 2. The deviation is divided by
    what it would be for independent readings of unit variance, so its root mean square estimates
    the scatter of one reading (Gasser, Sroka and Jennen-Steinmetz 1986,
    doi:10.1093/biomet/73.3.625).

    Returns
    -------
    indices, deviations : (n_points - 2 reach,) arrays
    """
    x, y = np.log(swept(group)), log_range(group)
    indices = np.arange(reach, x.size - reach)
    deviations = np.empty(indices.size)
    for k, i in enumerate(indices):
        near = np.r_[i - reach : i, i + 1 : i + reach + 1]
        weights = np.array([np.prod([(x[i] - x[b]) / (x[a] - x[b]) for b in near if b != a]) for a in near])
        deviations[k] = (y[i] - weights @ y[near]) / np.sqrt(1 + weights @ weights)
    return indices, deviations


def reversals(group: Group, rising: bool, low: float, high: float) -> list[list[float]]:
    """Neighbouring readings in [low, high] that go against the stated trend (equal ones do not)."""
    x, y = swept(group), group.reading
    return [
        [float(x[i]), float(y[i]), float(x[i + 1]), float(y[i + 1])]
        for i in range(x.size - 1)
        if low <= x[i] and x[i + 1] <= high and (y[i + 1] - y[i]) * (1 if rising else -1) < 0
    ]


def share_on_grid(values: Array, step: float) -> float:
    """Share of readings that are whole multiples of `step`."""
    return float(np.mean(np.abs(values / step - np.round(values / step)) < 1e-6))


def shared_conditions(groups: dict[int, Group]) -> list[dict[str, Any]]:
    """Conditions that two groups measured, with both readings."""
    found = []
    for a, b in combinations(groups, 2):
        if groups[a].waveform != groups[b].waveform:
            continue
        first, second = (
            {(float(f), float(v)): float(r) for f, v, r in zip(g.frequency_hz, g.amplitude_v, g.reading, strict=True)}
            for g in (groups[a], groups[b])
        )
        for f, v in sorted(first.keys() & second.keys()):
            one, two = first[f, v], second[f, v]
            found.append(
                {
                    "waveform": groups[a].waveform,
                    "frequency_hz": f,
                    "amplitude_v": v,
                    "groups": [a, b],
                    "ranges_um": [one, two],
                    "ratio": one / two,
                    "log_difference": float(np.log((one + OFFSET_UM) / (two + OFFSET_UM))),
                }
            )
    return found


def session_scatter(pairs: list[dict[str, Any]]) -> dict[str, Any]:
    """Standard deviation of one reading between groups, from readings of the same condition."""
    differences = np.array([p["log_difference"] for p in pairs])
    sd = rms(differences) / np.sqrt(2)
    n = differences.size
    low, high = CHI2[n]
    return {
        "pairs": n,
        "sd": sd,
        "rms_difference": sd * float(np.sqrt(2)),
        "interval_90": [sd * float(np.sqrt(n / high)), sd * float(np.sqrt(n / low))],
    }


def best_proportional(group: Group) -> dict[str, float]:
    """Least log_rmse of any model whose range is proportional to the amplitude."""
    slopes = np.exp(np.linspace(-5, 3, 8001))
    predicted = slopes[:, None] * group.amplitude_v
    errors = np.sqrt(np.mean((np.log(predicted + OFFSET_UM) - log_range(group)) ** 2, axis=1))
    best = int(np.argmin(errors))
    return {"log_rmse": float(errors[best]), "slope_um_per_v": float(slopes[best])}


def power_law(group: Group, low: float) -> float:
    """Exponent n of L ~ V^n above an amplitude, by least squares in logarithms."""
    keep = group.amplitude_v >= low
    return float(np.polyfit(np.log(group.amplitude_v[keep]), np.log(group.reading[keep]), 1)[0])


def ratio_20_15(groups: dict[int, Group]) -> tuple[Array, Array]:
    """Range at 20 V over range at 15 V (sine) at the frequencies both sweeps have."""
    f, one, two = np.intersect1d(groups[1].frequency_hz, groups[2].frequency_hz, return_indices=True)
    return f, groups[1].reading[one] / groups[2].reading[two]


def group_numbers(groups: dict[int, Group]) -> dict[int, dict[str, Any]]:
    """What the page quotes of each group."""
    per_group: dict[int, dict[str, Any]] = {}
    for i, group in groups.items():
        _, line = scatter(group, 1)
        where, cubic = scatter(group, 2)
        worst = np.argsort(-np.abs(cubic))[:3]
        values = group.reading
        per_group[i] = {
            "n_points": group.n_points,
            "range_um": [float(values.min()), float(values.max())],
            "table_2_range_um": list(TABLE_2_RANGE_UM[i]),
            "swept": [float(swept(group).min()), float(swept(group).max())],
            "at_least": float(swept(group)[np.argmin(values)]),
            "at_greatest": float(swept(group)[np.argmax(values)]),
            "scatter_line": rms(line),
            "scatter_cubic": rms(cubic),
            "scatter_cubic_robust": float(1.4826 * np.median(np.abs(cubic))),
            "scatter_cubic_above_2um": rms(cubic[values[where] >= 2]),
            "largest_deviations": [
                {
                    "at": float(swept(group)[where[k]]),
                    "range_um": float(values[where[k]]),
                    "deviation": float(cubic[k]),
                }
                for k in worst
            ],
            "readings_from_20um": int((values >= 20).sum()),
            "readings_below_5um": int((values < 5).sum()),
            "whole_um_from_20um": share_on_grid(values[values >= 20], 1.0),
            "multiples_of_0.4_from_20um": share_on_grid(values[values >= 20], 0.4),
            "multiples_of_0.2_from_20um": share_on_grid(values[values >= 20], 0.2),
            "multiples_of_0.04_below_5um": share_on_grid(values[values < 5], 0.04),
        }
    return per_group


def ratio_numbers(groups: dict[int, Group]) -> dict[str, Any]:
    """What it quotes of the ratio of readings at 20 V and 15 V."""
    f, ratio = ratio_20_15(groups)
    excess = np.log(ratio / (20 / 15))
    return {
        "n": int(f.size),
        "median": float(np.median(ratio)),
        "least": [float(f[ratio.argmin()]), float(ratio.min())],
        "second_least": float(np.sort(ratio)[1]),
        "greatest": [float(f[ratio.argmax()]), float(ratio.max())],
        "median_exponent": float(np.log(np.median(ratio)) / np.log(20 / 15)),
        "median_100_to_1000Hz": float(np.median(ratio[f <= 1000])),
        "median_from_10kHz": float(np.median(ratio[f >= 10000])),
        "proportional_unseen_group_log_rmse": rms(excess),
        "proportional_both_groups_log_rmse": rms(excess / 2),
        "from_group_3_at_1200Hz": at(groups[3], 20) / at(groups[3], 15),
        "from_groups_1_2_at_1200Hz": at(groups[1], 1200) / at(groups[2], 1200),
        "from_group_4_at_3000Hz": at(groups[4], 20) / at(groups[4], 15),
        "from_groups_1_2_at_3000Hz": at(groups[1], 3000) / at(groups[2], 3000),
        "square_group_5_at_1200Hz": at(groups[5], 20) / at(groups[5], 15),
    }


def text_numbers(groups: dict[int, Group]) -> dict[str, Any]:
    """Single numbers of its text."""
    plateau = groups[6]
    square_over_sine = {
        "amplitude_1200Hz": [
            [float(v), at(groups[5], v), at(groups[3], v)]
            for v in np.intersect1d(groups[5].amplitude_v, groups[3].amplitude_v)
            if at(groups[5], v) <= at(groups[3], v)
        ],
        "frequency_20V": [
            [float(x), at(groups[6], x), at(groups[1], x)]
            for x in np.intersect1d(groups[6].frequency_hz, groups[1].frequency_hz)
            if at(groups[6], x) <= at(groups[1], x)
        ],
    }
    return {
        "range_at_2kHz_over_peak": {i: at(groups[i], 2000) / float(groups[i].reading.max()) for i in (1, 2)},
        "first_frequency_below_5_percent_of_peak_hz": {
            i: float(
                groups[i]
                .frequency_hz[(groups[i].frequency_hz > 1200) & (groups[i].reading < 0.05 * groups[i].reading.max())]
                .min()
            )
            for i in (1, 2)
        },
        "square_below_3kHz_um": [
            float(plateau.reading[plateau.frequency_hz < 3000].min()),
            float(plateau.reading[plateau.frequency_hz < 3000].max()),
        ],
        "square_up_to_20Hz_mean_um": float(plateau.reading[plateau.frequency_hz <= 20].mean()),
        "square_50Hz_to_2500Hz_mean_um": float(
            plateau.reading[(plateau.frequency_hz >= 50) & (plateau.frequency_hz < 3000)].mean()
        ),
        "square_50Hz_to_2500Hz_sd_um": float(
            plateau.reading[(plateau.frequency_hz >= 50) & (plateau.frequency_hz < 3000)].std(ddof=1)
        ),
        "square_not_above_sine": square_over_sine,
        "least_1200Hz_over_3000Hz": min(
            at(groups[3], v) / at(groups[4], v) for v in np.intersect1d(groups[3].amplitude_v, groups[4].amplitude_v)
        ),
    }


def table_numbers(groups: dict[int, Group]) -> dict[str, Any]:
    """What it quotes in addition to the study's Table 4."""
    return {
        "measured_equals_appendix": all(
            at(groups[3], v) == row[1] and at(groups[4], v) == row[3] for v, row in TABLE_4.items()
        ),
        "theory_um_per_v_1200Hz": {v: row[0] / v for v, row in TABLE_4.items()},
        "theory_um_per_v_3000Hz": {v: row[2] / v for v, row in TABLE_4.items()},
        "theory_17V_3000Hz_if_proportional": 17 * float(np.mean([row[2] / v for v, row in TABLE_4.items() if v != 17])),
        "measured_um_per_v_1200Hz": {v: row[1] / v for v, row in TABLE_4.items()},
        "theory_19V_if_proportional": 19 * float(np.mean([row[0] / v for v, row in TABLE_4.items() if v != 19])),
    }


def numbers(groups: dict[int, Group]) -> dict[str, Any]:
    """Everything docs/data.md quotes."""
    pairs = shared_conditions(groups)
    differing = [p for p in pairs if p["ratio"] != 1]
    f, ratio = ratio_20_15(groups)
    per_group = group_numbers(groups)
    weights = np.array([d["n_points"] for d in per_group.values()])
    return {
        "n_points": int(weights.sum()),
        "groups": per_group,
        "scatter_all_cubic": float(
            np.sqrt(np.average([d["scatter_cubic"] ** 2 for d in per_group.values()], weights=weights))
        ),
        "scatter_all_line": float(
            np.sqrt(np.average([d["scatter_line"] ** 2 for d in per_group.values()], weights=weights))
        ),
        "shared_conditions": pairs,
        "session_all_pairs": session_scatter(pairs),
        "session_differing_pairs": session_scatter(differing),
        "ratio_20_15": ratio_numbers(groups),
        "proportional": {i: best_proportional(groups[i]) for i in (3, 4, 5)},
        "exponent_from_5V": {i: power_law(groups[i], 5) for i in (3, 4, 5)},
        # Group 2 at 300 Hz times the mean 20 V/15 V ratio of the neighbours, 200 and 400 Hz.
        "group_1_at_300Hz_expected_um": at(groups[2], 300) * float(np.sqrt(ratio[f == 200][0] * ratio[f == 400][0])),
        "step_of_grid_0.4um_sd_um": 0.4 / float(np.sqrt(12)),
        "not_monotone": {
            "3 rising with V": reversals(groups[3], True, 0, 20),
            "4 rising with V": reversals(groups[4], True, 0, 20),
            "5 rising with V": reversals(groups[5], True, 0, 20),
            "1 rising to 1.2 kHz": reversals(groups[1], True, 0, 1200),
            "1 falling from 1.2 kHz": reversals(groups[1], False, 1200, 1e9),
            "2 rising to 1.2 kHz": reversals(groups[2], True, 0, 1200),
            "2 falling from 1.2 kHz": reversals(groups[2], False, 1200, 1e9),
            "6 falling from 3 kHz": reversals(groups[6], False, 3000, 1e9),
        },
        "text": text_numbers(groups),
        "table_4": table_numbers(groups),
        "bumps": {
            "1 at 10, 11, 12, 13 kHz": [at(groups[1], x) for x in (1e4, 1.1e4, 1.2e4, 1.3e4)],
            "2 at 10, 11, 12, 13 kHz": [at(groups[2], x) for x in (1e4, 1.1e4, 1.2e4, 1.3e4)],
            "1 at 19, 20, 21, 22 kHz": [at(groups[1], x) for x in (1.9e4, 2e4, 2.1e4, 2.2e4)],
            "drop 4.5 to 5 kHz": {i: at(groups[i], 5000) / at(groups[i], 4500) for i in (1, 2)},
            "drop 4.6 to 5 kHz": {6: at(groups[6], 5000) / at(groups[6], 4600)},
        },
    }


# --- figures ------------------------------------------------------------------------------------


def style() -> None:
    """Set one look for all figures, legible at page width."""
    mpl.rcParams.update(
        {
            "figure.dpi": 150,
            "savefig.dpi": 150,
            "font.size": 10.5,
            "axes.titlesize": 11,
            "axes.titlelocation": "left",
            "axes.spines.top": False,
            "axes.spines.right": False,
            "axes.grid": True,
            "grid.alpha": 0.25,
            "grid.linewidth": 0.6,
            "legend.frameon": False,
            "legend.fontsize": 9.5,
            "figure.constrained_layout.use": True,
        }
    )


def draw(ax: Axes, group: Group, scale: float = 1.0, keep: NDArray[np.bool_] | None = None, **more: Any) -> None:
    """Draw one group's readings; zeros cannot be shown on a logarithmic axis and are left out."""
    colour, marker, label = LOOK[int(group.id)]
    x, y = swept(group) * scale, group.reading
    shown = (y > 0) if keep is None else keep & (y > 0)
    options = {"ms": 4.5, "lw": 0.9, "label": label, **more}
    ax.plot(x[shown], y[shown], color=colour, marker=marker, **options)


def note(ax: Axes, text: str, xy: tuple[float, float], at_xy: tuple[float, float]) -> None:
    """Label a point of interest."""
    ax.annotate(
        text,
        xy,
        at_xy,
        fontsize=9,
        arrowprops={"arrowstyle": "-", "color": "0.35", "lw": 0.8, "shrinkB": 4},
    )


def plain_ticks(ax: Axes, x: list[float] | None = None, y: list[float] | None = None) -> None:
    """Write numbers, not powers of ten, on logarithmic axes."""
    for axis, ticks in ((ax.xaxis, x), (ax.yaxis, y)):
        if ticks is not None:
            axis.set_major_locator(mpl.ticker.FixedLocator(ticks))
            axis.set_major_formatter(mpl.ticker.FuncFormatter(lambda v, _: f"{v:g}"))
            axis.set_minor_formatter(mpl.ticker.NullFormatter())


def overview(groups: dict[int, Group]) -> Figure:
    """All 288 readings."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.6), sharey=True)
    for i in (6, 1, 2):
        draw(left, groups[i], 1e-3)
    left.set(xscale="log", yscale="log", xlabel="drive frequency (kHz)", ylabel="launch range (µm)")
    left.set_title("(a) frequency sweeps")
    plain_ticks(left, [0.001, 0.01, 0.1, 1, 10, 50], [0.1, 1, 10, 100])
    left.legend(loc="lower left")
    left.set_ylim(0.07, 150)
    left.plot(50, 0.075, marker="v", mfc="none", color="k", ms=7, clip_on=False)
    note(left, "0 µm at 50 kHz", (50, 0.075), (0.75, 0.1))
    for i in (5, 3, 4):
        draw(right, groups[i])
    volts = np.array([1.0, 20.0])
    right.plot(volts, 0.5 * volts, color="0.45", ls="--", lw=1.2)
    right.text(1.25, 0.8, "range ∝ V", color="0.3", rotation=24, fontsize=9.5)
    right.set(xscale="log", xlabel="drive amplitude (V)")
    right.set_title("(b) amplitude sweeps")
    plain_ticks(right, [1, 2, 5, 10, 20])
    right.legend(loc="lower right")
    return figure


def repeats(groups: dict[int, Group], facts: dict[str, Any]) -> Figure:
    """The five conditions that two groups measured."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.9), width_ratios=(1.25, 1), sharey=True)
    pairs = sorted(facts["shared_conditions"], key=lambda p: p["ratio"])
    seen: set[int] = set()
    for y, pair in enumerate(pairs):
        left.plot(pair["ranges_um"], [y, y], color="0.6", lw=2, zorder=1)
        for i, value, shift in zip(pair["groups"], pair["ranges_um"], (0.12, -0.12), strict=True):
            colour, marker, label = LOOK[i]
            same = pair["ratio"] == 1  # one point would hide the other
            left.plot(
                value,
                y + (shift if same else 0),
                color=colour,
                marker=marker,
                ms=9,
                ls="none",
                label=label if i not in seen else None,
                zorder=2,
            )
            seen.add(i)
        gap = pair["log_difference"]
        right.barh(y, gap, color="#0072B2" if gap else "0.6", height=0.5)
        text = f"ratio {pair['ratio']:.2f}" if gap else "identical readings"
        right.text(max(gap, 0) + 0.01, y, text, va="center", fontsize=10)
    left.set_yticks(
        range(len(pairs)),
        [
            f"{p['waveform']}, {p['amplitude_v']:g} V,\n{p['frequency_hz'] / 1000:g} kHz "
            f"(groups {p['groups'][0]}, {p['groups'][1]})"
            for p in pairs
        ],
    )
    left.set(xlabel="launch range (µm)", xlim=(0, 105))
    left.set_title("(a) both readings")
    handles, labels = left.get_legend_handles_labels()
    order = np.argsort(labels)
    figure.legend(
        [handles[k] for k in order],
        [labels[k] for k in order],
        loc="outside lower center",
        ncols=6,
        handletextpad=0.1,
        columnspacing=1.2,
    )
    right.set(xlabel="ln of the ratio (units of log_rmse)", xlim=(-0.12, 0.42))
    right.axvline(0, color="0.3", lw=0.8)
    right.set_title("(b) disagreement, first group over second")
    return figure


def amplitude_law(groups: dict[int, Group], facts: dict[str, Any]) -> Figure:
    """How the range grows with the amplitude."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.3))
    f, ratio = ratio_20_15(groups)
    left.plot(f / 1e3, ratio, "o-", color="#0072B2", ms=4.5, lw=0.9, label="groups 1 / 2")
    r = facts["ratio_20_15"]
    for i, x, key in ((3, 1.2, "from_group_3_at_1200Hz"), (4, 3.0, "from_group_4_at_3000Hz")):
        colour, marker, label = LOOK[i]
        left.plot(
            x,
            r[key],
            color=colour,
            marker=marker,
            ms=10,
            ls="none",
            mec="k",
            label=f"group {label}",
        )
    for n, text in ((1, "∝ V"), (2, "∝ V²"), (3, "∝ V³")):
        left.axhline((20 / 15) ** n, color="0.45", ls="--", lw=1)
        left.text(20.5, (20 / 15) ** n + 0.03, text, fontsize=9.5, color="0.3")
    note(left, "300 Hz", (0.3, ratio[f == 300][0]), (0.42, 1.5))
    note(left, "6 kHz", (6, ratio[f == 6000][0]), (8, 3.12))
    left.set(
        xscale="log",
        xlabel="drive frequency (kHz)",
        ylabel="range at 20 V / range at 15 V",
        ylim=(1.2, 3.3),
        xlim=(0.08, 32),
    )
    plain_ticks(left, [0.1, 0.3, 1, 3, 10])
    left.legend(loc="upper left")
    left.set_title("(a) sine drive, 20 V against 15 V")
    for i in (5, 3, 4):
        colour, marker, label = LOOK[i]
        right.plot(
            groups[i].amplitude_v,
            groups[i].reading / groups[i].amplitude_v,
            color=colour,
            marker=marker,
            ms=4.5,
            lw=0.9,
            label=label,
        )
    right.set(xlabel="drive amplitude (V)", ylabel="range / amplitude (µm/V)", ylim=(0, None))
    right.set_title("(b) a proportional model is a level line")
    right.set_xticks([1, 5, 10, 15, 20])
    right.legend(loc="upper left")
    return figure


def odd_points(groups: dict[int, Group]) -> Figure:
    """Close-ups of readings that stand out."""
    figure, axes = plt.subplots(2, 2, figsize=(10, 7.4))
    (a, b), (c, d) = axes
    for i in (1, 2):
        draw(a, groups[i], 1.0, groups[i].frequency_hz <= 700)
    a.set(xscale="log", yscale="log", xlabel="drive frequency (Hz)", ylabel="launch range (µm)")
    a.set_title("(a) group 1 at 300 Hz is low")
    plain_ticks(a, [100, 200, 300, 500, 700], [1, 3, 10, 30])
    a.legend(loc="upper left")
    note(a, "300 Hz: 11.3 µm", (300, 11.3), (150, 17))
    for i in (6, 1, 2):
        keep = (groups[i].frequency_hz >= 8000) & (groups[i].frequency_hz <= 25000)
        draw(b, groups[i], 1e-3, keep)
    b.set(yscale="log", xlabel="drive frequency (kHz)", ylabel="launch range (µm)")
    b.set_title("(b) no fall at 11-12 and 21-22 kHz")
    plain_ticks(b, [8, 10, 12, 15, 20, 25], [1, 2, 5, 10])
    b.axvspan(10.5, 12.5, ymax=0.76, color="0.85", zorder=0)
    b.axvspan(20.5, 22.5, ymax=0.76, color="0.85", zorder=0)
    b.legend(loc="upper right")
    b.set_ylim(0.55, 22)
    for i in (5, 3, 4):
        draw(c, groups[i], 1.0, groups[i].amplitude_v <= 10)
    c.set(xscale="log", yscale="log", xlabel="drive amplitude (V)", ylabel="launch range (µm)")
    c.set_title("(c) weak drive: readings not in order")
    plain_ticks(c, [1, 2, 3, 5, 10], [0.1, 0.3, 1, 3, 10])
    note(c, "1 V: 0.44, then\n2 V: 0.37", (2, 0.37), (1.25, 1.1))
    note(c, "7.5 to 8.5 V:\n3.32, 3.31, 3.06", (8, 3.31), (5.6, 0.62))
    c.legend(loc="lower right", fontsize=9, bbox_to_anchor=(1.0, -0.02))
    draw(d, groups[6], 1.0, groups[6].frequency_hz <= 3500)
    d.axhline(94, color="0.45", ls="--", lw=1.2)
    d.text(1, 94.3, "the study's text:\nabout 94 µm", fontsize=9.5, color="0.3")
    d.set(xscale="log", xlabel="drive frequency (Hz)", ylabel="launch range (µm)", ylim=(74, 98))
    d.set_title("(d) square drive: not level below 3 kHz")
    plain_ticks(d, [1, 10, 100, 1000])
    note(d, "1 to 20 Hz: 86.8 to 88.0 µm", (10, 88), (1.6, 82))
    d.legend(loc="lower left")
    return figure


def resolution(facts: dict[str, Any]) -> Figure:
    """Which digits the readings use."""
    figure, axes = plt.subplots(1, 2, figsize=(10, 3.7), sharey=True)
    panels = (
        ("multiples_of_0.4_from_20um", "readings_from_20um", "(a) from 20 µm: multiples of 0.4 µm"),
        (
            "multiples_of_0.04_below_5um",
            "readings_below_5um",
            "(b) below 5 µm: multiples of 0.04 µm",
        ),
    )
    for ax, (key, count, title) in zip(axes, panels, strict=True):
        for i, d in facts["groups"].items():
            ax.bar(i, 100 * d[key], color=LOOK[i][0], width=0.65)
            ax.text(i, 100 * d[key] + 2, f"{100 * d[key]:.0f} %\nof {d[count]}", ha="center", fontsize=9)
        ax.axhline(25, color="0.25", ls="--", lw=1.2)
        ax.text(6.95, 25, "by\nchance", fontsize=9, color="0.25", va="center")
        ax.set(xlabel="group", xticks=range(1, 7), xlim=(0.4, 6.9), ylim=(0, 118))
        ax.set_title(title)
        ax.grid(axis="x", visible=False)
    axes[0].set_ylabel("share of readings (%)")
    axes[0].set_yticks(range(0, 101, 25))
    return figure


def scatter_figure(groups: dict[int, Group], facts: dict[str, Any]) -> Figure:
    """Scatter of the readings about the curve through their neighbours."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.3), width_ratios=(1.3, 1))
    for i, group in groups.items():
        colour, marker, label = LOOK[i]
        where, deviation = scatter(group, 2)
        left.plot(
            np.maximum(group.reading[where], 0.05),
            deviation,
            color=colour,
            marker=marker,
            ls="none",
            ms=5,
            alpha=0.8,
            label=label,
        )
    left.axhline(0, color="0.3", lw=0.8)
    left.set(
        xscale="log",
        xlabel="launch range (µm)",
        ylabel="deviation from neighbours (ln units)",
        ylim=(-0.36, 0.36),
    )
    plain_ticks(left, [0.1, 1, 10, 100])
    left.legend(fontsize=9, ncols=2, loc="upper right", handletextpad=0.1, columnspacing=0.8)
    left.set_title("(a) each reading against a cubic through four neighbours")
    x = np.arange(1, 7)
    d = facts["groups"]
    right.bar(x - 0.2, [d[i]["scatter_cubic"] for i in x], 0.38, color="#0072B2", label="root mean square")
    right.bar(
        x + 0.2,
        [d[i]["scatter_cubic_robust"] for i in x],
        0.38,
        color="#E69F00",
        label="robust (median)",
    )
    session = facts["session_all_pairs"]["sd"]
    right.axhline(session, color="0.25", ls="--", lw=1.2)
    right.text(0.5, session + 0.002, f"between groups, same condition: {session:.3f}", fontsize=9.5)
    right.set(xlabel="group", ylabel="scatter of one reading (ln units)", xticks=x, ylim=(0, 0.125))
    right.grid(axis="x", visible=False)
    right.legend(loc="upper right", ncols=2, fontsize=9, columnspacing=1.0)
    right.set_title("(b) per group")
    return figure


def rounded(value: Any) -> Any:
    """Five significant digits, so that the file does not change with the last bit."""
    if isinstance(value, dict):
        return {str(k): rounded(v) for k, v in value.items()}
    if isinstance(value, list):
        return [rounded(v) for v in value]
    return float(f"{value:.5g}") if isinstance(value, float) else value


def main() -> None:
    """Write the figures and the numbers."""
    experiment = read_experiment(ROOT / "experiments" / "psa")
    groups = {int(g.id): g for g in experiment.groups}
    facts = numbers(groups)
    FIGURES.mkdir(exist_ok=True)
    text = json.dumps(rounded(facts), indent=1)
    (FIGURES / "data.json").write_text(text + "\n", encoding="utf-8")
    style()
    for name, figure in (
        ("overview", overview(groups)),
        ("repeats", repeats(groups, facts)),
        ("amplitude_law", amplitude_law(groups, facts)),
        ("odd_points", odd_points(groups)),
        ("resolution", resolution(facts)),
        ("scatter", scatter_figure(groups, facts)),
    ):
        # No software version in the file: the same data give the same bytes.
        figure.savefig(FIGURES / f"data_{name}.png", metadata={"Software": None})
        plt.close(figure)
    print(f"wrote {FIGURES.relative_to(ROOT)}/data.json and 6 figures")


if __name__ == "__main__":
    main()
