r"""Which causes a design can distinguish, before anything is measured.

At a place :math:`\theta` of the baseline, cause :math:`i` at a plausible strength changes readings by :math:`e_i`, in
standard deviations of the scatter (`psafit.simulate.sensitivity`). With :math:`P` the projection on what refitted
parameters of the baseline cannot imitate, and :math:`Q_M` that on what the effects of a model's causes span with it,

.. math:: N_{i|M} = \tfrac12 \lVert (1 - Q_M) P e_i \rVert^2

are the nats by which readings that cause :math:`i` has made will speak against model :math:`M`, on average. It is the
expected difference of the best log likelihoods in the linearised problem. :math:`N_{i|0}`, with nothing in :math:`M`,
says whether the cause is seen at all. Effects bend with their strength: a cause of :math:`M` is taken at several
strengths, and the one that imitates best counts. Of the places in the baseline that are tried the median is reported.

A cause *may be taken for* another where its readings speak less than a threshold against that. Two are *confounded*
where each may be taken for the other; a *block* holds the causes that are connected so. Effects are finite, but the
refit is linear: of a cause that changes the readings many times over the numbers say in which direction, not how far. A
reading that a launch does not give with the cause, or without it, is left out. Samples of a trace have correlated
errors: what counts of each is what it says beyond the one before, as in the likelihood
(`psafit.inference.noise.whitened`).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from psafit.arrays import FloatArray
from psafit.diagnose.possible import Possible, TraceSettings, contact_times, may_be_read, proposals, traces
from psafit.experiment import Constants
from psafit.experiment.records import Conditions
from psafit.inference import noise
from psafit.observables import LAUNCH_RANGE, NUMBERED, OBSERVABLES
from psafit.physics.term import Term
from psafit.records import ABSENT
from psafit.simulate import Design, readings, simulate
from psafit.simulate.sensitivity import RIGS, in_scatter, plausible, reading_slopes, sets_with


@dataclass(frozen=True)
class IsolabilitySettings:
    """Options of `isolability`.

    Parameters
    ----------
    apart : float
        Nats from which on readings speak clearly against a model; three are odds of twenty to one.
    strength : float
        Strength of the cause that makes the readings, as a share of its prior: see
        `psafit.simulate.sensitivity.plausible`.
    imitating : tuple of float
        Strengths at which another cause may imitate it.
    relative, absolute : float, um
        Scatter of launch ranges: a share of the range, and what is added in quadrature. That of other observables has
        the medians of their priors.
    readings : tuple of int
        Numbers of readings of a further sweep that are tried, fewest first; the last is what a proposal has.
    tolerance : float
        Of the simulator, which slopes by differences need.
    trace : TraceSettings
        Of a further trace that is tried.
    stated : dict
        What is known of the scatter, by parameter, in its unit; takes the place of what is usual.
    """

    apart: float = 3.0
    strength: float = 0.5
    imitating: tuple[float, ...] = (0.2, 0.5, 0.8)
    relative: float = 0.05
    absolute: float = 0.3
    readings: tuple[int, ...] = (4, 8, 16)
    tolerance: float = 1e-9
    trace: TraceSettings = field(default_factory=TraceSettings)
    stated: dict[str, float] = field(default_factory=dict)

    def scatter(self, design: Design) -> FloatArray:
        """The scatter of each reading, (1, 3 or 4, n_points), as `psafit.inference.noise.scale` takes it."""
        relative, absolute, _ = LAUNCH_RANGE.scatter
        known = {relative.name: self.relative, absolute.name: self.absolute} | self.stated
        usual = {
            k: np.array([[known.get(p.name, p.prior_median) for p in o.scatter]]) for k, o in enumerate(OBSERVABLES)
        }
        return noise.by_reading(usual, design)


@dataclass(frozen=True)
class ConfoundedPair:
    """Readings of `truth` that speak by so many nats only against `rival`."""

    truth: list[str]
    rival: list[str]
    nats: float


@dataclass(frozen=True)
class Sweep:
    """A further sweep.

    Parameters
    ----------
    text : str
    readings : int
    waveform : str
    frequency_hz, amplitude_v : list of float
    drive : dict
        What else the drive has: see `psafit.diagnose.next_experiment.Proposal`.
    """

    text: str
    readings: int
    waveform: str
    frequency_hz: list[float]
    amplitude_v: list[float]
    drive: dict[str, Any]

    @classmethod
    def of(cls, possible: Possible, points: NDArray[np.intp] | slice = slice(None)) -> Sweep:
        """Some readings of a sweep that the rig allows."""
        d = possible.design
        drive, f, v = d.drives[d.drive[0]], d.frequency[points].tolist(), d.amplitude[points].tolist()
        return cls(possible.text, len(f), drive.waveform, f, v, drive.settings)


@dataclass(frozen=True)
class Split(Sweep):
    """The cheapest sweep that distinguishes the causes of a block.

    Parameters
    ----------
    nats : float
        By which the pair of the block that is hardest to distinguish is reported, with this sweep and what is planned.
    splits : bool
        Whether every pair is reported; else the sweep is the best of those that the rig allows.
    """

    nats: float
    splits: bool


@dataclass(frozen=True)
class TracedLaunch:
    """One more launch, which is followed over time.

    Parameters
    ----------
    text : str
    waveform : str
    frequency_hz, amplitude_v : float
    drive : dict
        As of `Sweep`.
    time_us : list of float
        Samples, from the start of the drive.
    """

    text: str
    waveform: str
    frequency_hz: float
    amplitude_v: float
    drive: dict[str, Any]
    time_us: list[float]

    @classmethod
    def of(cls, possible: Possible) -> TracedLaunch:
        """The launch of a trace that the rig allows."""
        d = possible.design
        drive = d.drives[d.drive[0]]
        f, v, time = float(d.frequency[0]), float(d.amplitude[0]), (d.time * 1e6).tolist()
        return cls(possible.text, drive.waveform, f, v, drive.settings, time)


@dataclass(frozen=True)
class AlsoRead:
    """Another observable: read of every launch that is planned, or a trace of one more.

    Parameters
    ----------
    observable : str
    nats : float
        By which the pair of the block that is hardest to distinguish is reported then.
    splits : bool
        Whether every pair is reported.
    pairs : list of lists of str
        Those that are reported, each way round, and were not before.
    trace : TracedLaunch, optional
        Where it is a trace.
    """

    observable: str
    nats: float
    splits: bool
    pairs: list[list[str]]
    trace: TracedLaunch | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True)
class Shown:
    """Causes that the design does not show, and what would: a further sweep, another observable, or a trace of it.

    Parameters
    ----------
    causes : list of str
    nats : list of float
        By which readings that each of them has made then speak against the baseline.
    sweep : Sweep, optional
    observable : str, optional
        Read of every launch that is planned, or along the trace.
    trace : TracedLaunch, optional
    """

    causes: list[str]
    nats: list[float]
    sweep: Sweep | None = field(default=None, metadata=ABSENT)
    observable: str | None = field(default=None, metadata=ABSENT)
    trace: TracedLaunch | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True)
class Block:
    """Causes that are confounded, and what would split them.

    Parameters
    ----------
    causes : list of str
    split : Split, optional
        A further sweep; None where none was asked for.
    also : AlsoRead, optional
        Another observable, of those that distinguish some pair the one that distinguishes most.
    """

    causes: list[str]
    split: Split | None
    also: AlsoRead | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True)
class Isolability:
    """Which causes a design can distinguish.

    Parameters
    ----------
    title : str
    readings : int
        Of the design.
    causes : list of str
        Rows and columns of `nats`.
    seen : list of float
        Nats by which readings that a cause has made speak against the baseline.
    nats : list of lists of float
        By which readings of the row's cause speak against the column's, both after a refit of the parameters.
    unseen : list of str
        Causes that the design would not show; they are in no block.
    shown : list of Shown
        What would show these, the cheapest first; those that nothing shows that is tried are left out.
    pairs : list of ConfoundedPair
        Two causes that one other one may be had for, and causes that a pair may be had for which neither of it is.
    taken_for : dict
        By cause: those for which its readings may be taken.
    blocks : list of Block
        Of two causes or more.
    settings : IsolabilitySettings
    """

    title: str
    readings: int
    causes: list[str]
    seen: list[float]
    nats: list[list[float]]
    unseen: list[str]
    shown: list[Shown]
    pairs: list[ConfoundedPair]
    taken_for: dict[str, list[str]]
    blocks: list[Block]
    settings: IsolabilitySettings


@dataclass(frozen=True, eq=False)
class Effects:
    """What causes do at one place, in standard deviations of the scatter; along a trace, of its innovations.

    `slopes` (n, n_points) belong to the baseline's parameters; `rows` holds by cause and strength the
    (n_directions, n_points) effects. A cause in `typical` has a direction for each session, and there by strength what
    it does where all sessions are at their medians, (n_points,).
    """

    slopes: FloatArray
    rows: dict[tuple[str, float], FloatArray]
    typical: dict[tuple[str, float], FloatArray]

    @classmethod
    def at(cls, design: Design, theta: FloatArray, terms: Sequence[Term], settings: IsolabilitySettings) -> Effects:
        """The effects in a design, at a place of the baseline."""
        scatter = settings.scatter(design)
        relative, absolute, _ = (row[0] for row in noise.columns(scatter))
        base = readings(design, theta, tolerance=settings.tolerance)[0]
        blank = np.array([OBSERVABLES[k].blank for k in design.measured])

        def changed(term: Term, share: float) -> FloatArray:
            sets = sets_with(term, design, theta, plausible(term, share))
            found = readings(design, sets, (term,), tolerance=settings.tolerance)
            off = in_scatter(found, relative, absolute) - in_scatter(base, relative, absolute)
            return noise.whitened(np.where(blank & ((found == 0.0) | (base == 0.0)), 0.0, off), scatter)

        rows, typical = {}, {}
        for term in terms:
            for share in {settings.strength, *settings.imitating}:
                found = changed(term, share)
                rows[term.id, share] = found[1:] if term.latent else found
                if term.latent:
                    typical[term.id, share] = found[0]
        slopes = reading_slopes(design, theta, tolerance=settings.tolerance)
        slopes = np.where(blank & (base == 0.0), 0.0, slopes)
        return cls(noise.whitened(slopes / np.hypot(absolute, relative * base), scatter), rows, typical)

    def of(self, ids: Sequence[str]) -> Effects:
        """The effects of some of the causes."""
        return Effects(self.slopes, {key: rows for key, rows in self.rows.items() if key[0] in ids}, self.typical)

    def with_part(self, other: Effects, points: NDArray[np.intp]) -> Effects:
        """These effects, with some readings of one more session."""
        rows = {}
        for (id, share), one in self.rows.items():
            more = other.rows[id, share][:, points]
            if (id, share) in self.typical:
                old, new = self.typical[id, share], other.typical[id, share][points]
                rows[id, share] = np.block([[one, np.tile(new, (len(one), 1))], [np.tile(old, (len(more), 1)), more]])
            else:
                rows[id, share] = np.hstack([one, more])
        return Effects(np.hstack([self.slopes, other.slopes[:, points]]), rows, {})

    def refitted(self) -> Effects:
        """What a refit of the baseline cannot imitate."""
        known = _basis(self.slopes)
        return Effects(self.slopes, {key: _outside(rows, known) for key, rows in self.rows.items()}, {})

    def against(self, truth: Sequence[str], rival: Sequence[str], settings: IsolabilitySettings) -> float:
        """Nats by which readings of some causes speak against others; the least over the strengths of one other."""
        made = _summed([self.rows[id, settings.strength] for id in truth])
        shares = settings.imitating if len(rival) == 1 else (settings.strength,)
        left = []
        for share in shares:
            basis = _basis(np.vstack([self.rows[id, share] for id in rival])) if rival else np.empty((0, made.shape[1]))
            left.append(float(np.mean(0.5 * np.sum(_outside(made, basis) ** 2, axis=1))))
        return min(left)


Further = tuple[Possible, Sequence[Effects]]
"""A sweep that the rig allows, and what causes do along it at each place."""


class _Other(NamedTuple):
    """What causes do where another observable is read, too; `trace` where that is a trace of one more launch."""

    name: str
    effects: list[Effects]
    trace: Possible | None = None


def _nats(
    effects: Sequence[Effects], truth: Sequence[str], rival: Sequence[str], settings: IsolabilitySettings
) -> float:
    """By which readings of some causes speak against others: the median of the places."""
    return float(np.median([one.against(truth, rival, settings) for one in effects]))


def _with(planned: Sequence[Effects], further: Iterable[Effects], points: NDArray[np.intp]) -> list[Effects]:
    """What a refit leaves at each place, with some readings of one more session."""
    return [one.with_part(more, points).refitted() for one, more in zip(planned, further, strict=True)]


def _summed(effects: Sequence[FloatArray]) -> FloatArray:
    """Every combination of directions of some causes at work together."""
    return np.array([np.sum(rows, axis=0) for rows in itertools.product(*effects)])


def _outside(rows: FloatArray, basis: FloatArray) -> FloatArray:
    return np.asarray(rows - (rows @ basis.T) @ basis)


def _basis(rows: FloatArray, floor: float = 1e-6) -> FloatArray:
    """Orthonormal rows that span the given ones, but for directions below a part of the largest."""
    _, size, directions = np.linalg.svd(rows, full_matrices=False)
    return np.asarray(directions[size > floor * max(float(size.max(initial=0.0)), 1e-12)])


def isolability(
    title: str,
    constants: Constants,
    groups: Sequence[Conditions],
    limits: Iterable[tuple[str, tuple[float, float]]],
    catalogue: Sequence[Term],
    *,
    readable: Sequence[str] = (),
    settings: IsolabilitySettings | None = None,
    places: Sequence[Sequence[float]] | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Isolability:
    """Ask which causes a design can distinguish.

    Parameters
    ----------
    title : str
    constants : Constants
    groups : sequence of Conditions
        What is measured, or planned.
    limits : pairs of a name and two ends
        Of the rig: see `psafit.diagnose.possible.proposals`.
    catalogue : sequence of Term
    readable : sequence of str
        Columns that may be read besides those that are; all of them if none is given.
    settings : IsolabilitySettings, optional
    places : sequence of (3,) arrays, optional
        Values of the baseline's parameters; those of `psafit.simulate.sensitivity.RIGS` by default.
    progress : callable
        Called with (steps done, steps).

    Returns
    -------
    Isolability
    """
    settings, limits = settings or IsolabilitySettings(), tuple(limits)
    design, at = Design.of(constants, groups), [np.array(p) for p in places or RIGS.values()]
    usual = design.usually_measured
    sweeps = [p.reading(usual, usual, design.measured) for p in proposals(constants, groups, limits) if not p.changed]
    raw = [Effects.at(design, theta, catalogue, settings) for theta in at]
    effects = [one.refitted() for one in raw]
    ids = [t.id for t in catalogue]

    def evidence_against(truth: Sequence[str], rival: Sequence[str] = ()) -> float:
        return _nats(effects, truth, rival, settings)

    seen = [evidence_against([id]) for id in ids]
    nats = [[0.0 if i == j else evidence_against([i], [j]) for j in ids] for i in ids]
    visible = [id for id, size in zip(ids, seen, strict=True) if size >= settings.apart]
    blocks = _blocks(ids, visible, nats, settings.apart)
    confounded = [t for t in catalogue if any(t.id in block for block in blocks)]
    hidden = [t for t in catalogue if t.id not in visible]
    asked = [*confounded, *hidden]
    new = [k for k in may_be_read(readable) if k not in design.measured]
    others = _others(constants, groups, limits, new, raw, at, asked, settings) if asked else []
    more = [(s, [Effects.at(s.design, theta, asked, settings) for theta in at]) for s in sweeps] if asked else []
    split: list[Block] = []
    for k, block in enumerate(blocks):
        progress(k, len(blocks))
        split.append(Block(block, _cheapest(raw, more, block, settings), _also(effects, others, block, settings)))
    return Isolability(
        title=title, readings=design.n_points, causes=ids, seen=seen, nats=nats,
        unseen=[id for id in ids if id not in visible],
        shown=_shown(raw, more, others, [t.id for t in hidden], settings),
        pairs=_pairs(visible, evidence_against, settings.apart),
        taken_for={
            i: near for i in visible
            if (near := [j for j in visible if i != j and nats[ids.index(i)][ids.index(j)] < settings.apart])
        },
        blocks=split, settings=settings,
    )  # fmt: skip


def _pairs(visible: Sequence[str], evidence_against: Callable[..., float], apart: float) -> list[ConfoundedPair]:
    """Pairs that look like a single cause, and single ones that look like a pair of which neither alone does."""
    alone = {(i, j): evidence_against([i], [j]) for i in visible for j in visible if i != j}
    found = []
    for one in visible:
        for pair in itertools.combinations([id for id in visible if id != one], 2):
            if (size := evidence_against(pair, [one])) < apart:
                found.append(ConfoundedPair(list(pair), [one], size))
            if all(alone[one, id] >= apart for id in pair) and (size := evidence_against([one], pair)) < apart:
                found.append(ConfoundedPair([one], list(pair), size))
    return sorted(found, key=lambda x: x.nats)


def _blocks(
    ids: Sequence[str], visible: Sequence[str], nats: Sequence[Sequence[float]], apart: float
) -> list[list[str]]:
    """Causes connected by confounding: components of the graph whose edges are the pairs that may be exchanged."""
    places = [ids.index(id) for id in visible]
    most = np.maximum(np.array(nats), np.array(nats).T)[np.ix_(places, places)]
    n, label = connected_components(most < apart, directed=False)
    found = [[id for id, own in zip(visible, label, strict=True) if own == k] for k in range(n)]
    return [block for block in found if len(block) > 1]


def _reading_also(group: Conditions, measured: int) -> Conditions:
    """A sweep in which one observable more is read of every launch; a trace as it is."""
    if group.time_us is not None:
        return group
    _, first = np.unique(group.row, return_index=True)
    kinds = np.concatenate([group.measured, np.full(first.size, measured)])
    return replace(group.at(np.concatenate([np.arange(group.n_points), first])), measured=kinds)


def _others(
    constants: Constants,
    groups: Sequence[Conditions],
    limits: Iterable[tuple[str, tuple[float, float]]],
    new: Collection[int],
    planned: Sequence[Effects],
    places: Sequence[FloatArray],
    terms: Sequence[Term],
    settings: IsolabilitySettings,
) -> list[_Other]:
    """What causes do where a `new` observable is read, of the same launches or along a trace."""
    found = []
    for k, o in NUMBERED:
        if k in new:
            also = Design.of(constants, [_reading_also(g, k) for g in groups])
            found.append(_Other(o.name, [Effects.at(also, theta, terms, settings).refitted() for theta in places]))

    def contact(design: Design) -> FloatArray:
        return np.asarray(np.fmax.reduce([contact_times(simulate(design, theta))[0] for theta in places]))

    before = [one.of([t.id for t in terms]) for one in planned]
    for p in traces(constants, groups, limits, contact, settings.trace):
        if p.design.measured[0] in new:
            every = np.arange(p.design.n_points)
            further = (Effects.at(p.design, theta, terms, settings) for theta in places)
            found.append(_Other(OBSERVABLES[p.design.measured[0]].name, _with(before, further, every), p))
    return found


def _also(
    planned: Sequence[Effects], others: Sequence[_Other], ids: Sequence[str], settings: IsolabilitySettings
) -> AlsoRead | None:
    """The observable that distinguishes most pairs of a block, and these; None if none does any."""

    def apart(effects: Sequence[Effects]) -> dict[tuple[str, str], float]:
        """Return, by pair, the nats of the side that is harder to show."""
        each = {(a, b): _nats(effects, [a], [b], settings) for a, b in itertools.permutations(ids, 2)}
        return {(a, b): min(each[a, b], each[b, a]) for a, b in itertools.combinations(ids, 2)}

    before, best = apart(planned), None
    for other in others:
        after = apart(other.effects)
        pairs = [list(p) for p in after if before[p] < settings.apart <= after[p]]
        least = min(after.values())
        if pairs and (best is None or (len(pairs), least) > (len(best.pairs), best.nats)):
            trace = TracedLaunch.of(other.trace) if other.trace else None
            best = AlsoRead(other.name, least, least >= settings.apart, pairs, trace)
    return best


def _cheapest(
    planned: Sequence[Effects], further: Sequence[Further], ids: Sequence[str], settings: IsolabilitySettings
) -> Split | None:
    """The sweep of fewest readings that distinguishes all pairs of some causes; the best one where none does."""
    before = [one.of(ids) for one in planned]
    best: Split | None = None
    for n in settings.readings:
        for sweep, more in further:
            points = np.unique(np.linspace(0, sweep.design.n_points - 1, n).round().astype(int))
            effects = _with(before, more, points)
            least = min(_nats(effects, [a], [b], settings) for a, b in itertools.permutations(ids, 2))
            if best is None or least > best.nats:
                best = Split(**vars(Sweep.of(sweep, points)), nats=least, splits=least >= settings.apart)
        if best is not None and best.splits:
            return best
    return best


def _shown(
    planned: Sequence[Effects],
    further: Sequence[Further],
    others: Sequence[_Other],
    ids: Sequence[str],
    settings: IsolabilitySettings,
) -> list[Shown]:
    """What shows causes that the design does not, the cheapest first: sweeps, then other observables, then traces.

    Of each kind first what shows most of them, then what shows most of the rest.
    """
    before = [one.of(ids) for one in planned]
    sweeps = [
        (Shown([], [], sweep=Sweep.of(sweep)), _with(before, more, np.arange(sweep.design.n_points)))
        for sweep, more in further
    ]
    also = [(Shown([], [], observable=one.name), one.effects) for one in others if one.trace is None]
    traced = [
        (Shown([], [], observable=one.name, trace=TracedLaunch.of(one.trace)), one.effects)
        for one in others
        if one.trace
    ]
    found, left = [], list(ids)
    for kind in (sweeps, also, traced):
        seen = [(what, {id: _nats(effects, [id], [], settings) for id in ids}) for what, effects in kind]
        while left and seen:
            what, nats = max(seen, key=lambda each: sum(each[1][id] >= settings.apart for id in left))
            causes = [id for id in left if nats[id] >= settings.apart]
            if not causes:
                break
            found.append(replace(what, causes=causes, nats=[nats[id] for id in causes]))
            left = [id for id in left if id not in causes]
    return found
