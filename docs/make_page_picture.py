"""Draw the annotated picture of a diagnosis page: numbers by what docs/howto/read-the-page.md explains.

It takes the page of the data set gap_and_slew, made as docs/make_readme_figure.py says, and needs a Chromium.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FILE = ROOT / "docs" / "figures" / "diagnosis-page.png"
# What is numbered, in this order: a selector, and the edge next to which its number stands.
MARKED = (
    (".summary .verdict", "left"),
    (".said p:has-text('Is the baseline adequate')", "left"),
    (".said p:has-text('What is wrong')", "left"),
    (".said p:has-text('What was gained')", "left"),
    (".said p:has-text('What next')", "left"),
    (".summary figure img", "right"),
    ("text=baseline against the readings", "left"),
    ("text=typical factor between baseline", "left"),
    ("nav", "left"),
    (".besides", "left"),
)
BADGE = (
    "position:absolute;width:30px;height:30px;border-radius:50%;background:#0072b2;color:#fff;"
    "font:600 17px/30px system-ui,'DejaVu Sans',sans-serif;text-align:center;z-index:9"
)


def draw(page_file: Path, file: Path) -> None:
    """Open the page, put the numbers in, and photograph its first screen."""
    from playwright.sync_api import sync_playwright

    names = ("chromium", "chromium-browser", "google-chrome")
    executable = next(filter(None, map(shutil.which, names)), None)
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=executable)
        page = browser.new_page(viewport={"width": 1240, "height": 1640})
        page.goto(page_file.resolve().as_uri())
        page.add_style_tag(content="body { padding: 0 28px !important }")
        for number, (selector, edge) in enumerate(MARKED, 1):
            box = page.locator(selector).first.bounding_box()
            assert box is not None, f"nothing on the page is {selector}"
            x = box["x"] - 36 if edge == "left" else box["x"] + box["width"] - 34
            y = box["y"] + (2 if edge == "left" else 6)
            page.evaluate(
                "([n, x, y, style]) => { const b = document.createElement('div'); b.textContent = n;"
                " b.style.cssText = `${style};left:${x}px;top:${y}px`; document.body.append(b) }",
                [number, x, y, BADGE],
            )
        page.screenshot(path=file)
        browser.close()


def main() -> int:
    found = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "fits" / "gap_and_slew-diagnosis" / "diagnosis.html"
    if not found.exists():
        print(f"no {found}: docs/make_readme_figure.py says how to make it; the picture stays as it is")
        return 0
    draw(found, FILE)
    return 0


if __name__ == "__main__":
    sys.exit(main())
