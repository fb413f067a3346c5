"""Which measurements a rig allows: sweeps of launches, and traces of one launch over time."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from psafit.arrays import FloatArray
from psafit.drives import Drive
from psafit.experiment import Conditions, Constants, GroupId, changes_text
from psafit.observables import OBSERVABLES
from psafit.simulate import Design, Simulation

_EITHER = (Drive("sine"), Drive("square"))


@dataclass(frozen=True)
class SweepSettings:
    """A sweep that may be proposed.

    Parameters
    ----------
    points : int
        Its readings.
    factors : tuple of float
        On the string's length and the ball's mass, where the experiment states no limits; and on what is held, where a
        stretch is measured again.
    same_rig : float
        Constants closer than this, in their logarithm, are the same rig.
    """

    points: int = 16
    factors: tuple[float, ...] = (0.5, 2.0)
    same_rig: float = 0.05


@dataclass(frozen=True)
class TraceSettings:
    """A trace that may be proposed.

    Parameters
    ----------
    samples : int
        Equally spaced, the last at its end.
    contacts : float
        Its length from the start of the drive, in contact times: the contact, and the beginning of the flight.
    """

    samples: int = 64
    contacts: float = 2.0


@dataclass(frozen=True, eq=False)
class Possible:
    """A measurement that the rig allows; `other` where it reads what was not read before."""

    text: str
    design: Design
    changed: dict[str, float]
    other: bool = False

    @property
    def needs(self) -> tuple[str, ...]:
        """What has to be had for it: constants that are changed, and an observable that was not read before."""
        return (*sorted(self.changed), *([OBSERVABLES[self.design.measured[0]].name] if self.other else []))

    def reading(self, measured: int, usual: int, read: Collection[int]) -> Possible:
        """Return the measurement with an observable read; what is said of the usual one is no more if it was `read`."""
        o, design = OBSERVABLES[measured], replace(self.design, measured=np.full(self.design.n_points, measured))
        text = self.text if measured == usual and usual in read else f"{self.text}, and read {o.titles}"
        return replace(self, text=text, design=design, other=measured not in read)


def may_be_read(readable: Sequence[str], read: Collection[int] = ()) -> list[int]:
    """Observables, by number, that are read, or that have one of some columns; all of them if none is given."""
    return [k for k, o in enumerate(OBSERVABLES) if not readable or o.column in readable or k in read]


def proposals(
    constants: Constants,
    groups: Sequence[Conditions],
    allowed: Iterable[tuple[str, tuple[float, float]]],
) -> list[Possible]:
    """Return the measurements that the rig allows: sweeps within its limits, and each changed constant.

    Parameters
    ----------
    constants : Constants
    groups : sequence of Conditions
        What is measured, or planned.
    allowed : pairs of a name and two ends
        The limits that the experiment states, if any.
    """
    how = SweepSettings()
    points = how.points
    # A recorded voltage is as it is: it can be played again, and to another rig.
    limits = dict(allowed)
    again = [g for g in groups if g.drive.recorded]
    found: list[Possible] = []
    span = _Span.of(constants, groups, limits)
    for words, changed in _rigs(constants, limits, how.factors, how.same_rig):
        rig = replace(constants, **changed)
        found += _sweeps(rig, span, words, changed, points) if span else []
        for g in again:
            f, v = g.frequency_hz[0], g.amplitude_v[0]
            text = f"{points} launches by the recording {g.drive.file}{words}"
            found.append(Possible(text, Design.sweep(rig, g.drive, np.full(points, f), v), changed))
    return list({p.text: p for p in found}.values())


@dataclass(frozen=True)
class _Span:
    """What launches may be driven by, within limits or the span of some groups: Hz, and V of each drive.

    `fixed` are frequencies in between, at which something else is varied, or a trace taken. What one drive was taken to
    may be too much for another, with a bias or of both signs: each has the span of its own groups.
    """

    frequency: tuple[float, float]
    fixed: tuple[float, ...]
    amplitudes: Mapping[Drive, tuple[float, float]]

    @classmethod
    def of(
        cls, constants: Constants, groups: Sequence[Conditions], limits: Mapping[str, tuple[float, float]]
    ) -> _Span | None:
        """Return the span of groups whose frequency and amplitude can be chosen; None without any.

        The samples of a trace are one launch.
        """
        swept = [g for g in groups if not g.drive.recorded and ("amplitude_v" in limits or g.amplitude_v.any())]
        if not swept:
            return None
        every = Design.of(constants, [g if g.time_us is None else g.at(slice(0, 1)) for g in swept])
        low_f, high_f = limits.get("frequency_hz") or np.quantile(every.frequency, (0.02, 0.98)).tolist()
        # Round numbers, unless they are not allowed.
        fixed = (min(max(float(f"{f:.2g}"), low_f), high_f) for f in np.geomspace(low_f, high_f, 6)[1:-1])
        # Who drives with a plain sine or square may do either.
        used = list(dict.fromkeys(g.drive for g in swept))
        drives = dict.fromkeys([*_EITHER, *used] if set(_EITHER) & set(used) else used)
        amplitudes = {}
        for drive in drives:
            same = _EITHER if drive in _EITHER else (drive,)
            volts = np.concatenate([g.amplitude_v[g.amplitude_v > 0] for g in swept if g.drive in same])
            amplitudes[drive] = limits.get("amplitude_v") or _from_least(volts)
        return cls((low_f, high_f), tuple(fixed), amplitudes)


def _from_least(volts: FloatArray) -> tuple[float, float]:
    """Return the least and the largest of some amplitudes; where they hardly differ, from a tenth."""
    bottom, top = float(volts.min()), float(volts.max())
    return (bottom if top > 1.5 * bottom else top / 10), top


def _sweeps(rig: Constants, span: _Span, words: str, changed: dict[str, float], points: int) -> Iterator[Possible]:
    """Sweeps of a rig by frequency and by amplitude."""
    low_f, high_f = span.frequency
    shares = (1.0, 0.5, 0.2) if _say(low_f) != _say(high_f) else ()
    for drive, (bottom, top) in span.amplitudes.items():
        for share in shares:
            volts = max(top * share, min(bottom, top))
            yield _sweep(rig, drive, "frequency", span.frequency, volts, points, words, changed)
        for at in span.fixed:
            yield _sweep(rig, drive, "amplitude", (bottom, top), at, points, words, changed)


def near(
    constants: Constants,
    groups: Sequence[Conditions],
    allowed: Iterable[tuple[str, tuple[float, float]]],
    places: Iterable[tuple[GroupId, str, float, float]],
) -> list[Possible]:
    """Return sweeps of stretches that were measured already: again, by another drive, and on each changed rig.

    Parameters
    ----------
    constants, groups, allowed
        As of `proposals`.
    places : tuples of group id, "frequency" or "amplitude", and two ends
        Each stretch reaches to the readings on either side of it.
    """
    how, limits, found = SweepSettings(), dict(allowed), []
    span = _Span.of(constants, groups, limits)
    for id, variable, low, high in places:
        group = next((g for g in groups if g.id == id), None)
        if span is None or group is None or group.time_us is not None or group.drive not in span.amplitudes:
            continue
        of, other, limit = group.frequency_hz, group.amplitude_v, span.amplitudes[group.drive]
        if variable != "frequency":
            of, other, limit = other, of, span.frequency
        ends = max(of[of < low], default=low), min(of[of > high], default=high)
        held = float(np.median(other))
        elsewhere = [x for x in (held * f for f in how.factors) if limit[0] <= x <= limit[1]]
        for words, changed in _rigs(constants, limits, how.factors, how.same_rig):
            rig = replace(constants, **changed)
            found += [
                _sweep(rig, group.drive, variable, ends, fixed, how.points, words, changed)
                for fixed in ([held] if changed else [held, *elsewhere])
            ]
    return list({p.text: p for p in found}.values())


def _sweep(
    rig: Constants,
    drive: Drive,
    variable: str,
    ends: tuple[float, float],
    held: float,
    points: int,
    words: str,
    changed: dict[str, float],
) -> Possible:
    """A sweep by frequency or by amplitude between two ends; the other is held."""
    between = " to ".join(_say(end, 3 if variable == "frequency" else 4) for end in ends)
    if variable == "frequency":
        text, f, v = f"{_say(held, 4)} V, {between} Hz", np.geomspace(*ends, points), np.full(points, held)
    else:
        text, f, v = f"{_say(held)} Hz, {between} V", np.full(points, held), np.linspace(*ends, points)
    return Possible(f"{_called(drive)}, {text}{words}", Design.sweep(rig, drive, f, v), changed)


def traces(
    constants: Constants,
    groups: Sequence[Conditions],
    allowed: Iterable[tuple[str, tuple[float, float]]],
    contact: Callable[[Design], FloatArray],
    settings: TraceSettings,
) -> list[Possible]:
    """Return the traces that may be taken on the rig as it is: of one launch each, by the largest drive.

    Parameters
    ----------
    constants, groups, allowed
        As of `proposals`.
    contact : callable
        Says of a design how long its contacts last, (n_points,), s; NaN where nothing is launched.
    settings : TraceSettings
    """
    found = []
    launches = [(g.drive, float(g.frequency_hz[0]), float(g.amplitude_v[0])) for g in groups if g.drive.recorded]
    if span := _Span.of(constants, groups, dict(allowed)):
        launches += [(drive, f, top) for drive, (_, top) in span.amplitudes.items() for f in span.fixed]
    for drive, f, v in dict.fromkeys(launches):
        lasts = float(contact(Design.sweep(constants, drive, f, v))[0])
        # A launch that fails is followed for one period.
        length = float(f"{1e6 * (settings.contacts * lasts if math.isfinite(lasts) else 1.0 / f):.2g}")
        time = np.linspace(0.0, length * 1e-6, settings.samples + 1)[1:]
        design = Design.sweep(constants, drive, np.full(settings.samples, f), v)
        where = f"the recording {drive.file}" if drive.recorded else f"{_called(drive)}, {_say(f)} Hz, {_say(v, 4)} V"
        for k, o in enumerate(OBSERVABLES):
            if o.traced:
                of = "tip's displacement" if o.tip else f"ball's {o.title}"
                text = f"a trace of the {of}, {where}, {settings.samples} samples over {length:g} us"
                read = replace(design, time=time, measured=np.full(settings.samples, k))
                found.append(Possible(text, read, {}, other=True))
    return found


def contact_times(found: Simulation) -> FloatArray:
    """How long contacts last, (n_sets, n_points), s; NaN where nothing is launched."""
    return np.where(found.launched, found.separation_time, np.nan)


def _called(drive: Drive) -> str:
    return f"{drive.label} {drive.file}" if drive.table else drive.label


def _rigs(
    constants: Constants, limits: Mapping[str, tuple[float, float]], factors: tuple[float, ...], same: float
) -> Iterator[tuple[str, dict[str, float]]]:
    """The rig as it is, and with each constant that can be changed as far as it can; words, and what is changed."""
    yield "", {}
    if not limits:
        for x in factors:
            yield f", string {x:g} times as long", {"l": constants.l * x}
        for x in factors:
            yield f", ball {x:g} times as heavy", {"M": constants.M * x}
    for name in (f.name for f in fields(constants) if f.name in limits):
        for end in limits[name]:
            if abs(math.log(end / getattr(constants, name))) > same:
                yield changes_text([(name, end)]), {name: end}


def _say(value: float, digits: int = 3) -> str:
    return f"{float(f'{value:.{digits}g}'):.6g}"
