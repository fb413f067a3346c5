"""The docs hold: their blocks run, their commands exist, their links lead somewhere."""

from __future__ import annotations

import html
import importlib.util
import os
import pkgutil
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np
import pytest
from matplotlib.figure import Figure
from pictures import blank
from scripts import loaded

from psafit import cli, physics, plugins
from psafit.cli import common
from psafit.errors import InputError
from psafit.experiment import Experiment, read_experiment, write_experiment
from psafit.model_search.settings import SearchSettings
from psafit.physics import plugin, term

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", *DOCS.rglob("*.md")])
PAGE = pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
# These need causes from files and runs of another rig: tests/test_rig.py has both, and follows them. Their commands are
# looked at here.
FOLLOWED_ELSEWHERE = ("add-a-cause.md", "elsewhere.md", "own-causes.md", "tutorial.md")
# A transcript shows commands, after a dollar, and what they printed; its script is run where it is made.
TRANSCRIPT = "console"
SHELL, PSAFIT = ("sh", "bash", "shell", TRANSCRIPT), ("psafit", ".venv/bin/psafit")
# What a page may ask of a shell other than psafit and make; run as it stands.
PLAIN = {"cat", "cp", "head", "ls", "mkdir", "mv"}
# They take minutes and have tests of their own: tests/reproduce, tests/challenge.
LONG = {("reproduce",), ("challenge", "run")}


# --- reading pages ----------------------------------------------------------------------------------


class Block(NamedTuple):
    """A fenced block."""

    language: str
    text: str
    line: int  # of the first line within it
    title: str = ""  # of a file that the page shows


class Mention(NamedTuple):
    """A command, with where it stands."""

    words: list[str]
    line: int
    whole: bool  # a line of a block, which somebody types as it is; else named in a sentence


def blocks(text: str) -> list[Block]:
    fence = r"^( *)```+(\w*)(?: title=\"([^\"\n]*)\")?[^\n]*\n(.*?)^\1```+ *$"
    found = re.finditer(fence, text, flags=re.MULTILINE | re.DOTALL)
    return [Block(m[2], m[4], text.count("\n", 0, m.start(4)) + 1, m[3] or "") for m in found]


def prose(text: str) -> str:
    """The page without its fenced and indented blocks; lines keep their numbers."""

    def empty(m: re.Match[str]) -> str:
        return "\n" * m[0].count("\n")

    text = re.sub(r"^( *)```+.*?^\1```+ *$", empty, text, flags=re.MULTILINE | re.DOTALL)
    return re.sub(r"(?<=\n\n)(    .*\n)+", empty, text)


def inline(text: str) -> Iterator[tuple[str, int]]:
    """Code within sentences."""
    body = prose(text)
    for m in re.finditer(r"(?<!`)`([^`]+)`(?!`)", body):
        yield " ".join(m[1].split()), body.count("\n", 0, m.start()) + 1


def mentions(text: str) -> list[Mention]:
    """Every command on a page."""
    found = []
    for block in blocks(text):
        if block.language not in SHELL:
            continue
        number = block.line
        for line in re.sub(r"\\\n", "\0", block.text).split("\n"):
            if block.language == TRANSCRIPT and not line.startswith("$ "):
                number += 1 + line.count("\0")
                continue
            words = shlex.split(line.replace("\0", " ").removeprefix("$ "), comments=True)
            if words:
                found.append(Mention(words, number, whole=True))
            number += 1 + line.count("\0")
    for code, number in inline(text):
        first = code.split()[0]
        if first in (*PSAFIT, "make", "python", "pip") and not re.match(r"\w+ *[=(]", code):
            found.append(Mention(shlex.split(code), number, whole=False))
    return found


def expanded(page: Path) -> str:
    """A page with what it includes; that must be there."""

    def included(m: re.Match[str]) -> str:
        text = (ROOT / m[1]).read_text("utf-8")
        if not m[2]:
            return text
        begin, end = (f"<!-- --8<-- [{edge}:{m[2]}] -->\n" for edge in ("start", "end"))
        assert text.count(begin) == text.count(end) == 1, f"{m[1]} has no section {m[2]}"
        return text.partition(begin)[2].partition(end)[0]

    return re.sub(r'^--8<-- "([^":]+)(?::([\w-]+))?"$', included, page.read_text("utf-8"), flags=re.MULTILINE)


def slugs(text: str) -> set[str]:
    """Anchors of the headings, as GitHub and the site make them."""
    found: set[str] = set()
    for title in re.findall(r"^#+ +(.*?) *#*$", prose(text), flags=re.MULTILINE):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", title)
        slug = base = re.sub(r"[^\w\- ]", "", plain.lower()).strip().replace(" ", "-")
        number = 0
        while slug in found:
            number += 1
            slug = f"{base}-{number}"
        found.add(slug)
    return found


def links(text: str) -> Iterator[str]:
    """Targets of links and images."""
    body = re.sub(r"(?<!`)`[^`]+`(?!`)", "code", prose(text))
    yield from re.findall(r"\]\(([^)\s]+)(?: +\"[^\"]*\")?\)", body)
    yield from re.findall(r"(?:src|href)=\"([^\"]+)\"", body)
    yield from re.findall(r"^\[[^\]]+\]: +(\S+)", body, flags=re.MULTILINE)


def dead(page: Path) -> list[str]:
    """Links of a page that lead nowhere."""
    found = []
    for target in links(expanded(page)):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        if not file.exists():
            found.append(f"{target}: no such file")
        elif DOCS in page.parents and not file.is_relative_to(DOCS):
            found.append(f"{target}: outside docs, so not on the site")
        elif anchor and (file.suffix != ".md" or anchor not in slugs(expanded(file))):
            found.append(f"{target}: no such heading")
    return found


# --- checking commands ------------------------------------------------------------------------------


def makefile() -> tuple[set[str], set[str]]:
    """Targets and variables."""
    text = (ROOT / "Makefile").read_text("utf-8")
    targets = re.findall(r"^([a-z][a-z-]*):.*## ", text, flags=re.MULTILINE)
    return set(targets), set(re.findall(r"^([A-Z]+) *\?=", text, flags=re.MULTILINE))


def subcommand(words: list[str]) -> tuple[tuple[str, ...], click.Command, list[str]]:
    """The command that `psafit WORDS` calls, and what is left of the words."""
    command: click.Command = cli.commands
    path: list[str] = []
    while isinstance(command, click.Group) and words and not words[0].startswith("-"):
        found = command.get_command(click.Context(command), words[0])
        assert found is not None, f"psafit {' '.join(path)} has no command {words[0]}"
        command, path, words = found, [*path, words[0]], words[1:]
    return tuple(path), command, words


def options(command: click.Command) -> set[str]:
    """Names of the options of a command and of those below it."""
    own = {o for p in command.get_params(click.Context(command)) for o in p.opts if o.startswith("-")}
    below = command.commands.values() if isinstance(command, click.Group) else ()
    return own.union(*map(options, below))


def check_psafit(words: list[str], whole: bool) -> None:
    """The command exists and takes these options; as a whole line it also lacks none."""
    path, command, rest = subcommand([w for w in words if w != "..."])  # the reader's own options
    if not whole:
        unknown = {w.partition("=")[0] for w in rest if w.startswith("--")} - options(command)
        assert not unknown, f"psafit {' '.join(path)} has no {', '.join(sorted(unknown))}"
        return
    try:
        context = command.make_context("psafit", list(rest))
    except click.exceptions.Exit:  # --help, --version
        return
    except click.UsageError as error:
        raise AssertionError(f"psafit {' '.join(words)}: {error.format_message()}") from error
    asked = context.params.get("ids") or context.params.get("terms")
    if asked:
        common.causes(asked)


def made(words: list[str]) -> list[list[str]]:
    """What `make WORDS` would call psafit with."""
    if shutil.which("make") is None:
        pytest.skip("no make")
    clean = {k: v for k, v in os.environ.items() if not k.startswith(("MAKE", "MFLAGS"))}
    command = ["make", "--dry-run", "--no-print-directory", *words]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, env=clean)
    assert done.returncode == 0, done.stderr
    lines = re.sub(r"\\\n", " ", done.stdout).splitlines()
    return [shlex.split(line)[1:] for line in lines if line.split()[:1] == [".venv/bin/psafit"]]


def check_make(words: list[str], whole: bool) -> None:
    targets, variables = makefile()
    asked = [w for w in words if "=" not in w]
    assert set(asked) <= targets, f"make has no target {', '.join(set(asked) - targets)}"
    given = {w.partition("=")[0] for w in words if "=" in w}
    assert given <= variables, f"make knows no {', '.join(given - variables)}"
    if whole:
        for line in made(words):
            check_psafit(line, whole=True)


def check_script(words: list[str], whole: bool) -> None:
    if words[0] == "-c":
        try:
            compile(words[1], "-c", "exec")
        except SyntaxError as error:
            raise AssertionError(f"python -c: {error}") from error
        return
    script = ROOT / words[0]
    assert script.is_file(), f"no script {words[0]}"
    unknown = [w for w in words[1:] if w.startswith("-") and w not in script.read_text("utf-8")]
    assert not unknown, f"{words[0]} knows no {', '.join(unknown)}"


def check_pip(words: list[str], whole: bool) -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["optional-dependencies"]
    asked = set(re.findall(r"(?:psafit|\.)\[([\w-]+)\]", " ".join(words)))
    assert asked <= extras.keys(), f"no extra {', '.join(asked - extras.keys())}"


def check_export(words: list[str], whole: bool) -> None:
    unread = {w.partition("=")[0] for w in words} - {plugins.VARIABLE}
    assert not unread, f"psafit reads no {', '.join(sorted(unread))}"


def check_plain(words: list[str], whole: bool) -> None:
    """It is run with the page."""


CHECKS: dict[str, Callable[[list[str], bool], None]] = {
    **dict.fromkeys(PSAFIT, check_psafit),
    **dict.fromkeys(PLAIN, check_plain),
    "export": check_export,
    "make": check_make,
    "python": check_script,
    "pip": check_pip,
}


def wrong(text: str) -> list[str]:
    """Commands on a page that would not do what they say."""
    found = []
    for words, line, whole in mentions(text):
        if words[0] not in CHECKS:
            found.append(f"line {line}: {words[0]} is not known here: teach this test to check it")
            continue
        try:
            CHECKS[words[0]](words[1:], whole)
        except (AssertionError, InputError) as error:
            found.append(f"line {line}: {error}".splitlines()[0])
    return found


def strange(text: str) -> list[str]:
    """Options, modules and files that sentences name and that are not there."""
    found = []
    known = options(cli.commands) | {"--help", "--text"}
    for code, line in inline(text):
        if re.fullmatch(r"--[a-z-]+( .*)?", code) and code.split()[0] not in known:
            found.append(f"line {line}: no option {code}")
        if re.fullmatch(r"psafit(\.\w+)+", code):
            try:
                pkgutil.resolve_name(code)
            except (ImportError, AttributeError):
                found.append(f"line {line}: no {code}")
        if re.fullmatch(r"(psafit|tests|docs|benchmarks|experiments)/[\w./-]+", code) and not (ROOT / code).exists():
            found.append(f"line {line}: no {code}")
    return found


# --- running pages ----------------------------------------------------------------------------------


def thinned(experiment: Experiment) -> Experiment:
    """A dozen readings of every group."""
    groups = []
    for group in experiment.groups:
        rows = np.unique(np.linspace(0, group.n_points - 1, 12).astype(int))
        groups.append(group.at(rows))
    return replace(experiment, groups=tuple(groups))


def set_up(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Go where a page is followed: few readings, short chains, few candidates, cheap searches, one data set redrawn.

    Figures are made and not drawn, which takes half of all time: tests/report draws them.
    """
    from truths import CHEAP

    from psafit import api, diagnose
    from psafit.diagnose.settings import Settings as Effort
    from psafit.inference.problem import Problem
    from psafit.inference.samplers.emcee import Settings
    from psafit.physics import terms

    write_experiment(thinned(read_experiment(ROOT / "experiments" / "psa")), folder / "experiments" / "psa")
    short = Settings(chunk=50, tuned=15, autocorrelation_times=1.0, effective_samples=1.0, r_hat=100.0)
    usual = Settings.of

    def of(problem: Problem) -> Settings:
        return replace(short, n_walkers=usual(problem).n_walkers)

    monkeypatch.setattr(Settings, "of", of)
    whole, effort = diagnose.diagnose, Effort(simulated=49, search=CHEAP)

    def few(*given: Any, **options: Any) -> Any:
        less = {"catalogue": terms(["preload", "reading_gain"]), "settings": effort}
        return whole(*given, **options | less | {"calibrate": min(options.get("calibrate", 0), 1)})

    for module in (diagnose, api):
        monkeypatch.setattr(module, "diagnose", few)
    monkeypatch.setattr(Figure, "savefig", blank)
    monkeypatch.chdir(folder)


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to follow a page in."""
    set_up(tmp_path, monkeypatch)
    return tmp_path


@pytest.fixture(scope="session")
def begun(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The fit and the diagnosis with which most pages begin; on a page the same command takes up what it has left."""
    folder = tmp_path_factory.mktemp("begun")
    with pytest.MonkeyPatch.context() as patch:
        set_up(folder, patch)
        call(["fit", "experiments/psa", "--group", "1"], patch)
        call(["diagnose", "experiments/psa", "--quick"], patch)
    return folder / "fits"


def call(words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Run `psafit WORDS` here."""
    monkeypatch.setattr(sys, "argv", ["psafit", *words])
    with pytest.raises(SystemExit) as caught:
        cli.main()
    assert not caught.value.code, f"psafit {' '.join(words)} ends with {caught.value.code}"


def typed(text: str) -> list[Mention]:
    """What a reader of the page types into a shell."""
    return [m for m in mentions(text) if m.whole]


def run_shell(block: Block, monkeypatch: pytest.MonkeyPatch, make: bool) -> None:
    for words, _, _ in typed(f"```sh\n{block.text}```\n"):
        if words[0] in PLAIN:
            subprocess.run(words, check=True, capture_output=True)
        calls = [words[1:]] if words[0] in PSAFIT else made(words[1:]) if make and words[0] == "make" else []
        for line in calls:
            if subcommand(line)[0] not in LONG:
                call(line, monkeypatch)


def run_python(block: Block, page: Path, names: dict[str, object], capsys: pytest.CaptureFixture[str]) -> None:
    """Run a block after those before it; a line that ends in `# -> words` must have printed them."""
    capsys.readouterr()
    exec(compile("\n" * (block.line - 1) + block.text, str(page), "exec"), names)
    printed = capsys.readouterr().out
    for promised in re.findall(r"# -> (.*)$", block.text, flags=re.MULTILINE):
        assert promised.strip() in printed.splitlines(), f"{page.name}: {promised!r} is not in\n{printed}"


def run_toml(block: Block, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An experiment.toml, next to files with the columns that its comments name; or more of the one before.

    A page that shows a part of one alone adds it to that of docs/own-rig.md.
    """
    folder.mkdir(exist_ok=True)
    if "[constants]" not in block.text:
        if not (folder / "experiment.toml").exists():
            whole = blocks((DOCS / "own-rig.md").read_text("utf-8"))
            run_toml(next(b for b in whole if b.language == "toml"), folder, monkeypatch)
        before = (folder / "experiment.toml").read_text("utf-8")
        (folder / "experiment.toml").write_text(before + block.text, encoding="utf-8")
        call(["check", str(folder)], monkeypatch)
        return
    (folder / "experiment.toml").write_text(block.text, encoding="utf-8")
    columns = re.findall(r"\b[a-z]+(?:_[a-z]+)*_(?:hz|v|um)\b", block.text)
    row = {"frequency_hz": "1000", "amplitude_v": "20", "launch_range_um": "50", "sigma_um": "1"}
    lines = [",".join(columns), ",".join(row.get(c, "1") for c in columns)]
    for group in tomllib.loads(block.text)["group"]:
        (folder / group["file"]).write_text("\n".join(lines) + "\n", encoding="utf-8")
    call(["check", str(folder)], monkeypatch)


def run_page(
    page: Path, text: str, desk: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> dict[str, object]:
    """Follow a page from its first block to its last; what make would run only where psafit goes on from it."""
    make = any(m.words[0] in PSAFIT for m in typed(text))
    names: dict[str, object] = {"__name__": "page"}
    for block in blocks(text):
        if block.language in SHELL and block.language != TRANSCRIPT:
            run_shell(block, monkeypatch, make)
        elif block.language in ("python", "py"):
            run_python(block, page, names, capsys)
        elif block.language == "toml" and not block.title:
            run_toml(block, desk / "mine", monkeypatch)
        elif block.title:
            (desk / block.title).parent.mkdir(exist_ok=True)
            (desk / block.title).write_text(block.text, encoding="utf-8")
    return names


def is_slow(page: Path) -> bool:
    """Whether a page fits or diagnoses anything."""
    text = page.read_text("utf-8")
    calls = any("fit(" in b.text or "diagnose(" in b.text for b in blocks(text))
    return calls or any(m.words[0] in PSAFIT for m in typed(text))


WITH_BLOCKS = [p for p in PAGES if p.name not in FOLLOWED_ELSEWHERE and blocks(p.read_text("utf-8"))]


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(p, id=str(p.relative_to(ROOT)), marks=pytest.mark.slow if is_slow(p) else ())
        for p in WITH_BLOCKS
    ],
)  # fmt: skip
def test_every_block_of_a_page_runs(page: Path, desk: Path, request, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    if is_slow(page):
        shutil.copytree(request.getfixturevalue("begun"), desk / "fits")
    run_page(page, page.read_text("utf-8"), desk, monkeypatch, capsys)


@PAGE
def test_every_block_has_a_language(page: Path) -> None:
    """One without would be run by nobody."""
    known = {*SHELL, "python", "py", "toml", "text", "csv", "json"}
    assert {b.language for b in blocks(page.read_text("utf-8"))} <= known


@pytest.fixture
def shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The cause that docs/own-causes.md shows is known, as --plugin makes it known to a process of its own."""
    file = tmp_path / "sensor_compression.py"
    file.write_text(loaded(DOCS / "make_tutorial.py").example())
    monkeypatch.setattr(physics, "TERMS", (*physics.TERMS, plugin.read(file)))

    def add(named: Iterable[Path]) -> None:
        assert {path.name for path in named} <= {file.name}, f"nobody is shown {', '.join(map(str, named))}"

    monkeypatch.setattr(plugins, "add", add)


@PAGE
def test_every_command_exists(page: Path, request: pytest.FixtureRequest) -> None:
    if page.name in FOLLOWED_ELSEWHERE:
        request.getfixturevalue("shown")
    found = wrong(page.read_text("utf-8"))
    assert not found, "\n".join(found)


@PAGE
def test_what_sentences_name_exists(page: Path) -> None:
    found = strange(page.read_text("utf-8"))
    assert not found, "\n".join(found)


@PAGE
def test_every_link_leads_somewhere(page: Path) -> None:
    found = dead(page)
    assert not found, "\n".join(found)


def test_the_cause_of_the_catalogue_page_is_one(desk: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    """The smallest cause there could be vanishes at neutral, acts elsewhere, and passes its own check."""
    from psafit.physics.term import Term
    from psafit.simulate import Design, simulate

    page = DOCS / "causes.md"
    term = run_page(page, page.read_text("utf-8"), desk, monkeypatch, capsys)["TERM"]
    assert isinstance(term, Term)
    for check in term.checks:
        assert check.value() == pytest.approx(check.expected, rel=check.tolerance)
    psa = read_experiment("experiments/psa")
    design = Design.of(psa.constants, psa.groups)
    ranges = simulate(design, [[1e6, 1e4, 60.0, 1.0], [1e6, 1e4, 60.0, 2.0]], [term]).launch_range
    np.testing.assert_array_equal(ranges[0], simulate(design, [1e6, 1e4, 60.0]).launch_range[0])
    assert not np.allclose(ranges[0], ranges[1])


@pytest.mark.parametrize("page", ["howto/oscilloscope.md", "howto/logged-table.md", "howto/vibrometer.md"])
def test_an_import_prints_what_its_page_shows(page: str, desk: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    file, command, printed = blocks((DOCS / page).read_text("utf-8"))[:3]
    (desk / file.title).write_text(file.text, encoding="utf-8")
    run_shell(command, monkeypatch, make=False)
    assert capsys.readouterr().out == printed.text


# --- the tests themselves ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("page", "words"),
    [
        ("```sh\npsafit fits experiments/psa\n```\n", "has no command fits"),
        ("```sh\npsafit fit experiments/psa --groups 1\n```\n", "No such option"),
        ("```sh\npsafit challenge make --out x\n```\n", "Missing option '--seed'"),
        ("```sh\npsafit fit experiments/psa --group 1 --group 2\n```\n", "given 2 times"),
        ("```sh\npsafit fit experiments/psa --group 1 \\\n    --seed=-1\n```\n", "not in the range"),
        ("```sh\npsafit fit experiments/psa --group 1 --terms lag\n```\n", "there is no cause 'lag'"),
        ("```sh\nmake fit GROUPS=1\n```\n", "make knows no GROUPS"),
        ("```sh\nmake fits\n```\n", "make has no target fits"),
        ("```sh\nmake diagnose GROUP=1 SEED=x\n```\n", "not a valid integer"),
        ("```sh\nset -e\n```\n", "teach this test"),
        ("```sh\nexport PSAFIT_PLUGIN=mine.py\n```\n", "psafit reads no PSAFIT_PLUGIN"),
        ("```sh\npython -c 'print('\n```\n", "never closed"),
        ("Say `psafit diagnose --fast`.", "has no --fast"),
        ("Say `psafit challenge mark`.", "has no command mark"),
        ("Say\n`make everything`.", "line 2: make has no target everything"),
        ("Say `python docs/make_cases.py`.", "no script"),
        ("Say `pip install 'psafit[clusters]'`.", "no extra clusters"),
    ],
)
def test_a_wrong_command_is_found(page: str, words: str) -> None:
    (found,) = wrong(page)
    assert words in found


@pytest.mark.parametrize("page", ["Say `--fast`.", "See `psafit.inference.runs`.", "See `psafit/physics/magnet.py`."])
def test_a_wrong_name_is_found(page: str) -> None:
    assert len(strange(page)) == 1


@pytest.mark.parametrize(
    "text",
    ["[a](b.md)", "![a](b.png)", "[a](#c)", "[a](there.md#c)", "[a](../x.md)", '<img src="b.png">', "[a]: b.md\n"],
)
def test_a_dead_link_is_found(text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules[__name__], "DOCS", tmp_path / "docs")
    (tmp_path / "docs").mkdir()
    (tmp_path / "x.md").write_text("# X\n")
    (tmp_path / "docs" / "there.md").write_text("# A heading\n\n```sh\n# no heading\n```\n")
    page = tmp_path / "docs" / "page.md"
    page.write_text(f"# One `two`, three\n\n[a](there.md#a-heading) [b](#one-two-three) `[c](d.md)`\n\n{text}\n")
    assert len(dead(page)) == 1


def test_a_broken_block_is_found(desk: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    page = desk / "page.md"
    good = {
        "python": "print(2)  # -> 2\n",
        "sh": "psafit check experiments/psa\n",
        "toml": (DOCS / "own-rig.md").read_text("utf-8").split("```toml\n")[1].split("```")[0],
    }
    bad = {"python": "-> 2", "sh": "experiments/psa", "toml": "launch_range_um"}
    for language, text in good.items():
        run_page(page, f"```{language}\n{text}```\n", desk, monkeypatch, capsys)
        broken = text.replace(bad[language], bad[language] + "x")
        assert broken != text
        with pytest.raises(AssertionError):
            run_page(page, f"```{language}\n{broken}```\n", desk, monkeypatch, capsys)
    with pytest.raises(NameError):
        run_page(page, "```python\nfit(1)\n```\n", desk, monkeypatch, capsys)


# --- the site ---------------------------------------------------------------------------------------


def test_every_page_is_in_the_navigation() -> None:
    nav = (ROOT / "mkdocs.yml").read_text("utf-8").partition("\nnav:\n")[2].partition("\n\n")[0]
    listed = re.findall(r"(\S+\.(?:md|ipynb))$", nav, flags=re.MULTILINE)
    assert len(set(listed)) == len(listed)
    assert set(listed) == {p.relative_to(DOCS).as_posix() for kind in ("md", "ipynb") for p in DOCS.rglob(f"*.{kind}")}


def lost_items(text: str) -> list[str]:
    """Items of lists that follow an indented paragraph at once, and would be rendered as more of it."""
    lines = text.splitlines()
    found = []
    for k, line in enumerate(lines):
        if re.match(r"(\d+\.|-) ", line):
            begin = next((i + 1 for i in range(k - 1, -1, -1) if not lines[i].strip()), 0)
            found += [line] if lines[begin].startswith(" ") else []
    return found


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_no_item_of_a_list_is_lost_in_a_paragraph(page: Path) -> None:
    assert not lost_items(expanded(page))
    assert lost_items("1. One.\n\n    More of it.\n2. Two.\n") == ["2. Two."]


@pytest.mark.slow
def test_the_site_is_built_without_a_warning_and_needs_no_network(tmp_path: Path) -> None:
    """Where the docs' libraries are installed (`make docs`); what it alone would find is a broken docstring."""
    needed = ("mkdocs", "material", "mkdocstrings_handlers", "latex2mathml")
    if any(importlib.util.find_spec(name) is None for name in needed):
        pytest.skip("the docs' libraries are not installed: make docs installs them")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", tmp_path],
        cwd=ROOT, capture_output=True, text=True, check=False, env=os.environ | {"NO_MKDOCS_2_WARNING": "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    pages = {p.relative_to(tmp_path).as_posix(): p.read_text("utf-8") for p in tmp_path.rglob("*.html")}
    for name, page in pages.items():
        loads = re.findall(r"<(?:script|img|iframe)[^>]*src=\"?([^\s\">]+)|<link[^>]*href=\"?([^\s\">]+)", page)
        outside = [a or b for a, b in loads if re.match(r"(https?:)?//", a or b)]
        assert not outside, f"{name} loads {outside}"
        equations = re.findall(r"<math.*?</math>", page, flags=re.DOTALL)
        assert not [e for e in equations if "\\" in e or "<merror" in e], f"{name}: LaTeX that was not understood"
        assert "arithmatex" not in page and ":math:" not in page, f"{name}: mathematics that was not found"
    styles = "".join(p.read_text("utf-8") for p in tmp_path.rglob("*.css"))
    assert not re.findall(r"url\([\"']?(?:https?:)?//", styles)
    assert pages["causes.html"].count("<math") > 100
    assert 'id="psafit.inference.run.fit"' in pages["api/inference.html"]
    assert (tmp_path / "search" / "search_index.js").stat().st_size > 50_000
    words = " ".join(html.unescape(re.sub(r"<[^>]+>", " ", pages["api/diagnose.html"])).split())
    of_one_line = (
        f"{name} ( int , default: {getattr(SearchSettings, name)} )" for name in ("short_draws", "short_starts")
    )
    assert all(said in words for said in of_one_line) and "seconds ( dict [ str , float ] )" in words


@pytest.mark.skipif(shutil.which("make") is None, reason="no make")
def test_the_case_study_expects_of_the_free_tip_what_its_causes_say() -> None:
    """Strokes on the first rise from rest, um, at the values that the page has for the two sets."""
    text = (DOCS / "case-study.md").read_text("utf-8")
    rows = [line.split("|")[2:5] for line in text.splitlines() if line.count(" µm |") == 3]
    said = [[float(cell.removesuffix(" µm ")) for cell in row] for row in rows]
    volts, q = np.array([5.0, 10.0, 20.0]), 0.12
    branch, factor = term("hysteresis").branch, term("anchored_stroke").stack_factor
    assert branch and factor
    loop = [q * v - branch(0.0, 0.0, v, q, [0.32, 5.4]) for v in volts]
    grows = [q * v * factor(v, [0.01, 150.0]) for v in volts]
    assert np.array(said) == pytest.approx(np.array([q * volts, loop, grows, 0.5 * q * volts]), abs=0.0051)


def test_a_small_letter_is_not_passed_over() -> None:
    """`make fit group=3` would fit group 1."""
    done = subprocess.run(
        ["make", "--dry-run", "fit", "group=3"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2 and "names are written in capitals: GROUP=3" in done.stderr


def test_the_page_of_commands_is_what_they_say() -> None:
    page = loaded(DOCS / "make_commands.py").page()
    assert (DOCS / "commands.md").read_text("utf-8") == page, "run python docs/make_commands.py"


def test_what_may_be_said_is_kept_by_tests_that_are_there() -> None:
    text = (ROOT / "docs" / "reliability.md").read_text("utf-8")
    table = text.split("## What may be said")[1].split("## Measured")[0]
    named = re.findall(r"`(test_\w+)`", table)
    there = {
        name
        for file in (ROOT / "tests").rglob("test_*.py")
        for name in re.findall(r"def (test_\w+)", file.read_text("utf-8"))
    }
    assert len(named) >= 10 and not set(named) - there
