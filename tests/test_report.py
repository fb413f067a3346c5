"""The report of a fit, built from made-up results: no simulation, no sampling."""

from __future__ import annotations

import ast
import json
import re
import warnings
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from reader import HOSTILE, Reader

from psafit.experiment import Constants, Experiment, Group, fingerprint
from psafit.files import portable_command
from psafit.inference.identify import describe
from psafit.inference.problem import Problem
from psafit.inference.run import Run
from psafit.inference.store import Draws
from psafit.records import (
    Fit,
    MinimumEntry,
    Numerics,
    ParameterEntry,
    ParameterSummary,
    PosteriorSummary,
    ProfilePoint,
    Refinement,
    Validation,
    plain,
)
from psafit.report import figures, fit, wording
from psafit.report.figures.groups import titled
from psafit.report.fit import write_report
from psafit.report.fit_pictures import _middle
from psafit.report.page import figure_data_uri
from psafit.report.style import PALETTE
from psafit.simulate.stability import contact_matrix, largest_stable_step
from psafit.validate import Prediction, score, verdict

REPORT = Path(fit.__file__).parent
CONSTANTS = Constants(M=0.0272, m=0.107, q=0.25e-6, l=0.15, k_s=25e6, g=9.8)

# Making a run by hand --------------------------------------------------------------------------------------------


def make_group(group_id, frequency, amplitude, measured, waveform="sine", sigma=None):
    n = len(measured)
    return Group(
        group_id,
        waveform,
        f"{group_id}.csv",
        np.broadcast_to(np.asarray(frequency, float), n).copy(),
        np.broadcast_to(np.asarray(amplitude, float), n).copy(),
        np.asarray(measured, float),
        sigma_um=sigma,
    )


def sweep_groups():
    """A frequency sweep out of order with a replicate, an amplitude sweep with zeros and uncertainties, a grid."""
    frequency = np.array([100.0, 1000, 300, 3000, 500, 10000, 500, 2000])
    rising = np.array([0.0, 0.0, 0.4, 1.2, 3.0, 8.0, 20.0, 60.0])
    return (
        make_group(1, frequency, 20.0, 5 + 4 * np.log10(frequency)),
        make_group("amps", 1200.0, np.arange(1.0, 9.0), rising, "square", sigma=0.1 + 0.05 * rising),
        make_group("grid_3", [500, 500, 900, 900], [10, 20, 10, 20], [3.0, 6.0, 4.0, 9.0]),
    )


def make_run(
    folder: Path, groups=None, fitted=(1,), *, title="Made-up rig", source="nowhere", converged=True, n_chains=6
) -> Run:
    groups = sweep_groups() if groups is None else groups
    experiment = Experiment(
        title, source, CONSTANTS, tuple(groups), folder / "experiment", fingerprint(CONSTANTS, groups), ("a.csv: odd",)
    )
    problem = Problem(experiment, tuple(fitted))
    rng = np.random.default_rng(5)
    middle = np.array([np.mean(p.prior_quantile([0.3, 0.6])) for p in problem.parameters])
    middle[1] = problem.parameters[1].sampling_bounds.upper - 1.0  # far out in its prior
    values = problem.to_physical(middle + 0.2 * rng.standard_normal((n_chains, 40, problem.n_dim)))
    draws = Draws(problem.names, values, np.zeros(values.shape[:2]), "ab" * 32)
    verdicts = ["determined", "determined", "bounded above", "determined", "not determined", "not determined"]
    summaries = []
    for i, p in enumerate(problem.parameters):
        low, median, high = (float(q) for q in np.quantile(draws.flat[:, i], [0.05, 0.5, 0.95]))
        ends = p.to_physical(p.prior_quantile([0.05, 0.95]))
        steps = np.array([-0.6, -0.3, 0.0, 0.3, 0.6])
        drop = 9.0 * np.where(steps > 0, steps, 0.0 if verdicts[i] == "bounded above" else steps) ** 2
        points = [ProfilePoint(float(median * np.exp(u)), float(d)) for u, d in zip(steps, drop, strict=True)]
        points = points if i < problem.n_physical else []
        text = describe(p.name, p.unit, median, (low, high), points, verdicts[i])
        summaries.append(
            ParameterSummary(p.name, median, low, high, float(ends[0]), float(ends[1]), 0.9, 1.004 + i / 1e3, 900.0 + i,
                             800.0 + i, 12.0, verdicts[i], text, points, p.is_implausible(median))
        )  # fmt: skip
    best = {s.name: s.median for s in summaries}
    record = Fit(
        identity="ab" * 32, title=title, source=source, fingerprint=experiment.fingerprint, groups=list(fitted),
        terms=[],
        engine="closed form", seed=7,
        parameters=[
            ParameterEntry(p.name, p.symbol, p.unit, p.description, p.bounds.lower, p.bounds.upper,
                           p.prior.describe(), p.source)
            for p in problem.parameters
        ],
        n_physical=problem.n_physical,
        minima=[MinimumEntry(best, -12.5, 9), MinimumEntry({k: 2 * v for k, v in best.items()}, -20.25, 3)],
        n_starts=12, n_failed=0, n_evaluations=345, n_missed=0, sampler={},
        lmfit_report="[[Fit Statistics]]\n  <made up>",
        versions={"psafit": "0.1.0", "python": "3.11.7"},
        command="psafit fit experiments/made-up --group 1 --seed 7",
    )  # fmt: skip
    message = "40 autocorrelation times, R-hat at most 1.009"
    message = message if converged else f"not converged after 90 steps ({message}): repeat the command to draw on"
    summary = PosteriorSummary("ab" * 32, converged, message, n_chains, 90, 10, 2, 0.31, 40.0, summaries, {})
    folder.mkdir(parents=True, exist_ok=True)
    return Run(folder, problem, record, summary, draws)


def make_predictions(run: Run) -> list[Prediction]:
    found = []
    for group in run.problem.experiment.groups:
        y = group.launch_range_um
        middle = 1.3 * y + 0.4
        found.append(
            Prediction(
                group=group,
                role="fit" if group.id in run.fit.groups else "holdout",
                median=middle,
                model_lower=0.9 * middle,
                model_upper=1.1 * middle,
                lower=np.maximum(0.6 * middle - 0.3, 0),
                upper=1.4 * middle,
                lower_50=0.8 * middle,
                upper_50=1.2 * middle,
                log_density=np.full(y.size, -2.0),
                crps=0.2 * middle,
                pit=np.linspace(0.02, 0.6, y.size),
                pit_p_value=0.04,
                drift_p_value=0.002,
            )
        )
    return found


def make_validation(run: Run, predictions: list[Prediction]) -> Validation:
    scores = [score(p) for p in predictions]
    unseen = [s.log_rmse for s in scores if s.role == "holdout" and s.informative]
    mean = float(np.mean(unseen)) if unseen else None
    return Validation(run.fit.identity, 240, 7, scores, mean, {str(p.group.id): p.pit.tolist() for p in predictions})


def make_numerics(run: Run) -> Numerics:
    best = run.fit.minima[0].values
    matrix = contact_matrix([best[name] for name in ("k_c", "c_s", "c_c")], CONSTANTS)
    limit = largest_stable_step(np.linalg.eigvals(matrix).astype(complex))
    steps = [Refinement(1e-3, 2e-4, 1e-6), Refinement(1e-5, 3.1e-7, 1e-9)]
    return Numerics(
        run.fit.identity, run.fit.engine, None, 9, 240, steps, 3.1e-7, 1e-5, True, 2.8e6, limit, 1e-6, 1.035
    )  # fmt: skip


def build(run: Run) -> Path:
    predictions = make_predictions(run)
    return write_report(run, make_validation(run, predictions), predictions, make_numerics(run))


# Reading the page back -------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Page:
    run: Run
    html: str
    reader: Reader


@pytest.fixture(scope="module")
def page(tmp_path_factory) -> Page:
    folder = tmp_path_factory.mktemp("secret-place") / "hold-out"
    run = make_run(folder, title=HOSTILE, source=HOSTILE)
    html = build(run).read_text("utf-8")
    return Page(run, html, Reader(html))


@pytest.fixture(scope="module")
def unhappy_page(tmp_path_factory) -> Page:
    """Not converged, every group fitted, one of a single reading, one of zeros only."""
    groups = (
        make_group(4, [1.0, 10.0, 90.0], 5.0, [40.0, 41.0, 40.5]),
        make_group("one", 1000.0, 5.0, [3.0]),
        make_group("nil", 1000.0, [1.0, 2.0], [0.0, 0.0]),
    )
    run = make_run(tmp_path_factory.mktemp("run"), groups, (4, "one", "nil"), converged=False)
    html = build(run).read_text("utf-8")
    return Page(run, html, Reader(html))


# The page --------------------------------------------------------------------------------------------------------


def test_sections_are_there_in_order(page):
    assert page.reader.headings == [
        "Parameters", "Minima found", "Measured against predicted", "Residuals", "Validation", "Posterior",
        "Chains and the sampler’s health", "Priors and their sources", "Numerics", "Provenance",
    ]  # fmt: skip
    targets = {attrs.get("id") for _, attrs in page.reader.tags}
    links = [attrs["href"] for attrs in page.reader.all("a")]
    assert len(links) > 9 and {link.removeprefix("#") for link in links} <= targets


def test_units_are_given(page):
    for unit in ("N/m", "N s/m", "µm", "nats", "Hz", "V"):
        assert unit in page.reader.text
    assert not re.search(r"\bum\b", page.reader.text)


def test_hostile_text_is_escaped(page):
    assert page.reader.foreign.lower().count("<script") == 1  # the numbers that the page's own script draws
    assert page.reader.all("script") == [{"type": "application/json"}, {}]
    assert page.html.count("</style>") == 1
    assert HOSTILE in page.reader.text
    allowed = {"class", "id", "href", "src", "alt", "lang", "charset", "name", "content", "scope", "role", "tabindex",
               "aria-label", "http-equiv", "type"}  # fmt: skip
    assert {name for _, attrs in page.reader.tags for name in attrs} <= allowed
    assert "[[Fit Statistics]] <made up>" in page.reader.text


def test_images_are_inside_and_described(page, unhappy_page):
    for one in (page, unhappy_page):
        images = one.reader.all("img")
        assert len(images) > 15
        for image in images:
            assert len(image["alt"] or "") > 30
            assert (image["src"] or "").startswith("data:image/")
        assert len({image["alt"] for image in images}) == len(images)


def test_nothing_is_fetched_from_elsewhere(page):
    assert not page.reader.all("link") and not page.reader.all("iframe")
    for _, attrs in page.reader.tags:
        for name in ("src", "href"):
            if name in attrs:
                assert attrs[name].startswith(("data:", "#"))
    assert not re.search(r"https?://|url\(|@import", page.reader.foreign)
    assert "default-src 'none'" in page.html


def test_no_path_of_the_machine(page):
    assert "secret-place" not in page.html
    assert "psafit fit experiments/made-up --group 1 --seed 7" in page.reader.text


def test_page_is_small(page):
    assert len(page.html) < 5e6


def test_scores_agree_with_the_record(page):
    validation = make_validation(page.run, make_predictions(page.run))
    record = json.loads(json.dumps(plain(validation)))
    cells = [" ".join(re.sub(r"<[^>]*>", " ", row).split()) for row in re.findall(r"<tr>(.*?)</tr>", page.html, re.S)]
    for s in record["groups"]:
        row = next(c for c in cells if c.startswith(f"Group {s['group']} ") and "nats" not in c and "µm" in c)
        assert f" {s['n_points']} {s['log_rmse']:.3f} ×{np.exp(s['log_rmse']):.2f} " in row
        assert f"{s['crps_um']:.2f} µm" in row
        assert s["verdict"] in page.reader.text
    assert f"{record['holdout_log_rmse']:.3f}" in page.reader.text
    assert f"factor of {np.exp(record['holdout_log_rmse']):.2f} off" in page.reader.text


def test_parameters_agree_with_the_record(page):
    for entry, s in zip(page.run.fit.parameters, page.run.summary.parameters, strict=True):
        assert entry.description in page.reader.text
        assert " ".join(wording.typeset(s.text.removeprefix(s.name)).split()) in page.reader.text
        assert f"R-hat {s.r_hat:.4f}; autocorrelation" in page.reader.text
        assert f"{s.ess_bulk:.0f} / {s.ess_tail:.0f}" in page.reader.text
        assert entry.source in page.reader.text
        row = next(r for r in re.findall(r"<tr>(.*?)</tr>", page.html, re.S) if f"{s.r_hat:.4f}" in r)
        assert ("implausible under the prior" in row) == s.implausible
        assert ("no lower limit" in row) == (s.verdict == "bounded above")
    assert "Implausible: cs comes out where the prior" in page.reader.text


def test_first_screen_says_what_it_must(page):
    text = page.reader.first_screen
    assert "8 readings of group 1 (sine, 20 V, 100 Hz to 10 kHz)" in text
    assert "groups amps and grid_3" in text
    assert "Not determined: cc has only an upper limit" in text
    assert "not converged" not in text
    assert "Below, fitted group 1 and, of the two the fit never saw, the worse, group amps." in text


def test_the_group_that_stands_for_the_unseen_is_told_by_its_rank():
    words = [_middle(n) for n in (1, 2, 3, 4)]
    assert words[:2] == ["the one the fit never saw", "of the two the fit never saw, the worse"]
    assert words[2].endswith("the one of median score") and words[3].endswith("the worse of the two of middle score")


def test_not_converged_is_said_first(unhappy_page):
    summary = unhappy_page.html[: unhappy_page.html.index('<h2 id="parameters"')]
    notice = summary[summary.index('class="notice bad"') :]
    assert "not converged after 90 steps" in notice and "repeat the command to draw on" in notice


def test_without_held_out_group(unhappy_page):
    text = unhappy_page.reader.text
    assert "nothing is left to test the prediction on" in text
    assert "No group was held out." in text
    assert "not seen by the fit" not in " ".join(image["alt"] for image in unhappy_page.reader.all("img"))
    assert "Fit of groups 4, one and nil: Made-up rig" in text


def test_numerics_are_shown(page):
    numerics = make_numerics(page.run)
    text = page.reader.text
    assert f"step of {1e6 * numerics.stable_step:.4g} µs" in text
    assert "the two methods agree to 3.1 × 10⁻⁷" in text.replace("\N{NO-BREAK SPACE}", " ")
    shown = fit.told_numerics(replace(numerics, stable_step=0.5e-6))
    assert (shown["limit_us"], shown["ratio"], shown["stable"]) == ("0.5", "2", False)


def test_unconverged_numerics_are_a_warning(page, tmp_path):
    run = make_run(tmp_path)
    predictions = make_predictions(run)
    numerics = replace(make_numerics(run), engine="stepper", tolerance=1e-5, error=2e-3, converged=False)
    written = write_report(run, make_validation(run, predictions), predictions, numerics).read_text("utf-8")
    assert "The predictions are not converged" in written and "(used)" in written


def test_causes_are_named(page):
    run = replace(page.run, fit=replace(page.run.fit, terms=["hysteresis"]))
    fitted = [fit.Shown(score(p), p, figures.sweep_of(p.group)) for p in make_predictions(run)]
    assert "extended by hysteresis" in fit._what_was_fitted(run, fitted)


def drawn(p: Prediction):
    return figures.group_figure(p.group, figures.sweep_of(p.group), [figures.curve_of(p)], p.role)


def test_same_results_same_bytes(tmp_path):
    p = make_predictions(make_run(tmp_path))[1]
    first, second = (figure_data_uri(drawn(p)) for _ in range(2))
    assert first == second
    small = figure_data_uri(drawn(p), svg_limit=0)
    assert small.startswith("data:image/png") and len(small) < 0.8 * len(first)


def test_thresholds_are_those_of_the_verdict():
    for limit, below, above in ((fit.GOOD, "predicted well", "roughly"), (fit.FAIR, "roughly followed", "missed")):
        for error, words in ((limit - 1e-9, below), (limit + 1e-9, above)):
            assert verdict(np.full(50, error), 0.9, 0.5, 0.5).startswith(words)


def test_one_reading_that_rules_a_group_is_told_apart():
    off = np.full(20, 0.1)
    assert "but for one reading" not in verdict(off, 0.9, 0.5, 0.5)
    off[7] = -2.0
    assert "off by ×1.58 (×1.11 but for one reading), " in verdict(off, 0.9, 0.5, 0.5)
    assert "but for one reading" not in verdict(off[6:8], 0.9, 0.5, 0.5)  # which of two?


# Figures ---------------------------------------------------------------------------------------------------------


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


def test_lines_ascend_and_zeros_sit_on_the_edge(tmp_path):
    run = make_run(tmp_path)
    for p in make_predictions(run):
        (axes,) = drawn(p).axes
        line = next(x for x in axes.lines if x.get_linestyle() == "-")
        assert np.all(np.diff(line.get_xdata()) > 0)
        zeros = int((p.group.launch_range_um == 0).sum())
        marks = [x for x in axes.lines if x.get_marker() == "v"]
        assert sum(len(x.get_xdata()) for x in marks) == zeros
        for mark in marks:
            assert axes.get_yscale() == "log"
            assert np.all(mark.get_ydata() == axes.get_ylim()[0])
        circles = [x for x in axes.lines if x.get_marker() == "o"]
        assert sum(len(x.get_xdata()) for x in circles) == p.group.n_points - zeros


def test_a_line_breaks_where_nothing_is_launched():
    group = make_group(1, [100.0, 200.0, 300.0, 400.0], [20.0] * 4, [100.0, 3.0, 2.0, 1.0])
    curve = figures.Curve("simulated", "vermillion", np.array([90.0, 3.0, 0.0, 0.0]))
    (axes,) = figures.group_figure(group, figures.sweep_of(group), [curve]).axes
    line = next(x for x in axes.lines if x.get_linestyle() == "-")
    assert np.isnan(line.get_ydata()).tolist() == [False, False, True, True]
    (mark,) = (x for x in axes.lines if x.get_marker() == "v")
    assert mark.get_xdata().tolist() == [300.0, 400.0] and np.all(mark.get_ydata() == axes.get_ylim()[0])


def test_zeros_are_in_every_legend():
    group = sweep_groups()[1]
    sweep, curve = figures.sweep_of(group), figures.Curve("model", "blue", group.launch_range_um + 0.1)

    def told(group: Group) -> list[str]:
        example = figures.Example("", "ink", group, sweep, [curve])
        (legend,) = figures.summary_figure([], [example], figures.handles([curve])).legends
        return [t.get_text() for t in legend.get_texts()]

    assert told(group) == ["measured", "model", "zero"]
    assert told(replace(group, launch_range_um=group.launch_range_um + 0.2)) == ["measured", "model"]
    assert told(replace(group, launch_range_um=np.clip(group.launch_range_um, 0.0, 1.5))) == [
        "measured",
        "model",
    ]  # linear


def test_the_legend_shows_a_zero_as_it_is_drawn():
    group = sweep_groups()[1]
    rising = replace(group, launch_range_um=group.launch_range_um + 0.1)
    curve = figures.Curve("model", "vermillion", np.where(group.launch_range_um > 1, group.launch_range_um, 0.0))
    for seen, color, filled in ((rising, PALETTE["vermillion"], True), (group, PALETTE["ink"], False)):
        (axes,) = figures.group_figure(seen, figures.sweep_of(seen), [curve]).axes
        drawn = [x for x in axes.lines if x.get_marker() == "v"]
        (mark,) = figures.zero_mark([(seen, [curve])])
        assert mark.get_markeredgecolor() == color and (mark.get_markerfacecolor() != "none") == filled
        looks = {(x.get_markeredgecolor(), x.get_markerfacecolor()) for x in drawn}
        assert (mark.get_markeredgecolor(), mark.get_markerfacecolor()) in looks


def test_a_changed_rig_is_told_in_the_head_of_a_figure():
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


def test_groups_that_cannot_tell_are_not_told_of(tmp_path):
    loud, silent = sweep_groups()[0], make_group("off", [100.0, 300.0, 900.0], 0.0, [0.0, 0.1, 0.0])
    run = make_run(tmp_path, (loud, silent, replace(loud, id=3)))
    validation = make_validation(run, make_predictions(run))
    assert "predicts group 3: typically" in fit._what_it_predicts(validation)
    run = make_run(tmp_path, (loud, silent))
    validation = make_validation(run, make_predictions(run))
    assert validation.holdout_log_rmse is None
    assert "no group that could tell, so nothing is left" in fit._what_it_predicts(validation)
    assert len(fit._tiles(validation)) == 2


def test_very_many_groups(tmp_path):
    groups = [make_group(i, [100.0, 300.0, 1000.0], 5.0, [2.0, 2.5, 3.0 + i]) for i in range(60)]
    run = make_run(tmp_path, groups, (0, 1, 2))
    predictions = make_predictions(run)
    scores = make_validation(run, predictions).groups
    shown = [fit.Shown(s, p, figures.sweep_of(p.group)) for s, p in zip(scores, predictions, strict=True)]
    kept = fit.fit_pictures.pictured(shown)
    assert len(kept) <= 25 and any(g.score.role == "fit" for g in kept)
    assert "the 57 other groups: typically" in fit._what_it_predicts(make_validation(run, predictions))


# Words -----------------------------------------------------------------------------------------------------------


def plain_spaces(text: str) -> str:
    return text.replace("\xa0", " ")


def test_numbers():
    assert plain_spaces(wording.number(3220596.8, 526000.0)) == "3.22 × 10⁶"
    assert wording.number(0.2, 0.056) == "0.200"
    assert wording.number(-12.34, 0.5) == "−12.34"
    assert wording.number(float("nan")) == "–"
    assert plain_spaces(wording.interval(2.72e6, 3.77e6, 5e5)) == "(2.72 to 3.77) × 10⁶"
    assert plain_spaces(wording.interval(23270.9, 4.297e7)) == "2.33 × 10⁴ to 4.30 × 10⁷"
    assert wording.exact(1e9) == "10⁹" and wording.exact(0.01) == "0.01"
    assert plain_spaces(wording.exact(2.5e6)) == "2.5 × 10⁶"
    assert wording.p_value(1 / 1001) == "≤ 0.001" and wording.p_value(0.5) == "0.50"
    assert plain_spaces(wording.percent(0.998)) == "over 99 %" and plain_spaces(wording.percent(1.0)) == "100 %"
    assert wording.factor(np.log(2)) == "2.00" and "10" in wording.factor(1e6)


def test_symbols_and_lists_are_escaped():
    assert wording.symbol_html(r"\sigma_{rel}") == "<i>σ<sub>rel</sub></i>"
    assert wording.symbol_html("k_c") == "<i>k<sub>c</sub></i>"
    assert "<b>" not in wording.symbol_html("<b>") and "<b>" not in wording.listed(["<b>", "<b>"])
    assert wording.listed(["a", "b", "c"]) == "a, b and c"
    assert wording.listed(range(20)).endswith("and 12 more")


def test_paths_are_cut():
    assert portable_command(["psafit", "fit", "/a/b/psa", "--out=/x/y"]) == "psafit fit psa --out=y"
    assert portable_command(["psafit", "fit", r"C:\Users\me\psa"]) == "psafit fit psa"
    assert portable_command(["fit", "~/psa", Path("experiments/psa"), "a b"]) == "fit psa experiments/psa 'a b'"


def test_plain_text_is_typeset():
    assert plain_spaces(wording.typeset("k_c = 3.22e6 N/m (90 %: -2 um to 1e-7), 275 us; R-hat 2-6")) == (
        "k_c = 3.22 × 10⁶ N/m (90 %: −2 µm to 1 × 10⁻⁷), 275 µs; R-hat 2-6"
    )


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
