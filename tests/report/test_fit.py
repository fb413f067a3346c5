"""The report of a fit, built from made-up results: no simulation, no sampling."""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass, replace

import numpy as np
import pytest
from fits_by_hand import (
    build,
    make_group,
    make_numerics,
    make_predictions,
    make_run,
    make_validation,
    mixed_groups,
    sweep_groups,
)
from reader import HOSTILE, Reader

from psafit.inference.run_folder import Run
from psafit.records import Retested, SessionSummary, plain
from psafit.report import fit, wording
from psafit.report.fit import write_report
from psafit.report.fit_pictures import middle_words, pictured, shown_groups
from psafit.validate import FAIR, GOOD, verdict

pytestmark = pytest.mark.usefixtures("undrawn")  # pages that several tests read are drawn nevertheless


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
    assert "Implausible: cs (its prior expects 23.3 to 43000 N s/m)." in page.reader.text
    assert "cs is beyond critical damping (3300 N s/m)" in page.reader.text


def test_what_each_session_has_is_in_a_table(tmp_path):
    """And what of the scatter is not determined stands behind a click, as all else of the table."""
    run = make_run(tmp_path)
    n = run.fit.n_physical
    last = [replace(p, verdict="not determined") for p in run.summary.parameters[n:]]
    run = replace(run, summary=replace(run.summary, parameters=[*run.summary.parameters[:n], *last]))
    sessions = [SessionSummary("session_lean", 1, "lean", "m", 3.2e-3, 2.9e-3, 3.5e-3)]
    run = replace(run, summary=replace(run.summary, sessions=sessions))
    predictions = make_predictions(run)
    path = write_report(run, make_validation(run, predictions), predictions, make_numerics(run))
    html = path.read_text("utf-8")
    assert "Group 1 lean 0.00320 m 0.00290 to 0.00350 m" in Reader(html).text
    aside = html.partition(f"that these readings do not determine: {len(last)}</summary>")[2].partition("</details>")[0]
    assert aside.count("not determined</span>") == len(last)


def test_first_screen_says_what_it_must(page):
    text = page.reader.first_screen
    assert "8 readings of group 1 (sine, 20 V, 100 Hz to 10 kHz)" in text
    assert "groups amps and grid_3" in text
    assert "Not determined: cc has only an upper limit" in text
    assert "not converged" not in text
    assert "Below, fitted group 1 and, of the two the fit never saw, the worse, group amps." in text


def test_the_group_that_stands_for_the_unseen_is_described_by_its_rank():
    words = [middle_words(n) for n in (1, 2, 3, 4)]
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
    shown = fit.numerics_content(replace(numerics, stable_step=0.5e-6))
    assert (shown["limit_us"], shown["ratio"], shown["stable"]) == ("0.5", "2", False)


@pytest.mark.slow
def test_unconverged_numerics_are_a_warning(tmp_path):
    run = make_run(tmp_path)
    predictions = make_predictions(run)
    numerics = replace(make_numerics(run), engine="stepper", tolerance=1e-5, error=2e-3, converged=False)
    written = write_report(run, make_validation(run, predictions), predictions, numerics).read_text("utf-8")
    assert "The predictions are not converged" in written and "(used)" in written


def test_causes_are_named(page):
    run = replace(page.run, fit=replace(page.run.fit, terms=["hysteresis"]))
    assert "extended by hysteresis" in fit.what_was_fitted(run)


def test_thresholds_are_those_of_the_verdict():
    for limit, below, above in ((GOOD, "predicted well", "roughly"), (FAIR, "roughly followed", "missed")):
        for error, words in ((limit - 1e-9, below), (limit + 1e-9, above)):
            assert verdict(np.full(50, error), 0.9, 0.5, 0.5)[1].startswith(words)


def test_a_fit_that_is_too_sure_does_not_predict(tmp_path):
    """However near it comes; and what it determines is doubted."""
    run = make_run(tmp_path)
    validation = make_validation(run, make_predictions(run))
    near = [replace(s, log_rmse=0.1, coverage_90=0.75, n_points=77, drift_p_value=0.5) for s in validation.groups]
    narrow = replace(validation, groups=near, holdout_log_rmse=0.1, coverage_p_value=1e-4)
    assert fit.verdict_of(narrow) == {"text": "comes near, too sure", "kind": "warn"}
    text = fit.what_it_predicts(narrow)
    assert "Does it predict what it has not seen?" in text and "surer than it may be" in text and "dequate" not in text
    honest = replace(narrow, groups=[replace(s, coverage_90=0.9) for s in near], coverage_p_value=0.5)
    assert fit.verdict_of(honest) == {"text": "predicts", "kind": "good"}
    tested = replace(honest, all_groups=Retested("tests", 0.005, 199))
    assert fit.verdict_of(tested) == {"text": "predicts, values in doubt", "kind": "warn"}
    trend = replace(honest, groups=[*honest.groups[:-1], replace(honest.groups[-1], drift_p_value=0.001)])
    assert fit.verdict_of(trend) == {"text": "comes near, misses a trend", "kind": "warn"}
    kinds = [[row[4]["kind"] for row in fit.parameter_rows(run, doubted)] for doubted in (False, True)]
    assert "good" in kinds[0] and "good" not in kinds[1]


def test_what_a_fit_to_all_readings_misses_is_on_the_page(tmp_path):
    run = make_run(tmp_path)
    predictions = make_predictions(run)
    validation = make_validation(run, predictions)
    for found, said in (
        (None, ""),
        (Retested("", 0.431, 199), "Fitted to all readings, the model passes the tests of misfit (p = 0.43)."),
        (Retested("tails", 0.015, 199), "passes the tests of misfit by heavy tails alone (p = 0.015)."),
    ):
        asked = replace(validation, all_groups=found)
        text = Reader(write_report(run, asked, predictions, make_numerics(run)).read_text("utf-8")).text
        assert said in text and ("Fitted to all readings" in text) is (found is not None)


def test_sweeps_that_could_show_no_trend_are_not_said_to_show_none(tmp_path):
    run = make_run(tmp_path)
    fixed = [replace(p, verdict="determined") for p in run.summary.parameters]
    run, predictions = replace(run, summary=replace(run.summary, parameters=fixed)), make_predictions(run)
    for p_value, said in (
        (0.5, "Along no sweep that could show it (2 of 3) do the errors drift"),
        (math.nan, "No sweep has readings"),
    ):
        validation = make_validation(run, [replace(p, drift_p_value=p_value) for p in predictions])
        page = Reader(write_report(run, validation, predictions, make_numerics(run)).read_text("utf-8"))
        assert said in page.text
    assert "if the model is right, the data fix them all" in page.text


def test_a_drift_is_judged_over_all_looks_everywhere_on_a_page(tmp_path):
    """Two groups are predicted: half of the level each."""
    run = make_run(tmp_path)
    predictions = make_predictions(run)
    first, *unseen = [replace(p, drift_p_value=0.5) for p in predictions]
    assert first.role == "fit" and [p.role for p in unseen] == ["holdout"] * 2
    for p_value, drifts in ((0.004, True), (0.006, False)):
        validation = make_validation(run, [first, replace(unseen[0], drift_p_value=p_value), unseen[1]])
        assert ["drift along" in s.verdict for s in validation.groups] == [False, drifts, False]
    page = Reader(write_report(run, validation, predictions, make_numerics(run)).read_text("utf-8"))
    assert "Along no sweep that could show it (2 of 3) do the errors drift" in page.text


def test_groups_that_cannot_show_it_are_not_reported(tmp_path):
    loud, silent = sweep_groups()[0], make_group("off", [100.0, 300.0, 900.0], 0.0, [0.0, 0.1, 0.0])
    run = make_run(tmp_path, (loud, silent, replace(loud, id=3)))
    validation = make_validation(run, make_predictions(run))
    assert "predicts group 3: typically" in fit.what_it_predicts(validation)
    run = make_run(tmp_path, (loud, silent))
    validation = make_validation(run, make_predictions(run))
    assert validation.holdout_log_rmse is None
    assert "no group that could show it, so nothing is left" in fit.what_it_predicts(validation)
    assert len(fit.tiles_of(validation)) == 2


def test_observables_of_a_group_are_no_groups(tmp_path):
    """They are named wherever readings are, on a page of which every picture differs."""
    page = Reader(build(make_run(tmp_path, mixed_groups(), (1, "trace"))).read_text("utf-8"))
    assert (
        "to the 27 readings of groups 1 (sine, 20 V, 800 Hz to 3 kHz: launch ranges, launch speeds and contact times)"
        " and trace (square, 1.2 kHz, 20 V, 0 to 110 µs: velocities)." in page.first_screen
    )
    assert "predict group 2: typically" in page.first_screen and "for group 2 (contact time) to ×" in page.first_screen
    assert (
        "Below, fitted group 1 (launch range) and, of those the fit never saw, the one of median score, group 2 (launch"
        in (page.first_screen)
    )
    assert "In groups 1 (launch range), 1 (launch speed), 1 (contact time), trace (velocity), 2 (launch" in page.text
    assert "Group 1 (launch speed) fitted 5" in page.text and "Group trace: velocity, square" in page.html
    images = page.all("img")
    assert len({image["alt"] for image in images}) == len(images) and "groups 1, 1" not in page.text
    run = make_run(tmp_path, mixed_groups(), (1, 2, "trace"))
    nothing_left = fit.what_it_predicts(make_validation(run, make_predictions(run)))
    assert "for group 1 (launch speed), ×" in nothing_left


def test_very_many_groups(tmp_path):
    groups = [make_group(i, [100.0, 300.0, 1000.0], 5.0, [2.0, 2.5, 3.0 + i]) for i in range(60)]
    run = make_run(tmp_path, groups, (0, 1, 2))
    predictions = make_predictions(run)
    kept = pictured(shown_groups(make_validation(run, predictions), predictions))
    assert len(kept) <= 25 and any(g.score.role == "fit" for g in kept)
    assert "the 57 other groups: typically" in fit.what_it_predicts(make_validation(run, predictions))


def test_the_page_compares_the_sampler_with_importance_draws(tmp_path):
    """Side by side, the largest difference in plain words; where it is more than chance, it says so."""
    run = make_run(tmp_path / "a")
    text = Reader(build(run).read_text("utf-8")).text
    assert "The sampler and 480 importance draws agree: no median and no limit differs by more than 0.05" in text
    assert "not to be trusted" not in text
    off = [replace(p, apart=0.4) if p.name == "c_c" else p for p in run.summary.importance.parameters]
    importance = replace(run.summary.importance, parameters=off, pareto_k=0.9)
    text = Reader(build(replace(run, summary=replace(run.summary, importance=importance))).read_text("utf-8")).text
    assert "disagree on c_c: a median or a limit differs by 0.40 of the 90 % interval" in text
    assert "where 0.06 would be chance" in text and "not to be trusted" in text
