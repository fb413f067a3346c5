r"""What a cause declares, and the rig it acts on.

A cause changes the baseline in one of two ways, or both. It *sets a number of the rig* (`Term.setup`): a mass, a
gap, a time constant; the engine gives every such number its meaning, once. Or it *puts a function into a slot*
(`law`, `stack_factor`, `branch`, `deceleration`, `reading`); the engine calls whatever functions the chosen causes
bring, so that a new one needs no change there. Functions of the slots are scalar Python, compiled on first use.

Each cause says the same a second time for the scalar reference (`Term.literal`), written as in the literature.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from psafit.arrays import FloatArray
from psafit.drives import WAVEFORMS, Drive
from psafit.experiment import Conditions, Constants, GroupId, Occasions, session_name
from psafit.observables import LAUNCH_RANGE, OBSERVABLES
from psafit.parameters import Parameter

Memory = Callable[[float, float, float], float]
Reading = Callable[[float, int], float]
Slot = Literal["drive", "stack", "contact", "flight", "reading"]
Trend = Literal["grows", "falls", "flat", "mixed"]
Drives = Literal["every", "stated", "shifting"]
DRIVES: dict[str, str] = {
    "every": "acts on every drive",
    "stated": "acts on every drive but a recorded one, whose voltage is known",
    "shifting": "acts on waveforms whose phase is free: not on those of jumps, nor on tables and recordings",
}
"""On which drives a cause has a meaning, in words."""
_OF_FLIGHT = frozenset({"displacement", "velocity"})
SLOTS: tuple[Slot, ...] = ("drive", "stack", "contact", "flight", "reading")


@dataclass(frozen=True)
class Setup:
    """The rig's numbers for a batch of parameter sets; arrays of shape (n_sets,).

    Parameters
    ----------
    k_c : array, N/m
        Contact stiffness.
    c_s : array, N s/m
        Structural damping.
    c_c : array, N s/m
        Contact damping.
    m : array, kg
        Stack.
    M : array, kg
        Ball.
    k_s : array, N/m
        Stack stiffness.
    q : array, m/V
        Free stroke per volt; the drive's force is ``k_s q u``.
    l : array, m
        String.
    g : array, m/s^2
    phase : array, rad
        At which the command starts, in addition to its own; one of jumps, or from a table, ignores it.
    lag : array, s
        Time constant of the amplifier: ``u' = (V_cmd - u)/lag``; 0: the voltage is the command.
    inverse_slew : array, s/V
        One over the largest rate of the voltage; 0: no limit. A voltage that has fallen behind runs at the
        largest rate until it meets the command (without lag), or until the lag asks for less.
    gap : array, m
        Distance of the ball from the tip at rest.
    lean : array, m
        How far the pendulum's equilibrium lies behind the ball's place of rest: the ball presses with ``M g lean/l``.
    bond : array, N
        The contact holds past d = 0 until ``k_c |d|`` exceeds it.
    pull : array
        What is left of a negative contact force while d >= 0; 1: all of it.
    cycles : array
        Periods of the drive within which the tip may strike a launched ball again, unless the ball has reached the
        apex of its hop before; 0: one contact.
    grip : array, m/s^2
        Friction on the ball before the hop, over its mass: against its motion in contact and between strikes; a ball at
        rest is held by up to as much.
    rub : array, m/s^2
        The same in the hop.
    wall_mass : array, kg
        Of the wall that the stack stands on; without a mass it stands still.
    wall_stiffness : array, N/m
        Of the wall.
    wall_damping : array, N s/m
        Of the wall.
    scale : array
        Factor on the amplitude of the command; a recorded voltage ignores it.
    idle : array, V
        Added to the voltage at which the drive rests before and after; a recorded voltage, which shows it, ignores it.
    """

    k_c: FloatArray
    c_s: FloatArray
    c_c: FloatArray
    m: FloatArray
    M: FloatArray
    k_s: FloatArray
    q: FloatArray
    l: FloatArray
    g: FloatArray
    phase: FloatArray
    lag: FloatArray
    inverse_slew: FloatArray
    gap: FloatArray
    lean: FloatArray
    bond: FloatArray
    pull: FloatArray
    cycles: FloatArray
    grip: FloatArray
    rub: FloatArray
    scale: FloatArray
    idle: FloatArray
    wall_mass: FloatArray
    wall_stiffness: FloatArray
    wall_damping: FloatArray

    @classmethod
    def of(cls, constants: Constants, theta: FloatArray) -> Setup:
        """Return the baseline; `theta` is (n_sets, 3): k_c (N/m), c_s, c_c (N s/m)."""
        k_c, c_s, c_c = theta.T
        numbers = {f.name: np.zeros(len(theta)) for f in dataclasses.fields(cls)}
        numbers |= {f.name: np.full(len(theta), getattr(constants, f.name)) for f in dataclasses.fields(constants)}
        one = np.ones(len(theta))
        return cls(**numbers | {"k_c": k_c, "c_s": c_s, "c_c": c_c, "pull": one, "scale": one})

    def take(self, sets: NDArray[np.intp] | slice) -> Setup:
        """Some of the parameter sets."""
        return Setup(*(getattr(self, f.name)[sets] for f in dataclasses.fields(self)))

    def records(self) -> NDArray[np.void]:
        """One record a set, (n_sets,), with the numbers under their names, as the compiled engine takes them."""
        found = np.empty(len(self.k_c), [(f.name, float) for f in dataclasses.fields(self)])
        for name in found.dtype.names or ():
            found[name] = getattr(self, name)
        return found

    def change(self, **numbers: FloatArray) -> Setup:
        """Return a setup with some numbers replaced."""
        return dataclasses.replace(self, **numbers)


@dataclass
class ReferenceRig:
    """One rig as the scalar reference sees it; a cause's `literal` edits it.

    Numbers as in `Setup`, with `slew` (V/s) the limit itself; functions as the literature writes them.

    Parameters
    ----------
    stroke : callable
        ``stroke(u)``: free displacement, m, of the stack at voltage `u`; the drive's force is ``k_s (stroke - sum z)``.
    memories : list of callable
        Each ``rate(z, u, du)``: rate, m/s, of a hysteresis state `z` (m) of its own, at voltage `u` (V) and its rate
        `du` (V/s).
    elastic, damping : callable
        ``elastic(d, rate)``, ``damping(d, rate)``: the two parts of the contact force, N.
    deceleration : callable
        ``deceleration(x, v)``: tangential deceleration, m/s^2, of the swinging ball in addition to gravity's.
    offset_weight : float
        Weight of the ball's place at separation in the swing's energy.
    reading : callable
        ``reading(L, group)``: what is read, m, of a launch range `L` (m) by reader number `group`:
        by default each session has one.
    readings : dict of str to callable
        The same of other observables, by name, in SI units; what is not there is read as it is.
    frequency, amplitude : float, Hz, V
        Of the drive of this launch, once it begins; a reading may depend on them.
    """

    k_c: float
    c_s: float
    c_c: float
    m: float
    M: float
    k_s: float
    q: float
    l: float
    g: float
    phase: float = 0.0
    lag: float = 0.0
    slew: float = math.inf
    gap: float = 0.0
    lean: float = 0.0
    bond: float = 0.0
    pull: float = 1.0
    cycles: float = 0.0
    grip: float = 0.0
    rub: float = 0.0
    scale: float = 1.0
    idle: float = 0.0
    wall_mass: float = 0.0
    wall_stiffness: float = 0.0
    wall_damping: float = 0.0
    stroke: Callable[[float], float] = field(init=False)
    memories: list[Memory] = field(default_factory=list)
    elastic: Callable[[float, float], float] = field(init=False)
    damping: Callable[[float, float], float] = field(init=False)
    deceleration: Callable[[float, float], float] = field(init=False)
    reading: Reading = field(init=False)
    readings: dict[str, Reading] = field(default_factory=dict)
    offset_weight: float = 0.0
    frequency: float = math.nan
    amplitude: float = math.nan

    def __post_init__(self) -> None:
        self.stroke = lambda u: self.q * u
        self.elastic = lambda d, rate: self.k_c * d
        self.damping = lambda d, rate: self.c_c * rate
        self.deceleration = lambda x, v: 0.0
        self.reading = lambda L, group: L

    def read(self, observable: str, value: float, group: int) -> float:
        """What is read of the value of an observable, SI units, in a session."""
        reading = self.reading if observable == LAUNCH_RANGE.name else self.readings.get(observable)
        return float(reading(value, group)) if reading else value


@dataclass(frozen=True)
class Symptom:
    """What a cause does to the launch range, in words and in a form that can be checked against the simulator.

    The form is that of plain sines and squares; `Term.drives` says on which others the cause acts.

    Parameters
    ----------
    text : str
        For a reader: which scaling, which region.
    sign : {-1, 0, 1}
        Does a larger value (away from neutral) lower or raise the launch range; 0: both occur.
    frequency, amplitude : {"grows", "falls", "flat", "mixed"}
        How the relative effect changes with drive frequency and with voltage.
    waveforms : tuple of str
        On which of sine and square the cause acts.
    """

    text: str
    sign: Literal[-1, 0, 1]
    frequency: Trend
    amplitude: Trend
    waveforms: tuple[str, ...] = ("sine", "square")


@dataclass(frozen=True)
class Check:
    """A value worked out by hand, away from neutral.

    Parameters
    ----------
    working : str
        The calculation, for a reader.
    value : callable
        Asks the cause's own functions for it.
    expected : float
    tolerance : float
        Relative.
    """

    working: str
    value: Callable[[], float]
    expected: float
    tolerance: float = 1e-12


@dataclass(frozen=True)
class OfSession:
    """What a session has by a cause with a latent parameter, as people know it: a gain, a length.

    Parameters
    ----------
    title : str
    unit : str
        "1" of a factor.
    value : callable
        ``value(p)``, (n_sets,), of the cause's parameters and the session's own value behind them.
    """

    title: str
    unit: str
    value: Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Term:
    """A candidate cause.

    Parameters
    ----------
    id : str
    slot : {"drive", "stack", "contact", "flight", "reading"}
    title : str
        A few words.
    equation : str
        LaTeX, one line, without dollar signs.
    description : str
        The module's docstring: the equation and where it comes from.
    parameters : tuple of Parameter
        Each with a neutral value; at neutral values of all of them the cause vanishes exactly.
    symptom : Symptom
    reference : str
    checks : tuple of Check
    literal : callable
        ``literal(rig, p)`` edits a `ReferenceRig` for the scalar reference; `p` as floats.
    probability : float
        How probable it is, before any reading, that the cause is at work. The default is a surprise: of 25 such causes
        one is expected.
    because : str
        Why. A cause of your own may leave it out.
    look : str
        What to look at on the rig to see it without launches, and with what. Empty where no simple look shows it.
    setup : callable, optional
        ``setup(rig, p)`` returns the changed `Setup`; `p` is (n_sets, n_parameters). With a latent parameter it is
        asked for one session after the other, and `p` has one more column: the session's own value.
    law : callable, optional
        ``law(d, rate, p, out)`` changes the contact force in place; `out` holds the elastic force, its derivatives
        by indentation and rate, then the damping force and its two.
    stack_factor : callable, optional
        ``stack_factor(size, p)``: factor on the stroke at voltage ``+-size``. `size` is the voltage's magnitude, and
        negative where the engine looks past a zero of the drive: continue the formula smoothly.
    branch : callable, optional
        ``branch(z0, u0, u, q, p)``: hysteresis state, m, reached from `z0` by moving the voltage one way, `u0` to `u`.
    deceleration : callable, optional
        ``deceleration(x, v, p)``, m/s^2, of the swinging ball at distance `x` (m) along its arc and speed `v` > 0.
    swing_offset : callable, optional
        ``swing_offset(p)``: (n_sets,) weights of the ball's place at separation in the swing's energy.
    reading : callable, optional
        ``reading(L, p, group)``: (n_sets, n_points) ranges, m, as read; `group` (n_points,) numbers the sessions, and
        with a `latent` the readers: the instruments, each in each session.
    condition : callable, optional
        ``condition(frequency, amplitude, p)``: (n_sets, n_points) factors on the ranges as read, at each reading's
        drive frequency, Hz, and amplitude, V, (n_points,). It describes what depends on the condition and names no
        mechanism.
    reads : tuple of str
        Observables whose readings `reading` and `condition` change, each in its SI unit; `literal` then edits
        `ReferenceRig.reading` for one after the other. What reads others than launch ranges does nothing else.
    latent : Parameter, optional
        One more parameter for every session, appended to `p` in their order; to that of `setup`, the one of the session
        in question. Without `setup` there is one for every reader, an instrument in a session.
    of_session : OfSession, optional
        What each session has by it; fits and diagnoses report that.
    redefines : tuple of (str, str)
        Parameters of the baseline that are something else with it, and what: a noun with its article.
    limit : (str, tuple of float), optional
        Where a vanishing strength does not tend to the baseline: the cause it tends to, with that one's values. The
        description says why.
    drives : {"every", "stated", "shifting"}
        On which drives it has a meaning; see `DRIVES`.
    plugin : str
        Leading digits of the SHA-256 of the file, where that is no part of psafit; set when it is read.
    """

    id: str
    slot: Slot
    title: str
    equation: str
    description: str
    parameters: tuple[Parameter, ...]
    symptom: Symptom
    reference: str
    checks: tuple[Check, ...]
    literal: Callable[[ReferenceRig, Sequence[float]], None]
    probability: float = 0.04
    because: str = ""
    look: str = ""
    setup: Callable[[Setup, FloatArray], Setup] | None = None
    law: Callable[[float, float, Any, Any], None] | None = None
    stack_factor: Callable[[float, Any], float] | None = None
    branch: Callable[[float, float, float, float, Any], float] | None = None
    deceleration: Callable[[float, float, Any], float] | None = None
    swing_offset: Callable[[FloatArray], FloatArray] | None = None
    reading: Callable[[FloatArray, FloatArray, NDArray[np.int64]], FloatArray] | None = None
    condition: Callable[[FloatArray, FloatArray, FloatArray], FloatArray] | None = None
    reads: tuple[str, ...] = (LAUNCH_RANGE.name,)
    latent: Parameter | None = None
    of_session: OfSession | None = None
    redefines: tuple[tuple[str, str], ...] = ()
    limit: tuple[str, tuple[float, ...]] | None = None
    drives: Drives = "every"
    plugin: str = ""

    def __post_init__(self) -> None:
        if not self.id.isidentifier() or self.id != self.id.lower():
            raise ValueError(f"cause {self.id!r}: the identifier is not lower-case snake case")
        if self.slot not in SLOTS:
            raise ValueError(f"{self.id}: no slot {self.slot!r}; slots are {', '.join(SLOTS)}")
        if not self.parameters:
            raise ValueError(f"{self.id}: a cause without a parameter cannot vanish")
        for parameter in self.parameters:
            if parameter.neutral is None and parameter is self.parameters[0]:
                raise ValueError(f"{self.id}: parameter {parameter.name} has no neutral value")
        if not 0.0 < self.probability < 1.0:
            raise ValueError(f"{self.id}: probability {self.probability} is not between 0 and 1")
        if not self.checks:
            raise ValueError(f"{self.id}: no check by hand")
        if self.drives not in DRIVES:
            raise ValueError(f"{self.id}: no drives {self.drives!r}; there are {', '.join(DRIVES)}")
        if type(self.reads) is not tuple or not self.reads or len({*self.reads}) < len(self.reads):
            raise ValueError(f"{self.id}: reads is {self.reads!r}; give a tuple of observables, each once")
        if unknown := [name for name in self.reads if name not in {o.name for o in OBSERVABLES}]:
            known = ", ".join(o.name for o in OBSERVABLES)
            raise ValueError(f"{self.id}: there is no observable {unknown[0]!r} to read; there are {known}")
        if self.reads != (LAUNCH_RANGE.name,) and {*self.hooks} - {self.reading, self.condition}:
            raise ValueError(f"{self.id}: what changes readings of {', '.join(self.reads)} can do nothing else")
        if self.of_session and not self.latent:
            raise ValueError(f"{self.id}: what a session has by it asks for a latent parameter")
        if not self.hooks:
            raise ValueError(f"{self.id}: neither sets a number of the rig nor fills a slot")

    @property
    def hooks(self) -> tuple[Callable[..., object], ...]:
        """Functions of the cause on the fast path, as far as it has them."""
        every = (
            self.setup, self.law, self.stack_factor, self.branch, self.deceleration, self.swing_offset, self.reading,
            self.condition,
        )  # fmt: skip
        return tuple(face for face in every if face)

    @property
    def strength(self) -> Parameter:
        """The first parameter: at its neutral value the cause vanishes, whatever the others are."""
        return self.parameters[0]

    @property
    def signature(self) -> str:
        """What a stored result knows it by: the identifier, and of a plugin the file."""
        return signature(self.id, self.plugin)

    @property
    def determinants(self) -> list[Any]:
        """What a search among causes knows it by: the signature, its probability, and those of its parameters."""
        latent = [self.latent] if self.latent else []
        return [self.signature, self.probability, *(p.signature for p in (*self.parameters, *latent))]

    def acts_on(self, drive: Drive) -> bool:
        """Whether it has a meaning on a drive."""
        if self.drives == "shifting":
            return drive.waveform in WAVEFORMS and WAVEFORMS[drive.waveform].shifts
        return self.drives == "every" or not drive.recorded

    @property
    def after_launch(self) -> bool:
        """Whether it acts on the flight and on the reading alone, so that only what is `shown_in` can show it."""
        return self.setup is None and not self.stepped

    @property
    def shown_in(self) -> frozenset[str]:
        """Observables that can show what acts after the launch: what it `reads`, and the ball's flight."""
        return frozenset(self.reads) | (_OF_FLIGHT if self.deceleration else frozenset())

    @property
    def by_session(self) -> bool:
        """Whether every session has a rig of its own, and not only a reading."""
        return self.latent is not None and self.setup is not None

    @property
    def per(self) -> Literal["sessions", "readers"]:
        """What has a latent value: each session, or, where the cause changes readings alone, each instrument in it."""
        return "readers" if self.latent and not self.setup else "sessions"

    def having(self, occasions: Occasions) -> tuple[GroupId, ...]:
        """The sessions, or the readers, whose latent value does something: those that read what the cause changes."""
        if self.latent is None:
            return ()
        if self.per == "sessions":
            return occasions.sessions
        both = zip(occasions.readers, occasions.read, strict=True)
        return tuple(id for id, read in both if not read.isdisjoint(self.reads))

    def latent_names(self, occasions: Occasions) -> list[str]:
        """Names of the latent parameters that the simulator takes, one for every session, or reader."""
        return [session_name(self.latent.name, id) for id in occasions.numbered(self.per)] if self.latent else []

    @property
    def stepped(self) -> bool:
        """Whether a function of this cause acts while the ball is in contact, so that the motion has no closed form."""
        return not (self.law is None and self.stack_factor is None and self.branch is None)


def signature(id: str, plugin: str) -> str:
    """See `Term.signature`."""
    return f"{id}@{plugin}" if plugin else id


def idle(causes: Iterable[Term], groups: Sequence[Conditions]) -> list[str]:
    """Causes that act on none of some groups' drives, or that nothing shows that is read there."""

    def acts(term: Term, group: Conditions) -> bool:
        read = {o.name for o in group.observables}
        return term.acts_on(group.drive) and not (term.after_launch and read.isdisjoint(term.shown_in))

    return [t.id for t in causes if not any(acts(t, g) for g in groups)]
