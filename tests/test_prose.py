"""The pages are written in short sentences and paragraphs, and with the field's words (CONTRIBUTING.md, Prose)."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
HISTORY = {"campaign-history.md", "changelog.md", "history.md", "search-history.md"}
# Made from docstrings and from `--help`; their prose is that of the code.
GENERATED = {"causes.md", "commands.md"}
PAGES = [ROOT / "README.md", *(p for p in sorted((ROOT / "docs").rglob("*.md")) if p.name not in HISTORY)]
AVOIDED = re.compile(
    r"\b(hills?|climb(s|ed|ing)?|ascend\w*|ladders?|rungs?|leaders?|told|tells?|telling|leftovers?|unnamed|coarse\w*"
    r"|cliffs?|beside|alike|scouted)\b"
)

# Words that are gone from the code, too. What stays are keys of files (`short_climbs` of a diagnosis' settings, the
# tasks "climb" and "weigh", `leftover` of a misfit, `alike` of a confusion, "height" of an optimum) and the position in
# a buffer. `unnamed` is a key as well, so that only what it stood before is looked for.
GONE = re.compile(
    r"(?<![a-zA-Z])(hills?|Hills|[Cc]limb(s|ed|ing)?|[Aa]scen(d|ds|ded|t)|rungs?|cliffs?|scouted|[Ll]eftovers?"
    r"|[Ll]adders?|[Ll]eaders?|[Tt]old|[Tt]ell(s|ing|er)?|[Bb]eside|[Aa]like|unnamed discrepancy)(?![a-z])"
)
KEYS = re.compile(
    r"W\. Hill|(short|carried)_climbs|\"climb\"|\.leftover|leftover=|leftover ?:|confusion\.alike|alike=confus"
    r"|alike ?: list|`alike`|buffer\.tell"
)
# A log posterior has no height; rebounds, pictures and the tip that a ball leaves have.
HEIGHT = re.compile(r"(?<![\w\"])(heights?)(?![\w\"])")
NO_HEIGHT = ("inference", "model_search", "diagnose", "challenge")


def prose(text: str) -> str:
    """The page without blocks, pictures, equations and code."""
    text = re.sub(r"^( *)```.*?^\1``` *$", "", text, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"(?<=\n\n)(    .*\n)+|^:::.*(\n    .*)*|!\[[^\]]*\]\([^)]*\)", "", text, flags=re.MULTILINE)
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
    return re.sub(r"`[^`]+`|\$[^$\n]+\$", "X", text)


def paragraphs(text: str) -> list[str]:
    """Paragraphs and items of lists; tables and headings are neither."""
    rows = re.sub(r"^(#|\|).*$", "", prose(text), flags=re.MULTILINE)
    items = re.sub(r"^ *([-*+]|\d+\.) ", "\n\n", rows, flags=re.MULTILINE)
    return [" ".join(p.split()) for p in re.split(r"\n\s*\n", items) if p.strip()]


def sentences(paragraph: str) -> list[str]:
    return re.split(r"(?<=[.!?:])[)*_\"”']*\s+", paragraph)


def long(pieces: list[str], words: int) -> list[str]:
    return [p for p in pieces if len(p.split()) > words]


def test_sentences_and_paragraphs_are_short() -> None:
    every = [p for page in PAGES for p in paragraphs(page.read_text("utf-8"))]
    said = [s for p in every for s in sentences(p)]
    assert len(said) > 1000
    assert len(long(said, 40)) <= 0.03 * len(said), long(said, 40)
    assert len(long(every, 90)) <= 0.05 * len(every), long(every, 90)


@pytest.mark.parametrize("page", [p for p in PAGES if p.name not in GENERATED], ids=lambda p: p.name)
def test_words_are_those_of_the_field(page: Path) -> None:
    found = [m[0] for m in AVOIDED.finditer(prose(page.read_text("utf-8")))]
    assert not found


def written(*folders: str) -> list[tuple[Path, int, str]]:
    """Every line of the code below some folders, tests of words left out: (file, number, line)."""
    files = sorted(p for f in folders for kind in ("*.py", "*.j2", "*.js", "*.css") for p in (ROOT / f).rglob(kind))
    every = ((p, n, line) for p in files for n, line in enumerate(p.read_text("utf-8").splitlines(), 1))
    return [(p.relative_to(ROOT), n, line) for p, n, line in every if p != Path(__file__)]


def test_words_of_the_code_are_those_of_the_field() -> None:
    assert GONE.search("def _climbed(x):") and not GONE.search("ascending, descent")
    assert (
        GONE.search("test_a_run_is_told_of") and GONE.search("cannot tell it") and not GONE.search("tellurium, besides")
    )
    assert not GONE.search(KEYS.sub("", 'self.short_climbs, "climb", confusion.alike, buffer.tell()'))
    code = written("psafit", "tests", "benchmarks", "docs")
    assert len(code) > 20_000
    found = [f"{path}:{number}: {line.strip()}" for path, number, line in code if GONE.search(KEYS.sub("", line))]
    assert not found, "\n" + "\n".join(found)


def test_a_log_posterior_has_no_height() -> None:
    assert HEIGHT.search("end.height > 0") and not HEIGHT.search('"height", separation_height, HEIGHT')
    code = written(*(f"psafit/{name}" for name in NO_HEIGHT))
    found = [f"{path}:{number}: {line.strip()}" for path, number, line in code if HEIGHT.search(line)]
    assert not found, "\n" + "\n".join(found)


@pytest.mark.parametrize("page", [p for p in PAGES if p.name not in GENERATED], ids=lambda p: p.name)
def test_lines_are_no_longer_than_those_of_code(page: Path) -> None:
    """But for rows of tables, pictures, and what a command prints or a generator takes."""
    text = re.sub(r"^( *)```[\s\S]*?^\1``` *$|^:::.*(\n    .*)*", "", page.read_text("utf-8"), flags=re.MULTILINE)
    assert not [row for row in text.splitlines() if len(row) > 120 and not row.startswith(("|", "!["))]


def test_a_long_sentence_is_found() -> None:
    page = f"# Title\n\n{'word ' * 41}end. Short.\n\n- item\n- {'word ' * 91}\n\n```\n{'code ' * 100}\n```\n"
    every = paragraphs(page)
    assert len(every) == 3 and len(long(every, 90)) == 1
    assert [len(long(sentences(p), 40)) for p in every] == [1, 0, 1]


def test_the_readme_fits_on_a_few_screens() -> None:
    text = (ROOT / "README.md").read_text("utf-8")
    assert len(text.splitlines()) <= 120
    assert "make fit GROUP=1" in text[:600] and "make test" in text[:600]
