"""Hide an effect: draw a true model, simulate a design with the literal reference, scatter, write, seal.

Nothing in the experiment folder says what was hidden. Everything is drawn from the seed, in streams of their own, so
that one seed gives the same bytes however the work is shared out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import joblib
import numpy as np
from numpy.typing import NDArray

import psafit
from psafit.arrays import FloatArray
from psafit.challenge import strength as strengths
from psafit.challenge.answer import (
    ANSWER,
    COMMITMENT,
    EXPERIMENT,
    KINDS,
    Answer,
    DrawnDesign,
    Kind,
    Place,
    Scatter,
    by_reading,
    seal,
)
from psafit.challenge.conditions import ConditionSettings, drawn, nameless, summary
from psafit.errors import InputError
from psafit.experiment import Experiment, Occasions, fingerprint, write_experiment
from psafit.inference import noise
from psafit.observables import LAUNCH_RANGE, OBSERVABLES, Motion, Observable
from psafit.parameters import Parameter
from psafit.physics import TERMS, baseline
from psafit.physics import terms as catalogue
from psafit.physics.term import ReferenceRig, Term
from psafit.simulate import Design
from psafit.simulate.literal import launch_in, motion_in, reference_rig
from psafit.simulate.reference import Point
from psafit.simulate.sensitivity import Side, share_of
from psafit.workers import processes

Edit = Callable[[ReferenceRig, Point], None]
Parameters = Mapping[str, float]

# Streams of random numbers; `conditions` has others.
_TRUTH, _SCATTER, _OUTSIDE, _KIND = range(1, 5)


@dataclass(frozen=True)
class HideSettings:
    """What true models and their readings are like.

    Parameters
    ----------
    relative, absolute : (float, float)
        Relative and absolute scatter of each observable: their median, as a part of the median of its prior, and the
        factor that one standard deviation means.
    memory : (float, float)
        Correlation time of the scatter along traces likewise.
    digits : int
        Of a reading, behind the first of the usual absolute scatter: hundredths of a micrometre, where that is 0.1 um.
    sample : int
        Before all readings are simulated, one in so many says whether a true model launches.
    odds : tuple of float
        How often nothing, one or two causes are hidden where no kind is asked for.
    redraws : int
        True models drawn until one launches in most readings.
    patience : int
        Launching models that are tried for causes as strong as asked for, before the strongest of them is taken.
    """

    relative: tuple[float, float] = (1.0, 1.25)
    absolute: tuple[float, float] = (0.5, 1.5)
    memory: tuple[float, float] = (1.0, 2.0)
    digits: int = 1
    sample: int = 12
    odds: tuple[float, float, float] = (0.25, 0.5, 0.25)
    redraws: int = 200
    patience: int = 5


class Simulator(Protocol):
    """The true model of one challenge, for effects that change the rig itself."""

    def __call__(self, edit: Edit) -> FloatArray:
        """Readings without scatter, (n_points,), with ``edit(rig, point)`` applied to the rig of every launch."""


@dataclass(frozen=True)
class Outside:
    """An effect that is not in the catalogue.

    Parameters
    ----------
    name : str
    apply : callable
        ``apply(experiment, true, simulate, rng)`` returns the readings without scatter, (n_points,), and the places in
        which it acts. `experiment` has the design, its readings are the `true` ones without the effect; `simulate` is a
        `Simulator`. A function of a module, so that other processes find it.
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
    conditions: ConditionSettings | None = None,
) -> Challenge:
    """Draw a true model and write `experiment/`, `answer.json` and `commitment.txt`.

    Parameters
    ----------
    seed : int
    folder : Path
        Made if needed; must not hold a challenge.
    design_of : Experiment, optional
        Whose conditions are simulated; a drawn design without it.
    readings : int, optional
        Launches of a drawn design, about; its sweeps are of one length. Drawn by default.
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
    conditions : ConditionSettings, optional
        What a drawn design may be.

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
    kind, chosen = _request(seed, kind, terms, outside, settings.odds)
    if strength is not None and not (np.isfinite(strength) and strength > 0):
        raise InputError(f"a gain of {strength:g} nats cannot be asked for", "give a number above 0")
    for name in (ANSWER, COMMITMENT, EXPERIMENT):
        if (folder / name).exists():
            raise InputError("is there already", "choose an empty folder", file=folder / name)
    if design_of is None:
        # Effects outside the catalogue change launch ranges; not all of them change what else may be read.
        blank = drawn(seed, readings, causes=chosen, ranges=outside is not None, settings=conditions)
    else:
        blank = nameless(design_of)
    design = summary(blank) if design_of is None else None
    return _made(seed, folder, blank, design, kind, chosen, outside, strength, nu, believed, jobs, settings)


def _made(
    seed: int,
    folder: Path,
    blank: Experiment,
    drawn_design: DrawnDesign | None,
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
    scatter = _scatter(rng, design, nu, believed, settings)
    truth, true, redraws = _launching(
        lambda: draw_challenge(rng, chosen, design, blank.occasions, scatter, strength, settings.sample),
        lambda parameters: simulate_literally(design, parameters, chosen, blank.occasions, jobs=jobs),
        lambda true: strengths.enough(design, true),
        settings,
    )
    where = ""
    places: list[Place] = []
    if outside is not None:
        true, places = _outside(outside, blank, design, truth.parameters, true, seed, jobs)
        where = outside.where
    read = read_off(design, true, scatter, np.random.default_rng([seed, _SCATTER]), settings.digits)
    there = strengths.legible(design, true) & strengths.legible(design, read)
    experiment = replace(_of(blank.with_readings(read), there), folder=folder / EXPERIMENT)
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
        design="given" if drawn_design is None else "drawn",
        redraws=redraws,
        true_readings=true[there].tolist(),
        fingerprint=experiment.fingerprint,
        drawn=drawn_design,
    )
    commitment = seal(answer, folder)
    write_experiment(experiment, folder / EXPERIMENT)
    return Challenge(folder, experiment, answer, commitment)


def _launching(
    draw: Callable[[], Truth | None],
    simulate: Callable[[Parameters], FloatArray],
    enough: Callable[[FloatArray], bool],
    settings: HideSettings,
) -> tuple[Truth, FloatArray, int]:
    """A true model that launches in most readings, these without scatter, and how many were drawn before it."""
    weak: list[Truth] = []
    for before in range(settings.redraws):
        truth = draw()
        if truth is not None and not truth.reached:
            weak.append(truth)
        if truth is None or not truth.reached:
            if not weak or (len(weak) < settings.patience and before + 1 < settings.redraws):
                continue
            truth = max(weak, key=lambda t: min(t.expected.values()))
        true = simulate(truth.parameters)
        if enough(true):
            return truth, true, before
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
class Truth:
    """A true model that was drawn: its values, what each cause is expected to gain, and whether as much was reached."""

    parameters: dict[str, float]
    expected: dict[str, float]
    share: dict[str, float]
    reached: bool


def draw_challenge(
    rng: np.random.Generator,
    chosen: Sequence[Term],
    design: Design,
    occasions: Occasions,
    scatter: Scatter,
    nats: float | None,
    every: int,
) -> Truth | None:
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
            z = term.latent.prior_quantile(rng.uniform(size=len(term.latent_names(occasions))))
            own += [float(x) for x in term.latent.to_physical(z)]
        others.append(own)
    sample = np.unique(np.linspace(0, design.n_points - 1, max(design.n_points // every, 8)).astype(int))
    some = design.points(sample)

    def launched(causes: Sequence[Term]) -> bool:
        """Whether enough of the sample is, by the values drawn so far."""
        return strengths.enough(some, simulate_literally(design, values, causes, occasions, points=sample))

    if not launched(()):
        return None
    theta = np.array(list(values.values()))
    expected: dict[str, float] = {}
    share: dict[str, float] = {}
    reached = True
    for term, own, side, believed in zip(chosen, others, sides, first, strict=True):
        if nats is None:
            value = believed
        else:
            found = strengths.find(term, side, np.array(own), theta, design, scatter, nats)
            value, expected[term.id] = found.value, found.nats
            reached = reached and found.reached
        share[term.id] = share_of(term, value)
        names = [p.name for p in term.parameters]
        names += term.latent_names(occasions)
        values.update(zip(names, [value, *own], strict=True))
    if chosen and not launched(chosen):
        return None
    return Truth(values, expected, share, reached)


def simulate_literally(
    design: Design,
    parameters: Parameters,
    terms: Sequence[Term],
    occasions: Occasions,
    *,
    edit: Edit | None = None,
    points: NDArray[np.intp] | None = None,
    jobs: int = 1,
    chunk: int = 16,
    rtol: float = 1e-12,
) -> FloatArray:
    """Readings by the scalar reference, which shares no code with the simulator that diagnoses.

    Parameters
    ----------
    design : Design
    parameters : mapping
        Values as `Answer.parameters` has them.
    terms : sequence of Term
        In the registry's order.
    occasions : Occasions
        Those of the design's groups.
    edit : callable, optional
        ``edit(rig, point)``: a last change of the rig of every launch.
    points : (n,) int array, optional
        Which readings; all by default.
    jobs : int
        Processes.
    chunk : int
        Launches that a process takes at once.
    rtol : float
        Relative error of the integration.

    Returns
    -------
    (n,) array
        Without scatter, each in the unit of its observable; zero where a launch failed.
    """
    chosen = np.arange(design.n_points) if points is None else points
    rigs = _Rigs(design, dict(parameters), tuple(terms), occasions, edit, rtol)
    plain, traced = np.flatnonzero(~design.traced[chosen]), np.flatnonzero(design.traced[chosen])
    read = np.empty(len(chosen))
    if plain.size:
        read[plain] = _of_launches(rigs, chosen[plain], jobs, chunk)
    if traced.size:
        read[traced] = _along_traces(rigs, chosen[traced], jobs)
    return read


def _of_launches(rigs: _Rigs, chosen: NDArray[np.intp], jobs: int, chunk: int) -> FloatArray:
    """Readings of launches as a whole."""
    measured = rigs.design.measured[chosen]
    first, back = rigs.launches(chosen)
    forces = any(OBSERVABLES[k].force for k in np.unique(measured))
    parts = np.array_split(chosen[first], max(len(first) // chunk, 1))
    rows = _shared(rigs.launched, [(p, forces) for p in parts], jobs)
    return _as_read(rigs, chosen, _Launches(*np.concatenate(rows)[back].T))


def _along_traces(rigs: _Rigs, chosen: NDArray[np.intp], jobs: int) -> FloatArray:
    """Samples of traces; those of one launch take one simulation."""
    time = rigs.design.time[chosen]
    first, back = rigs.launches(chosen)
    times = [np.unique(time[back == k]) for k in range(first.size)]
    followed = _shared(rigs.followed, list(zip(chosen[first], times, strict=True)), jobs)
    seen = np.empty((len(chosen), 3))
    for k, (own, motion) in enumerate(zip(times, followed, strict=True)):
        seen[back == k] = motion[np.searchsorted(own, time[back == k])]
    return _as_read(rigs, chosen, Motion(*seen.T))


def _as_read(rigs: _Rigs, chosen: NDArray[np.intp], simulated: _Launches | Motion) -> FloatArray:
    """What is read of a simulation of some points, each in the unit of its observable."""
    measured, read = rigs.design.measured[chosen], np.empty(len(chosen))
    for k in np.unique(measured):
        o, here = OBSERVABLES[k], measured == k
        values = o.of(simulated)[here]
        if rigs.change(o):
            both = zip(chosen[here].tolist(), values.tolist(), strict=True)
            values = np.array([x if o.blank and x == 0.0 else rigs.read(i, o.name, x) for i, x in both])
        read[here] = values * o.scale
    return read


@dataclass(frozen=True, eq=False)
class _Launches:
    """What observables take from a simulation: see `psafit.observables.Launches`."""

    launch_range: FloatArray
    separation_time: FloatArray
    separation_speed: FloatArray
    peak_force: FloatArray

    @property
    def launched(self) -> NDArray[np.bool_]:
        return np.isfinite(self.separation_time)


def _shared(work: Callable[..., FloatArray], each: Sequence[tuple[Any, ...]], jobs: int) -> list[FloatArray]:
    """What a function makes of each set of arguments, by some processes."""
    if jobs == 1:
        return [work(*one) for one in each]
    with processes(jobs) as usable:
        return list(joblib.Parallel(n_jobs=usable)(joblib.delayed(work)(*one) for one in each))


@dataclass(frozen=True, eq=False)
class _Rigs:
    """The true model at the conditions of a design; arguments as of `simulate_literally`."""

    design: Design
    parameters: Parameters
    terms: tuple[Term, ...]
    occasions: Occasions
    edit: Edit | None
    rtol: float

    def launches(self, chosen: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """One of some points at each launch, and which launch each is of; the same launch again is one.

        It reads the launch range if any does: ranges are simulated as they are read.
        """
        return self.design.patterns(chosen)

    def at(self, i: int) -> tuple[ReferenceRig, Point]:
        """The rig, and the drive, of a point."""
        d, values = self.design, self.parameters
        theta = [values[p.name] for p in baseline.PARAMETERS]
        point = Point(d.drives[d.drive[i]], float(d.frequency[i]), float(d.amplitude[i]))
        causes = []
        for term in self.terms:
            own = [values[p.name] for p in term.parameters]
            if term.latent:
                own += [values[term.latent_names(self.occasions)[d.occasion(term.per)[i]]]]
            causes.append((term, own))
        rig = reference_rig(theta, causes, d.rigs[d.rig[i]])
        if self.edit is not None:
            self.edit(rig, point)
        return rig, point

    def change(self, observable: Observable) -> bool:
        """Whether its readings may differ from its values; launch ranges are integrated as they are read."""
        reads = self.edit is not None or any(observable.name in t.reads for t in self.terms)
        return reads and observable is not LAUNCH_RANGE

    def read(self, i: int, observable: str, value: float) -> float:
        """What is read of the value of an observable, SI units, at a point."""
        rig, point = self.at(i)
        rig.frequency, rig.amplitude = point.frequency, point.amplitude
        return rig.read(observable, value, int(self.design.session[i]))

    def launched(self, points: NDArray[np.intp], forces: bool) -> FloatArray:
        """Launch range, time and speed of the separation, and peak force, (n, 4)."""
        found = np.empty((len(points), 4))
        for k, i in enumerate(points):
            rig, point = self.at(int(i))
            seen = launch_in(rig, point, group=int(self.design.session[i]), rtol=self.rtol, forces=forces)
            found[k] = seen.launch_range, seen.separation_time, seen.velocity, seen.peak_force
        return found

    def followed(self, i: int, times: FloatArray) -> FloatArray:
        """Ball, its speed and the tip at some times of a launch, (n_times, 3)."""
        rig, point = self.at(int(i))
        return motion_in(rig, point, times.tolist(), rtol=self.rtol)


def _outside(
    effect: Outside,
    blank: Experiment,
    design: Design,
    parameters: Parameters,
    true: FloatArray,
    seed: int,
    jobs: int,
) -> tuple[FloatArray, list[Place]]:
    def simulator(edit: Edit) -> FloatArray:
        return simulate_literally(design, parameters, (), blank.occasions, edit=edit, jobs=jobs)

    rng = np.random.default_rng([seed, _OUTSIDE])
    changed, places = effect.apply(blank.with_readings(true), true.copy(), simulator, rng)
    changed = np.asarray(changed, dtype=float)
    possible = np.isfinite(changed).all() and (changed[~design.traced] >= 0).all()
    if changed.shape != true.shape or not possible:
        raise ValueError(f"{effect.name}: readings must be finite, of launches not negative, and of shape {true.shape}")
    return changed, list(places)


def _scatter(
    rng: np.random.Generator, design: Design, nu: float | None, believed: bool, settings: HideSettings
) -> dict[str, float | None]:
    """Scatter of all that is read, as `Answer.scatter` has it."""
    found: dict[str, float | None] = {}
    for k in np.unique(design.measured):
        relative, absolute, tails, *memory = OBSERVABLES[k].scatter
        if believed:
            found |= {p.name: _from_prior(p, rng) for p in OBSERVABLES[k].scatter}
            continue
        usual = ((relative, settings.relative), (absolute, settings.absolute), *((p, settings.memory) for p in memory))
        for p, (part, factor) in usual:
            found[p.name] = _log_normal(rng, part * p.prior_median, factor)
        found[tails.name] = nu
    return found


def read_off(design: Design, true: FloatArray, scatter: Scatter, rng: np.random.Generator, digits: int) -> FloatArray:
    """One reading of every true value, as an instrument shows it: rounded, and of a launch never below zero."""
    values = by_reading(scatter, design)
    relative, absolute, _ = (row[0] for row in noise.columns(values))
    s = np.hypot(relative * true, absolute)
    z, decimals = np.empty(true.size), np.empty(true.size, int)
    for k in np.unique(design.measured):
        here, (finest, tails) = design.measured == k, OBSERVABLES[k].scatter[1:3]
        nu = scatter[tails.name]
        z[here] = rng.standard_normal(here.sum()) if nu is None else rng.standard_t(nu, here.sum())
        decimals[here] = math.ceil(-math.log10(finest.prior_median) - 1e-9) + digits
    z = noise.correlated(z[None], values)[0]
    read = np.array([np.round(x, n) for x, n in zip(true + s * z, decimals, strict=True)])
    return np.where(design.traced, read, np.maximum(read, 0.0)) + 0.0  # no negative zero


def _of(experiment: Experiment, there: NDArray[np.bool_]) -> Experiment:
    """Return the experiment with only those readings that there are."""
    ends = np.cumsum([g.n_points for g in experiment.groups])
    parts = zip(experiment.groups, np.split(there, ends[:-1]), strict=True)
    groups = tuple(g.at(np.flatnonzero(own)) for g, own in parts)
    return replace(experiment, groups=groups, fingerprint=fingerprint(experiment.constants, groups))


def _from_prior(p: Parameter, rng: np.random.Generator) -> float:
    return float(p.to_physical(p.prior_quantile(rng.uniform())))


def _log_normal(rng: np.random.Generator, median: float, factor: float) -> float:
    return float(median * factor ** rng.standard_normal())


__all__ = ["Challenge", "Edit", "Outside", "Simulator", "make", "simulate_literally"]
