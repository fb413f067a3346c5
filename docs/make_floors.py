"""Draw docs/figures/floors.svg: the package's floors, and what is made on each on the way from readings to a page."""

from __future__ import annotations

import ast
import textwrap
from collections.abc import Iterator
from pathlib import Path

HERE = Path(__file__).resolve().parent
PICTURE = HERE / "figures" / "floors.svg"
WIDTH, HEIGHT, TOP = 920, 66, 44  # of the picture, of a floor, of the headings
# Left and right edges of the columns in which boxes stand, to the right of the floors' names.
COLUMNS = {"a": (446, 588), "b": (612, 754), "c": (778, 908), "ab": (446, 754), "abc": (446, 908)}
# Floor (a module on it), columns, what is made there, where it is kept.
BOXES = (
    ("files", "a", "readings", "TOML, CSV files"),
    ("experiment", "a", "Experiment", "checked, frozen"),
    ("physics", "b", "Term", "one cause"),
    ("simulate", "b", "Simulation", "launch ranges"),
    ("inference", "a", "Problem", "likelihood, prior"),
    ("inference", "b", "Fit", "fit.json"),
    ("inference", "c", "posterior", "posterior.nc"),
    ("validate", "c", "Validation", "validation.json"),
    ("diagnose", "ab", "Diagnosis", "diagnosis.json"),
    ("report", "abc", "page", "report.html, diagnosis.html"),
)
# From a floor to a floor, straight up at x; or first sideways, from x to x.
UP = (
    ("files", "experiment", 500), ("experiment", "inference", 500), ("physics", "simulate", 683),
    ("inference", "validate", 843), ("inference", "diagnose", 500),
    ("validate", "report", 843), ("diagnose", "report", 600),
)  # fmt: skip
BENT = (("simulate", "inference", 612, 550), ("validate", "diagnose", 778, 700))
ALONG = (("inference", 588, 612), ("inference", 754, 778))


def floors() -> list[list[str]]:
    """Modules of each floor, from the ground up, as tests/test_architecture.py has them."""
    tree = ast.parse((HERE.parent / "tests" / "test_architecture.py").read_text("utf-8"))
    found = next(n.value for n in tree.body if isinstance(n, ast.Assign) and ast.unparse(n.targets[0]) == "FLOORS")
    return [sorted(name or "__init__" for name in names) for names in ast.literal_eval(found)]


def picture() -> str:
    """The whole file."""
    known = floors()
    above = {name: TOP + (len(known) - 1 - k) * HEIGHT for k, names in enumerate(known) for name in names}
    height = TOP + len(known) * HEIGHT + 8
    words = "Floors of the package from the ground up, and the data that flow from readings up to a page"
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" height="{height}"'
        ' font-family="system-ui, \'DejaVu Sans\', sans-serif" font-size="16" fill="#1a1a1a">',
        f"<title>{words}</title>",
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" markerHeight="8" orient="auto">'
        '<path d="M0 0L8 4L0 8z" fill="#444"/></marker></defs>',
        f'<rect width="{WIDTH}" height="{height}" rx="6" fill="#fff"/>',
        '<text x="12" y="28" font-weight="600">Floors: imports go down</text>',
        '<text x="446" y="28" font-weight="600">Data: from readings up to a page</text>',
        *(line for k, names in enumerate(known) for line in _floor(names, above[names[0]], k)),
        *_arrows(above),
        *(line for box in BOXES for line in _box(*box, above[box[0]])),
        "</svg>",
    ]
    return "\n".join(lines) + "\n"


def _floor(names: list[str], y: int, level: int) -> Iterator[str]:
    yield f'<rect x="4" y="{y}" width="{WIDTH - 8}" height="{HEIGHT}" fill="{("#eef2f6", "#fafbfc")[level % 2]}"/>'
    yield f'<text x="14" y="{y + HEIGHT // 2 + 5}" fill="#555">{level}</text>'
    rows = textwrap.wrap(", ".join(names), 38)
    for k, row in enumerate(rows):
        at = y + HEIGHT // 2 + 5 + 21 * k - 10 * (len(rows) - 1)
        yield f'<text x="38" y="{at}" font-family="ui-monospace, \'DejaVu Sans Mono\', monospace">{row}</text>'


def _box(_: str, columns: str, name: str, kept: str, y: int) -> Iterator[str]:
    left, right = COLUMNS[columns]
    middle = (left + right) // 2
    yield (
        f'<rect x="{left}" y="{y + 8}" width="{right - left}" height="{HEIGHT - 16}" rx="5" fill="#fff"'
        ' stroke="#0072b2" stroke-width="2"/>'
    )
    yield f'<text x="{middle}" y="{y + 30}" text-anchor="middle" font-weight="600">{name}</text>'
    yield f'<text x="{middle}" y="{y + 49}" text-anchor="middle" font-size="14" fill="#444">{kept}</text>'


def _arrows(above: dict[str, int]) -> Iterator[str]:
    line = '<path d="{}" fill="none" stroke="#444" stroke-width="1.6" marker-end="url(#tip)"/>'
    for below, over, x in UP:
        yield line.format(f"M{x} {above[below] + 8}V{above[over] + HEIGHT - 7}")
    for below, over, x, to in BENT:
        yield line.format(f"M{x} {above[below] + HEIGHT // 2}H{to}V{above[over] + HEIGHT - 7}")
    for floor, x, to in ALONG:
        yield line.format(f"M{x} {above[floor] + HEIGHT // 2}H{to - 1}")


if __name__ == "__main__":
    PICTURE.write_text(picture(), encoding="utf-8")
