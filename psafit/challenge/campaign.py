"""Many challenges: a plan, and its results, one file a data set.

A data set is made, diagnosed and put before the oracle in a temporary folder; what is kept is its `Result`, written in
one step. Whatever has a result is not run again, so that an interrupted campaign goes on where it stopped. Results do
not depend on the number of workers or on their order.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

import psafit
from psafit.challenge import Sizes
from psafit.challenge.answer import EXPERIMENT, Answer, Conditions, Kind, unseal
from psafit.challenge.hide import Outside, make
from psafit.challenge.oracle import Oracle, consult
from psafit.diagnose import diagnose as examine
from psafit.diagnose.record import RESULT
from psafit.errors import InputError, PsafitError
from psafit.experiment import Experiment, read_experiment
from psafit.files import digest, locked, remove_temporaries
from psafit.physics import TERMS, plugin_versions
from psafit.records import plain, read_content, read_json, write_json
from psafit.workers import processes, reach, scratch, unordered

Diagnose = Callable[..., object]
"""``diagnose(experiment, group_ids, folder, quick=True, seed=seed)`` writes `diagnosis.json` into `folder`."""

CAMPAIGN, RESULTS = "campaign.json", "results"
LEVELS: Mapping[str, float] = {"weak": 10.0, "medium": 30.0, "strong": 100.0}
"""Oracle gains asked for, nats."""

PRIOR = "prior"
"""Level of truths that are drawn as the diagnosis believes them to be: only of these can its probabilities be right."""

SEEN_NATS = 25.0
"""An oracle gain from which a miss counts, and rivals are looked for."""

_KEPT = ("verdict", "unexplained_by", "named", "alternatives", "causes", "misfit")
_AGAIN = "move it elsewhere, and run the campaign again"


@dataclass(frozen=True)
class Spec:
    """One data set of a campaign.

    Parameters
    ----------
    id : str
        Name of its result file.
    seed : int
    kind : {"nothing", "one", "two", "outside"}
    terms : list of str
    outside : str, optional
        Name of the effect outside the catalogue.
    level : str
        "weak", "medium", "strong"; "prior" where number (up to two) and strength of the causes, and the scatter, are
        drawn from the diagnosis's own priors; else empty.
    nats : float, optional
        Oracle gain asked of each cause alone.
    design : {"given", "drawn"}
    """

    id: str
    seed: int
    kind: Kind
    terms: list[str]
    outside: str | None
    level: str
    nats: float | None
    design: Conditions


@dataclass(frozen=True)
class Result:
    """`results/<id>.json`: truth, oracle and verdict of one data set.

    Parameters
    ----------
    spec : Spec
    version : str
        Of psafit.
    status : {"done", "failed"}
        A failed one has no diagnosis, counts as a miss and is tried again.
    message : str
        Why it failed.
    answer : Answer
    oracle : Oracle
    diagnosis : dict
        ``verdict``, ``named``, ``alternatives``, ``causes`` and ``misfit`` of `diagnosis.json`.
    seconds : dict
        Wall time of ``make``, ``oracle`` and ``diagnose``.
    """

    spec: Spec
    version: str
    status: Literal["done", "failed"]
    message: str
    answer: Answer
    oracle: Oracle
    diagnosis: dict[str, Any]
    seconds: dict[str, float]


@dataclass(frozen=True)
class Campaign:
    """`campaign.json`: what is run.

    Parameters
    ----------
    version : str
        Of psafit.
    command : str
    design : str
        Fingerprint of the experiment whose conditions are simulated.
    specs : list of Spec
    plugins : dict
        Own causes among the candidates, by identifier: which file each was.
    """

    version: str
    command: str
    design: str
    specs: list[Spec]
    plugins: dict[str, str] = field(default_factory=dict)


def plan(
    seed: int,
    *,
    outside: Sequence[str] = (),
    terms: Sequence[str] | None = None,
    each: int = Sizes.each,
    nothing: int = Sizes.nothing,
    pairs: int = Sizes.pairs,
    drawn: int = Sizes.drawn,
    outside_each: int = 3,
    pair_nats: float = 60.0,
    designs: int = Sizes.designs,
) -> list[Spec]:
    """List the data sets of a campaign: every cause at three strengths, pairs, outside effects, nothing, and draws.

    Parameters
    ----------
    seed : int
        Two campaigns of different seeds have no data set in common.
    outside : sequence of str
        Names of effects outside the catalogue.
    terms : sequence of str, optional
        The causes; the whole catalogue by default.
    each : int
        Data sets of every cause and strength.
    nothing, pairs : int
        Data sets with nothing hidden, and with two causes.
    drawn : int
        Data sets with nothing, one or two causes, as often as the diagnosis expects them, strengths drawn from their
        priors.
    outside_each : int
        Data sets of every outside effect.
    pair_nats : float
        Oracle gain asked of each cause of a pair alone.
    designs : int
        One in so many data sets has a drawn design: see `psafit.challenge.conditions`. With 0 none has.

    Returns
    -------
    list of Spec
        In an order that mixes the kinds, so that a campaign cut short is a fair part of the whole.
    """
    ids = [t.id for t in TERMS] if terms is None else list(terms)
    rng = np.random.default_rng([seed, 10])
    wanted: list[tuple[Kind, list[str], str | None, str, float | None]] = []
    for _ in range(each):
        wanted += [("one", [i], None, level, nats) for i in ids for level, nats in LEVELS.items()]
    wanted += [("nothing", [], None, "", None)] * nothing
    for _ in range(pairs if len(ids) > 1 else 0):
        both = sorted(int(i) for i in rng.choice(len(ids), size=2, replace=False))
        wanted.append(("two", [ids[i] for i in both], None, "", pair_nats))
    wanted += [("outside", [], name, "", None) for name in outside for _ in range(outside_each)]
    kinds: tuple[Kind, ...] = ("nothing", "one", "two")
    believed = np.array([t.probability for t in TERMS if t.id in ids])
    for _ in range(drawn):
        # As a diagnosis believes, of sets of at most two: the odds of what is expected of every rig are those of a set.
        while (chosen := np.flatnonzero(rng.random(len(ids)) < believed)).size >= len(kinds):
            pass
        # Of a part of the catalogue, truths are not what a diagnosis believes, which looks for all of it.
        wanted.append((kinds[chosen.size], [ids[i] for i in chosen], None, PRIOR if terms is None else "", None))
    # Seeds before the shuffle: the same data set whatever else is planned of its kind later in the list.
    seeds = [int(np.random.default_rng([seed, 11, k]).integers(2**32)) for k in range(len(wanted))]
    specs = []
    for k, ((kind, causes, effect, level, nats), own) in enumerate(zip(wanted, seeds, strict=True)):
        label = "-".join([*(causes or [effect or "nothing"]), *([level] if level else [])])
        design: Conditions = "drawn" if designs and own % designs == 0 else "given"
        specs.append(Spec(f"{k:04d}-{label}", own, kind, causes, effect, level, nats, design))
    return [specs[int(i)] for i in rng.permutation(len(specs))]


def solve(
    spec: Spec,
    design_of: Experiment,
    diagnose: Diagnose = examine,
    outside: Sequence[Outside] = (),
) -> Result:
    """Make one data set, diagnose it, and ask the oracle.

    Parameters
    ----------
    spec : Spec
    design_of : Experiment
        Whose conditions are simulated, unless the design is drawn.
    diagnose : callable
        See `Diagnose`.
    outside : sequence of Outside
        The effects that specs name.

    Returns
    -------
    Result
        Failed where the diagnosis says so on purpose (`PsafitError`) or breaks its contract; anything else it raises
        is a bug, and goes on.
    """
    effects = {effect.name: effect for effect in outside}
    if spec.outside is not None and spec.outside not in effects:
        raise InputError(f"{spec.id}: no outside effect {spec.outside}", "pass it to the campaign")
    with scratch() as folder:
        begun = time.monotonic()
        made = make(
            spec.seed,
            folder,
            design_of=design_of if spec.design == "given" else None,
            kind=spec.kind,
            terms=None if spec.outside else spec.terms,
            outside=effects[spec.outside] if spec.outside else None,
            strength=spec.nats,
            believed=spec.level == PRIOR,
        )
        seconds = {"make": time.monotonic() - begun}
        # As anybody would read it: nothing reaches the diagnosis but the folder.
        experiment = read_experiment(folder / EXPERIMENT)
        begun = time.monotonic()
        status: Literal["done", "failed"] = "done"
        message = ""
        diagnosis: dict[str, Any] = {}
        try:
            diagnose(experiment, experiment.ids, folder / "diagnosis", quick=True, seed=spec.seed % 2**31)
            diagnosis = read_diagnosis(folder / "diagnosis" / RESULT)
        except PsafitError as error:
            status, message = "failed", str(error).replace(str(folder), "")
        seconds["diagnose"] = time.monotonic() - begun
    oracle = consult(experiment, made.answer, seed=1, rivals_from=SEEN_NATS)
    seconds["oracle"] = oracle.seconds
    return Result(spec, psafit.__version__, status, message, made.answer, oracle, diagnosis, seconds)


def read_diagnosis(file: Path, fingerprint: str | None = None) -> dict[str, Any]:
    """Read what the score needs of a `diagnosis.json`, and check that it keeps the contract.

    With a fingerprint it must be of those readings, if it says of which it is: other programs' diagnoses need not.

    Raises
    ------
    InputError
        If it is missing, damaged, or lacks a key.
    """
    remedy = "run psafit diagnose again"
    content = _checked(read_content(file, remedy=remedy), file, remedy)
    if fingerprint and content.get("fingerprint", fingerprint) != fingerprint:
        raise InputError("is of other readings than the challenge's", "diagnose FOLDER/experiment", file=file)
    return {key: content.get(key, {}) for key in _KEPT}


def _checked(content: Any, file: Path, remedy: str) -> dict[str, Any]:
    """A diagnosis, if it keeps the contract."""
    verdicts = ("adequate", "explained", "ambiguous", "unexplained")
    lists = ("named", "alternatives", "causes")
    if (
        not isinstance(content, dict)
        or content.get("verdict") not in verdicts
        or not all(isinstance(content.get(key), list) for key in lists)
        or not all(isinstance(cause, dict) and _measured(cause.get("parameters")) for cause in content["causes"])
        or not all(map(_names, [content["named"], *content["alternatives"]]))
        or not all(_names(cause.get("terms")) for cause in content["causes"])
        or not all(_is_number(cause.get("probability") or 0.0) for cause in content["causes"])
        or not isinstance(content.get("misfit", {}), dict)
        or not _pointed(content.get("misfit", {}).get("where") or [])
    ):
        raise InputError("is no diagnosis of schema 1", remedy, file=file)
    return content


def _names(ids: object) -> bool:
    return isinstance(ids, list) and all(isinstance(id, str) and id.isprintable() for id in ids)


def _measured(parameters: object) -> bool:
    """Whether the parameters of a record, if it has any, are numbers; None stands for one that is not finite."""
    if parameters is None:
        return True
    if not isinstance(parameters, dict):
        return False
    numbers = [p.get(k) for p in parameters.values() if isinstance(p, dict) for k in ("median", "lower", "upper")]
    return all(x is None or _is_number(x) for x in numbers)


def _pointed(places: object) -> bool:
    """Whether places of a misfit are such; None stands for an open end."""
    ends = ("from", "to")
    return isinstance(places, list) and all(
        isinstance(place, dict) and all(place.get(end) is None or _is_number(place[end]) for end in ends)
        for place in places
    )


def _is_number(x: object) -> bool:
    """Whether it is one that a float can hold: JSON's integers have no end."""
    return isinstance(x, int | float) and abs(x) <= sys.float_info.max


def run(
    specs: Sequence[Spec],
    folder: Path,
    *,
    design_of: Experiment,
    diagnose: Diagnose = examine,
    outside: Sequence[Outside] = (),
    jobs: int = 2,
    scheduler: str | None = None,
    limit: int | None = None,
    kinds: Collection[Kind] = (),
    command: str = "",
    progress: Callable[[int, int, str], None] = lambda done, total, note: None,
) -> list[Result]:
    """Run what has no result yet.

    Parameters
    ----------
    specs : sequence of Spec
    folder : Path
        Receives `campaign.json` and `results/`.
    design_of : Experiment
    diagnose : callable
        See `Diagnose`.
    outside : sequence of Outside
    jobs : int
        Processes of this machine.
    scheduler : str, optional
        Address of a Dask scheduler that shares the work out instead (extra ``psafit[cluster]``).
    limit : int, optional
        Run no more than the first so many of the plan; a later run goes on with the others.
    kinds : collection of str
        Run those of these kinds alone; all by default.
    command : str
        Kept in `campaign.json`.
    progress : callable
        Called with (data sets done, data sets in all, name of the last).

    Returns
    -------
    list of Result
        Of all specs that have one, in their order.

    Raises
    ------
    InputError
        If the folder holds another campaign, a result is damaged, or Dask is asked for and not there.
    """
    if scheduler is not None:
        reach(scheduler)
    campaign = Campaign(psafit.__version__, command, design_of.fingerprint, list(specs), plugin_versions())
    with locked(folder):
        _claim(folder, campaign)
        results = folder / RESULTS
        results.mkdir(parents=True, exist_ok=True)
        remove_temporaries(results)
        wanted = [spec for spec in specs if not kinds or spec.kind in kinds][:limit]
        done = {spec.id: found for spec in wanted if (found := _read(folder, spec)) and found.status == "done"}
        left = [spec for spec in wanted if spec.id not in done]
        progress(len(done), len(wanted), "")
        if left:
            with processes(jobs, scheduler) as usable:
                calls = ((spec, design_of, diagnose, tuple(outside)) for spec in left)
                for result in unordered(usable, solve, calls):
                    write_json(results / f"{result.spec.id}.json", result, sealed=True)
                    done[result.spec.id] = result
                    progress(len(done), len(wanted), result.spec.id)
    # Read back, so that a fresh result and one of an earlier run are the same to the last digit.
    return load(folder)[1]


def judge(folder: Path, diagnosis: Path) -> Result:
    """Put one diagnosis of a challenge next to the sealed answer.

    Parameters
    ----------
    folder : Path
        Of `psafit challenge make`.
    diagnosis : Path
        `diagnosis.json`.

    Returns
    -------
    Result
        Its time of diagnosis is NaN.

    Raises
    ------
    InputError
        If the answer is not the one committed to, or a file cannot be used.
    """
    experiment, answer = unseal(folder)
    found = read_diagnosis(diagnosis, answer.fingerprint)
    oracle = consult(experiment, answer, seed=1, rivals_from=SEEN_NATS)
    spec = Spec(
        "challenge", answer.seed, answer.kind, answer.terms, answer.outside, "", answer.asked_nats, answer.design
    )
    return Result(spec, psafit.__version__, "done", "", answer, oracle, found, {"diagnose": math.nan})


def load(folder: Path) -> tuple[Campaign, list[Result]]:
    """Read a campaign and the results it has so far, in the order of its plan."""
    campaign = read_json(folder / CAMPAIGN, Campaign, remedy="give the folder of psafit challenge run")
    return campaign, [result for spec in campaign.specs if (result := _read(folder, spec))]


def content_hash(result: Result) -> str:
    """SHA-256 of everything in a result but wall times: equal wherever and with whatever it was computed."""
    content = plain(result)
    del content["seconds"], content["oracle"]["seconds"]
    return digest(content)


def _read(folder: Path, spec: Spec) -> Result | None:
    file = folder / RESULTS / f"{spec.id}.json"
    if not file.exists():
        return None
    result = read_json(file, Result, sealed=True, remedy=_AGAIN)
    if plain(result.spec) != plain(spec):
        raise InputError("is of another data set than the campaign plans", _AGAIN, file=file)
    return result


def _claim(folder: Path, campaign: Campaign) -> None:
    """Write the plan, or see that the one which is there is the same."""
    file = folder / CAMPAIGN
    if file.exists():
        there = read_json(file, Campaign, remedy="choose another folder")
        mine, theirs = plain(campaign), plain(there)
        for key in ("version", "design", "specs", "plugins"):
            if mine[key] != theirs[key]:
                raise InputError(
                    f"plans another campaign (its {key} differ)", "choose another folder with --out", file=file
                )
        return
    write_json(file, campaign)
