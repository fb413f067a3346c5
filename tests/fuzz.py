"""Hostile input by the thousand: every file psafit reads, and the options of every command (`make fuzz`).

Each case runs one command, in a copy of a small folder of which one file, or the command line, was spoilt. Commands
that do more than read run in a process of their own. Whatever it meets, psafit must end within a time limit with exit
code 0, 1 or 2; where it refuses, with a line on standard error for each fault, no traceback, and nothing left behind.
A case is determined by the seed and its number: ``python tests/fuzz.py --seed S --only N`` repeats it.
"""

from __future__ import annotations

import argparse
import contextlib
import datetime
import functools
import hashlib
import io
import json
import os
import pickle
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
LIMIT = 60  # s, of one case
TOKENS = [
    b"", b"nan", b"NaN", b"inf", b"-inf", b"1e999", b"-1", b"0", b"1e-320", b"\x00", b"\xff\xfe", b"\xef\xbb\xbf",
    b"\r", b"\n", b"\t", b'"', b"'", b",", b";", b"=", b"[", b"]", b"{", b"}", b"#", b"\\", b"../../etc/passwd",
    b"<script>alert(1)</script>", "−5".encode(), "１２".encode(), "\u202e".encode(), b"%s%n", b"$(touch hacked)",
    b"[" * 3000, b"9" * 5000, b"true", b"null", b"1979-05-27", b"0x1F", b"1_000",
]  # fmt: skip
VALUES: list[Any] = [
    None, True, False, 0, -1, 1, 2**80, 1e999, -1e999, float("nan"), 1e-320, "", "nan", "\u202e",
    "<script>alert(1)</script>", "a" * 5000, [], {}, [[]], [None], {"": None}, "../../x", "\x00",
]  # fmt: skip
TOML = [
    "nan", "inf", "-inf", "-1", "0", "0.0", "1", "2", "1e-320", "1e-9", "1e9", "1e300", "9" * 400, "true", "''", "'a'",
    "'b'", "'c'", "'sine'", "'square'", "'../a.csv'", '"\\u0000"', '"\\u202e"', "[]", "[[]]", "{}", "1979-05-27",
]  # fmt: skip
CELLS: list[Any] = [
    None, True, 0, -1, 1e300, 1e-320, "", "nan", "1,5", "1.5", "5 mV", "\u202e", "#DIV/0!", "=1/0", "a" * 5000, "Vpp",
    datetime.datetime(2026, 11, 3), datetime.time(1, 2), datetime.timedelta(hours=30), "−5", "# retuned",
]  # fmt: skip
WORDS = [
    "", " ", "0", "-1", "1", "2", "a", "b", "a,b", "a,a", ",", "nan", "1e999", "1e400", "99999999999999999999", "--",
    "-", "-x", "--nonsense", "rig", "missing", "rig/a.csv", "rig/experiment.toml", "fit", "challenge", "campaign",
    "/dev/null", "/dev/full", "/proc/nothing", "new", "out.json", "rig/out.csv", "x" * 5000, "\u202e", "<script>",
    "$(touch hacked)", "%s", "k_c=1", "k_c=", "=1", "k_c=nan", "k_c=-1", "q=2", "c_s=1e300", "hysteresis",
    "hysteresis,hysteresis", "preload,gap", "nothing", "plug.py", "picture.png", "picture.xyz", "1.5",
    "tcp://127.0.0.1:1",
]  # fmt: skip


class Reached(BaseException):
    """The options were accepted, and long work would begin."""


class Late(BaseException):
    """A case took longer than it may."""


# --- folders to spoil -----------------------------------------------------------------------------------------------

# The candidates of a diagnosis here: the whole catalogue takes minutes.
CAUSES = ("reading_offset", "stack_stiffness")
# What the diagnosis that is taken up again found undisturbed.
UNDISTURBED = "undisturbed.json"
# What an imported file holds, or a folder with many keys, where it was not spoilt.
TRUTH = "truth.pickle"
# Cases that need nothing of what `prepare` makes.
ALONE = ("import", "keys")
# Commands that end at once and keep nothing in memory: they run within this process.
READS = ("import", "check")
CAMPAIGN = (
    f"challenge run --seed 11 --experiment rig --terms {CAUSES[0]} --each 0 --nothing 2 --pairs 0 --drawn 0 --designs 0"
    " --quiet --out campaign"
)


def prepare(folder: Path) -> None:
    """A small experiment and what comes of it: fits, diagnoses, a challenge, a campaign; claims, and a plugin."""
    from scripts import loaded

    from psafit.challenge.campaign import plan
    from psafit.challenge.campaign import run as run_campaign
    from psafit.challenge.hide import make
    from psafit.diagnose import diagnose
    from psafit.diagnose.record import RESULT
    from psafit.experiment import read_experiment
    from psafit.inference.problem import Problem
    from psafit.inference.run import fit
    from psafit.inference.samplers.emcee import Settings
    from psafit.physics import terms
    from psafit.validate import validate

    rig = folder / "rig"
    rig.mkdir()
    (rig / "experiment.toml").write_text(
        'title = "a rig"\nsource = "made up"\n'
        "[constants]\nM = 0.027\nm = 0.005\nq = 1.2e-7\nl = 0.09\nk_s = 4.89e7\ng = 9.81\n"
        '[[group]]\nid = "a"\nfile = "a.csv"\nwaveform = "sine"\n'
        '[[group]]\nid = "b"\nfile = "b.csv"\nwaveform = "square"\n'
    )
    for name, volts in (("a", 20.0), ("b", 12.0)):
        f = np.geomspace(300, 1e4, 8)
        y = 30 * volts / 20 / (1 + (f / 3000) ** 2)
        rows = "\n".join(f"{a:.6g},{volts},{b:.4g}" for a, b in zip(f, y, strict=True))
        (rig / f"{name}.csv").write_text(f"frequency_hz,amplitude_v,launch_range_um\n{rows}\n")
    _add_known(rig, folder / "known")
    data = read_experiment(rig)
    problem = Problem(data, ("a",))
    settings = Settings.of(problem)
    run = fit(data, ("a",), folder / "fit", seed=1, settings=replace(settings, max_steps=100), n_starts=4)
    validate(run)
    shutil.copytree(folder / "fit", folder / "other")
    few = functools.partial(diagnose, catalogue=terms(CAUSES), jobs=1)
    few(data, ("a",), folder / "diagnosis")
    shutil.rmtree(folder / "diagnosis" / "steps")
    few(data, ("a",), folder / "interrupted", quick=True)
    (folder / "interrupted" / RESULT).rename(folder / UNDISTURBED)
    hidden = make(4, folder / "challenge", design_of=data, terms=CAUSES)
    few(hidden.experiment, ("a",), folder / "challenge" / "diagnosis", quick=True)
    # Its own conditions, small as they are, instead of drawn ones.
    specs = plan(11, terms=CAUSES[:1], each=0, nothing=2, pairs=0, drawn=0, designs=0)
    run_campaign(specs, folder / "campaign", design_of=data, diagnose=few, jobs=1)
    claims = (ROOT / "experiments" / "psa" / "published.toml").read_text("utf-8")
    (rig / "published.toml").write_text(re.sub(r"(?m)^group = .*$", 'group = "a"', claims), "utf-8")
    (folder / "plug.py").write_text(loaded(ROOT / "docs" / "make_tutorial.py").example(), "utf-8")


def _add_known(rig: Path, folder: Path) -> None:
    """Copy a rig and add all that may be known of it: priors, limits, errors of readings, a group of another string."""
    shutil.copytree(rig, folder)
    definition = (folder / "experiment.toml").read_text("utf-8") + "constants = { l = 0.06, m = 0.006 }\n"
    definition += '[prior.k_c]\nmedian = 4e6\nfactor = 1.5\nsource = "Hertz"\n'
    definition += '[prior.hysteresis_strength]\nmean = 0.15\nsd = 0.05\nsource = "data sheet"\n'
    definition += "[limits]\nfrequency_hz = [100, 20000]\namplitude_v = [1, 20]\nl = [0.06, 0.12]\n"
    (folder / "experiment.toml").write_text(definition, "utf-8")
    head, *rows = (folder / "a.csv").read_text("utf-8").splitlines()
    rows = [f"{row},{0.05 * float(row.rpartition(',')[2]) + 0.05:.3g}" for row in rows]
    (folder / "a.csv").write_text("\n".join([f"{head},sigma_um", *rows, ""]), "utf-8")


# --- spoiling -------------------------------------------------------------------------------------------------------


def spoil_bytes(content: bytes, rng: random.Random) -> bytes:
    """One to three changes of a file, as bytes."""
    for _ in range(rng.choice([1, 1, 2, 3])):
        at = rng.randrange(len(content) + 1)
        end = min(at + rng.choice([1, 2, 10, 200]), len(content))
        kind = rng.randrange(7)
        if kind == 0:
            content = content[:at] + bytes([rng.randrange(256)]) + content[at + 1 :]
        elif kind == 1:
            content = content[:at] + content[end:]
        elif kind == 2:
            content = content[:end] + content[at:]
        elif kind == 3:
            content = content[:at]
        elif kind == 4:
            content = content[:at] + rng.choice(TOKENS) + content[end:]
        elif kind == 5:
            lines = content.split(b"\n")
            rng.shuffle(lines)
            content = b"\n".join(lines)
        else:
            words = content.split(b",")
            words[rng.randrange(len(words))] = rng.choice(TOKENS)
            content = b",".join(words)
    return content


def spoil_json(content: bytes, rng: random.Random) -> bytes:
    """One to three changes of a record's nodes."""
    tree = json.loads(content)
    for _ in range(rng.choice([1, 1, 2, 3])):
        node = tree
        for _ in range(rng.randrange(1, 7)):
            if not isinstance(node, dict | list) or not node:
                break
            key: Any = rng.choice(list(node)) if isinstance(node, dict) else rng.randrange(len(node))
            if not isinstance(node[key], dict | list) or not node[key] or rng.random() < 0.25:
                if rng.random() < 0.2 and isinstance(node, dict):
                    del node[key]
                else:
                    node[key] = rng.choice(VALUES)
                break
            node = node[key]
    return json.dumps(tree).encode("utf-8", "surrogatepass")


def spoil_toml(content: bytes, rng: random.Random) -> bytes:
    """One to three values, each changed to another that TOML knows."""
    lines = content.decode().split("\n")
    values = [k for k, line in enumerate(lines) if " = " in line]
    for k in rng.sample(values, rng.choice([1, 1, 2, 3])):
        lines[k] = f"{lines[k].partition(' = ')[0]} = {rng.choice(TOML)}"
    return "\n".join(lines).encode()


def spoil_workbook(content: bytes, rng: random.Random) -> bytes:
    """One to three cells, each changed to anything that a cell may hold."""
    from openpyxl import load_workbook

    book = load_workbook(io.BytesIO(content))
    for _ in range(rng.choice([1, 1, 2, 3])):
        sheet = rng.choice(book.worksheets)
        cell = sheet.cell(rng.randint(1, sheet.max_row), rng.randint(1, sheet.max_column))
        cell.value = rng.choice(CELLS)
    spoilt = io.BytesIO()
    book.save(spoilt)
    return spoilt.getvalue()


DEEPER = {".json": spoil_json, ".toml": spoil_toml, ".xlsx": spoil_workbook}


def spoil(path: Path, rng: random.Random) -> None:
    """Spoil a file where it is: its values, where it is of a kind that has some, or its bytes."""
    content = path.read_bytes()
    by = DEEPER.get(path.suffix, spoil_bytes) if rng.random() < 0.6 else spoil_bytes
    path.write_bytes(by(content, rng))


def commit(folder: Path) -> None:
    """Forge the seal of a challenge's answer, which nobody would read otherwise."""
    digest = hashlib.sha256((folder / "answer.json").read_bytes()).hexdigest()
    (folder / "commitment.txt").write_text(f"{digest}  answer.json\n")


# --- cases ----------------------------------------------------------------------------------------------------------

READERS: dict[str, tuple[list[str], list[str]]] = {
    # What is spoilt, and the commands that read it.
    "definition": (["rig/experiment.toml"], ["check rig"]),
    "table": (["rig/a.csv", "rig/b.csv"], ["check rig"]),
    "known": (
        ["known/experiment.toml", "known/a.csv"],
        ["check known", "simulate known --terms hysteresis --set hysteresis_strength=0.2"],
    ),
    "claims": (["rig/published.toml"], ["reproduce rig --out new --quiet"]),
    "plugin": (
        ["plug.py"],
        [
            "terms --plugin plug.py",
            "check-cause plug.py --draws 1",
            "simulate rig --plugin plug.py --terms sensor_compression --set sensor_kappa=1000",
        ],
    ),
    "run": (
        ["fit/*.json", "fit/*.csv", "fit/experiment/*"],
        ["simulate rig --run fit", "watch fit --once", "validate fit", "report fit", "report other fit"],
    ),
    "chain": (["fit/*.nc", "fit/*.h5"], ["simulate rig --run fit", "watch fit --once", "validate fit"]),
    "diagnosis": (
        ["diagnosis/*.json", "diagnosis/*.csv", "diagnosis/experiment/*"],
        ["report diagnosis --experiment rig", "report diagnosis", "simulate rig --run diagnosis"],
    ),
    "pair": (["fit/*", "diagnosis/*"], ["report fit diagnosis", "report diagnosis fit"]),
    "steps": (
        ["interrupted/steps/*"],
        [f"diagnose rig --group a --quick --causes {','.join(CAUSES)} --no-report --quiet --out interrupted"],
    ),
    "challenge": (
        ["challenge/*.json", "challenge/*.txt", "challenge/experiment/*", "challenge/diagnosis/diagnosis.json"],
        ["challenge score challenge --diagnosis challenge/diagnosis"],
    ),
    "campaign": (["campaign/*.json", "campaign/results/*"], ["challenge score campaign", CAMPAIGN]),
}
SHARE = {
    "definition": 0.14, "table": 0.14, "known": 0.12, "claims": 0.02, "plugin": 0.02, "run": 0.08, "chain": 0.04,
    "diagnosis": 0.03, "pair": 0.02, "steps": 0.02, "challenge": 0.06, "campaign": 0.04, "options": 0.17,
    "import": 0.1, "keys": 0.1,
}  # fmt: skip


def commands() -> dict[str, list[str]]:
    """Every command with its options, from the program itself."""
    import click

    from psafit import cli

    found = {}

    def walk(group: click.Group, words: str) -> None:
        for name, command in group.commands.items():
            if isinstance(command, click.Group):
                walk(command, f"{words}{name} ")
            else:
                found[f"{words}{name}"] = [o for p in command.params for o in p.opts if o.startswith("-")]

    walk(cli.commands, "")
    return found


def words_of(rng: random.Random, known: dict[str, list[str]]) -> list[str]:
    """A command with options and arguments of any kind."""
    command = rng.choice(list(known))
    words = command.split()
    if rng.random() < 0.7:
        words.append(rng.choice(["rig", "fit", "diagnosis", rng.choice(WORDS)]))
    for _ in range(rng.randrange(5)):
        if known[command] and rng.random() < 0.8:
            words.append(rng.choice(known[command]))
        if rng.random() < 0.8:
            words.append(rng.choice(WORDS))
    return words


def case(number: int, seed: int, kinds: Sequence[str]) -> tuple[random.Random, str]:
    """What determines a case, and its kind."""
    rng = random.Random(f"{seed}-{number}")
    return rng, rng.choices(kinds, [SHARE[kind] for kind in kinds])[0]


def set_up(kind: str, rng: random.Random, known: dict[str, list[str]], folder: Path) -> list[str]:
    """Spoil something in `folder`; the command to run."""
    if kind == "options":
        return words_of(rng, known)
    if kind in ALONE:
        return (import_words if kind == "import" else keyed_words)(rng, folder)
    patterns, readers = READERS[kind]
    files = sorted(f for pattern in patterns for f in folder.glob(pattern) if f.is_file())
    spoilt = rng.choice(files)
    spoil(spoilt, rng)
    if spoilt.name == "answer.json" and rng.random() < 0.6:
        commit(spoilt.parent)
    return rng.choice(readers).split()


def import_words(rng: random.Random, folder: Path) -> list[str]:
    """A file as instruments write it, half of them spoilt, and the command that imports it."""
    from foreign import draw, draw_trace
    from recordings import draw_traces

    draws = functools.partial(draw_traces, damaged=0.4)
    made = rng.choices([draw, draw_trace, draws], [3, 1, 3])[0](rng, folder, more=0.5)
    if rng.random() < 0.4 and not made.wrong:
        spoil(rng.choice([made.file, *made.others]), rng)
    else:
        (folder / TRUTH).write_bytes(pickle.dumps((made.readings, made.wrong)))
    return ["import", made.file.name, "--out", "new", *made.options]


def keyed_words(rng: random.Random, folder: Path) -> list[str]:
    """A folder with every key that there is, half of them spoilt, and a command that reads it."""
    from keyed import draw

    made = draw(rng, folder / "rig")
    if rng.random() < 0.5:
        spoil(rng.choice(sorted((folder / "rig").iterdir())), rng)
    else:
        (folder / TRUTH).write_bytes(pickle.dumps(made))
    return rng.choices(["check rig", "simulate rig --quiet"], [20, 1])[0].split()


def listing(folder: Path) -> set[str]:
    """Everything in a folder."""
    return {str(p.relative_to(folder)) for p in folder.rglob("*")}


def run(kind: str, words: list[str], folder: Path) -> dict[str, Any]:
    """Run a command in a process of its own; what came of it."""
    before = listing(folder)
    with stand_ins(kind):
        # Causes are read once in a process: a plugin needs one that has read none.
        if kind == "plugin":
            result = _anew(words, folder)
        elif words[0] in READS:
            result = _here(words, folder)
        else:
            result = _forked(words, folder)
    result["left"] = sorted(listing(folder) - before)
    return result


def stand_ins(kind: str) -> contextlib.ExitStack:
    """What takes the place of long work: nothing, as far as options go."""

    def reached(*args: object, **options: object) -> None:
        raise Reached

    patches = contextlib.ExitStack()
    for name in LONG if kind == "options" else ():
        patches.enter_context(mock.patch(name, reached))
    return patches


def _anew(words: list[str], folder: Path) -> dict[str, Any]:
    environment = {k: v for k, v in os.environ.items() if k != "PSAFIT_PLUGINS"} | {"PYTHONPATH": str(ROOT)}
    try:
        done = subprocess.run(
            [sys.executable, "-m", "psafit", *words], cwd=folder, capture_output=True, timeout=LIMIT, check=False,
            env=environment,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return {"code": None, "signal": signal.SIGALRM, "err": ""}
    out, err = (text.decode(errors="replace") for text in (done.stdout, done.stderr))
    if done.returncode < 0:
        return {"code": None, "signal": -done.returncode, "err": err}
    return {"code": done.returncode, "err": err, "out": out[-300:]}


def _forked(words: list[str], folder: Path) -> dict[str, Any]:
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        said = _in_child(words, folder)
        with os.fdopen(writing, "w") as pipe:
            json.dump(said, pipe)
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading) as pipe:
        text = pipe.read()
    _, status = os.waitpid(child, 0)
    return json.loads(text) if text else {"code": None, "signal": os.WTERMSIG(status), "err": ""}


def _here(words: list[str], folder: Path) -> dict[str, Any]:
    """Run a command that only reads and writes files, without a process of its own."""
    place = Path.cwd()

    def late(*_: object) -> None:
        raise Late

    signal.signal(signal.SIGALRM, late)
    signal.alarm(LIMIT)
    try:
        return _run(words, folder)
    except Late:
        return {"code": None, "signal": signal.SIGALRM, "err": ""}
    finally:
        signal.alarm(0)
        os.chdir(place)


def _in_child(words: list[str], folder: Path) -> dict[str, Any]:
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(LIMIT)
    return _run(words, folder)


def _run(words: list[str], folder: Path) -> dict[str, Any]:
    from psafit import cli

    os.chdir(folder)
    out, err = io.StringIO(), io.StringIO()
    code: Any = None
    with (
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        mock.patch.object(sys, "argv", ["psafit", *words]),
    ):
        try:
            cli.main()
        except SystemExit as end:
            code = end.code
        except Reached:
            code = "long work"
        except Late:
            raise
        except BaseException:
            code = "traceback"
            traceback.print_exc()
    return {"code": code, "err": err.getvalue(), "out": out.getvalue()[-300:]}


def fault(result: dict[str, Any]) -> str:
    """What is wrong with the end of a case; empty for nothing."""
    code, lines = result["code"], [line for line in result["err"].splitlines() if line.strip()]
    if code is None:
        return (
            "killed by its time limit" if result["signal"] == signal.SIGALRM else f"killed by signal {result['signal']}"
        )
    if code == "traceback" or "Traceback" in result["err"]:
        return f"a traceback: {lines[-1][:200] if lines else ''}"
    if code in (0, 1, "long work"):
        return ""
    if code != 2:
        return f"exit code {code}"
    if not 1 <= len(lines) <= 11 or (len(lines) > 1 and not all(line.startswith("psafit: ") for line in lines)):
        return f"{len(lines)} lines of error"
    if (longest := max(map(len, lines))) > 1200:
        return f"a line of {longest} characters"
    if any(ord(c) < 32 or 0x202A <= ord(c) <= 0x202E for line in lines for c in line):
        return "control characters on the terminal"
    return f"left behind {', '.join(result['left'][:3])}" if result["left"] else ""


def another(folder: Path) -> str:
    """Whether a diagnosis that went on found something else than undisturbed; empty for no."""
    found, expected = (
        {k: v for k, v in json.loads(path.read_text("utf-8")).items() if k not in ("seconds", "command", "sha256")}
        for path in (folder / "interrupted" / "diagnosis.json", folder / UNDISTURBED)
    )
    return "" if found == expected else "another result"


def misread(folder: Path, code: object) -> str:
    """Whether an import holds other readings than the file that was not spoilt; empty for no."""
    from foreign import Reading, differ, driven
    from keyed import read_plainly

    truth = folder / TRUTH
    if not truth.exists() or code == 2:
        return ""
    readings, wrong = pickle.loads(truth.read_bytes())
    if wrong:
        return f"accepted with {wrong}"
    found: list[Reading] = []
    for g in read_plainly(folder / "new"):
        drive = driven(g.waveform, g.settings)
        found += [(drive, *cell[:4], cell[4] or 0.0) for cell in g.cells]
        condition = drive, *g.cells[0][:2]
        for row in g.rows:
            names = (name.replace("time_us", "drive_us") for name in g.columns)
            found += [(*condition, name, x, 0.0) for name, x in zip(names, row, strict=True)]
    return "other readings than in the file" if differ(found, readings) else ""


def misunderstood(folder: Path, code: object) -> str:
    """Whether a folder with many keys was not read as it is; empty for no."""
    from keyed import differs, read_plainly

    from psafit.experiment import read_experiment

    truth = folder / TRUTH
    made = pickle.loads(truth.read_bytes()) if truth.exists() else None
    if made is not None and (code == 2) != bool(made.wrong):
        return f"accepted with {made.wrong}" if made.wrong else "refused, and it is sound"
    if code == 2:
        return ""
    found = read_experiment(folder / "rig")
    return differs(found, made.groups, made.rig) if made is not None else differs(found, read_plainly(folder / "rig"))


def misread_by(kind: str, folder: Path, code: object) -> str:
    """What a case that ended as it may did wrong; empty for nothing."""
    if kind == "steps":
        return another(folder)
    return {"keys": misunderstood, "import": misread}.get(kind, lambda *_: "")(folder, code)


# What begins long work, once options and inputs have been accepted.
LONG = [
    "psafit.inference.run.fit", "psafit.diagnose.diagnose", "psafit.reproduce.reproduce",
    "psafit.challenge.campaign.run", "psafit.challenge.hide.make", "psafit.simulate.contract.check",
]  # fmt: skip


def main() -> int:
    """Run the cases, and list what went wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=int(time.time()))
    parser.add_argument("--only", type=int, help="repeat this case, and show all of it")
    parser.add_argument("--kind", choices=list(SHARE), nargs="+", default=list(SHARE), help="only of these kinds")
    given = parser.parse_args()
    root = Path(tempfile.mkdtemp(prefix="fuzz-"))
    try:
        whole = root / "whole"
        whole.mkdir()
        if not set(given.kind) <= set(ALONE) and not _prepared(whole):
            return 1
        return _all(given, root, whole)
    finally:
        shutil.rmtree(root, ignore_errors=True)


def _prepared(whole: Path) -> bool:
    """Fill the folder that other cases spoil copies of; whether that went well."""
    with contextlib.redirect_stdout(io.StringIO()):
        maker = os.fork()
        if maker == 0:  # the threads of its simulations end with it
            prepare(whole)
            os._exit(0)
        return not os.waitpid(maker, 0)[1]


def _all(given: argparse.Namespace, root: Path, whole: Path) -> int:
    import psafit.api
    import psafit.challenge.campaign
    import psafit.experiment.importing
    import psafit.report.diagnosis  # noqa: F401 - what a case imports is imported once
    from psafit.experiment.importing.units import unit

    unit("Hz")  # pint reads its definitions

    known = commands()
    print(f"seed {given.seed}", flush=True)
    ends: Counter[tuple[str, str]] = Counter()
    faults: dict[int, str] = {}
    begun = time.monotonic()
    place = root / "case"
    if given.only is None and not _sound(given.kind, place, whole):
        return 1
    for number in [given.only] if given.only is not None else range(given.cases):
        rng, kind = case(number, given.seed, given.kind)
        shutil.copytree(whole, place, ignore=shutil.ignore_patterns("*") if kind in ALONE else None)
        words = set_up(kind, rng, known, place)
        result = run(kind, words, place)
        wrong = fault(result) or misread_by(kind, place, result["code"])
        shutil.rmtree(place)
        ends[kind, f"exit {result['code']}" if not wrong else "FAULT"] += 1
        if wrong:
            faults[number] = f"{kind}: psafit {' '.join(w[:60] for w in words)}: {wrong}"
            print(f"case {number}: {faults[number]}", flush=True)
        if given.only is not None:
            print(json.dumps({"words": words, **result}, indent=1))
        if number % 200 == 199:
            print(f"{number + 1} cases, {len(faults)} faults, {time.monotonic() - begun:.0f} s", flush=True)
    for (kind, end), n in sorted(ends.items()):
        print(f"{kind:12} {end:16} {n}")
    print(f"{sum(ends.values())} cases in {time.monotonic() - begun:.0f} s, {len(faults)} faults")
    return 1 if faults else 0


def _sound(wanted: Sequence[str], place: Path, whole: Path) -> bool:
    """Whether the commands take what is not spoilt: a refusal would otherwise be reported of anything."""
    for kind in READERS.keys() & set(wanted):
        for command in READERS[kind][1]:
            shutil.copytree(whole, place)
            result = run(kind, command.split(), place)
            shutil.rmtree(place)
            if fault(result) or result["code"] not in (0, 1):
                print(f"{kind}: psafit {command}: {json.dumps(result, indent=1)}")
                return False
    return True


if __name__ == "__main__":
    sys.exit(main())
