"""The floors of the house: who may import whom, and what no file may hold."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "psafit"

# From the ground up. A module imports from its own floor or from below, never from above.
FLOORS = (
    # "" is psafit/__init__.py
    {"", "arrays", "drives", "errors", "files", "heartbeat", "parameters", "plugins", "text", "workers"},
    {"experiment", "forecast", "observables", "records"},
    {"physics"},
    {"prior_check", "simulate"},
    {"inference"},
    {"validate", "numerics", "reproduce", "model_search"},
    {"diagnose"},
    {"challenge", "compare", "watch"},
    {"report"},
    {"api", "cli", "progress", "__main__"},
)
LEVEL = {name: level for level, names in enumerate(FLOORS) for name in names}
DRAWS = {"matplotlib", "cycler", "corner", "jinja2", "markupsafe"}
TALKS = {"click", "rich"}
COMES_WITH = {  # hard requirements of a declared library, met in its own interface
    "arviz-stats": "arviz",  # from 1.0 on
    "cycler": "matplotlib",
    "markupsafe": "jinja2",
    "pil": "matplotlib",
}
OPTIONAL = {"nautilus": "nautilus-sampler", "distributed": "distributed"}  # of an extra, and named so by a distribution
HEAVY = (
    "scipy", "numba", "pandas", "matplotlib", "arviz", "lmfit", "emcee", "corner", "xarray", "h5py", "pint",
    "clevercsv",
)  # fmt: skip


class Import(NamedTuple):
    """One imported name, where it stands: `psafit.simulate.design`, `numpy`, ..."""

    module: str  # dotted, of the importing file
    target: str
    place: str

    @property
    def from_part(self) -> str:
        return part(self.module)

    @property
    def to_part(self) -> str:
        return part(self.target)


def part(dotted: str) -> str:
    """The first name below psafit: its floor hangs on it."""
    return [*dotted.split("."), ""][1]


def imports_of(path: Path, root: Path = ROOT) -> Iterator[Import]:
    """Every import in a file, those inside functions and under TYPE_CHECKING too; relative ones resolved."""
    parts = path.relative_to(root).with_suffix("").parts
    package = parts[:-1]
    module = ".".join(package if parts[-1] == "__init__" else parts)
    file = path.relative_to(root)
    for node in ast.walk(ast.parse(path.read_text("utf-8"), path)):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield Import(module, alias.name, f"{file}:{node.lineno}")
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package[: len(package) - node.level + 1]) if node.level else ""
            origin = ".".join(filter(None, (base, node.module)))
            for alias in node.names:
                # `from psafit import validate` imports a module; `from psafit import __version__` a value.
                below = f"{origin}.{alias.name}"
                known = origin != "psafit" or alias.name in LEVEL
                target = below if origin == "psafit" and known else origin
                yield Import(module, target, f"{file}:{node.lineno}")


MODULES = sorted(PACKAGE.rglob("*.py"))
LINES = {path: path.read_text("utf-8") for path in MODULES}


@cache
def imports() -> list[Import]:
    """Those of the whole package: read when a test asks for them, not by every process that collects tests."""
    return [found for path in MODULES for found in imports_of(path)]


def internal() -> list[Import]:
    return [i for i in imports() if i.target.split(".")[0] == "psafit"]


def external() -> list[Import]:
    return [i for i in imports() if i.target.split(".")[0] not in {"psafit", *sys.stdlib_module_names}]


def holds_numbers(value: ast.expr) -> bool:
    """Whether a value is a number, or made of some; neither an enumeration, nor a record or an option that has some."""
    if isinstance(value, ast.Call):
        name = ast.unparse(value.func).split(".")[-1]
        if name[0].isupper() or name in ("option", "range"):
            return False
    return any(isinstance(n, ast.Constant) and type(n.value) in (int, float, complex) for n in ast.walk(value))


def numeric_constants(text: str) -> list[str]:
    """Names in capitals, of a module or a class, that stand for numbers."""
    tree = ast.parse(text)
    found = []
    for body in (tree, *(n for n in ast.walk(tree) if isinstance(n, ast.ClassDef))):
        for line in body.body:
            if isinstance(line, ast.Assign | ast.AnnAssign) and line.value is not None and holds_numbers(line.value):
                targets = line.targets if isinstance(line, ast.Assign) else [line.target]
                names = [n.id for target in targets for n in ast.walk(target) if isinstance(n, ast.Name)]
                found += [name for name in names if re.fullmatch(r"_*[A-Z][A-Z0-9_]*", name)]
    return found


def test_numbers_are_options() -> None:
    """What can be set has a name, a meaning and a default; capitals are for facts of mathematics and of formats."""
    assert numeric_constants("A, _B = 1, 2.0\nC = range(3)\nD = Term(p=0.1)\nE = {'m': -1}\nf = 2\n") == [
        "A",
        "_B",
        "E",
    ]
    found = [f"{path.relative_to(ROOT)}: {name}" for path, text in LINES.items() for name in numeric_constants(text)]
    thousands = sum(len(text.splitlines()) for text in LINES.values()) / 1000
    assert len(found) <= 3 * thousands, "\n" + "\n".join(found)


def lengths(text: str) -> dict[str, tuple[int, bool]]:
    """Lines of every function, by its name, and whether it is a compiled kernel."""
    return {
        n.name: (n.end_lineno - n.lineno + 1, any("compiled" in ast.unparse(d) for d in n.decorator_list))
        for n in ast.walk(ast.parse(text))
        if isinstance(n, ast.FunctionDef) and n.end_lineno is not None
    }


def test_functions_are_short() -> None:
    """None is over 80 lines, with its docstring; compiled kernels, which keep their state at hand, are below 150."""
    assert lengths("@compiled(borrows=True)\ndef f(x):\n    return x\n") == {"f": (2, True)}
    files = [p for part in ("psafit", "benchmarks", "docs", "tests") for p in sorted((ROOT / part).rglob("*.py"))]
    long = [
        f"{path.relative_to(ROOT)}: {name} has {n} lines"
        for path in files
        for name, (n, kernel) in lengths(path.read_text("utf-8")).items()
        if n > (149 if kernel else 80)
    ]
    assert not long, "\n" + "\n".join(long)


def repeated(texts: dict[Path, str], n: int = 8) -> list[str]:
    """Places where as many lines stand again as somewhere else; imports and comments apart."""
    seen: dict[tuple[str, ...], str] = {}
    found = []
    for path, text in texts.items():
        rows = [(k, line.strip()) for k, line in enumerate(text.splitlines(), 1)]
        imported = {
            k
            for node in ast.parse(text).body
            if isinstance(node, ast.Import | ast.ImportFrom)
            for k in range(node.lineno, (node.end_lineno or 0) + 1)
        }
        rows = [(k, line) for k, line in rows if line and not line.startswith("#") and k not in imported]
        for i in range(len(rows) - n + 1):
            place = seen.setdefault(tuple(line for _, line in rows[i : i + n]), f"{path.name}:{rows[i][0]}")
            if place != f"{path.name}:{rows[i][0]}":
                found.append(f"{path.name}:{rows[i][0]} is {place}")
    return found


def test_nothing_stands_twice() -> None:
    eight = "".join(f"a{k} = {k}\n" for k in range(8))
    assert repeated({Path("x.py"): eight, Path("y.py"): "b = 1\n" + eight}) == ["y.py:2 is x.py:1"]
    files = [p for part in ("psafit", "benchmarks", "docs", "tests") for p in sorted((ROOT / part).rglob("*.py"))]
    twice = repeated({path.relative_to(ROOT): path.read_text("utf-8") for path in files})
    assert not twice, "\n" + "\n".join(twice)


def listed(imports: list[Import]) -> str:
    return "\n" + "\n".join(f"{i.place}: {i.module} imports {i.target}" for i in imports)


def test_imports_are_found(tmp_path: Path) -> None:
    """The reader sees what it is there to see: a check that finds nothing would pass anything."""
    (tmp_path / "psafit" / "physics").mkdir(parents=True)
    file = tmp_path / "psafit" / "physics" / "gap.py"
    file.write_text(
        "import psafit.report.page\n"
        "from psafit import validate, __version__\n"
        "from . import term\n"
        "from ..simulate import batch\n"
        "def f():\n"
        "    from matplotlib.figure import Figure\n"
    )
    found = list(imports_of(file, tmp_path))
    assert [i.target for i in found] == [
        "psafit.report.page",
        "psafit.validate",
        "psafit",
        "psafit.physics",
        "psafit.simulate",
        "matplotlib.figure",
    ]
    assert {i.module for i in found} == {"psafit.physics.gap"}
    assert found[-1].place == "psafit/physics/gap.py:6"
    assert len(internal()) > 10


def test_every_module_has_a_floor() -> None:
    parts = {p.relative_to(PACKAGE).parts[0].removesuffix(".py") for p in MODULES} - {"__init__"}
    assert parts <= LEVEL.keys(), "a new module is given a floor in FLOORS, and in docs"


def test_imports_go_only_downward() -> None:
    # But for the front door, which opens on the top floor when it is asked to.
    inside = [i for i in internal() if i.module != "psafit"]
    upward = [i for i in inside if LEVEL.get(i.to_part, 0) > LEVEL.get(i.from_part, 0)]
    assert not upward, listed(upward)


def test_only_the_report_draws() -> None:
    drawn = [i for i in external() if i.target.split(".")[0] in DRAWS and i.from_part != "report"]
    assert not drawn, listed(drawn)


def test_only_the_command_line_talks() -> None:
    allowed = LEVEL["report"]
    spoken = [i for i in external() if i.target.split(".")[0] in TALKS and LEVEL[i.from_part] < allowed]
    assert not spoken, listed(spoken)


def test_the_reference_shares_no_code_with_the_fast_path() -> None:
    """Two implementations check each other only as long as neither calls the other."""
    references = {"psafit.simulate.reference", "psafit.simulate.literal", "psafit.simulate.literal_scheme"}
    shared = [
        i
        for i in internal()
        if i.module in references
        and i.to_part == "simulate"
        and i.target not in references | {"psafit.simulate.design"}  # the conditions, which are no computation
    ]
    fast = {"batch", "closed_form", "collocation", "drive", "flight", "stepper"}
    shared += [i for i in internal() if i.module.split(".")[-1] in fast and i.target in references]
    assert not shared, listed(shared)


def test_every_library_is_declared() -> None:
    """What psafit imports stands in pyproject.toml, not merely in the environment by way of another library."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    declared = {re.split(r"[<>=!~ \[;]", d, maxsplit=1)[0].lower() for d in project["dependencies"]}
    names = [(i, i.target.split(".")[0].lower().replace("_", "-")) for i in external()]
    extras = str(project["optional-dependencies"])
    missing = [
        i for i, name in names if COMES_WITH.get(name, name) not in declared and OPTIONAL.get(name, "?") not in extras
    ]
    assert not missing, listed(missing)


def test_every_declared_library_is_explained() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras = project["optional-dependencies"].values()
    wanted = [*project["dependencies"], *(name for extra in extras for name in extra)]
    names = {re.split(r"[<>=!~ \[;]", d, maxsplit=1)[0] for d in wanted}
    table = (ROOT / "docs" / "dependencies.md").read_text("utf-8")
    explained = set(re.findall(r"^\| ([\w-]+) \|", table, flags=re.MULTILINE)) - {"library", "file"}
    assert explained == names


@pytest.mark.parametrize(
    ("module", "left_out"), [("psafit.cli", HEAVY), ("psafit.model_search.fitter", ("lmfit", "pandas", "matplotlib"))]
)
def test_what_starts_often_starts_light(module: str, left_out: tuple[str, ...]) -> None:
    """`psafit --help` and a search's processes: what takes seconds to load is loaded by what needs it."""
    assert loaded(f"import {module}", left_out) == []


def test_an_import_stays_light(tmp_path: Path) -> None:
    """What reads tables and prints what it understood needs neither the simulator nor a fit."""
    files = [tmp_path / name for name in ("a.csv", "b.csv")]
    for file in files:
        file.write_text("f (Hz);Vp;Range (um)\n1000;20;76\n1500;10;70\n", encoding="utf-8")
    words = ["import", *map(str, files), "--waveform", "sine", "--out", str(tmp_path / "rig")]
    needed = {"scipy", "pint", "clevercsv"}
    done = f"from psafit.cli import commands; commands.main({words}, standalone_mode=False)"
    assert loaded(done, [name for name in HEAVY if name not in needed]) == []
    assert (tmp_path / "rig").is_dir()


def loaded(code: str, libraries: Sequence[str]) -> list[str]:
    """Libraries that some code has loaded in a process of its own."""
    code += f"; import sys; print('loaded:', *[name for name in {libraries} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.rpartition("loaded:")[2].split()


def text_files() -> list[Path]:
    """Files in the repository or about to be: tracked, or neither tracked nor ignored."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    try:
        done = subprocess.run(command, cwd=ROOT, capture_output=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a git work tree: what belongs to the project is not known")
    paths = [ROOT / name for name in done.stdout.decode().split("\0") if name]
    return [p for p in paths if p.is_file() and b"\0" not in p.read_bytes()]


# Spelled in pieces, so that this file does not hold what it looks for.
MACHINE = r"(?<![\w.~*-])/(?:{})(?![\w.-])".format(
    "|".join(["work", "root", r"tmp/[\w.-]+", r"home/[\w.-]+", r"Users/[\w.-]+"])
)
HOSTS = "pypi/org pypi/python/org pythonhosted/org registry/npmjs deb/debian/org conda/anaconda/org"
REGISTRY = "|".join(host.replace("/", r"\.") for host in HOSTS.split())


@pytest.mark.parametrize(
    ("pattern", "specimen"),
    [
        pytest.param(MACHINE, "see /" + "work/main/x.py", id="machine path"),
        pytest.param(MACHINE, 'open("/' + 'tmp/bash_jobs.0/1")', id="temporary path"),
        pytest.param(REGISTRY, "https://" + "pypi" + ".org/simple", id="registry"),
    ],
)
def test_no_address_of_this_machine(pattern: str, specimen: str) -> None:
    assert re.search(pattern, specimen), "the pattern has to find what it looks for"
    found = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()[:100]}"
        for path in text_files()
        for number, line in enumerate(path.read_text("utf-8", errors="replace").splitlines(), 1)
        if re.search(pattern, line)
    ]
    assert not found, "\n" + "\n".join(found)


def test_every_stage_of_long_work_has_a_title() -> None:
    from psafit.progress import TITLES

    said = {name for path in PACKAGE.rglob("*.py") for name in re.findall(r'\._?stage\(f?"([^"]+)"', path.read_text())}
    # The gain's stages are named by their protocols.
    assert {"search", "causes", "significance", "nautilus", "{protocol} gain"} <= said
    assert said - {"{protocol} gain"} | {"strict gain", "nested gain"} <= set(TITLES)
