"""The report in a real browser: it opens from a file, fits the window, and needs nothing else.

The browser is the system's Chromium, driven by playwright. Without either the tests are skipped, or fail where
PSAFIT_REQUIRE_BROWSER=1 says that they must run.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest
from campaigns import result as answered
from diagnoses_by_hand import make_experiment, make_record
from fits_by_hand import build, make_run, sweep_groups
from reader import HOSTILE
from sides import made

from psafit.challenge.score import score
from psafit.compare import compare
from psafit.report.challenge import write_page
from psafit.report.comparison import write_comparison
from psafit.report.diagnosis import write_diagnosis
from psafit.report.reproduction import write_reproduction

pytestmark = pytest.mark.slow

PSA = Path(__file__).parents[1] / "experiments" / "psa"
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
SIZES = ((1280, 900), (400, 800))


def missing(reason: str) -> None:
    if os.environ.get("PSAFIT_REQUIRE_BROWSER") == "1":
        pytest.fail(f"{reason}, and PSAFIT_REQUIRE_BROWSER=1")
    pytest.skip(reason)


@pytest.fixture(scope="module")
def browser():
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        missing("playwright is not installed")
    path = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if path is None:
        missing(f"none of {', '.join(BROWSERS)} is on the PATH")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox", "--disable-gpu"])
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def report(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    run = make_run(folder, sweep_groups()[:2], title=HOSTILE, source=HOSTILE, converged=False)
    return build(run)


class Opened:
    """A page, and what it complained of and asked for."""

    def __init__(self, browser, report: Path, size: tuple[int, int], **options):
        self.address = report.as_uri()
        self.complaints: list[str] = []
        self.requests: list[str] = []
        self.context = browser.new_context(viewport={"width": size[0], "height": size[1]}, **options)
        self.page = self.context.new_page()
        self.page.on("console", lambda message: self.complaints.append(message.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("dialog", lambda dialog: (self.complaints.append(dialog.message), dialog.dismiss()))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(self.address, wait_until="load")

    def width(self) -> int:
        return self.page.evaluate("document.documentElement.scrollWidth")


@pytest.fixture(scope="module", params=SIZES, ids=lambda size: f"{size[0]}px")
def opened(browser, report, request):
    one = Opened(browser, report, request.param)
    yield one
    one.context.close()


def test_no_complaint_and_no_request(opened):
    assert opened.complaints == []
    assert [url for url in opened.requests if not url.startswith("data:")] == [opened.address]


def test_page_fits_the_window(opened):
    inner = opened.page.evaluate("innerWidth")
    assert opened.width() <= inner
    opened.page.evaluate("document.querySelectorAll('details').forEach(one => one.open = true)")
    assert opened.width() <= inner
    opened.page.evaluate("document.querySelectorAll('details').forEach(one => one.open = false)")


def test_every_image_is_drawn(opened):
    opened.page.evaluate("document.querySelectorAll('details').forEach(one => one.open = true)")
    images = opened.page.evaluate(
        "Promise.all([...document.images].map(one => one.decode().then(() =>"
        " [one.complete, one.naturalWidth, one.getBoundingClientRect().width])))"
    )
    opened.page.evaluate("document.querySelectorAll('details').forEach(one => one.open = false)")
    assert len(images) > 15
    for complete, natural, shown in images:
        assert complete and natural > 0
        assert shown >= 280, "too narrow to be read"


def test_details_open_with_the_keyboard(opened):
    page = opened.page
    first = page.locator("details").first
    assert first.get_attribute("open") is None
    seen = set()
    for _ in range(80):
        page.keyboard.press("Tab")
        seen.add(page.evaluate("document.activeElement.tagName"))
        if page.evaluate("document.activeElement === document.querySelector('details > summary')"):
            break
    assert {"A", "SUMMARY"} <= seen, "links and folded parts are reached by Tab"
    page.keyboard.press("Enter")
    assert first.get_attribute("open") is not None
    page.keyboard.press("Enter")
    assert first.get_attribute("open") is None


def test_first_screen_shows_warning_and_sentences(opened):
    # In the page's own coordinates: a smooth scroll that an earlier test began may still be under way.
    top = opened.page.evaluate("document.querySelector('.notice.bad').getBoundingClientRect().top + scrollY")
    assert 0 <= top < 420
    assert opened.page.locator(".summary img").is_visible()
    assert HOSTILE in opened.page.title()


def test_curves_answer_to_the_keyboard(opened):
    page = opened.page
    chart, readout = page.locator(".explorer > svg"), page.locator(".readout")
    assert "arrow keys" in readout.inner_text()
    chart.focus()
    page.keyboard.press("ArrowRight")
    first = readout.inner_text()
    assert first.startswith("100 Hz, 20 V: measured 13.0 µm; predicted median 17.3 µm (90 % of readings ")
    assert chart.get_attribute("role") == "slider" and chart.get_attribute("aria-valuetext") == first
    page.keyboard.press("End")
    assert readout.inner_text().startswith("10000 Hz") and chart.get_attribute("aria-valuenow") == "8"
    page.keyboard.press("Escape")
    assert "arrow keys" in readout.inner_text()


def test_curves_answer_to_the_pointer(opened):
    page = opened.page
    chart = page.locator(".explorer > svg")
    chart.scroll_into_view_if_needed()
    box = chart.bounding_box()
    page.mouse.move(box["x"] + box["width"] - 16, box["y"] + 40)
    assert page.locator(".readout").inner_text().startswith("10000 Hz")


def test_curves_are_switched_on_and_off(opened):
    page = opened.page
    drawn = "[...document.querySelectorAll('.explorer > svg .{}')].length"
    readings = page.evaluate(drawn.format("reading"))
    assert readings == 8 and page.evaluate(drawn.format("line")) == 1 and page.evaluate(drawn.format("band")) == 2
    for name, kind in (("measured", "reading"), ("90 % of the model", "band")):
        before = page.evaluate(drawn.format(kind))
        page.get_by_role("checkbox", name=name).uncheck()
        assert page.evaluate(drawn.format(kind)) < before
        page.get_by_role("checkbox", name=name).check()
        assert page.evaluate(drawn.format(kind)) == before
    swatches = "[...document.querySelectorAll('.explorer fieldset svg .band')]"
    shades = page.evaluate(f"{swatches}.map(r => getComputedStyle(r).fillOpacity)")
    assert shades == ["0.2", "0.2", "0.42"]  # that of readings; that of the model lies on it
    ticks = "[...document.querySelectorAll('.explorer > svg text[text-anchor=end]')].map(t => t.textContent)"
    linear = page.evaluate(ticks)
    page.get_by_role("checkbox", name="launch range").check()
    assert page.evaluate(ticks) != linear and "0" in linear and "0" not in page.evaluate(ticks)
    page.get_by_role("checkbox", name="launch range").uncheck()
    page.locator(".explorer select").select_option("1")
    assert "Drive amplitude (V)" in page.locator(".explorer > svg").text_content()
    page.locator(".explorer select").select_option("0")


# Pages on which curves can be explored, and those without.
EXPLORED, STILL = ("diagnosis", "comparison"), ("reproduction", "score")


@pytest.fixture(scope="module")
def other_pages(result, tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("pages")
    experiment = make_experiment(HOSTILE)
    sides = made(HOSTILE, 2.0), made("b", 1.1)
    provenance = {"Command": HOSTILE}
    reported = {"tau": {"median": 2.0, "lower": 1.0, "upper": 3.0}}
    judged = [
        answered(["a"], named=["a"], causes=[{"terms": ["a"], "probability": 0.9, "parameters": reported}]),
        answered(["a"], named=["<b> & $x_ {{ 7 }}"]),
        answered([], verdict="adequate"),
        answered([], outside="<i> & $x_ {{ 7 }}", verdict="unexplained"),
    ]
    return {
        "diagnosis": write_diagnosis(make_record(experiment, title=HOSTILE), experiment, folder),
        "comparison": write_comparison(*sides, compare(*sides), folder / "comparison.html"),
        "reproduction": write_reproduction(result, folder / "reproduction.html", provenance),
        "score": write_page(score(judged), folder / "score.html", provenance),
    }


@pytest.mark.parametrize("size", SIZES, ids=lambda size: f"{size[0]}px")
@pytest.mark.parametrize("name", [*EXPLORED, *STILL])
def test_every_page_has_the_same_manners(browser, other_pages, name, size):
    one = Opened(browser, other_pages[name], size)
    one.page.evaluate("document.querySelectorAll('details').forEach(one => one.open = true)")
    assert one.width() <= one.page.evaluate("innerWidth")
    assert one.page.locator(".verdict .badge").is_visible() and one.page.locator(".summary img").count() == 1
    assert (one.page.locator(".explorer > svg .reading").count() > 0) is (name in EXPLORED)
    assert one.page.evaluate("[...document.images].filter(e => !e.alt).length") == 0
    unnamed = "[...document.querySelectorAll('input, select, svg[tabindex]')].filter(e =>"
    assert one.page.evaluate(f"{unnamed} !e.ariaLabel && !e.labels?.[0]?.textContent).length") == 0
    assert one.complaints == [] and [url for url in one.requests if not url.startswith("data:")] == [one.address]
    one.context.close()


def contrast(one: str, other: str) -> float:
    """WCAG contrast of two colours given as rgb(r, g, b)."""

    def luminance(color: str) -> float:
        parts = [int(x) / 255 for x in color[color.index("(") + 1 : -1].split(",")[:3]]
        r, g, b = (x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4 for x in parts)
        return 0.2126 * r + 0.7152 * g + 0.0722 * b

    low, high = sorted([luminance(one), luminance(other)])
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_colours_can_be_read(browser, report, scheme):
    one = Opened(browser, report, SIZES[0], color_scheme=scheme)
    ask = "style => { const s = getComputedStyle(style); return [s.color, s.backgroundColor]; }"
    paper = one.page.eval_on_selector("body", ask)[1]
    # Whatever this fit has found, all colours are looked at.
    badges = "".join(f"<span class='badge {kind}'>word</span>" for kind in ("good", "bad", "warn"))
    one.page.evaluate("html => document.body.insertAdjacentHTML('beforeend', html)", badges)
    for selector in ("body", ".badge.good", ".badge.bad", ".badge.warn", ".badge.fit", ".badge.holdout", ".notice.bad",
                     "figcaption", "nav a"):  # fmt: skip
        color, background = one.page.eval_on_selector(selector, ask)
        background = paper if background == "rgba(0, 0, 0, 0)" else background
        assert contrast(color, background) >= 4.5, selector
    one.context.close()


@pytest.mark.slow
def test_page_prints(browser, report):
    one = Opened(browser, report, SIZES[0])
    one.page.emulate_media(media="print")
    assert one.page.pdf(format="A4").startswith(b"%PDF")
    assert one.complaints == []
    one.context.close()
