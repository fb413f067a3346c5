"""Figures."""

from __future__ import annotations

import ast
import re
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fits_by_hand import make_group, make_predictions, make_run, sweep_groups
from matplotlib.figure import Figure
from matplotlib.text import Text

from psafit.experiment import Conditions, Experiment, Group
from psafit.report import figures, fit
from psafit.report.figures import curves
from psafit.report.figures.axes import scale_axis
from psafit.report.figures.groups import titled
from psafit.report.figures.influence import influence_figure
from psafit.report.page import figure_data_uri
from psafit.report.style import PALETTE
from psafit.validate import Prediction

REPORT = Path(fit.__file__).parent


def drawn(p: Prediction):
    return figures.group_figure(p.group, figures.sweep_of(p.group), [figures.curve_of(p)], p.role)


def test_same_results_same_bytes(tmp_path):
    p = make_predictions(make_run(tmp_path))[1]
    first, second = (figure_data_uri(drawn(p)) for _ in range(2))
    assert first == second
    small = figure_data_uri(drawn(p), svg_limit=0)
    assert small.startswith("data:image/png") and len(small) < 0.8 * len(first)


@pytest.mark.parametrize(
    ("high", "few", "labelled"),
    [
        (400.0, False, [100, 200, 300, 400]),  # too few powers of ten to be read
        (1100.0, False, [100, 200, 500, 1000]),
        (2e4, False, [100, 300, 1000, 3000, 1e4]),
        (2e4, True, [100, 1000, 1e4]),
        (3e6, False, [100, 1000, 1e4, 1e5, 1e6]),
        (3e6, True, [100, 1e4, 1e6]),
    ],
)
def test_a_logarithmic_axis_is_labelled_by_its_decades(high, few, labelled):
    axes = Figure().subplots()
    scale_axis(axes, "x", 90.0, high, log=True, few=few)
    assert [t for t in axes.get_xticks() if 90.0 <= t <= high] == pytest.approx(labelled)


def test_figures_do_not_compute():
    for file in [*(REPORT / "figures").glob("*.py"), REPORT / "style.py"]:
        tree = ast.parse(file.read_text("utf-8"))
        kept = {id(n) for top in ast.walk(tree) if isinstance(top, ast.If) and "TYPE_CHECKING" in ast.dump(top.test)
                for n in ast.walk(top)}  # fmt: skip
        for node in ast.walk(tree):
            if id(node) in kept:
                continue
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [a.name for a in node.names] if isinstance(node, ast.Import) else []
            for name in names:
                assert not name.startswith(("psafit.simulate", "psafit.inference", "psafit.validate", "scipy")), file
                assert "pyplot" not in name, file
            if isinstance(node, ast.Call):
                called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
                assert called not in {"simulate", "predict", "score"}, file


def test_pages_do_not_simulate():
    for file in REPORT.glob("fit*.py"):
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("psafit.simulate"):
                assert node.module == "psafit.simulate.stability", "a property of the equations, not a run of them"


@pytest.mark.parametrize(
    ("frequency", "amplitude", "variable", "log"),
    [
        ([1.0, 10, 100], 5.0, "frequency", True),
        ([100.0, 110, 120], [5.0, 5.02, 5.01], "frequency", False),
        (1000.0, [1.0, 10, 20], "amplitude", True),
        (1000.0, [0.0, 10, 20], "amplitude", False),
        ([1.0, 2, 3], [1.0, 2, 3], "order", False),
        (5.0, 5.0, "order", False),
    ],
)
def test_abscissa_is_what_varies(frequency, amplitude, variable, log):
    sweep = figures.sweep_of(make_group(1, frequency, amplitude, [1.0, 2.0, 3.0]))
    assert (sweep.variable, sweep.log) == (variable, log)


def test_lines_are_sorted_and_zeros_sit_on_the_edge(tmp_path):
    run = make_run(tmp_path)
    for p in make_predictions(run):
        (axes,) = drawn(p).axes
        line = next(x for x in axes.lines if x.get_linestyle() == "-")
        assert np.all(np.diff(line.get_xdata()) > 0)
        zeros = int((p.group.reading == 0).sum())
        marks = [x for x in axes.lines if x.get_marker() == "v"]
        assert sum(len(x.get_xdata()) for x in marks) == zeros
        for mark in marks:
            assert axes.get_yscale() == "log"
            assert np.all(mark.get_ydata() == axes.get_ylim()[0])
        circles = [x for x in axes.lines if x.get_marker() == "o"]
        assert sum(len(x.get_xdata()) for x in circles) == p.group.n_points - zeros


@pytest.mark.parametrize(("amplitude", "style"), [([20.0] * 3, "default"), ([20.0, 5.0, 10.0], "steps-mid")])
def test_where_frequency_and_amplitude_vary_no_line_leads_from_reading_to_reading(amplitude, style):
    group = make_group(1, [100.0, 200.0, 300.0], amplitude, [100.0, 3.0, 2.0])
    band = figures.Band(curves.MODEL_BAND, np.array([80.0, 2.5, 1.5]), np.array([100.0, 3.5, 2.5]))
    curve = figures.Curve("simulated", "vermillion", np.array([90.0, 3.0, 2.0]), (band,))
    (axes,) = figures.group_figure(group, figures.sweep_of(group), [curve]).axes
    assert {x.get_drawstyle() for x in axes.lines if x.get_linestyle() == "-"} == {style}
    # Steps turn a corner at each reading's place and between two of them.
    corners = np.unique(axes.collections[0].get_paths()[0].vertices[:, 0])
    assert set(corners) == ({1.0, 1.5, 2.5, 3.0} if style == "steps-mid" else {100.0, 200.0, 300.0})


def test_a_line_breaks_where_nothing_is_launched():
    group = make_group(1, [100.0, 200.0, 300.0, 400.0], [20.0] * 4, [100.0, 3.0, 2.0, 1.0])
    curve = figures.Curve("simulated", "vermillion", np.array([90.0, 3.0, 0.0, 0.0]))
    (axes,) = figures.group_figure(group, figures.sweep_of(group), [curve]).axes
    line = next(x for x in axes.lines if x.get_linestyle() == "-")
    assert np.isnan(line.get_ydata()).tolist() == [False, False, True, True]
    (mark,) = (x for x in axes.lines if x.get_marker() == "v")
    assert mark.get_xdata().tolist() == [300.0, 400.0] and np.all(mark.get_ydata() == axes.get_ylim()[0])


def test_readings_of_either_sign_are_seen_whatever_they_support():
    """A trace goes below zero, and no sample of it lies at the edge of the picture."""
    time = np.linspace(10.0, 400.0, 14)
    moved = 3.0 * np.sin(time / 40.0)
    full = np.full(14, 20.0)
    trace = Group(1, "square", "a.csv", 50 * full, full, moved, time_us=time, measured=np.full(14, 4, np.int8))
    figure = influence_figure([trace], [figures.sweep_of(trace)], [np.zeros(14)], most=1.0)
    axes = figure.axes[0]
    (points,) = axes.collections
    assert axes.get_yscale() == "linear" and points.get_offsets()[:, 1].tolist() == moved.tolist()
    assert axes.get_ylim()[0] < moved.min() and axes.get_ylim()[1] > moved.max()


def test_rows_of_the_first_picture_differ_where_the_groups_do():
    """What all groups share stands in the title, and no name loses what distinguishes it."""
    held = ["40 V", "90 V", "1.5 kHz"]
    rows = [
        figures.Row(k, f"unipolar sine (bias 2 V, 5 periods), {one}", [figures.Mark(0.1, "blue")])
        for k, one in enumerate(held, start=1)
    ]
    names, shared = figures.row_names(rows)
    assert names == ["1: 40 V", "2: 90 V", "3: 1.5 kHz"] and shared == "unipolar sine (bias 2 V, 5 periods)"
    other = figures.Row("lens", "sine, 40 V", rows[0].marks)
    names, shared = figures.row_names([*rows, other])
    assert [name[-4:] for name in names] == ["40 V", "90 V", " kHz", "40 V"] and shared == ""
    assert len({*names}) == 4 and all(len(name) <= 30 for name in names)
    assert figures.row_names(rows[:1]) == (["1: unipolar sine, 40 V"], "")
    bursts = [
        figures.Row(k, f"unipolar sine ({n} periods), {k}0 V, l = 0.09 m", rows[0].marks) for k, n in ((1, 5), (2, 25))
    ]
    names, shared = figures.row_names([*bursts, figures.Row(3, "unipolar triangle, 20 V, l = 0.09 m", rows[0].marks)])
    assert all(f"{k}0 V" in name for k, name in zip((1, 2, 2), names, strict=True)) and shared == "l = 0.09 m"
    read = [
        figures.Row(f"A_{w[:3]}_f", f"launch {what}, {w} (3 periods), {volts} V", rows[0].marks)
        for w, volts in (("sine", 18), ("square", 9), ("triangle", 18)) for what in ("range", "speed")
    ]  # fmt: skip
    names, _ = figures.row_names(read)
    assert names[:3] == ["A_sin_f: launch range, 18 V", "A_sin_f: launch speed, 18 V", "A_squ_f: launch range, 9 V"]
    same = [figures.Row(k, "sine, 2 kHz", rows[0].marks) for k in (1, 2)]
    assert figures.row_names(same) == (["1", "2"], "sine, 2 kHz")
    long = ["launch speeds, 649.4 Hz, 30 V", "displacements, 649.4 Hz, 100 V"]
    named = [figures.Row(f"rise40{end}", text, rows[0].marks) for end, text in zip(("", "-trace"), long, strict=True)]
    assert figures.row_names(named) == (["rise40", "rise40-trace"], "649.4 Hz"), "names say enough"
    group = sweep_groups()[1]
    example = figures.Example("", "ink", group, figures.sweep_of(group), [])
    figure = figures.summary_figure(rows, [example], figures.handles([]))
    texts = [t.get_text() for t in figure.findobj(Text)]
    assert "All groups: unipolar sine (bias 2 V, 5 periods)" in texts


def test_what_would_lie_on_one_another_is_shown_against_the_first():
    group = sweep_groups()[1]
    group = replace(group, reading=np.geomspace(1.0, 50.0, group.n_points))
    rng = np.random.default_rng(1)
    noisy = replace(group, reading=group.reading * np.exp(0.01 * rng.standard_normal(group.n_points)))
    far, near = (
        [
            figures.Curve("baseline", "grey", group.reading, dashed=True),
            figures.Curve(
                "model",
                "blue",
                group.reading * f,
                (figures.Band(figures.READING_BAND, group.reading, 2 * group.reading),),
            ),
        ]
        for f in (3.0, 1.02)
    )
    sweep = figures.sweep_of(group)
    plain, close = (figures.Example("", "ink", noisy, sweep, curves).magnified() for curves in (far, near))
    assert plain.view is None and plain.label.endswith("(µm)") and plain.group is noisy
    assert close.label == "Launch range / baseline" and close.group.reading == pytest.approx(
        noisy.reading / group.reading
    )
    assert close.curves[0].middle == pytest.approx(1.0) and close.curves[1].middle == pytest.approx(1.02)
    low, high, log = close.view
    assert log and low < close.group.reading.min() and close.group.reading.max() < high < 1.1
    assert close.curves[1].bands[0].high == pytest.approx(2.0)  # a wide band does not set the view
    for few in ([], near[:1]):
        alone = figures.Example("", "ink", noisy, sweep, few)
        assert alone.magnified() is alone
    # Readings of zero have no factor.
    none = figures.Example("", "ink", replace(noisy, reading=np.maximum(noisy.reading - 2, 0.0)), sweep, near)
    assert none.magnified() is none
    trace = replace(
        noisy, time_us=np.arange(1.0, group.n_points + 1), reading=noisy.reading - 20.0,
        measured=np.full(group.n_points, 4, np.int8),
    )  # fmt: skip
    over_time = figures.Example("", "ink", trace, figures.sweep_of(trace), near).magnified()
    assert over_time.group.reading == pytest.approx(trace.reading - group.reading) and not over_time.view[2]
    assert "\N{MINUS SIGN} baseline" in over_time.label
    figure = figures.summary_figure([], [close, over_time], [])
    assert [axes.get_ylabel() for axes in figure.axes] == [close.label, over_time.label]


def test_zeros_are_in_every_legend():
    group = sweep_groups()[1]
    sweep, curve = figures.sweep_of(group), figures.Curve("model", "blue", group.reading + 0.1)

    def reported(group: Group) -> list[str]:
        example = figures.Example("", "ink", group, sweep, [curve])
        (legend,) = figures.summary_figure([], [example], figures.handles([curve])).legends
        return [t.get_text() for t in legend.get_texts()]

    assert reported(group) == ["measured", "model", "zero"]
    assert reported(replace(group, reading=group.reading + 0.2)) == ["measured", "model"]
    assert reported(replace(group, reading=np.clip(group.reading, 0.0, 1.5))) == [
        "measured",
        "model",
    ]  # linear


def test_the_legend_shows_a_zero_as_it_is_drawn():
    group = sweep_groups()[1]
    rising = replace(group, reading=group.reading + 0.1)
    curve = figures.Curve("model", "vermillion", np.where(group.reading > 1, group.reading, 0.0))
    for seen, color, filled in ((rising, PALETTE["vermillion"], True), (group, PALETTE["ink"], False)):
        (axes,) = figures.group_figure(seen, figures.sweep_of(seen), [curve]).axes
        drawn = [x for x in axes.lines if x.get_marker() == "v"]
        (mark,) = figures.zero_mark([(seen, [curve])])
        assert mark.get_markeredgecolor() == color and (mark.get_markerfacecolor() != "none") == filled
        looks = {(x.get_markeredgecolor(), x.get_markerfacecolor()) for x in drawn}
        assert (mark.get_markeredgecolor(), mark.get_markerfacecolor()) in looks


def test_a_changed_rig_is_in_the_head_of_a_figure():
    group = replace(make_group("sq3100", 3100.0, [1.0, 3.0, 9.0], [1.0, 2.0, 3.0], "square"), changed=(("M", 0.0544),))
    (axes,) = figures.group_figure(group, figures.sweep_of(group), []).axes
    lines = axes.get_title(loc="left").replace("\xa0", " ").split("\n")
    assert lines == ["Group sq3100: square, 3.1 kHz,", "M = 0.0544 kg"]
    every = replace(group, changed=tuple((name, 1.234567e-5) for name in "Mmqlg"))
    (axes,) = figures.group_figure(every, figures.sweep_of(every), []).axes
    lines = axes.get_title(loc="left").split("\n")
    assert len(lines) == 2 and lines[1].endswith("…") and max(map(len, lines)) <= 36


def test_a_long_name_leaves_room_in_the_head_of_a_figure():
    assert [titled(12), titled("May 12")] == ["Group 12", "Group May 12"]
    long = "the second session of May 12"
    assert titled(long) == "the se… May 12" and titled(long, 18) == "the seco…of May 12"
    group = make_group(long, [100.0, 300.0, 900.0], 20.0, [1.0, 2.0, 3.0])
    (axes,) = figures.group_figure(group, figures.sweep_of(group), []).axes
    assert axes.get_title(loc="left") == "the seco…of May 12: sine, 20 V"


def test_one_reading_far_off_does_not_flatten_the_residuals() -> None:
    near = np.linspace(-0.2, 0.2, 40)
    low, high = figures.residual_view([near, np.append(near, 7.3)])
    assert -0.6 < low < -0.2 and 0.2 < high < 1.0


def test_residual_axis_is_common_and_holds_every_error(tmp_path):
    run = make_run(tmp_path)
    view = figures.residual_view([np.array([-0.1, 2.0]), np.array([0.5])])
    assert view[0] < -0.1 and view[1] > 2.0
    p = make_predictions(run)[0]
    error = np.linspace(-0.1, 2.0, p.group.n_points)
    (axes,) = figures.residual_figure(p, figures.sweep_of(p.group), error, (error - 1, error + 1), [], view).axes
    assert axes.get_ylim() == pytest.approx(view)
    labels = [t.get_text() for t in axes.get_yticklabels()]
    assert "×1" in labels and len(labels) >= 3


def test_a_walker_that_keeps_to_itself_is_shown(tmp_path):
    run = make_run(tmp_path, n_chains=40)
    values = run.draws.values[..., 0].copy()
    values[17] *= 3.0
    (axes,) = figures.trace_figure(fit.fit_pictures.marginals(run)[0], values, 2).axes
    assert len(axes.lines) == 16
    assert sum(np.allclose(line.get_ydata(), values[17]) for line in axes.lines) == 1


def test_marginals_survive_a_stuck_chain(tmp_path):
    run = make_run(tmp_path)
    stuck = run.draws.values.copy()
    stuck[...] = stuck[:1, :1]
    stuck_run = replace(run, draws=replace(run.draws, values=stuck))
    marginals = fit.fit_pictures.marginals(stuck_run)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*ArviZ is undergoing")
        figures.corner_figure(marginals[:3], [float(m.draws[0]) for m in marginals[:3]])
    figures.marginal_figure(marginals[0])
    figures.trace_figure(marginals[0], stuck[..., 0], 2)


def test_a_band_keeps_its_distance_from_a_curve_between_readings() -> None:
    """In proportion where the curve is above zero at both readings, straight where it is not."""
    x = np.array([1.0, 3.0, 5.0])
    line = np.array([1.0, 2.0, 3.0, 4.0, 5.0]), np.array([10.0, 2.0, 20.0, 7.0, 0.0])
    band = figures.Band("90 % of readings", np.array([9.0, 20.0, 0.0]), np.array([20.0, 30.0, 4.0]))
    curve = figures.Curve("model", "blue", np.array([10.0, 20.0, 0.0]), (band,), line=line)
    at, low, high = curves.band_of(curve, band, x)
    assert at.tolist() == [1, 2, 3, 4, 5]
    assert low == pytest.approx([9.0, 2.0 * 0.95, 20.0, 10.0, 0.0])
    assert high == pytest.approx([20.0, 2.0 * 1.75, 30.0, 17.0, 4.0])
    for one, straight in zip(curves.band_of(replace(curve, line=None), band, x), (x, band.low, band.high), strict=True):
        assert one == pytest.approx(straight)


def test_a_picture_of_a_plan_shows_no_readings() -> None:
    plan = [Conditions(1, "sine", "", np.geomspace(1e2, 1e4, 9), np.full(9, 20.0))]
    none = [[figures.Curve("simulated", "vermillion", np.r_[0.0, np.geomspace(0.5, 80.0, 8)])]]
    figure = figures.groups_figure(plan, [figures.sweep_of(g) for g in plan], none)
    assert [t.get_text() for t in figure.legends[0].get_texts()] == ["zero", "simulated"]
    assert (
        figure.axes[0].get_yscale() == "log" and len(figure.axes[0].lines) == 3
    )  # zeros at the foot, a line, what will be read


def test_measured_and_simulated_are_distinguished(known: Experiment) -> None:
    sweeps = [figures.sweep_of(g) for g in known.groups]
    curves = [[figures.Curve("simulated", "vermillion", 1.2 * g.reading)] for g in known.groups]
    figure = figures.groups_figure(known.groups, sweeps, curves)
    assert len(figure.axes) == 3
    for axes, group in zip(figure.axes, known.groups, strict=True):
        assert axes.get_ylabel() == "Launch range (µm)" and re.search(r"\((Hz|V)\)", axes.get_xlabel())
        line = next(x for x in axes.lines if x.get_linestyle() == "-")
        circles = next(x for x in axes.lines if x.get_marker() == "o")
        assert line.get_color() != circles.get_markeredgecolor() and line.get_marker() in (None, "None", "")
        assert len(circles.get_xdata()) == np.count_nonzero(group.reading > 0) or axes.get_yscale() == "linear"
    assert [t.get_text() for t in figure.legends[0].get_texts()] == ["measured", "simulated"]


def test_numbers_to_explore_are_those_of_the_curves(known: Experiment) -> None:
    group = known.groups[2]
    curve = figures.Curve("model", "blue", 2 * group.reading)
    reported = figures.explorable("t", group, figures.sweep_of(group), [curve], [replace(curve, name="more")])
    order = np.argsort(group.amplitude_v, kind="stable")
    assert reported["x"] == pytest.approx(group.amplitude_v[order], rel=1e-4)
    assert reported["measured"] == pytest.approx(group.reading[order], rel=1e-4)
    assert reported["curves"][0]["middle"] == pytest.approx(2 * group.reading[order], rel=1e-4)
    assert [c["off"] for c in reported["curves"]] == [False, True]
    line = np.array([1.0, 2.0]), np.array([0.123456789, 4.0])
    (drawn,) = figures.explorable("t", group, figures.sweep_of(group), [replace(curve, line=line)])["curves"]
    assert drawn["line"] == [[1.0, 2.0], [0.12346, 4.0]] and reported["curves"][0]["line"] is None
