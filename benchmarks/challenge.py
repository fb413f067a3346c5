"""`make challenge`: hide every kind of effect, diagnose, and score; writes `score.json` and `score.html`.

Whatever has a result in the folder is not run again. Effects outside the catalogue come from the tests.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

ROOT = Path(__file__).resolve().parent.parent
# The workers find the effects by this path, too.
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from outside import OUTSIDE

from psafit.challenge import Sizes
from psafit.challenge.answer import KINDS
from psafit.challenge.campaign import load, plan, run
from psafit.challenge.score import score
from psafit.cli.common import BAD_INPUT, CHECK_FAILED, DONE
from psafit.errors import InputError, PsafitError
from psafit.experiment import read_experiment
from psafit.files import portable_command
from psafit.records import write_json
from psafit.report.challenge import write_page


def reported(done: int, total: int, note: str) -> None:
    print(f"{done} of {total} data sets {note}".rstrip(), file=sys.stderr, flush=True)


def campaign(words: argparse.Namespace) -> int:
    """Run, score, write; 1 where a target is missed or a diagnosis failed."""
    specs = plan(words.seed, outside=[effect.name for effect in OUTSIDE], designs=words.designs)
    # The number of workers and of data sets at a time do not change a result.
    command = [
        "benchmarks/challenge.py",
        "--seed",
        words.seed,
        "--experiment",
        words.experiment,
        "--designs",
        words.designs,
    ]
    run(
        specs,
        words.out,
        design_of=read_experiment(words.experiment),
        outside=OUTSIDE,
        jobs=words.jobs,
        scheduler=words.scheduler,
        limit=words.limit,
        kinds=words.kinds,
        command=portable_command(["python", *command]),
        progress=reported,
    )
    planned, results = load(words.out)
    found = score(results)
    provenance = {"Version": planned.version, "Command": planned.command, "Seed": f"{words.seed}"}
    provenance |= {"Data sets": f"{len(results)} of {len(specs)}"}
    write_json(words.out / "score.json", found)
    page = write_page(found, words.out / "score.html", provenance)
    for result in results:
        if result.status == "failed":
            print(f"failed: {result.spec.id}: {result.message}", file=sys.stderr)
    for t in found.targets:
        print(t.text)
    print(f"page: {page}")
    missed = any(t.holds is False for t in found.targets)
    return CHECK_FAILED if missed or found.n_failed else DONE


def positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} is not above 0")
    return value


def seed(text: str) -> int:
    value = int(text)
    if not 0 <= value < 2**32:
        raise argparse.ArgumentTypeError(f"{text} is not from 0 to {2**32 - 1}")
    return value


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=seed, default=1)
    parser.add_argument("--jobs", type=positive, default=2, help="processes")
    parser.add_argument("--limit", type=positive, help="only the first so many data sets of the plan")
    parser.add_argument("--kinds", nargs="*", default=[], choices=KINDS, help="only data sets of these kinds")
    parser.add_argument("--out", type=Path, default=Path("fits/challenge"))
    parser.add_argument("--experiment", type=Path, default=Path("experiments/psa"), help="whose design is simulated")
    parser.add_argument("--designs", type=int, default=Sizes.designs, help="one in so many has a drawn design; 0: none")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="Dask scheduler that shares the work out")
    words = parser.parse_args()
    try:
        return campaign(words)
    except InputError as error:
        print(f"challenge: {error}", file=sys.stderr)
        return BAD_INPUT
    except PsafitError as error:
        print(f"challenge: {error}", file=sys.stderr)
        return CHECK_FAILED
    except KeyboardInterrupt:
        print("challenge: interrupted; repeat the same command to go on where it stopped", file=sys.stderr)
        return BAD_INPUT


if __name__ == "__main__":
    sys.exit(main())
