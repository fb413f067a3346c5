"""Effects hidden with fresh seeds in every run: the diagnosis finds what nobody has named to it.

Of each kind (nothing, one cause, two causes, an effect outside the catalogue) data sets are drawn until enough are
answered rightly. How many that are follows from the chance that a sound diagnosis is right, so that it fails less than
once in a thousand runs. A failure prints the seed and every verdict; ``PSAFIT_CHALLENGE_SEED=<seed>`` replays it.

The fast test hides in 36 readings and gives the diagnosis three causes to choose from; the slow one hides in 72 and
gives it the whole catalogue. Two more slow ones hide less, among seven causes: one that says of the rig what few think
of, and one of a stack that is driven from 0 V. Kinds and causes are drawn in each run, as seeds are: two kinds by the
fast test, one by a slow one. ``tests/hidden_rates.py`` counts all kinds, with ``--slow`` of the whole catalogue.
"""

from __future__ import annotations

import itertools
import os
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from outside import OUTSIDE
from rigs import RIG
from scipy.stats import binom

from psafit import model_search
from psafit.challenge.answer import EXPERIMENT, Answer
from psafit.challenge.campaign import read_diagnosis
from psafit.challenge.hide import Challenge, make
from psafit.challenge.oracle import Oracle, consult
from psafit.challenge.score import located, reported_set
from psafit.diagnose import diagnose, judging
from psafit.diagnose.discrepancy import Discrepancy, discrepancy
from psafit.diagnose.misfit import examine
from psafit.diagnose.settings import Settings
from psafit.experiment import Experiment, Group, fingerprint, read_experiment
from psafit.inference.candidate import Candidate
from psafit.inference.problem import Problem
from psafit.model_search import SearchSettings, model_set
from psafit.physics import TERMS, terms

SEED = "PSAFIT_CHALLENGE_SEED"
UNIT_ERROR = next(effect for effect in OUTSIDE if effect.name == "unit_error")
# Closed forms, which are quick to fit, and causes that this design shows well.
SINGLES = ("start_phase", "gap", "preload")
PAIR = ("start_phase", "preload")
# What a diagnosis chooses from where it need not look at all there is.
FEW = SINGLES
ASKED, ASKED_OF_EACH = 100.0, 60.0
# What the oracle must see for a miss to count: of the whole, and of each of a pair given the other.
SEEN, SEEN_EACH = 40.0, 15.0
_TRIES = 12

# Chances that a sound diagnosis is right about a data set: the targets of the full campaign, which count from 25 nats
# on. `python tests/hidden_rates.py` counts them.
RIGHT = {"nothing": 0.95, "one": 0.95, "two": 0.70, "outside": 0.85}
ONCE_IN = 1000
# Sets in a verdict beyond which it says nothing.
MOST_MEMBERS = 6


@dataclass(frozen=True)
class Hidden:
    """One data set and what the oracle says of it."""

    made: Challenge
    oracle: Oracle
    seed: int


def needed(chance: float, n: int, once_in: float = ONCE_IN * len(RIGHT)) -> int:
    """Right answers of `n` that can be asked for, so that a sound diagnosis gives fewer less than once in `once_in`."""
    fewer = binom.cdf(np.arange(n + 1), n, chance)  # P(at most k right)
    return int(np.searchsorted(fewer, 1 / once_in))


def tries(chance: float, once_in: float = ONCE_IN * len(RIGHT)) -> int:
    """Data sets of which one right answer can be asked for."""
    return next(n for n in itertools.count(1) if needed(chance, n, once_in))


def blank(n: int = 24, waveforms: tuple[str, str] = ("sine", "square")) -> Experiment:
    """Conditions of three groups: a sweep of frequency by each of two waveforms, and one of amplitude by the first."""
    conditions = (
        (waveforms[0], np.round(np.geomspace(100, 2e4, n)), np.full(n, 20.0)),
        (waveforms[1], np.round(np.geomspace(50, 2e4, n)), np.full(n, 15.0)),
        (waveforms[0], np.full(n, 1500.0), np.round(np.linspace(2, 20, n), 2)),
    )
    groups = tuple(
        Group(k, waveform, f"group{k}.csv", f, v, np.zeros(n))  # type: ignore[arg-type]
        for k, (waveform, f, v) in enumerate(conditions, 1)
    )
    return Experiment("Blank", "drawn", RIG, groups, Path(), fingerprint(RIG, groups))


@dataclass(frozen=True)
class Asked:
    """What a diagnosis answers to: readings a group, the causes it may choose from, and how far it looks.

    And what is hidden: by which waveforms it shows, how strong a single cause is and what of it an oracle must see.
    """

    readings: int
    causes: Sequence[str] | None
    search: SearchSettings = field(default_factory=SearchSettings)
    waveforms: tuple[str, str] = ("sine", "square")
    strength: float = ASKED
    seen: float = SEEN


def hide(kind: str, causes: Sequence[str], rng: np.random.Generator, folder: Path, how: Asked) -> Hidden:
    """Hide something that the oracle sees well: rigs on which it does not are passed over."""
    design = blank(how.readings, how.waveforms)
    for k in range(_TRIES):
        seed = int(rng.integers(2**31))
        place = folder / str(k)
        if kind in ("nothing", "outside"):
            effect = UNIT_ERROR if kind == "outside" else None
            made = make(seed, place, design_of=design, kind=None if effect else "nothing", outside=effect)
        else:
            asked = how.strength if kind == "one" else ASKED_OF_EACH
            made = make(seed, place, design_of=design, terms=causes, strength=asked)
        oracle = consult(made.experiment, made.answer, seed=1, starts=12)  # enough to see 40 nats or more
        if kind == "nothing" or (oracle.gain >= how.seen and min(oracle.without.values(), default=SEEN) >= SEEN_EACH):
            return Hidden(made, oracle, seed)
    raise AssertionError(f"{kind} {causes}: nothing that an oracle sees, in {_TRIES} tries")


def is_right(answer: Answer, diagnosis: dict[str, Any]) -> bool:
    """Whether a verdict does what it must.

    A cause or a pair lies within one member of the reported set; an outside effect is unexplained, or the misfit points
    at the group in which it acts.
    """
    verdict = diagnosis["verdict"]
    if answer.kind == "nothing":
        return bool(verdict == "adequate")
    if answer.kind == "outside":
        return bool(verdict == "unexplained" or (verdict != "adequate" and located(diagnosis, answer.places)))
    truth = frozenset(answer.terms)
    members = reported_set(diagnosis)
    if len(members) > MOST_MEMBERS:
        return False
    inside = truth in members if answer.kind == "one" else any(truth <= member for member in members)
    # Strengths are chosen by what they gain, and may be implausible.
    return inside and (verdict in ("explained", "ambiguous") or diagnosis.get("unexplained_by") == "values")


def answer_to(hidden: Hidden, folder: Path, asked: Asked) -> dict[str, Any]:
    """What a diagnosis says that reads the folder as anybody would."""
    experiment = read_experiment(hidden.made.folder / EXPERIMENT)
    catalogue = None if asked.causes is None else terms(asked.causes)
    settings = replace(Settings.usual(quick=True), simulated=99, search=asked.search)
    diagnose(experiment, experiment.ids, folder, quick=True, seed=hidden.seed, catalogue=catalogue, settings=settings)
    return read_diagnosis(folder / "diagnosis.json")


# Nothing that is hidden has more than two causes; what more of them add is not asked for.
FAST, SLOW = Asked(12, FEW), Asked(24, None, SearchSettings(most_causes=2))


def hide_one(
    kind: str, rng: np.random.Generator, folder: Path, asked: Asked, singles: Sequence[str] = SINGLES
) -> Hidden:
    """A data set of a kind of `RIGHT`."""
    hidden = {"one": [str(rng.choice(singles))], "two": list(PAIR)}.get(kind, [])
    return hide(kind, hidden, rng, folder, asked)


def missed_kinds(
    asked: Asked,
    kinds: Iterable[str],
    seed: int,
    folder: Path,
    singles: Sequence[str] = SINGLES,
    once_in: float = ONCE_IN * len(RIGHT),
) -> tuple[list[str], str]:
    """Kinds of which too few data sets are answered rightly, and a line for each data set.

    Of a kind a sound diagnosis misses all once in `once_in`.
    """
    rng = np.random.default_rng(seed)
    lines, missed = [], []
    for kind in kinds:
        for n in range(tries(RIGHT[kind], once_in)):
            hidden = hide_one(kind, rng, folder / f"{kind}-{n}", asked, singles)
            begun = time.monotonic()
            said = answer_to(hidden, folder / f"{kind}-{n}-diagnosis", asked)
            answer, right = hidden.made.answer, is_right(hidden.made.answer, said)
            truth = answer.outside or " + ".join(answer.terms) or "nothing"
            lines.append(
                f"{'right' if right else 'WRONG'}: {truth} (seed {hidden.seed}, {hidden.oracle.gain:.0f} nats): "
                f"{said['verdict']} {said['named']}, alternatives {said['alternatives'][:4]}, "
                f"p {said['misfit'].get('p_value')}, {time.monotonic() - begun:.0f} s"
            )
            if right:
                break
        else:
            missed.append(kind)
    return missed, "\n".join([f"{SEED}={seed}: missed {missed or 'no kind'}", *lines])


def test_the_rule_allows_what_chance_does() -> None:
    """Five fair coins show no head once in 32 throws, and one at most in 6 of 32."""
    assert tries(0.5, 31) == 5 and tries(0.5, 33) == 6
    assert needed(0.5, 5, 31) == 1 and needed(0.5, 5, 33) == 0 and needed(0.5, 5, 5) == 2
    assert sum((1 - p) ** tries(p) for p in RIGHT.values()) < 1 / ONCE_IN


def test_a_stubborn_diagnosis_can_do_one_kind() -> None:
    """One that always finds the baseline adequate, or always something without a name, misses all other kinds."""
    hidden = {"nothing": [], "one": ["gap"], "two": ["gap", "preload"], "outside": []}
    for verdict in ("adequate", "unexplained"):
        printed = {"verdict": verdict, "named": [], "alternatives": [], "causes": [], "misfit": {}}
        answers = [
            Answer("0", 1, kind, causes, {}, {}, None, {}, True, {}, None, "", [], "given", 0, [], "")  # type: ignore[arg-type]
            for kind, causes in hidden.items()
        ]
        assert sum(is_right(answer, printed) for answer in answers) == 1
    # Nor is it an answer to name everything that there is.
    printed = {
        "verdict": "ambiguous",
        "named": ["gap"],
        "alternatives": [[t.id] for t in TERMS],
        "causes": [],
        "misfit": {},
    }
    assert not any(is_right(answer, printed) for answer in answers)


# Parts of a diagnosis, and the kind that cannot be done without each. (What has no name is seen by three: the tests
# with what they say of tails and coincidences, the discrepancy, and values that nobody expects of what imitates it.)
PARTS = {
    "what has no name": "outside",
    "single causes": "one",
    "combinations": "two",
    "the price of a cause": "nothing",
}

PAID = 30.0  # nats a cause: more than one costs that does nothing


def without(part: str, patch: pytest.MonkeyPatch) -> None:
    """Take a part away."""
    if part == "what has no name":
        silent = {"p_value": 1.0, "places": (), "coincidences": (), "usual_tails": None}
        patch.setattr(judging, "examine", lambda *a, **k: replace(examine(*a, **k), **silent))

        def nothing(model: Candidate, outlying: Any = None) -> Discrepancy:
            found = discrepancy(model, outlying)
            return replace(found, log_bayes=-50.0, log_evidence=found.log_evidence - found.log_bayes - 50.0)

        patch.setattr(judging, "discrepancy", nothing)
        patch.setattr(Problem, "implausible", lambda *a: [])
    else:
        priced = model_set.log_prior
        odds = {
            "single causes": lambda ids, beliefs: -1e6 if len(ids) == 1 else priced(ids, beliefs),
            "combinations": lambda ids, beliefs: -1e6 if len(ids) > 1 else priced(ids, beliefs),
            # Causes are paid for, not only free: of few, none need gain anything by luck.
            "the price of a cause": lambda ids, beliefs: PAID * len(ids),
        }
        for module in (model_set, model_search):
            patch.setattr(module, "log_prior", odds[part])


@pytest.mark.slow
def test_a_broken_diagnosis_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a part of it the test below misses a kind, with any seeds that it may draw.

    One or two data sets show that, of which a sound diagnosis is right about one in nine of ten runs: part and seeds
    are fresh, and a part that only helps sometimes is found out in some run.
    """
    seed = drawn_seed()
    part = drawn(PARTS, seed)
    without(part, monkeypatch)
    asked = FAST
    if part in ("single causes", "the price of a cause"):
        # Nor is a set whose further cause does not show counted with the set without it.
        monkeypatch.setattr(model_set, "shown", lambda share, mass, effects: dict(share))
        asked = replace(FAST, search=SearchSettings(visible=-PAID))
    missed, report = missed_kinds(asked, [PARTS[part]], seed, tmp_path, once_in=10)
    print(report)
    assert missed == [PARTS[part]], f"without {part}: {report}"


def test_hidden_effects_are_found(tmp_path: Path) -> None:
    """Something of the catalogue, and something that must not be called so."""
    seed = drawn_seed()
    kinds = [drawn(("one", "two"), seed), drawn(("nothing", "outside"), seed)]
    missed, report = missed_kinds(FAST, kinds, seed, tmp_path)
    print(report)
    assert not missed, report


@pytest.mark.slow
def test_hidden_effects_are_found_among_the_whole_catalogue(tmp_path: Path) -> None:
    seed = drawn_seed()
    missed, report = missed_kinds(SLOW, [drawn(RIGHT, seed)], seed, tmp_path)
    print(report)
    assert not missed, report


# What few think of when they describe a rig: hidden by some 30 nats, as weak as a diagnosis must still see.
OVERLOOKED = ("amplitude_scale", "idle_level", "session_lean", "frame_compliance")
WEAK = Asked(24, (*FEW, *OVERLOOKED), strength=35.0, seen=25.0)


@pytest.mark.slow
def test_what_few_think_of_is_found(tmp_path: Path) -> None:
    seed = drawn_seed()
    missed, report = missed_kinds(WEAK, ["one"], seed, tmp_path, [drawn(OVERLOOKED, seed)])
    print(report)
    assert not missed, report


@pytest.mark.slow
def test_hidden_effects_of_a_stack_driven_from_0_v_are_found(tmp_path: Path) -> None:
    unipolar = replace(WEAK, waveforms=("unipolar_sine", "unipolar_square"))
    seed = drawn_seed()
    missed, report = missed_kinds(unipolar, [drawn(("nothing", "one"), seed)], seed, tmp_path)
    print(report)
    assert not missed, report


def drawn_seed() -> int:
    """The seed that the environment names for a replay, or a fresh one."""
    return int(os.environ.get(SEED) or int.from_bytes(os.urandom(4), "little"))


def drawn(names: Iterable[str], seed: int) -> str:
    """The one of some names that a seed draws."""
    return str(np.random.default_rng([seed, 1]).choice(list(names)))
