"""Hide an effect: draw a true model, simulate a design with the literal reference, scatter, write, seal.

Nothing in the experiment folder says what was hidden. Everything is drawn from the seed, in streams of their own, so
that one seed gives the same bytes however the work is shared out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, Protocol

import joblib
import numpy as np
from numpy.typing import NDArray

import psafit
from psafit.arrays import FloatArray
from psafit.challenge import strength as strengths
from psafit.challenge.answer import ANSWER, COMMITMENT, EXPERIMENT, KINDS, Answer, Kind, Place, Scatter, seal, sizes
from psafit.drives import Drive
from psafit.errors import InputError
from psafit.experiment import (
    Constants,
    Experiment,
    Group,
    GroupId,
    fingerprint,
    session_name,
    write_experiment,
)
from psafit.inference import noise as scatter_law
from psafit.observables import LAUNCH_RANGE
from psafit.parameters import Parameter
from psafit.physics import TERMS, baseline
from psafit.physics import terms as catalogue
from psafit.physics.term import Term, World
from psafit.simulate import MICRO, Design
from psafit.simulate.literal import launch_in, literal_world
from psafit.simulate.reference import Point
from psafit.simulate.sensitivity import Side, share_of
from psafit.workers import processes

Edit = Callable[[World, Point], None]
Parameters = Mapping[str, float]

# Streams of random numbers.
_DESIGN, _TRUTH, _SCATTER, _OUTSIDE, _KIND = range(5)

# The rig of the study, from which drawn designs depart.
_RIG = Constants(M=0.027, m=0.005, q=1.2e-7, l=0.09, k_s=4.89e7, g=9.81)


@dataclass(frozen=True)
class HideSettings:
    """What true models and their readings are like.

    Parameters
    ----------
    relative, absolute_um : (float, float)
        Scatter: its median, and the factor that one standard deviation means.
    decimals : int
        Of a reading in micrometres.
    sample : int
        Before all readings are simulated, one in so many says whether a true model launches.
    odds : tuple of float
        How often nothing, one or two causes are hidden where no kind is asked for.
    redraws : int
        True models drawn until one launches in most readings.
    patience : int
        Launching models that are tried for causes as strong as asked for, before the strongest of them is taken.
    """

    relative: tuple[float, float] = (0.05, 1.25)
    absolute_um: tuple[float, float] = (0.05, 1.5)
    decimals: int = 2
    sample: int = 12
    odds: tuple[float, float, float] = (0.25, 0.5, 0.25)
    redraws: int = 200
    patience: int = 5


class Simulator(Protocol):
    """The true model of one challenge, for effects that change the rig itself."""

    def __call__(self, edit: Edit) -> FloatArray:
        """Ranges, um, (n_points,), with ``edit(world, point)`` applied to the rig of every reading."""


@dataclass(frozen=True)
class Outside:
    """An effect that is not in the catalogue.

    Parameters
    ----------
    name : str
    apply : callable
        ``apply(experiment, true_um, simulate, rng)`` returns the ranges, um, (n_points,), and the places in which it
        acts. `experiment` has the design, its readings are the true ranges; `simulate` is a `Simulator`. A function of
        a module, so that other processes find it.
    where : str
        In words.
    """

    name: str
    apply: Callable[[Experiment, FloatArray, Simulator, np.random.Generator], tuple[FloatArray, Sequence[Place]]]
    where: str


@dataclass(frozen=True)
class Challenge:
    """What `make` wrote.

    Parameters
    ----------
    folder : Path
    experiment : Experiment
    answer : Answer
    commitment : str
        SHA-256 of `answer.json`.
    """

    folder: Path
    experiment: Experiment
    answer: Answer
    commitment: str


def make(
    seed: int,
    folder: Path,
    *,
    design_of: Experiment | None = None,
    readings: int | None = None,
    kind: Kind | None = None,
    terms: Sequence[str] | None = None,
    outside: Outside | None = None,
    strength: float | None = None,
    nu: float | None = None,
    believed: bool = False,
    jobs: int = 1,
    settings: HideSettings | None = None,
) -> Challenge:
    """Draw a true model and write `experiment/`, `answer.json` and `commitment.txt`.

    Parameters
    ----------
    seed : int
    folder : Path
        Made if needed; must not hold a challenge.
    design_of : Experiment, optional
        Whose conditions are simulated; a drawn design of similar size without it.
    readings : int, optional
        Of a drawn design, about; its sweeps are of one length. 200 to 350 by default.
    kind : {"nothing", "one", "two", "outside"}, optional
        Drawn if neither this nor `terms` nor `outside` is given.
    terms : sequence of str, optional
        The causes to hide; drawn from the catalogue by default.
    outside : Outside, optional
    strength : float, nats, optional
        Oracle gain asked of each cause alone; strengths are drawn from their priors without it.
    nu : float, optional
        Degrees of freedom of Student's scatter; normal by default.
    believed : bool
        Draw the scatter, too, from the priors that a diagnosis has for it.
    jobs : int
        Processes that simulate.
    settings : HideSettings, optional

    Returns
    -------
    Challenge

    Raises
    ------
    InputError
        If the request contradicts itself, the folder holds a challenge, or no true model launches in most readings.
    """
    settings = settings or HideSettings()
    if strength is not None and (kind == "nothing" or outside is not None):
        raise InputError("a strength of no cause is asked for", "leave it out")
    if design_of is not None and any(g.observables != (LAUNCH_RANGE,) for g in design_of.groups):
        raise InputError(
            "reads more than launch ranges, in which challenges are hidden",
            f"leave {LAUNCH_RANGE.column} alone in its files", file=design_of.folder,
        )  # fmt: skip
    kind, chosen = _request(seed, kind, terms, outside, settings.odds)
    if strength is not None and not (np.isfinite(strength) and strength > 0):
        raise InputError(f"a gain of {strength:g} nats cannot be asked for", "give a number above 0")
    for name in (ANSWER, COMMITMENT, EXPERIMENT):
        if (folder / name).exists():
            raise InputError("is there already", "choose an empty folder", file=folder / name)
    drawn_design = np.random.default_rng([seed, _DESIGN])
    blank = _drawn_design(drawn_design, readings) if design_of is None else _nameless(design_of)
    source: Literal["given", "drawn"] = "drawn" if design_of is None else "given"
    return _made(seed, folder, blank, source, kind, chosen, outside, strength, nu, believed, jobs, settings)


def _made(
    seed: int,
    folder: Path,
    blank: Experiment,
    source: Literal["given", "drawn"],
    kind: Kind,
    chosen: Sequence[Term],
    outside: Outside | None,
    strength: float | None,
    nu: float | None,
    believed: bool,
    jobs: int,
    settings: HideSettings,
) -> Challenge:
    """The challenge of a request that was checked, at the conditions of a blank experiment."""
    design = Design.of(blank.constants, blank.groups)
    rng = np.random.default_rng([seed, _TRUTH])
    scatter = {
        "sigma_rel": _log_normal(rng, *settings.relative),
        "sigma_abs": _log_normal(rng, *settings.absolute_um),
        "nu": nu,
    }
    if believed:
        scatter = {p.name: _from_prior(p, rng) for p in scatter_law.PARAMETERS}
    truth, true_um, redraws = _launching(
        lambda: _draw(rng, chosen, design, blank.ids, scatter, strength, settings.sample),
        lambda parameters: simulate_literally(design, parameters, chosen, blank.ids, jobs=jobs),
        settings,
    )
    where = ""
    places: list[Place] = []
    if outside is not None:
        true_um, places = _outside(outside, blank, design, truth.parameters, true_um, seed, jobs)
        where = outside.where
    read = _read(true_um, scatter, np.random.default_rng([seed, _SCATTER]), settings.decimals)
    experiment = replace(blank.with_readings(read), folder=folder / EXPERIMENT)
    answer = Answer(
        version=psafit.__version__,
        seed=seed,
        kind=kind,
        terms=[t.id for t in chosen],
        parameters=dict(truth.parameters),
        scatter=scatter,
        asked_nats=strength if chosen else None,
        expected_nats=truth.expected,
        reached=truth.reached,
        share=truth.share,
        outside=None if outside is None else outside.name,
        where=where,
        places=places,
        design=source,
        redraws=redraws,
        true_um=true_um.tolist(),
        fingerprint=experiment.fingerprint,
    )
    commitment = seal(answer, folder)
    write_experiment(experiment, folder / EXPERIMENT)
    return Challenge(folder, experiment, answer, commitment)


def _launching(
    draw: Callable[[], _Truth | None], simulate: Callable[[Parameters], FloatArray], settings: HideSettings
) -> tuple[_Truth, FloatArray, int]:
    """A true model that launches in most readings, its ranges, and how many were drawn before it."""
    weak: list[_Truth] = []
    for drawn in range(settings.redraws):
        truth = draw()
        if truth is not None and not truth.reached:
            weak.append(truth)
        if truth is None or not truth.reached:
            if not weak or (len(weak) < settings.patience and drawn + 1 < settings.redraws):
                continue
            truth = max(weak, key=lambda t: min(t.expected.values()))
        true_um = simulate(truth.parameters)
        if strengths.enough(true_um):
            return truth, true_um, drawn
        if not truth.reached:
            weak.remove(truth)
    raise InputError("nothing launches at these conditions", "choose an experiment whose drive launches the ball")


def _request(
    seed: int,
    kind: Kind | None,
    ids: Sequence[str] | None,
    outside: Outside | None,
    odds: tuple[float, float, float],
) -> tuple[Kind, tuple[Term, ...]]:
    """What is to be hidden; the causes in the registry's order."""
    if kind is not None and kind not in KINDS:
        raise InputError(f"there is no kind {kind!r}", f"choose from {', '.join(KINDS)}")
    if ids and outside is not None:
        raise InputError("an outside effect and causes of the catalogue are asked for", "choose one of them")
    if (kind == "outside") != (outside is not None) and (kind is not None or outside is None):
        raise InputError(
            f"kind {kind} and {'no' if outside is None else 'an'} outside effect do not go together",
            "effects outside the catalogue are passed to psafit.challenge.hide.make by tests",
        )
    if outside is not None:
        return "outside", ()
    rng = np.random.default_rng([seed, _KIND])
    named: Kind | None = None
    if ids is not None:
        if len(ids) > 2:
            raise InputError(f"{len(ids)} causes are asked for", "hide at most two")
        named = ("nothing", "one", "two")[len(ids)]
        if kind is not None and kind != named:
            raise InputError(f"kind {kind} does not fit {len(ids)} causes", f"leave it out, or ask for {named}")
    drawn: Kind = KINDS[int(rng.choice(3, p=odds))]
    wanted = named or kind or drawn
    if ids is None:
        picked = rng.choice(len(TERMS), size=KINDS.index(wanted), replace=False)
        ids = [TERMS[int(i)].id for i in picked]
    return wanted, catalogue(ids)


@dataclass(frozen=True)
class _Truth:
    parameters: dict[str, float]
    expected: dict[str, float]
    share: dict[str, float]
    reached: bool


def _draw(
    rng: np.random.Generator,
    chosen: Sequence[Term],
    design: Design,
    ids: Sequence[GroupId],
    scatter: Scatter,
    nats: float | None,
    every: int,
) -> _Truth | None:
    """A true model; None where the baseline itself, by one reading in `every`, does not launch."""
    values = {p.name: _from_prior(p, rng) for p in baseline.PARAMETERS}
    # Everything is drawn before anything is rejected: as many numbers for every try.
    others: list[list[float]] = []
    sides: list[Side] = []
    first = []
    for term in chosen:
        first.append(_from_prior(term.strength, rng))
        sides.append(strengths.side_of(term, rng))
        own = [_from_prior(p, rng) for p in term.parameters[1:]]
        if term.latent:
            z = term.latent.prior_quantile(rng.uniform(size=len(ids)))
            own += [float(x) for x in term.latent.to_physical(z)]
        others.append(own)
    sample = np.unique(np.linspace(0, design.n_points - 1, max(design.n_points // every, 8)).astype(int))
    if not strengths.enough(simulate_literally(design, values, (), ids, points=sample)):
        return None
    theta = np.array(list(values.values()))
    expected: dict[str, float] = {}
    share: dict[str, float] = {}
    reached = True
    for term, own, side, drawn in zip(chosen, others, sides, first, strict=True):
        if nats is None:
            value = drawn
        else:
            found = strengths.find(term, side, np.array(own), theta, design, scatter, nats)
            value, expected[term.id] = found.value, found.nats
            reached = reached and found.reached
        share[term.id] = share_of(term, value)
        names = [p.name for p in term.parameters]
        names += [session_name(term.latent.name, g) for g in ids] if term.latent else []
        values.update(zip(names, [value, *own], strict=True))
    if chosen and not strengths.enough(simulate_literally(design, values, chosen, ids, points=sample)):
        return None
    return _Truth(values, expected, share, reached)


def simulate_literally(
    design: Design,
    parameters: Parameters,
    terms: Sequence[Term],
    ids: Sequence[GroupId],
    *,
    edit: Edit | None = None,
    points: NDArray[np.intp] | None = None,
    jobs: int = 1,
    chunk: int = 16,
    rtol: float = 1e-12,
) -> FloatArray:
    """Ranges by the scalar reference, which shares no code with the simulator that diagnoses.

    Parameters
    ----------
    design : Design
    parameters : mapping
        Values as `Answer.parameters` has them.
    terms : sequence of Term
        In the registry's order.
    ids : sequence of group ids
        Of the design's sessions.
    edit : callable, optional
        ``edit(world, point)``: a last change of the rig of every reading.
    points : (n,) int array, optional
        Which readings; all by default.
    jobs : int
        Processes.
    chunk : int
        Readings that a process takes at once.
    rtol : float
        Relative error of the integration.

    Returns
    -------
    (n,) array, um
    """
    chosen = np.arange(design.n_points) if points is None else points
    work = (design, dict(parameters), tuple(terms), tuple(ids), edit, rtol)
    if jobs == 1:
        return _some(*work, chosen)
    parts = np.array_split(chosen, max(len(chosen) // chunk, 1))
    with processes(jobs) as usable:
        done = joblib.Parallel(n_jobs=usable)(joblib.delayed(_some)(*work, part) for part in parts)
    return np.concatenate(done)


def _some(
    design: Design,
    parameters: Parameters,
    terms: Sequence[Term],
    ids: Sequence[GroupId],
    edit: Edit | None,
    rtol: float,
    points: NDArray[np.intp],
) -> FloatArray:
    theta = [parameters[p.name] for p in baseline.PARAMETERS]
    found = np.empty(len(points))
    for k, i in enumerate(points):
        group = int(design.group[i])
        point = Point(design.drives[design.drive[i]], float(design.frequency[i]), float(design.amplitude[i]))
        causes = []
        for term in terms:
            own = [parameters[p.name] for p in term.parameters]
            own += [parameters[session_name(term.latent.name, ids[group])]] if term.latent else []
            causes.append((term, own))
        world = literal_world(theta, causes, design.rigs[design.rig[i]])
        if edit is not None:
            edit(world, point)
        found[k] = launch_in(world, point, group=group, rtol=rtol).launch_range * MICRO
    return found


def _outside(
    effect: Outside,
    blank: Experiment,
    design: Design,
    parameters: Parameters,
    true_um: FloatArray,
    seed: int,
    jobs: int,
) -> tuple[FloatArray, list[Place]]:
    def simulator(edit: Edit) -> FloatArray:
        return simulate_literally(design, parameters, (), blank.ids, edit=edit, jobs=jobs)

    rng = np.random.default_rng([seed, _OUTSIDE])
    changed, places = effect.apply(blank.with_readings(true_um), true_um.copy(), simulator, rng)
    changed = np.asarray(changed, dtype=float)
    if changed.shape != true_um.shape or not (np.isfinite(changed).all() and (changed >= 0).all()):
        raise ValueError(f"{effect.name}: ranges must be finite, not negative, and of shape {true_um.shape}")
    return changed, list(places)


def _read(true_um: FloatArray, scatter: Scatter, rng: np.random.Generator, decimals: int) -> FloatArray:
    """One reading of every range, as an instrument shows it: rounded, and never below zero."""
    relative, absolute = sizes(scatter)
    s = np.hypot(relative * true_um, absolute)
    nu = scatter["nu"]
    z = rng.standard_normal(true_um.size) if nu is None else rng.standard_t(nu, true_um.size)
    return np.maximum(np.round(true_um + s * z, decimals), 0.0) + 0.0  # no negative zero


def _nameless(given: Experiment) -> Experiment:
    """The conditions, with titles and file names that say nothing."""
    groups = tuple(replace(g, file=f"group{k}.csv", sigma=None) for k, g in enumerate(given.groups, 1))
    return _blank(given.constants, groups)


def _blank(constants: Constants, groups: tuple[Group, ...]) -> Experiment:
    return Experiment("Challenge", "simulated", constants, groups, Path(), fingerprint(constants, groups))


def _from_prior(p: Parameter, rng: np.random.Generator) -> float:
    return float(p.to_physical(p.prior_quantile(rng.uniform())))


def _log_normal(rng: np.random.Generator, median: float, factor: float) -> float:
    return float(median * factor ** rng.standard_normal())


def _drawn_design(rng: np.random.Generator, readings: int | None = None) -> Experiment:
    """Four to seven sweeps of a rig like the study's; so many readings in all, or 200 to 350."""
    ball, string = _RIG.M * 1.5 ** rng.uniform(-1, 1), _RIG.l * 1.5 ** rng.uniform(-1, 1)
    constants = Constants(M=float(f"{ball:.3g}"), m=_RIG.m, q=_RIG.q, l=float(f"{string:.3g}"), k_s=_RIG.k_s, g=_RIG.g)
    n_groups = int(rng.integers(4, 8))
    groups = []
    for number in range(1, n_groups + 1):
        n = (int(rng.integers(200, 351)) if readings is None else readings) // n_groups
        waveform = "square" if rng.uniform() < 0.35 else "sine"
        if number == 1 or rng.uniform() < 0.5:
            low, high = rng.uniform(50.0, 400.0), rng.uniform(5e3, 25e3)
            f = np.round(np.geomspace(low, high, n), 0)
            v = np.full(n, float(rng.choice([10.0, 15.0, 20.0])))
        else:
            f = np.full(n, float(round(rng.uniform(500.0, 4000.0), -2)))
            v = np.round(np.linspace(rng.uniform(1.0, 5.0), 20.0, n), 2)
        groups.append(Group(number, Drive(waveform), f"group{number}.csv", f, v, np.zeros(n)))
    return _blank(constants, tuple(groups))


__all__ = ["Challenge", "Edit", "Outside", "Simulator", "make", "simulate_literally"]
