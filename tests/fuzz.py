"""Hostile input by the thousand: every file psafit reads, and the options of every command (`make fuzz`).

Each case runs one command in a process of its own, in a copy of a small folder of which one file, or the command
line, was spoilt. Whatever it meets, psafit must end within a time limit with exit code 0, 1 or 2; where it refuses,
with one line on standard error, no traceback, and nothing left behind. A case is determined by the seed and its
number: ``python tests/fuzz.py --seed S --only N`` repeats it.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

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
WORDS = [
    "", " ", "0", "-1", "1", "2", "a", "b", "a,b", "a,a", ",", "nan", "1e999", "1e400", "99999999999999999999", "--",
    "-", "-x", "--nonsense", "rig", "missing", "rig/a.csv", "rig/experiment.toml", "fit", "challenge", "/dev/null",
    "/dev/full", "/proc/nothing", "new", "out.json", "rig/out.csv", "x" * 5000, "\u202e", "<script>",
    "$(touch hacked)", "%s", "k_c=1", "k_c=", "=1", "k_c=nan", "k_c=-1", "q=2", "c_s=1e300", "hysteresis",
    "hysteresis,hysteresis", "preload,gap", "nothing", "plug.py", "picture.png", "picture.xyz", "1.5",
    "tcp://127.0.0.1:1",
]  # fmt: skip


class Reached(BaseException):
    """The options were accepted, and long work would begin."""


# --- folders to spoil -----------------------------------------------------------------------------------------------


def prepare(folder: Path) -> None:
    """A small experiment, a finished fit, a diagnosis and a challenge of it."""
    from psafit.diagnose import diagnose
    from psafit.experiment import read_experiment
    from psafit.inference.emcee_adaptor import Settings
    from psafit.inference.problem import Problem
    from psafit.inference.run import fit
    from psafit.physics import terms
    from psafit.validate import validate

    rig = folder / "rig"
    rig.mkdir(parents=True)
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
    data = read_experiment(rig)
    problem = Problem(data, ("a",))
    settings = Settings.of(problem)
    run = fit(data, ("a",), folder / "fit", seed=1, settings=replace(settings, max_steps=100), n_starts=4)
    validate(run)
    diagnose(data, ("a",), folder / "diagnosis", quick=True, catalogue=terms(["reading_offset", "stack_stiffness"]))
    shutil.rmtree(folder / "diagnosis" / "steps", ignore_errors=True)


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


def spoil(path: Path, rng: random.Random) -> None:
    """Spoil a file where it is."""
    content = path.read_bytes()
    if path.suffix == ".json" and rng.random() < 0.6:
        path.write_bytes(spoil_json(content, rng))
    else:
        path.write_bytes(spoil_bytes(content, rng))


# --- cases ----------------------------------------------------------------------------------------------------------

READERS: dict[str, tuple[list[str], list[str]]] = {
    # What is spoilt, and the commands that read it.
    "definition": (["rig/experiment.toml"], ["check rig"]),
    "table": (["rig/a.csv", "rig/b.csv"], ["check rig"]),
    "run": (["fit/*.json", "fit/*.csv"], ["simulate rig --run fit", "watch fit --once", "validate fit"]),
    "chain": (["fit/*.nc", "fit/*.h5"], ["simulate rig --run fit", "watch fit --once", "validate fit"]),
    "diagnosis": (["diagnosis/diagnosis.json"], ["report diagnosis --experiment rig"]),
}
SHARE = {"definition": 0.22, "table": 0.22, "run": 0.08, "chain": 0.04, "diagnosis": 0.02, "options": 0.42}


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


def case(number: int, seed: int, known: dict[str, list[str]], folder: Path) -> tuple[str, list[str]]:
    """Spoil something in `folder`; the kind of case and the command to run."""
    rng = random.Random(f"{seed}-{number}")
    kind = rng.choices(list(SHARE), list(SHARE.values()))[0]
    if kind == "options":
        return kind, words_of(rng, known)
    patterns, readers = READERS[kind]
    files = sorted(f for pattern in patterns for f in folder.glob(pattern))
    spoil(rng.choice(files), rng)
    return kind, rng.choice(readers).split()


def listing(folder: Path) -> set[str]:
    """Everything in a folder."""
    return {str(p.relative_to(folder)) for p in folder.rglob("*")}


def run(words: list[str], folder: Path) -> dict[str, Any]:
    """Run a command in a process of its own; what came of it."""
    before = listing(folder)
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
    result: dict[str, Any] = json.loads(text) if text else {"code": None, "signal": os.WTERMSIG(status), "err": ""}
    result["left"] = sorted(listing(folder) - before)
    return result


def _in_child(words: list[str], folder: Path) -> dict[str, Any]:
    from psafit import cli

    os.chdir(folder)
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(LIMIT)
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
    if len(lines) != 1:
        return f"{len(lines)} lines of error"
    if len(lines[0]) > 1200:
        return f"a line of {len(lines[0])} characters"
    if any(ord(c) < 32 or 0x202A <= ord(c) <= 0x202E for c in lines[0]):
        return "control characters on the terminal"
    return f"left behind {', '.join(result['left'][:3])}" if result["left"] else ""


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
    parser.add_argument("--kind", choices=list(SHARE), help="run cases of this kind alone")
    given = parser.parse_args()
    root = Path(tempfile.mkdtemp(prefix="fuzz-"))
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            whole = root / "whole"
            maker = os.fork()
            if maker == 0:  # the threads of its simulations end with it
                prepare(whole)
                os._exit(0)
            if os.waitpid(maker, 0)[1]:
                return 1
        return _all(given, root, whole)
    finally:
        shutil.rmtree(root, ignore_errors=True)


def _all(given: argparse.Namespace, root: Path, whole: Path) -> int:
    import psafit.api
    import psafit.challenge.campaign
    import psafit.report.diagnosis  # noqa: F401 - what a case imports is imported once

    known = commands()
    print(f"seed {given.seed}", flush=True)
    ends: Counter[tuple[str, str]] = Counter()
    faults: dict[int, str] = {}
    begun = time.monotonic()

    def reached(*args: object, **options: object) -> None:
        raise Reached

    with contextlib.ExitStack() as patches:
        for name in LONG:
            patches.enter_context(mock.patch(name, reached))
        for number in [given.only] if given.only is not None else range(given.cases):
            place = root / "case"
            shutil.copytree(whole, place)
            kind, words = case(number, given.seed, known, place)
            if given.kind in (None, kind):
                result = run(words, place)
                wrong = fault(result)
                ends[kind, f"exit {result['code']}" if not wrong else "FAULT"] += 1
                if wrong:
                    faults[number] = f"{kind}: psafit {' '.join(w[:60] for w in words)}: {wrong}"
                    print(f"case {number}: {faults[number]}", flush=True)
                if given.only is not None:
                    print(json.dumps({"words": words, **result}, indent=1))
            shutil.rmtree(place)
            if number % 1000 == 999:
                print(f"{number + 1} cases, {len(faults)} faults, {time.monotonic() - begun:.0f} s", flush=True)
    for (kind, end), n in sorted(ends.items()):
        print(f"{kind:12} {end:16} {n}")
    print(f"{sum(ends.values())} cases in {time.monotonic() - begun:.0f} s, {len(faults)} faults")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
