"""The data sets of the yardstick of the search (`benchmarks/search.py`): their readings, and what is hidden in them.

Readings are kept in `search_sets.jsonl`, one data set a line, so that two versions of the search see the same. Cases
stand in that file alone. All else is made from its seed when it is first asked for, by the literal reference.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from outside import OUTSIDE

import psafit
from psafit.challenge.answer import Answer
from psafit.challenge.campaign import PRIOR, Spec, plan
from psafit.challenge.conditions import ConditionSettings
from psafit.challenge.hide import make, simulate_literally
from psafit.challenge.oracle import Oracle, consult, truth_of
from psafit.challenge.strength import enough
from psafit.experiment import Constants, Experiment, Group, Occasions, fingerprint, read_experiment, session_name
from psafit.files import write_atomically
from psafit.inference.candidate import fit
from psafit.inference.problem import Problem
from psafit.parameters import Parameter
from psafit.physics import TERMS, Term, baseline, terms
from psafit.simulate import MICRO, Design, simulate

FILE = ROOT / "benchmarks" / "search_sets.jsonl"
STUDY = ROOT / "experiments" / "psa"
GROUPS = ("cases", "pairs", "limits", "study", "campaign")


@dataclass(frozen=True, eq=False)
class DataSet:
    """Readings, and what is hidden in them.

    Parameters
    ----------
    id : str
    group : {"cases", "pairs", "limits", "study", "campaign"}
    truth : tuple of str, optional
        The causes at work, in the registry's order; None where they are not known or outside the catalogue.
    about : str
        Where it comes from.
    experiment : Experiment
    most : int
        Causes up to which a search must look: four, as the quick search of version 0.1.0 did, or six.
    parameters : dict
        True values, as far as they are known.
    gain : float, optional
        Of the truth over the baseline in log likelihood, nats, both fitted (`psafit.challenge.oracle`).
    without : dict
        Of the truth over the truth without each cause, nats.
    """

    id: str
    group: str
    truth: tuple[str, ...] | None
    about: str
    experiment: Experiment
    most: int = 4
    parameters: Mapping[str, float] = field(default_factory=dict)
    gain: float | None = None
    without: Mapping[str, float] = field(default_factory=dict)


# The catalogue when the yardstick was frozen: a cause that came later must not change what is drawn.
_LATER = ("amplitude_scale", "idle_level", "session_lean", "frame_compliance")
CATALOGUE = [t.id for t in TERMS if t.id not in _LATER]


# --- the file -------------------------------------------------------------------------------------------------------


def to_line(data: DataSet) -> str:
    """Format a data set as one line of JSON."""
    groups = [
        {
            "id": g.id,
            "waveform": g.waveform,
            "frequency_hz": g.frequency_hz.tolist(),
            "amplitude_v": g.amplitude_v.tolist(),
            "launch_range_um": g.reading.tolist(),
        }
        for g in data.experiment.groups
    ]
    own = {name: getattr(data, name) for name in ("id", "group", "truth", "about", "most", "gain")}
    own |= {"without": dict(data.without), "parameters": dict(data.parameters)}
    return json.dumps({**own, "constants": asdict(data.experiment.constants), "groups": groups}, allow_nan=False)


def from_line(line: str) -> DataSet:
    """Read what `to_line` wrote."""
    kept: dict[str, Any] = json.loads(line)
    groups = tuple(
        Group(
            g["id"], g["waveform"], f"group{k}.csv",
            np.array(g["frequency_hz"]), np.array(g["amplitude_v"]), reading=np.array(g["launch_range_um"]),
        )
        for k, g in enumerate(kept.pop("groups"), 1)
    )  # fmt: skip
    truth = kept.pop("truth")
    experiment = _experiment(Constants(**kept.pop("constants")), groups)
    return DataSet(truth=None if truth is None else tuple(truth), experiment=experiment, **kept)


def stored(file: Path = FILE) -> dict[str, DataSet]:
    """Data sets of a file, by id; none if there is no file."""
    lines = file.read_text("utf-8").splitlines() if file.exists() else []
    return {data.id: data for data in map(from_line, lines)}


def store(data: DataSet, file: Path = FILE) -> None:
    """Add a data set to a file, in the place of one of the same id."""
    kept = {**stored(file), data.id: data}
    order = {id: k for k, id in enumerate(makers())}
    lines = [to_line(kept[id]) for id in sorted(kept, key=lambda id: (order.get(id, -1), id))]
    write_atomically(file, "".join(f"{line}\n" for line in lines).encode())


def _experiment(constants: Constants, groups: tuple[Group, ...]) -> Experiment:
    return Experiment("Yardstick", "simulated", constants, groups, Path(), fingerprint(constants, groups))


# --- what there is --------------------------------------------------------------------------------------------------


def makers() -> dict[str, Callable[[], DataSet]]:
    """How each data set is made, by id; cases are stored, not made, and are not here."""
    return {**_pairs(), **_limits(), **_study(), **_campaign()}


def wanted(groups: Sequence[str]) -> list[str]:
    """Ids of the data sets of some groups, group after group."""
    of = {"cases": sorted(id for id, data in stored().items() if data.group == "cases")}
    # What is stored of a campaign was planned with the catalogue of then.
    planned = sorted(id for id, data in stored().items() if data.group == "campaign")
    of |= {"pairs": [*_pairs()], "limits": [*_limits()], "study": [*_study()]}
    of |= {"campaign": [*dict.fromkeys([*planned, *_campaign()])]}
    return [id for group in groups for id in of[group]]


def get(id: str, file: Path = FILE) -> DataSet:
    """A data set from the file; made, and added to it, if it is not there. Those of the study are in their folder."""
    study = _study()
    if id in study:
        return study[id]()
    kept = stored(file)
    if id not in kept:
        store(makers()[id](), file)
        kept = stored(file)  # as the next run will read it
    return kept[id]


def _study() -> dict[str, Callable[[], DataSet]]:
    """The study: nobody knows what is at work there."""

    def part(name: str, groups: Sequence[int], most: int) -> DataSet:
        whole = read_experiment(STUDY)
        chosen = _experiment(whole.constants, whole.select(groups))
        return DataSet(name, "study", None, f"experiments/psa, groups {', '.join(map(str, groups))}", chosen, most)

    parts: dict[str, tuple[Sequence[int], int]] = {
        "study-quick": ((1, 2, 3, 4, 5, 6), 4),
        "study": ((1, 2, 3, 4, 5, 6), 6),
        "study-without-5": ((1, 2, 3, 4, 6), 6),
        "study-group-1": ((1,), 6),
    }
    return {name: partial(part, name, *of) for name, of in parts.items()}


def _campaign(seed: int = 101, n: int = 40) -> dict[str, Callable[[], DataSet]]:
    """The first of a campaign's plan, which mixes nothing, one cause, two, and effects outside the catalogue."""
    specs = plan(seed, outside=[effect.name for effect in OUTSIDE], terms=CATALOGUE, designs=4, nothing=40)[:n]
    return {f"campaign-{s.id}": partial(_of_spec, f"campaign-{s.id}", "campaign", s, seed) for s in specs}


def _limits() -> dict[str, Callable[[], DataSet]]:
    """What docs/limits.md and docs/challenge.md name as missed, or as found since, and whose seed is known.

    Campaigns before that of seed 32 were planned with 23 causes, that with 24. What they drew from the priors of then
    is not made any more.
    """
    then = [id for id in CATALOGUE if id != "anchored_stroke"]
    earlier = [id for id in then if id != "sliding_support"]
    effects = [effect.name for effect in OUTSIDE]
    named = {
        3: ("0119-adhesion-repeat_impacts", "0111-hysteresis-stroke_tolerance"),
        5: ("0129-hysteresis-stroke_tolerance",),
        6: ("0121-amplifier_lag-adhesion", "0117-amplifier_lag-adhesion", "0125-stack_stiffness-soft_layer",
            "0128-stack_stiffness-hertz_exponent"),
        9: ("0019-modal_mass-medium",),
        25: ("0055-flight_friction-medium",),
        32: ("0005-slew_limit-strong", "0137-frame_resonance", "0138-frame_resonance"),
    }  # fmt: skip
    found: dict[str, Callable[[], DataSet]] = {"seed11-two-40": _seed_11}
    for seed, ids in named.items():
        specs = {
            s.id: s for s in plan(seed, outside=effects, terms=then if seed >= 32 else earlier, designs=4, nothing=40)
        }
        for id in ids:
            found[f"seed{seed}-{id}"] = partial(_of_spec, f"seed{seed}-{id}", "limits", specs[id], seed)
    return found


def _seed_11() -> DataSet:
    about = "psafit challenge make --seed 11 --kind two --strength 40"
    with tempfile.TemporaryDirectory() as folder:
        made = make(11, Path(folder) / "made", design_of=read_experiment(STUDY), kind="two", strength=40.0)
    return _of_answer("seed11-two-40", "limits", about, made.experiment, made.answer)


def _of_spec(id: str, group: str, spec: Spec, seed: int) -> DataSet:
    """A data set of a campaign."""
    effect = next((e for e in OUTSIDE if e.name == spec.outside), None)
    with tempfile.TemporaryDirectory() as folder:
        made = make(
            spec.seed,
            Path(folder) / "made",
            design_of=read_experiment(STUDY) if spec.design == "given" else None,
            kind=spec.kind,
            terms=None if effect else spec.terms,
            outside=effect,
            strength=spec.nats,
            believed=spec.level == PRIOR,
            conditions=ConditionSettings.like_the_study(),
        )
    return _of_answer(id, group, f"campaign of seed {seed}, data set {spec.id}", made.experiment, made.answer)


def _of_answer(id: str, group: str, about: str, experiment: Experiment, answer: Answer) -> DataSet:
    truth = None if answer.outside else tuple(answer.terms)
    what = about + (f": {answer.where}" if answer.where else "")
    return DataSet(id, group, truth, what, experiment, parameters=_parameters(answer))


def _parameters(answer: Answer) -> dict[str, float]:
    return {**answer.parameters, **{name: value for name, value in answer.scatter.items() if value is not None}}


# --- pairs and triples ----------------------------------------------------------------------------------------------


def dealt(seed: int, sizes: Sequence[int]) -> list[tuple[str, ...]]:
    """Sets of causes of these sizes: the catalogue is shuffled and dealt out, again and again, so that all occur.

    Causes of one set differ.
    """
    rng = np.random.default_rng([seed, 1])

    def cards() -> Iterator[str]:
        while True:
            yield from (CATALOGUE[int(i)] for i in rng.permutation(len(CATALOGUE)))

    deck, hands = cards(), []
    for size in sizes:
        hand: set[str] = set()
        while len(hand) < size:
            hand.add(next(deck))
        hands.append(tuple(t.id for t in TERMS if t.id in hand))
    return hands


@dataclass(frozen=True)
class Truth:
    """A true model: its causes, the values of all its parameters, and the scatter's."""

    causes: tuple[Term, ...]
    values: dict[str, float]
    scatter: dict[str, float | None]


def drawn_truth(rng: np.random.Generator, ids: Sequence[str], sessions: Sequence[Any]) -> Truth:
    """Draw a true model from the priors, with normal scatter of about 5 % and 0.05 um."""

    def from_prior(p: Parameter) -> float:
        return float(p.to_physical(p.prior_quantile(rng.uniform())))

    causes = terms(ids)
    values = {p.name: from_prior(p) for p in (*baseline.PARAMETERS, *(p for t in causes for p in t.parameters))}
    for t in causes:
        if t.latent:
            values |= {session_name(t.latent.name, g): from_prior(t.latent) for g in sessions}
    sizes = 0.05 * np.exp(rng.standard_normal(2) * np.log([1.25, 1.5]))
    return Truth(causes, values, {"sigma_rel": float(sizes[0]), "sigma_abs": float(sizes[1]), "nu": None})


def _pairs(seed: int = 1, pairs: int = 20, triples: int = 10) -> dict[str, Callable[[], DataSet]]:
    """Pairs and triples of causes, under the conditions of three rigs in turn."""
    found: dict[str, Callable[[], DataSet]] = {}
    for k, ids in enumerate(dealt(seed, [2] * pairs + [3] * triples)):
        name = f"{'pair' if len(ids) == 2 else 'triple'}-{k:02}"
        found[name] = partial(hidden, name, ids, seed, k)
    return found


def _conditions(k: int) -> Experiment:
    """Conditions of the study, or of a case with another rig and a third of the readings."""
    another = ("gap_and_slew", "narrow_resonance")
    return read_experiment(STUDY) if k % 3 == 0 else get(another[k % 3 - 1]).experiment


def hidden(
    name: str,
    ids: Sequence[str],
    seed: int,
    number: int,
    *,
    least: float = 15.0,
    most: float = 200.0,
    each: float = 8.0,
    patience: int = 40,
) -> DataSet:
    """Hide some causes so that they show: the truth gains `least` to `most` nats, each cause `each` given the others.

    Truths are drawn from the priors until one does. After each `patience` of them the causes are drawn anew.

    Parameters
    ----------
    name : str
    ids : sequence of str
    seed, number : int
        Of the draws.
    least, most, each : float, nats
        Gain in log likelihood, by `psafit.challenge.oracle`.
    patience : int
    """
    conditions = _conditions(number)
    design = Design.of(conditions.constants, conditions.groups)
    attempt = 0
    while True:
        rng = np.random.default_rng([seed, 2, number, attempt])
        if attempt and attempt % patience == 0:
            chosen = rng.choice(len(CATALOGUE), size=len(ids), replace=False)
            ids = [CATALOGUE[i] for i in sorted(chosen)]
        attempt += 1
        truth = drawn_truth(rng, ids, conditions.ids)
        noise = rng.standard_normal(design.n_points)

        def answer_of(true: np.ndarray, truth: Truth = truth) -> Answer:
            # A kind names at most two causes; nothing that is asked here depends on it.
            return Answer(
                psafit.__version__, seed, "two", [t.id for t in truth.causes], truth.values, truth.scatter, None, {},
                True, {}, None, "", [], "given", 0, true.tolist(), "",
            )  # fmt: skip

        quick_um = _simulated(design, truth, conditions)
        if not enough(design, quick_um):
            continue
        quick = _read(conditions, quick_um, truth, noise)
        if not _shows(quick, answer_of(quick_um), least, most, each):
            continue
        true_um = simulate_literally(design, truth.values, truth.causes, Occasions.of(conditions.groups))
        experiment = _read(conditions, true_um, truth, noise)
        answer = answer_of(true_um)
        oracle = consult(experiment, answer, seed=1)
        if seen(oracle, least, most, each):
            about = f"benchmarks/search_sets.py, seed {seed}, number {number}, draw {attempt}"
            return replace(
                _of_answer(name, "pairs", about, experiment, answer), gain=oracle.gain, without=oracle.without
            )


def seen(oracle: Oracle, least: float, most: float, each: float) -> bool:
    """Whether the truth gains what is asked for, and each of its causes."""
    return least <= oracle.gain <= most and min(oracle.without.values()) >= each


def _simulated(design: Design, truth: Truth, conditions: Experiment) -> np.ndarray:
    """True ranges by the fast simulator, um; what they are worth is asked before the literal reference is."""
    row = [truth.values[p.name] for p in baseline.PARAMETERS]
    for t in truth.causes:
        row += [truth.values[p.name] for p in t.parameters]
        row += [truth.values[session_name(t.latent.name, g)] for g in conditions.ids] if t.latent else []
    return np.maximum(simulate(design, np.array(row), truth.causes).launch_range[0] * MICRO, 0.0)


def _read(conditions: Experiment, true_um: np.ndarray, truth: Truth, noise: np.ndarray) -> Experiment:
    """Readings with scatter, of two decimals."""
    size = np.hypot(float(truth.scatter["sigma_rel"] or 0) * true_um, float(truth.scatter["sigma_abs"] or 0))
    read = conditions.with_readings(np.maximum(np.round(true_um + size * noise, 2), 0.0) + 0.0)
    return _experiment(read.constants, read.groups)


def _shows(experiment: Experiment, answer: Answer, least: float, most: float, each: float) -> bool:
    """A quick look at what the oracle would say: it fits every part from many more places."""
    whole = Problem(experiment, experiment.ids, terms(answer.terms), tolerance=1e-3)
    at = truth_of(whole, answer)
    reached = float(whole.log_likelihood(at[None])[0])
    plain = replace(whole, terms=())
    bare = fit(plain, (), seed=1, draws=512, most=8)
    if not least <= reached - bare.log_likelihood <= most:
        return False
    for gone in whole.terms:
        rest, kept = whole.without(gone)
        if reached - fit(rest, [bare], seed=1, extra=at[kept][None], draws=32, most=2).log_likelihood < each:
            return False
    return True
