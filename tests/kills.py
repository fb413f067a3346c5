"""Kill -9 at random moments, again and again, until the work is done (`make kills`).

A fit, a quick and a full diagnosis and a campaign run as separate processes, each killed at random moments and started
again with the same command. Nothing under its own name may ever be half-written, and what comes out must be what an
undisturbed run gives: the same draws, verdict and results to the last digit.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rigs import RIG, TRUTH, measure

from psafit.experiment import Experiment, Group, fingerprint, write_experiment
from psafit.physics import terms
from psafit.simulate import Design, simulate

ROOT = Path(__file__).resolve().parents[1]


def hiding() -> Experiment:
    """Two short sweeps of a rig with a slow amplifier, which either of them gives away: so every stage is reached."""
    rng, groups = np.random.default_rng(3), []
    f = np.geomspace(200, 1.5e4, 9)
    for number, (waveform, volts) in enumerate((("sine", 20.0), ("square", 12.0)), 1):
        design = Design.sweep(RIG, waveform, f, np.full(f.size, volts))
        true = simulate(design, [*TRUTH, 6e-5], terms(["amplifier_lag"])).launch_range[0] * 1e6
        read = true * (1 + 0.02 * rng.standard_normal(f.size)) + 0.03 * rng.standard_normal(f.size)
        groups.append(Group(number, waveform, f"{number}.csv", f, design.amplitude, np.maximum(np.round(read, 2), 0.0)))
    return Experiment("A slow amplifier", "drawn", RIG, tuple(groups), Path("hiding"), fingerprint(RIG, groups))


def _without(tree: Any, names: frozenset[str]) -> Any:
    if isinstance(tree, dict):
        return {k: _without(v, names) for k, v in tree.items() if k not in names}
    return [_without(v, names) for v in tree] if isinstance(tree, list) else tree


def _record(path: Path, *names: str) -> Any:
    return _without(json.loads(path.read_text("utf-8")), frozenset(names))


def of_fit(folder: Path) -> Any:
    """Draws and records of a fit, without times (and hashes of files that hold some)."""
    import xarray

    with xarray.open_dataset(folder / "posterior.nc", group="posterior", engine="h5netcdf") as posterior:
        draws = {str(name): np.asarray(values).tolist() for name, values in posterior.data_vars.items()}
    return [draws, _record(folder / "fit.json", "seconds", "command", "sha256")]


def of_diagnosis(folder: Path) -> Any:
    """The result of a diagnosis, without times."""
    return _record(folder / "diagnosis.json", "seconds", "command", "sha256")


def of_full_diagnosis(folder: Path) -> Any:
    """The result of a diagnosis, the draws of its extension, and what else there is."""
    from psafit.files import is_temporary

    result = of_diagnosis(folder)
    names = sorted(path.name for path in folder.iterdir() if not is_temporary(path))
    return [result, [of_fit(folder / run["folder"]) for run in result["extension"].values()], names]


def of_campaign(folder: Path) -> Any:
    """The results of a campaign, without times."""
    from psafit.challenge.campaign import content_hash, load

    return sorted(content_hash(result) for result in load(folder)[1])


KINDS: dict[str, tuple[list[str], Callable[[Path], Any]]] = {
    "fit": (["fit", "rig", "--group", "1", "--no-report", "--quiet", "--out", "{out}"], of_fit),
    "diagnosis": (
        ["diagnose", "rig", "--group", "1", "--quick", "--no-report", "--quiet", "--out", "{out}"],
        of_diagnosis,
    ),
    # One search where nothing is hidden instead of 19: the same stage, in seconds.
    "full": (["diagnose", "hiding", "--group", "1", "--searches", "1", "--quiet", "--out", "{out}"], of_full_diagnosis),
    "campaign": (
        [
            *["challenge", "run", "--seed", "3", "--experiment", "rig", "--terms", "stack_stiffness", "--each", "0"],
            *["--nothing", "3", "--pairs", "0", "--drawn", "0", "--jobs", "1", "--quiet", "--out", "{out}"],
        ],
        of_campaign,
    ),
}


def start(words: list[str], place: Path, out: str) -> subprocess.Popen[bytes]:
    """Begin, or go on."""
    command = [sys.executable, "-m", "psafit", *(word.format(out=out) for word in words)]
    return subprocess.Popen(
        command, cwd=place, env={**os.environ, "PYTHONPATH": str(ROOT)}, start_new_session=True,
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
    )  # fmt: skip


def whole(folder: Path) -> list[str]:
    """Files that cannot be read as what their names say."""
    import h5py

    from psafit.files import is_temporary

    broken = []
    for path in folder.rglob("*"):
        if is_temporary(path):
            continue
        try:
            if path.suffix == ".json":
                json.loads(path.read_text("utf-8"))
            elif path.suffix == ".npz":
                with np.load(path) as stored:
                    dict(stored)
            elif path.suffix in (".nc", ".h5"):
                h5py.File(path, "r").close()
            elif path.suffix == ".csv":
                text = path.read_text("utf-8")
                if len({len(row) for row in csv.reader(text.splitlines())}) != 1 or not text.endswith("\n"):
                    raise ValueError("a table that ends too early")
            elif path.suffix == ".toml":
                tomllib.loads(path.read_text("utf-8"))
            elif path.suffix == ".html" and not path.read_text("utf-8").rstrip().endswith("</html>"):
                raise ValueError("a page that ends too early")
        except Exception as error:
            broken.append(f"{path.relative_to(folder)}: {error}")
    return broken


def main() -> int:
    """Kill, go on, compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=27, help="of each kind")
    parser.add_argument("--seed", type=int, default=int(time.time()))
    parser.add_argument("--kind", choices=list(KINDS), action="append")
    given = parser.parse_args()
    rng = random.Random(given.seed)
    print(f"seed {given.seed}", flush=True)
    place = Path(tempfile.mkdtemp(prefix="kills-"))
    faults = 0
    try:
        # Readings that the baseline explains: a search of seconds.
        write_experiment(measure(np.random.default_rng(5)), place / "rig")
        write_experiment(hiding(), place / "hiding")
        for kind in given.kind or KINDS:
            words, content = KINDS[kind]
            begun = time.monotonic()
            calm = start(words, place, "calm")
            said = calm.communicate()[1].decode()
            seconds = time.monotonic() - begun
            if calm.returncode:
                print(f"{kind}: the undisturbed run ended with {calm.returncode}: {said}")
                return 1
            expected = content(place / "calm")
            kills = ends = 0
            while kills < given.kills:
                ends += 1
                out = f"{kind}-{ends}"
                while True:
                    process = start(words, place, out)
                    wait = rng.uniform(0.0, seconds) if kills < given.kills else 10 * seconds + 60
                    try:
                        process.wait(wait)
                    except subprocess.TimeoutExpired:
                        os.killpg(process.pid, signal.SIGKILL)
                        process.communicate()
                        kills += 1
                        if broken := whole(place / out):
                            faults += 1
                            print(f"{kind}, kill {kills}: half-written {'; '.join(broken)}", flush=True)
                        continue
                    error = process.communicate()[1].decode()
                    break
                if broken := whole(place / out):
                    faults += 1
                    print(f"{kind}, after kill {kills}: half-written {'; '.join(broken)}", flush=True)
                if process.returncode:
                    faults += 1
                    print(f"{kind}, after kill {kills}: exit {process.returncode}: {error[-300:]}", flush=True)
                elif content(place / out) != expected:
                    faults += 1
                    print(f"{kind}, after kill {kills}: another result", flush=True)
                shutil.rmtree(place / out, ignore_errors=True)
                print(f"{kind}: {kills} of {given.kills} kills, {ends} runs to the end", file=sys.stderr, flush=True)
            shutil.rmtree(place / "calm")
            print(f"{kind}: {kills} kills, {ends} runs to the end, undisturbed {seconds:.0f} s", flush=True)
    finally:
        shutil.rmtree(place, ignore_errors=True)
    print(f"{faults} faults")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
