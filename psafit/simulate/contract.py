"""The contract of a cause: what the tests hold the built-in ones to, and `psafit check-cause` anybody's.

A cause says the same several times over: a declaration, functions for the fast path, a scalar function for the literal
reference, numbers worked out by hand. Every check here sets one of them against another, or against the simulator.
"""

from __future__ import annotations

import inspect
import itertools
import math
import sys
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from ctypes import CFUNCTYPE, POINTER, c_double
from dataclasses import dataclass, replace
from functools import partial, wraps
from types import CodeType
from typing import Any, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from psafit.arrays import FloatArray
from psafit.drives import Drive
from psafit.experiment import Constants
from psafit.observables import LAUNCH_RANGE, named
from psafit.parameters import Parameter
from psafit.physics import TERMS, baseline, term
from psafit.physics.term import SLOTS, ReferenceRig, Term
from psafit.plugins import blamed, message_of
from psafit.simulate import stepper
from psafit.simulate.batch import Simulation, path_of, simulate
from psafit.simulate.callbacks import HOOKS, address
from psafit.simulate.design import SINE, SQUARE, Counts, Design
from psafit.simulate.literal import LiteralLaunch, literal_launch
from psafit.simulate.reference import Point
from psafit.simulate.sensitivity import REFERENCE, RIGS, effect, observe, plausible

STUDY = Constants(M=0.027, m=0.005, q=1.2e-7, l=0.09, k_s=4.89e7, g=9.81)
"""The rig of the study (Table 3)."""

AGREEMENT = {"closed form": 1e-9, "stepper": 1e-6}
"""Relative difference from the reference that each path of the simulator is allowed, of an ångström at least."""


# Voltages and frequencies at which causes are looked at, like the study's six groups.
_SWEEPS: tuple[tuple[int, ArrayLike, ArrayLike], ...] = (
    (SINE, np.geomspace(100, 25e3, 46), 20.0),
    (SINE, np.geomspace(100, 18e3, 24), 15.0),
    (SINE, 1200.0, np.linspace(1, 20, 16)),
    (SINE, 3000.0, np.linspace(3, 20, 16)),
    (SQUARE, 1200.0, np.linspace(1, 20, 16)),
    (SQUARE, np.geomspace(1, 5e4, 24), 20.0),
)


@dataclass(frozen=True)
class Outcome:
    """What one check found.

    Parameters
    ----------
    check : str
        Its name.
    passed : bool
    text : str
        One line, with the numbers.
    worst, allowed : float, optional
        The number that decides, and its limit, where there is one.
    cases : tuple of str
        Draws that failed, in full.
    """

    check: str
    passed: bool
    text: str
    worst: float | None = None
    allowed: float | None = None
    cases: tuple[str, ...] = ()


def _within(check: str, worst: float, allowed: float, text: str) -> Outcome:
    return Outcome(check, worst <= allowed, f"{text} {worst:.2g}, allowed {allowed:g}", worst, allowed)


def _apart(found: FloatArray, expected: FloatArray) -> float:
    """Largest relative difference."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(np.max(np.where(found == expected, 0.0, np.abs(found - expected) / np.abs(expected))))


def of_ranges(cause: Term) -> Term:
    """A cause that changes readings of another observable as if it changed launch ranges.

    A usual reading of the first that it `reads` stands for a usual range.
    """
    if LAUNCH_RANGE.name in cause.reads:
        return cause
    usual = (math.sqrt(math.prod(o.usual)) / o.scale for o in (named(cause.reads[0]), LAUNCH_RANGE))
    factor = next(usual) / next(usual)

    def literal(rig: ReferenceRig, p: Sequence[float]) -> None:
        before = rig.reading
        rig.reading = lambda x, group: factor * before(x / factor, group)
        cause.literal(rig, p)
        inside = rig.reading
        rig.reading = lambda L, group: inside(factor * L, group) / factor

    given = cause.reading
    if given is None:
        return replace(cause, reads=(LAUNCH_RANGE.name,), literal=literal)

    @wraps(given)
    def reading(L: FloatArray, p: FloatArray, group: NDArray[np.int64]) -> FloatArray:
        return given(factor * L, p, group) / factor

    return replace(cause, reads=(LAUNCH_RANGE.name,), literal=literal, reading=reading)


def usual_design() -> Design:
    """Six sweeps like the study's groups, each a session of its own."""
    parts = [np.broadcast_arrays(waveform, f, v, k) for k, (waveform, f, v) in enumerate(_SWEEPS)]
    waveform, f, v, session = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Design(STUDY, waveform, f, v, session)


# --- draws, and the comparison with the reference -------------------------------------------------------------------


@dataclass(frozen=True)
class Draw:
    """One launch: conditions, the baseline's parameters, and each cause's, its latent one last."""

    point: Point
    theta: list[float]
    causes: tuple[Term, ...] = ()
    values: tuple[list[float], ...] = ()
    constants: Constants = STUDY

    def __repr__(self) -> str:
        causes = "".join(f'term("{t.id}"), ' for t in self.causes)
        return f"Draw({self.point}, {self.theta}, ({causes}), {self.values})"

    def simulated(self, tolerance: float = stepper.TOLERANCE) -> Simulation:
        """By the fast path."""
        design = Design.sweep(self.constants, self.point.drive, self.point.frequency, self.point.amplitude)
        row = np.array([*self.theta, *itertools.chain(*self.values)])
        return simulate(design, row, self.causes, tolerance=tolerance)

    def fast(self, tolerance: float = stepper.TOLERANCE) -> tuple[float, str]:
        """Launch range, m, and the path that gave it."""
        found = self.simulated(tolerance)
        # Where the place of a ball counts that is not launched, steps have followed it.
        return float(found.launch_range[0, 0]), found.engine if found.launched[0, 0] else "stepper"

    def literal(self, factor: float = 1.0) -> LiteralLaunch:
        """By the literal reference, with all parameters times a factor."""
        theta = [x * factor for x in self.theta]
        values = [[x * factor for x in own] for own in self.values]
        pairs = list(zip(self.causes, values, strict=True))
        return literal_launch(self.point, theta, pairs, self.constants)

    def reference(self, factor: float = 1.0) -> float:
        """Launch range, m, of the literal reference, with all parameters times a factor."""
        return self.literal(factor).launch_range

    def beyond_a_jump(
        self, fast: float, value: float, *, nearby: float = 1e-6, jump: float = 0.01, like: float = 1e-3
    ) -> bool:
        """Whether a slight change of all parameters makes the reference jump to what `fast` is.

        Parameters
        ----------
        fast, value : float, m
            Launch ranges of the fast path and of the reference.
        nearby : float
            Relative change of every parameter.
        jump : float
            Least relative change of the reference.
        like : float
            Relative difference of `fast` from what is beyond the jump.
        """
        nearby_values = (self.reference(1 + e) for e in (-nearby, nearby))
        return any(abs(b - value) > jump * abs(value) and abs(fast - b) <= like * _size_of(b) for b in nearby_values)

    def disagreement(self, tolerance: float = stepper.TOLERANCE) -> float:
        """Relative error of the fast path in units of what it is allowed."""
        fast, engine = self.fast(tolerance)
        reference = self.reference()
        if fast == reference:
            return 0.0
        error = abs(fast - reference) / _size_of(reference)
        if error > AGREEMENT[engine] and self.beyond_a_jump(fast, reference):
            return 0.0
        return error / AGREEMENT[engine]


def _size_of(launch_range: float, least: float = 1e-10) -> float:
    """Size of a launch range, m; one that is smaller than an atom, an angstrom, counts as one."""
    return max(abs(launch_range), least)


def some(p: Parameter, rng: np.random.Generator) -> float:
    """A value from a parameter's prior."""
    return float(p.to_physical(p.prior_quantile(rng.uniform())))


def draw(
    rng: np.random.Generator,
    causes: Sequence[Term] = (),
    constants: Constants = STUDY,
    drives: Sequence[Drive] = (Drive("square"), Drive("sine")),
    **fixed: float,
) -> Draw:
    """A launch by one of some drives at random conditions, with parameters from the priors but for those fixed."""

    def value(p: Parameter) -> float:
        drawn = some(p, rng)
        return fixed.get(p.name, drawn)

    values = tuple([value(p) for p in (*t.parameters, *([t.latent] if t.latent else []))] for t in causes)
    drive = drives[min(int(len(drives) * rng.random()), len(drives) - 1)]
    point = Point(drive, float(np.exp(rng.uniform(np.log(30), np.log(3e4)))), float(rng.uniform(1, 40)))
    return Draw(point, [value(p) for p in baseline.PARAMETERS], tuple(causes), values, constants)


def edges(parameters: Iterable[Parameter]) -> Iterator[dict[str, float]]:
    """Every parameter at each of its bounds."""
    for p in parameters:
        yield from ({p.name: bound} for bound in (p.bounds.lower, p.bounds.upper))


def agreement(draws: Sequence[Draw], check: str = "reference", finer: float | None = None) -> Outcome:
    """Whether the fast path gives what the literal reference gives.

    Parameters
    ----------
    draws : sequence of Draw
    check : str
        Name of the check.
    finer : float, optional
        Tolerance of the steps with which a draw that disagrees is tried again: some draws are so ill-conditioned that
        steps of the usual one err by more than is allowed.
    """
    sizes = [d.disagreement() for d in draws]
    if finer is not None:
        sizes = [size if size <= 1 else d.disagreement(finer) for d, size in zip(draws, sizes, strict=True)]
    wrong = [d for d, size in zip(draws, sizes, strict=True) if not size <= 1]
    worst = max(sizes, key=_nan_last, default=0.0)
    taken = "; ".join(f"{count} {path}" for path, count in _paths(draws))
    text = f"fast against literal in {len(draws)} draws ({taken}), worst in units of the allowed error {worst:.2g}"
    if wrong:
        drive, f, v = wrong[0].point
        text = f"{text}; {len(wrong)} disagree, the first at {Drive.of(drive).label}, {f:.5g} Hz, {v:.3g} V"
    return Outcome(check, not wrong, text, worst, 1.0, tuple(map(repr, wrong)))


def _nan_last(size: float) -> float:
    return math.inf if math.isnan(size) else size


def _paths(draws: Iterable[Draw]) -> list[tuple[str, int]]:
    taken = [path_of(d.causes) for d in draws]
    return [(path, taken.count(path)) for path in AGREEMENT if path in taken]


# --- the file's own statements --------------------------------------------------------------------------------------


def declaration(cause: Term) -> Outcome:
    """Nothing is left unsaid, and LaTeX can be set: braces in pairs, no dollar signs, one line."""
    named = (*cause.parameters, *([cause.latent] if cause.latent else []))
    texts = {"title": cause.title, "reference": cause.reference, "description": cause.description}
    texts |= {"symptom": cause.symptom.text} | {f"description of {p.name}": p.description for p in named}
    texts |= {f"source of {p.name}'s prior": p.source for p in named}
    faults = [f"no {what}" for what, text in texts.items() if not text.strip()]
    if not cause.description.startswith(cause.description[:1].upper()):
        faults.append("the description begins with a small letter")
    for what, latex in {"equation": cause.equation, **{p.name: p.symbol for p in cause.parameters}}.items():
        if latex.count("{") != latex.count("}") or "$" in latex or "\n" in latex or not latex.strip():
            faults.append(f"{what} is not one line of LaTeX without dollar signs, its braces in pairs")
    outside = [p.name for p in named if p.neutral is not None and not p.bounds.lower <= p.neutral <= p.bounds.upper]
    faults += [f"neutral value of {name} outside its bounds" for name in outside]
    plain = [p.name for p in baseline.PARAMETERS]
    unknown = [name for name, _ in cause.redefines if name not in plain]
    faults += [f"redefines {name}, which is none of {', '.join(plain)}" for name in unknown]
    if cause.of_session:
        found = np.shape(cause.of_session.value(np.tile([*plausible(cause), 0.5], (3, 1))))
        faults += [f"what a session has is of shape {found} for 3 sets, not (3,)"] if found != (3,) else []
    said = f"{len(named)} parameter{'s' * (len(named) > 1)}, each with unit, bounds, prior and source"
    return Outcome("declaration", not faults, "; ".join(faults) or said)


def by_hand(cause: Term) -> Outcome:
    """The values worked out by hand, each of what a function of the cause says."""
    own = {getattr(inspect.unwrap(hook), "__code__", None) for hook in cause.hooks}
    wrong, worst = [], 0.0
    for check in cause.checks:
        value, called = _observed(check.value)
        error = _apart(np.array([value]), np.array([check.expected]))
        worst = max(worst, error / check.tolerance if error else 0.0, key=_nan_last)
        if not error <= check.tolerance:
            wrong.append(f"; {check.working}: got {value:.12g}, expected {check.expected:.12g}")
        elif None not in own and not own & called:
            wrong.append(f"; {check.working}: asks no function of the cause")
    n = len(cause.checks)
    text = f"{n - len(wrong)} of {n} come out, worst in units of the allowed error {worst:.2g}"
    return Outcome("by hand", not wrong, text + "".join(wrong), worst, 1.0)


def _observed(function: Callable[[], float]) -> tuple[float, set[CodeType | None]]:
    """What a function returns, and the code that ran for it."""
    called: set[CodeType | None] = set()
    before = sys.getprofile()
    sys.setprofile(lambda frame, event, argument: called.add(frame.f_code))
    try:
        return float(function()), called
    finally:
        sys.setprofile(before)


class _Numbers(list[float]):
    """A list that refuses what machine code would take from next to it."""

    def __getitem__(self, i: Any) -> Any:
        return super().__getitem__(self._sound(i))

    def __setitem__(self, i: Any, value: Any) -> None:
        super().__setitem__(self._sound(i), value)

    @staticmethod
    def _sound(i: SupportsIndex) -> SupportsIndex:
        if i.__index__() < 0:
            raise IndexError("index below zero")
        return i


def compiled(cause: Term, rng: np.random.Generator) -> Outcome:
    """As machine code, the functions of slots say what they say in Python."""
    hooks = {kind: n for kind, n in HOOKS.items() if getattr(cause, kind)}
    worst = 0.0
    for kind, (n_numbers, n_lists) in hooks.items():
        function = getattr(cause, kind)
        p = [some(q, rng) for q in cause.parameters]
        scale = 1e-6 if kind == "law" else 1.0
        numbers = [float(x) for x in rng.uniform(0.1, 2.0 if kind == "law" else 9.0, n_numbers) * scale]
        out = [[3.0, 1e6, 0.1, 0.5, 0.2, 60.0]] if kind == "law" else []
        # Python first: it raises where machine code would write next to the array.
        buffers = [_Numbers(numbers_) for numbers_ in out]
        value = function(*numbers, _Numbers(p), *buffers)
        number, array = c_double, POINTER(c_double)
        code = CFUNCTYPE(None if out else number, *[number] * n_numbers, *[array] * n_lists)(address(kind, function))
        lists = [(c_double * len(x))(*x) for x in (p, *out)]
        back = code(*numbers, *lists)
        found, expected = (list(lists[1]), list(buffers[0])) if out else ([back], [value])
        worst = max(worst, _apart(np.array(found, float), np.array(expected, float)))
    if not hooks:
        return Outcome("compiled", True, "no function of a slot to compile")
    return _within("compiled", worst, 1e-14, f"{', '.join(hooks)} as machine code against Python: relative difference")


def law_derivatives(cause: Term, rng: np.random.Generator, among: Sequence[Term] = ()) -> Outcome:
    """Derivatives of a law, on its own and after each other law, against differences of its forces."""
    assert cause.law
    k_c, c_c, h = 1e6, 50.0, 1e-4
    worst, where = 0.0, "alone"

    def force(d: float, rate: float, before: Term | None, values: list[list[float]]) -> list[float]:
        out = [k_c * d, k_c, 0.0, c_c * rate, 0.0, c_c]
        for t, p in zip((before, cause), values, strict=True):
            if t and t.law:
                t.law(d, rate, p, out)
        return out

    for before in (None, *(t for t in among if t.law)):
        for d in (2.3e-6, 4e-8, -3e-7):
            rate = float(rng.normal(0, 0.02))
            values = [[some(p, rng) for p in t.parameters] if t else [] for t in (before, cause)]
            out = force(d, rate, before, values)
            up, down = (force(d * (1 + e), rate, before, values) for e in (h, -h))
            fast, slow = (force(d, rate * (1 + e), before, values) for e in (h, -h))
            for given, part, (more, less), x in (
                (1, 0, (up, down), d), (4, 3, (up, down), d), (2, 0, (fast, slow), rate), (5, 3, (fast, slow), rate)
            ):  # fmt: skip
                slope = (more[part] - less[part]) / (2 * h * x)
                error = abs(out[given] - slope) / max(1e-6 * abs(slope), 1e-7 * abs(out[part] / x), 1e-300)
                if not error <= worst:
                    worst, where = error, f"after {before.id}" if before else "alone"
    text = f"of the law against differences, worst {where}, in units of the allowed error"
    return _within("derivatives", worst, 1.0, text)


# --- neutral values -------------------------------------------------------------------------------------------------


def rows(cause: Term, strength: float, rng: np.random.Generator, counts: Counts) -> FloatArray:
    """The rigs, and as many draws from the baseline's prior, with the cause at a strength and its others anywhere."""
    thetas = [*RIGS.values(), *([some(p, rng) for p in baseline.PARAMETERS] for _ in RIGS)]
    others = [[some(p, rng) for p in cause.parameters[1:]] for _ in thetas]
    free = [[some(cause.latent, rng) for _ in range(counts.latents(cause))] if cause.latent else [] for _ in thetas]
    return np.array([[*t, strength, *o, *f] for t, o, f in zip(thetas, others, free, strict=True)])


def neutral(cause: Term, design: Design, rng: np.random.Generator) -> Outcome:
    """At the neutral value of its strength the cause is not there."""
    p = cause.strength
    assert p.neutral is not None
    sets = rows(cause, p.neutral, rng, design.counts)
    base = simulate(design, sets[:, :3]).launch_range
    worst = _apart(simulate(design, sets, [cause]).launch_range, base)
    text = f"{p.name} = {p.neutral:g} against the baseline, {_size(sets, design)}: relative difference"
    return _within("neutral", worst, 1e-10, text)


def approached(cause: Term, design: Design, rng: np.random.Generator, *, step: float = 1e-11) -> Outcome:
    """A vanishing strength tends to the baseline, or to the limit that the cause declares.

    What is a `step` from neutral in the sampling coordinate counts as vanishing: a cause that is plausible at a
    thousand times what shows changes the least ranges by a thousand times this.
    """
    p = cause.strength
    assert p.neutral is not None
    u = float(p.to_sampling(p.neutral))
    id, values = cause.limit or ("", ())
    worst = 0.0
    for near in (u - step, u + step):
        if p.sampling_bounds.lower <= near <= p.sampling_bounds.upper:
            sets = rows(cause, float(p.to_physical(near)), rng, design.counts)
            limit = np.hstack([sets[:, :3], np.tile(values, (len(sets), 1))])
            base = simulate(design, limit, [term(id)] if id else ()).launch_range
            worst = max(worst, _apart(simulate(design, sets, [cause]).launch_range, base))
    text = f"{p.name} next to {p.neutral:g} against {id or 'the baseline'}: relative difference"
    return _within("continuous", worst, 1e-6, text)


def _size(sets: FloatArray, design: Design) -> str:
    return f"{len(sets)} parameter sets x {design.n_points} readings"


# --- what it does ---------------------------------------------------------------------------------------------------


def symptom(cause: Term, constants: Constants = STUDY, drives: Sequence[Drive] = (), volts: float = 20.0) -> Outcome:
    """The declared symptom is what the simulator shows.

    It is declared for sine and square. Of other `drives`, driven up to `volts`, it also checks what the simulator
    shows, which must not be the opposite sign, nor anything where the cause has no meaning.
    """
    if any(not d.plain or d.waveform not in ("sine", "square") for d in drives):
        return _symptom_on(cause, constants, drives, volts)
    declared, observed = cause.symptom, observe(cause, constants)
    names = ("sign", "frequency", "amplitude", "waveforms")
    pairs = [(name, getattr(declared, name), getattr(observed, name)) for name in names]
    wrong = [f"{name} {_word(said)} declared, {_word(seen)} computed" for name, said, seen in pairs if said != seen]
    agreed = ", ".join(f"{name} {_word(seen)}" for name, _, seen in pairs)
    return Outcome("symptom", not wrong, "; ".join(wrong) or f"as declared: {agreed}")


def _symptom_on(cause: Term, constants: Constants, drives: Sequence[Drive], volts: float) -> Outcome:
    seen = observe(cause, constants, drives, volts)
    meant = list(dict.fromkeys(d.label for d in drives if cause.acts_on(d)))
    wrong = []
    if seen.sign * cause.symptom.sign < 0:
        wrong.append(f"sign {cause.symptom.sign} declared, {seen.sign} computed")
    wrong += [f"does something on {label}, where it has no meaning" for label in seen.waveforms if label not in meant]
    wrong += [f"does nothing on {label}" for label in meant if label not in seen.waveforms]
    does = f"sign {seen.sign}, frequency {seen.frequency}, amplitude {seen.amplitude}"
    return Outcome("symptom", not wrong, "; ".join(wrong) or f"on {_word(tuple(meant)) or 'no drive here'}: {does}")


def _word(value: Any) -> str:
    return " and ".join(value) if isinstance(value, tuple) else str(value)


def moved(cause: Term, design: Design) -> Outcome:
    """Every parameter moves the prediction: from a plausible value to one of the two that bound 80 % of its prior."""
    usual = plausible(cause)
    sizes = {}
    for i, p in enumerate(cause.parameters):
        changed = np.array([usual, usual])
        changed[:, i] = p.to_physical(p.prior_quantile([0.1, 0.9]))
        sizes[p.name] = max(_shift(cause, design, theta, row, usual) for theta in RIGS.values() for row in changed)
    if cause.latent:
        sizes[cause.latent.name] = float(np.abs(effect(cause, design).log_change).max(axis=1).min())
    least = {name: 1e-3 if cause.latent and name == cause.latent.name else 1e-4 for name in sizes}
    still = [name for name in sizes if not sizes[name] > least[name]]
    text = ", ".join(f"{name} by up to {size:.2g}" for name, size in sizes.items())
    said = f"{text} standard deviations of a usual scatter"
    return Outcome("parameters", not still, said + "".join(f"; {name} moves nothing" for name in still))


def _shift(cause: Term, design: Design, theta: ArrayLike, one: FloatArray, other: FloatArray) -> float:
    difference = effect(cause, design, theta, one).deviation - effect(cause, design, theta, other).deviation
    return float(np.abs(difference).max())


def path(cause: Term, design: Design, of_steps: float = 1e-6) -> Outcome:
    """The path announced is the one taken, and agrees with fine steps: a closed form to 1e-6, steps to `of_steps`."""
    sets = np.concatenate([REFERENCE, plausible(cause), [0.3] * design.counts.latents(cause)])
    found = simulate(design, sets, [cause])
    steps = simulate(design, sets, [cause], path="stepper", tolerance=1e-9)
    worst, announced = _apart(found.launch_range, steps.launch_range), path_of([cause])
    same = found.engine == announced
    text = f"simulated by the {found.engine}{'' if same else f', announced {announced}'}; against fine steps:"
    allowed = 1e-6 if announced == "closed form" else of_steps
    text = f"{text} relative difference {worst:.2g}, allowed {allowed:g}"
    return Outcome("path", same and worst <= allowed, text, worst, allowed)


# --- all of it ------------------------------------------------------------------------------------------------------


def check(
    cause: Term,
    design: Design | None = None,
    *,
    draws: int = 40,
    seed: int = 1,
    fine: float = 1e-8,
    usual: float = 1e-5,
) -> Iterator[Outcome]:
    """Hold one cause to the whole contract, check by check.

    Parameters
    ----------
    cause : Term
    design : Design, optional
        Conditions and rig; `usual_design` by default.
    draws : int
        Compared with the reference, alone; one more in the company of each other cause.
    seed : int
    fine : float
        Tolerance of the steps that leaves no error of theirs in a comparison with the reference.
    usual : float
        What usual steps may err by.

    Yields
    ------
    Outcome
        A check that raises has failed. Where a function of a slot does not compile, the simulator is not let near it.
    """
    cause = of_ranges(cause)
    design = usual_design() if design is None else design
    few = design.points(np.arange(0, design.n_points, max(1, design.n_points // 30)))
    constants, drives = design.constants, design.used
    volts = float(design.amplitude.max())
    others = [t for t in TERMS if t.id != cause.id]
    order = [t.id for t in (*TERMS, cause)]

    def rng(number: int) -> np.random.Generator:
        return np.random.default_rng([seed, zlib.crc32(cause.id.encode()), number])

    def alone() -> Outcome:
        chance = rng(2)
        return agreement([draw(chance, [cause], constants, drives) for _ in range(draws)], finer=fine)

    def at_bounds() -> Outcome:
        chance = rng(3)
        twice = [e for e in edges(cause.parameters) for _ in range(2)]
        return agreement([draw(chance, [cause], constants, drives, **e) for e in twice], "bounds", fine)

    def in_company() -> Outcome:
        chance = rng(4)
        pairs = [sorted((cause, other), key=lambda t: (SLOTS.index(t.slot), order.index(t.id))) for other in others]
        return agreement([draw(chance, pair, constants, drives) for pair in pairs], "in company", fine)

    statements: list[tuple[str, Callable[[], Outcome]]] = [
        ("declaration", partial(declaration, cause)),
        ("by hand", partial(by_hand, cause)),
        ("compiled", partial(compiled, cause, rng(0))),
    ]
    simulated: list[tuple[str, Callable[[], Outcome]]] = [
        ("neutral", partial(neutral, cause, design, rng(5))),
        ("continuous", partial(approached, cause, few, rng(6))),
        ("reference", alone),
        ("bounds", at_bounds),
        ("in company", in_company),
        ("path", partial(path, cause, design, usual)),
        ("symptom", partial(symptom, cause, constants, drives, volts)),
        ("parameters", partial(moved, cause, design)),
    ]
    if cause.law:
        simulated.insert(0, ("derivatives", partial(law_derivatives, cause, rng(1), others)))
    for name, run in statements:
        outcome = _guarded(name, run)
        yield outcome
    if not outcome.passed:
        return
    for name, run in simulated:
        yield _guarded(name, run)


def _guarded(check: str, run: Callable[[], Outcome]) -> Outcome:
    try:
        return run()
    except Exception as error:  # whatever a foreign function raises is its failure, not ours
        found = blamed(error)
        return Outcome(check, False, message_of(error) if found is None else f"line {found.line}: {message_of(error)}")
