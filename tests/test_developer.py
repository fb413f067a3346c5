"""The developer's page says of the floors what their test holds; changelog and citation know the version."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from scripts import loaded

import psafit

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
FLOORS = loaded(DOCS / "make_floors.py")


def release(version: str) -> tuple[int, ...]:
    """The numbers of a version; one under development has those of the release that it becomes."""
    return tuple(map(int, version.partition(".dev")[0].split(".")))


def test_the_page_lists_the_floors() -> None:
    page = (DOCS / "developer.md").read_text("utf-8")
    rows = re.findall(r"^\| (\d+) \| (`[^|]*) \|", page, flags=re.MULTILINE)
    assert [(int(k), sorted(re.findall(r"`(\w+)`", names))) for k, names in rows] == list(enumerate(FLOORS.floors()))


def test_the_picture_shows_the_floors() -> None:
    assert FLOORS.PICTURE.read_text("utf-8") == FLOORS.picture(), "run python docs/make_floors.py"


def test_the_changelog_begins_with_what_is_unreleased() -> None:
    text = (ROOT / "CHANGELOG.md").read_text("utf-8")
    first, *releases = re.findall(r"^## \[(.+?)\]", text, flags=re.MULTILINE)
    assert first == "Unreleased" and "Unreleased" not in releases
    assert re.search(rf"^## \[{re.escape(releases[0])}\] - \d{{4}}-\d\d-\d\d$", text, flags=re.MULTILINE)
    ahead = release(psafit.__version__) > release(releases[0])
    assert ahead if ".dev" in psafit.__version__ else releases[0] == psafit.__version__


def test_the_version_is_one() -> None:
    assert tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["version"] == psafit.__version__


def test_the_citation_is_of_the_latest_release() -> None:
    text = (ROOT / "CITATION.cff").read_text("utf-8")
    version, date = (
        re.search(rf"^{key}: \"?([^\"\n]+)", text, flags=re.MULTILINE) for key in ("version", "date-released")
    )
    assert version and date
    changelog = (ROOT / "CHANGELOG.md").read_text("utf-8")
    assert changelog.partition("## [Unreleased]")[2].partition("\n## ")[2].startswith(f"[{version[1]}] - {date[1]}\n")
