"""Values that are possible but look like a wrong unit, and what `psafit new` has put there to be replaced."""

from __future__ import annotations

import itertools
import math
import tomllib
from collections.abc import Iterable, Sequence
from functools import cache
from importlib.resources import as_file, files

import numpy as np

from psafit.arrays import FloatArray
from psafit.drives import WAVEFORMS, Drive, from_zero, peak_to_peak
from psafit.experiment.records import DEFINITION, Constants, Group, GroupId
from psafit.experiment.rig import MATERIALS, Rig, is_rated_stroke
from psafit.experiment.table import read_csv, readings_of
from psafit.experiment.text import one_line
from psafit.observables import LAUNCH_RANGE, OBSERVABLES, Observable, in_another_unit
from psafit.parameters import Belief
from psafit.text import series

_EXAMPLE = "EXAMPLE, replace:"
_POWER = "is a power of ten wrong?"
_HERTZ = in_another_unit("Hz", ["kHz"], ["mHz"], large=True)
_VOLTS = in_another_unit("V", ["kV"], ["mV"], large=True)
# Wide enough for any rig of this kind, narrow enough to catch a factor of a thousand in the unit: the ends, the unit,
# and what to ask below and above.
_CONSTANTS: dict[str, tuple[float, float, str, str, str]] = {
    "M": (1e-6, 1.0, "kg", _POWER, "is it given in grams?"),
    "m": (1e-6, 1.0, "kg", _POWER, "is it given in grams?"),
    "q": (1e-11, 1e-5, "m/V", _POWER, "is it given in um/V or nm/V?"),
    "l": (1e-3, 10.0, "m", _POWER, "is it given in mm?"),
    "k_s": (1e4, 1e12, "N/m", "is it given in N/um?", _POWER),
    "g": (9.7, 9.9, "m/s^2", "is it given in another unit?", "is it given in cm/s^2?"),
}
# The same of facts. Less than an ohm is what power amplifiers have, or kilo-ohms of a generator.
_FACTS: dict[str, tuple[float, float, str, str, str]] = {
    "ball_radius": (1e-4, 0.1, "m", _POWER, "is it given in mm?"),
    "source_resistance": (1.0, 1e5, "ohm", "is it given in kilo-ohms?", "is it given in milliohms?"),
    "capacity": (1e-10, 1e-3, "F", _POWER, "is it given in uF or nF?"),
    "rated_voltage": (5.0, 5000.0, "V", "is it given in kV?", "is it given in mV?"),
    "rated_stroke": (1e-7, 1e-3, "m", "is it the stroke per volt?", "is it given in um or mm?"),
    "layer_thickness": (1e-6, 5e-3, "m", _POWER, "is it given in um or mm?"),
}


def left_from_example(title: str, source: str, constants: Constants, groups: Sequence[Group]) -> list[str]:
    """One line for what is still the example's: words and constants of the definition, and readings."""
    found = []
    if any(text.startswith(_EXAMPLE) for text in (title, source)):
        found.append(f"{DEFINITION}: title or source is still that of the example; replace it")
    rig, tables = _example()
    there = [g for g in groups if any(_same_readings(g, table) for table in tables)]
    found += [one_line(f"{g.file}: group {g.id}: these readings are the example's; put in your own") for g in there]
    if found and constants == rig:
        found.append(f"{DEFINITION}: all six constants are the example's; put in your rig's")
    return found


@cache
def _example() -> tuple[Constants, list[dict[str, FloatArray]]]:
    """The rig and the columns of the readings that `psafit new` writes."""
    with as_file(files("psafit").joinpath("templates")) as place:
        definition = tomllib.loads((place / DEFINITION).read_text("utf-8"))
        tables = [readings_of(read_csv(place / g["file"])) for g in definition["group"]]
        return Constants(**definition["constants"]), tables


def _same_readings(group: Group, columns: dict[str, FloatArray]) -> bool:
    return all(np.array_equal(getattr(group, name), column) for name, column in columns.items())


def doubt(name: str, value: float) -> tuple[str, str] | None:
    """What is said of a constant or a fact, SI, outside of what such rigs have, and what is asked; None within."""
    low, high, _, below, above = (_CONSTANTS | _FACTS)[name]
    if low <= value <= high:
        return None
    return f"{valued(name, value)} is outside {low:g} to {high:g}", below if value < low else above


def valued(name: str, value: float) -> str:
    """A constant or a fact with its value and unit."""
    constant = "constant " if name in _CONSTANTS else ""
    return f"{constant}{name} = {value:g} {(_CONSTANTS | _FACTS)[name][2]}"


def _outside(values: Constants | Rig, names: Iterable[str]) -> list[str]:
    """What is asked of values, attributes that may be missing."""
    given = ((name, value) for name in names if (value := getattr(values, name)) is not None)
    return ["; ".join(said) for name, value in given if (said := doubt(name, value))]


def suspicious_constants(constants: Constants) -> list[str]:
    """One line for each constant outside what such rigs have."""
    return [f"{DEFINITION}: {text}" for text in _outside(constants, _CONSTANTS)]


def suspicious_facts(
    rig: Rig, constants: Constants, groups: Sequence[Group], beliefs: Sequence[Belief] = ()
) -> list[str]:
    """One line for each fact outside what such rigs have, or against another, or against the drive."""
    found = [*contradicted(rig, constants, beliefs), *_suspicious_rating(rig, groups)]
    return [f"{DEFINITION}: [rig] {text}" for text in found]


def contradicted(rig: Rig, constants: Constants, beliefs: Sequence[Belief] = ()) -> list[str]:
    """What is asked of facts outside what such rigs have, or against a constant that no belief speaks of."""
    ball = _suspicious_ball(rig, constants)
    found = [*_outside(rig, _FACTS), *ball]
    if rig.rated_stroke is None or rig.rated_voltage is None or is_rated_stroke(rig, constants):
        if not any(b.name == "modal_mass_ratio" and b.prior for b in beliefs):  # else somebody says how m was found
            found += _suspicious_stack(rig, constants, ball_is_right=rig.ball_radius is not None and not ball)
    else:
        found.append(
            f"rated_stroke over rated_voltage is {rig.rated_stroke / rig.rated_voltage:.3g} m/V, constant"
            f" q = {constants.q:g} m/V; they should be the same"
        )
    return found


def _suspicious_rating(
    rig: Rig, groups: Sequence[Group], least: float = 0.3, most: float = 4.0, reverse: float = 0.2, beyond: float = 1.3
) -> list[str]:
    """A rated voltage that no layers have, or that the drive exceeds, or goes against.

    Parameters
    ----------
    rig : Rig
    groups : sequence of Group
    least, most : float, kV/mm
        Fields at the rated voltage. Layers of 0.4 to 1 mm take 1000 V, those of 25 to 100 um 100 to 150 V (Physik
        Instrumente, pages on stack design, read): 1 to 2.5 kV/mm, and up to 4 at 25 um. Bulk PZT depoles and arcs
        beyond.
    reverse : float
        How far below zero a drive may go, over the rated voltage: soft PZT depoles beyond. Makers state -20 V for
        stacks of 100 to 130 V, -30 V for those of 150 V (piezosystem jena, a device file with -20 to 130 V, read;
        Physik Instrumente, -20 to 120 V, and others, usual figures, not verified). Bipolar elements exist.
    beyond : float
        Highest drive over the voltage at which the data sheet states the stroke: makers state it at 100 V of stacks
        that take 120 or 130 V (the same).
    """
    if rig.rated_voltage is None:
        return []
    found = []
    if rig.layer_thickness is not None:
        field = 1e-6 * rig.rated_voltage / rig.layer_thickness
        if not least <= field <= most:
            found.append(
                f"rated_voltage over layer_thickness is {field:.3g} kV/mm, of stacks it is 1 to 2; is one of them in"
                " another unit?"
            )
    reached = {group.id: group.volts for group in groups}
    highest = max(reached, key=lambda id: max(map(abs, reached[id])))
    volts = max(map(abs, reached[highest]))
    if volts > beyond * rig.rated_voltage:
        found.append(
            f"rated_voltage = {rig.rated_voltage:g} V is below the drive of group {highest}, which reaches"
            f" {volts:g} V; is one of them wrong?"
        )
        return found
    low: dict[str, list[GroupId]] = {}
    for group in groups:
        if reached[group.id][0] < -reverse * rig.rated_voltage:
            low.setdefault(group.waveform, []).append(group.id)
    asked = (_reversed(form, ids, min(reached[id][0] for id in ids), rig.rated_voltage) for form, ids in low.items())
    return [*found, *asked]


def _reversed(waveform: str, ids: Sequence[GroupId], volts: float, rated: float) -> str:
    """What is asked of drives that go as far below zero as most stacks do not survive."""
    raised = from_zero(waveform)
    remedy = f"if it goes from 0 to V: {raised}" if raised else "is its sign right, and bias_v?"
    drives = f"the drive of group {ids[0]}, {waveform}, goes down to"
    if len(ids) > 1:
        drives = f"the drives of groups {series(ids)}, {waveform}, go as far down as"
    return f"{drives} {volts:g} V, which most stacks of {rated:g} V do not survive; {remedy}"


def _suspicious_ball(rig: Rig, constants: Constants, factor: float = 1.33) -> list[str]:
    """A mass that a solid ball of this radius, and material if it is given, does not have.

    Parameters
    ----------
    rig : Rig
    constants : Constants
    factor : float
        Densities of one material differ by less, and rounded radii add less to the mass.
    """
    if rig.ball_radius is None:
        return []
    solids = [MATERIALS[rig.ball_material]] if rig.ball_material else list(MATERIALS.values())
    masses = [4 / 3 * math.pi * rig.ball_radius**3 * solid.density for solid in solids]
    least, most = min(masses), max(masses)

    def may_weigh(mass: float) -> bool:
        return least / factor <= mass <= most * factor

    if may_weigh(constants.M):
        return []
    weighs = f"{least:.3g} kg" if rig.ball_material else f"{least:.3g} to {most:.3g} kg"
    guess = "is the diameter given, or another unit?"
    if may_weigh(constants.m):
        guess = f"constant m = {constants.m:g} kg is: are m, of the stack, and M, of the ball, swapped?"
    kind = rig.ball_material or "solid"
    ball = f"{'an' if kind[0] in 'aeiou' else 'a'} {kind} ball of radius {rig.ball_radius:g} m"
    return [f"{ball} weighs {weighs}, constant M = {constants.M:g} kg; {guess}"]


def _suspicious_stack(
    rig: Rig, constants: Constants, *, ball_is_right: bool, strain: float = 1e-3, factor: float = 9.0
) -> list[str]:
    r"""A mass that a stack of this stiffness and stroke does not have.

    A column of length :math:`L` and section `A` has :math:`k_s = E A/L` and weighs
    :math:`\rho A L = \rho k_s L^2/E`; its length follows from the stroke.

    Parameters
    ----------
    rig : Rig
    constants : Constants
    ball_is_right : bool
        Whether the ball's mass agrees with its radius: then it was not swapped with that of the stack.
    strain : float
        Rated stroke of a multilayer stack over its length: makers' usual figure.
    factor : float
        The estimate is off by less: 1.5 in the strain counts twice, 1.3 in the modulus; an end piece, or a mass that is
        that of a mode, makes 3.
    """
    if rig.rated_stroke is None:
        return []
    pzt = MATERIALS["pzt"]
    usual = pzt.density * constants.k_s * (rig.rated_stroke / strain) ** 2 / pzt.modulus
    if 1 / factor <= constants.m / usual <= factor:
        return []
    guess = "is one of them in another unit? If a head is part of m, go on: [prior.modal_mass_ratio] says so"
    if not ball_is_right and 1 / factor <= constants.M / usual <= factor:
        guess = f"constant M = {constants.M:g} kg is nearer: are m, of the stack, and M, of the ball, swapped?"
    return [
        f"a stack of rated_stroke = {rig.rated_stroke:g} m and k_s = {constants.k_s:g} N/m weighs about {usual:.2g} kg,"
        f" constant m = {constants.m:g} kg; {guess}"
    ]


def suspicious_readings(group: Group, constants: Constants | None) -> list[str]:
    """Name columns whose scale points to another unit than the column's; a rig may not be known yet."""
    v_max = float(group.amplitude_v.max())
    found = [*suspicious_conditions(group), *_suspicious_settings(group), *_suspicious_recording(group, v_max)]
    for part in group.parts:
        found += _suspicious_part(part, constants, v_max)
    found += [*_suspicious_pairs(group, constants), *_copied_rows(group)]
    return [one_line(f"{group.file}: group {group.id}: {text}") for text in found]


def suspicious_conditions(group: Group, least: int = 5) -> list[str]:
    """What is asked of the columns of a group's conditions: another unit, or swapped with each other or a reading.

    Parameters
    ----------
    group : Group
    least : int
        Readings at fewer conditions, rounded as instruments do, may all be equal.
    """
    f_max, v_max = float(group.frequency_hz.max()), float(group.amplitude_v.max())
    hertz, volts = (
        _suspicious_hertz(f_max),
        [] if group.drive.recorded else _suspicious_volts(v_max, bool(group.driven.any())),
    )
    if hertz and volts and not _suspicious_hertz(v_max) and not _suspicious_volts(f_max, f_max > 0):
        return [f"frequencies end at {f_max:g} Hz, and amplitudes reach {v_max:g} V; are their columns swapped?"]
    found = [*hertz, *volts]
    for part in () if group.time_us is not None else group.parts:
        n_conditions = np.unique(part.conditions, axis=0).shape[0]
        if n_conditions >= least and part.reading[0] and not np.ptp(part.reading):
            every = f"every {part.observable.title} is {part.reading[0]:g} {part.observable.unit}"
            found.append(f"{every} at {n_conditions} conditions; are columns swapped?")
    return found


def is_usual(column: str, value: float) -> bool:
    """Whether the greatest number of a condition or a reading, in psafit's unit, is one that such rigs have."""
    if column == "frequency_hz":
        return not _suspicious_hertz(value)
    if column == "amplitude_v":
        return not _suspicious_volts(value, driven=True)
    return all(o.usual[0] <= value <= o.usual[1] for o in OBSERVABLES if o.column == column)


def _suspicious_hertz(f_max: float) -> list[str]:
    """What the greatest frequency says."""
    if f_max <= 50:  # below this a stack hardly moves the ball, and kHz values end here
        return [f"every frequency is at or below 50 Hz (greatest {f_max:g}); given in kHz?"]
    return [f"frequencies reach {f_max:g} Hz, above 1 MHz; {_HERTZ}?"] if f_max > 1e6 else []


def _unreached(
    drive: Drive, volts: FloatArray, v_max: float, periods: float, reach: float = 0.8, end: float = 0.9
) -> list[str]:
    """What a recorded voltage says against the amplitude that is stated.

    Parameters
    ----------
    drive : Drive
    volts : (n,) array
        As recorded.
    v_max : float
        The amplitude, V.
    periods : float
        How many were recorded.
    reach : float
        A recording goes as far from rest as the amplitude, and spans no more than twice that, to within this factor.
    end : float
        A part of a period whose last voltage is at least this part of its largest was still on its way.
    """
    if v_max == 0:
        return []
    away = np.abs(volts - drive.idle_v)
    ends_early = periods < 1.0 and away[-1] >= end * away.max()
    low, high = min(float(volts.min()), drive.idle_v), max(float(volts.max()), drive.idle_v)
    said = f"the recorded drive goes from {low:.4g} to {high:.4g} V"
    if max(high - drive.idle_v, drive.idle_v - low) < reach * v_max:
        asked = "is the factor of a divider or an amplifier missing?"
        asked = f"was it still on its way in the part of a period that it has, or {asked}" if ends_early else asked
        return [f"{said} and never reaches amplitude_v = {v_max:g}; {asked}"]
    if reach * (high - low) > 2 * v_max:
        return [f"{said}, beyond amplitude_v = {v_max:g}; is that another quantity, or in another unit?"]
    return []


def _suspicious_volts(v_max: float, driven: bool) -> list[str]:
    """What the greatest amplitude says, of launches of which some are `driven`, if by a bias alone."""
    if not driven:
        return ["every amplitude is zero: nothing drives the ball"]
    if 0 < v_max < 0.1:
        asked = in_another_unit("V", ["kV"], ["mV"], large=False)
        return [f"every amplitude is below 0.1 V (greatest {v_max:g}); {asked}?"]
    return [f"amplitudes reach {v_max:g} V, above 1 kV; {_VOLTS}?"] if v_max > 1000 else []


def _suspicious_settings(group: Group) -> list[str]:
    """What is said of voltages of the drive that all launches have."""
    settings = {name: float(getattr(group.drive, name)) for name in ("bias_v", "idle_v")}
    return [f"{name} = {v:g} V, above 1 kV; {_VOLTS}?" for name, v in settings.items() if abs(v) > 1000]


def _suspicious_recording(group: Group, v_max: float, shortest_us: float = 1.0, overshoot: float = 1.5) -> list[str]:
    """What a recorded drive says, and the times of a trace.

    Parameters
    ----------
    group : Group
    v_max : float
        The amplitude, V.
    shortest_us : float
        No drive of a stack, and no contact, is over sooner.
    overshoot : float
        Levels of one period are 1 at the amplitude, and not so far beyond it.
    """
    found = []
    if group.time_us is not None and group.time_us[-1] < shortest_us:
        found.append(f"the trace ends after {group.time_us[-1]:g} us; is its time given in s or ms?")
    table = group.drive.table
    if table is not None and not table.recorded and (level := float(np.abs(table.value).max())) > overshoot:
        found.append(
            f"levels in {group.drive.file} reach {level:g}, and a level is per volt of amplitude_v; are these volts?"
            " Then divide them by the amplitude"
        )
    if table is None or not table.recorded:
        return found
    lasts_us, most_v = 1e6 * float(table.at[-1]), float(np.abs(table.value).max())
    if lasts_us < shortest_us:
        found.append(f"the drive in {group.drive.file} ends after {lasts_us:g} us; is its time given in s or ms?")
    if most_v > 1000:
        found.append(f"the drive in {group.drive.file} reaches {most_v:g} V, above 1 kV; {_VOLTS}?")
    if group.varied:
        what = " and ".join(group.varied)
        found.append(
            f"the {what} varies, but a recorded voltage is taken as it is: the simulation is the same for every row;"
            " give each condition a group and a recording of its own"
        )
    return found + _unreached(group.drive, table.value, v_max, float(table.at[-1] * group.frequency_hz.min()))


def _suspicious_part(part: Group, constants: Constants | None, v_max: float) -> list[str]:
    """What the scale of one observable's readings says."""
    found, o = [], part.observable
    least, most = o.usual
    r_max = float(np.abs(part.reading).max())
    string_um = constants.l * 1e6 if constants and o is LAUNCH_RANGE else math.inf
    still = float(np.abs(part.reading)[~part.driven].max(initial=0.0))
    if still > 0 and v_max > 0:
        of = "" if o is LAUNCH_RANGE else f" ({o.title})"
        found.append(f"the ball is launched by {still:g} {o.unit} at 0 V{of}; is that the reading's offset?")
    if r_max == 0:
        found.append(f"every {o.title} is zero: there is nothing to fit")
    elif r_max < least:
        found.append(f"every {o.title} is below {least:g} {o.unit} (greatest {r_max:g}); {o.asked(large=False)}?")
    if r_max > string_um:
        asked = o.asked(large=True)
        found.append(f"launch ranges reach {r_max:g} um, beyond the string of {string_um:g} um; {asked}?")
    elif r_max > most:
        # Ten centimetres read better than 1e+05 um.
        beyond = "10 cm" if o is LAUNCH_RANGE else f"{most:g} {o.unit}"
        found.append(f"{o.titles} reach {r_max:g} {o.unit}, above {beyond}; {o.asked(large=True)}?")
    if part.sigma is not None and r_max > 0 and float(part.sigma.min()) > r_max:
        found.append(
            f"every {o.sigma_column} exceeds every {o.title} (least {part.sigma.min():g} {o.unit}); given in another"
            " unit?"
        )
    return found + _suspicious_trace(part) + _spread(part)


def _spread(part: Group, least: int = 10, factor: float = 10.0) -> list[str]:
    """What launches of one condition say that no scatter explains.

    Parameters
    ----------
    part : Group
    least : int
        As many samples make a trace; fewer launches may hold a blunder.
    factor : float
        Between the least and the greatest reading. Launches scatter by some per cent.
    """
    _, of = np.unique(part.conditions, axis=0, return_inverse=True)  # along a trace each is one
    for k in np.flatnonzero(np.bincount(of.ravel()) >= least):
        read = part.reading[(of.ravel() == k) & (part.reading > part.observable.still)]
        if read.size >= least and read.max() > factor * read.min():
            said = f"{read.size} {part.observable.titles} of one condition go from {read.min():g} to {read.max():g}"
            return [f"{said} {part.observable.unit}; are they recorded over time, or is a condition missing?"]
    return []


def _suspicious_clock(part: Group, late: float = 10.0) -> list[str]:
    """What the times of a trace say.

    Parameters
    ----------
    part : Group
        Samples of one trace.
    late : float
        A trace begins within so many samples of the start of its drive.
    """
    if part.time_us is None or part.n_points < 2:
        return []
    begin, step = float(part.time_us[0]), float(part.time_us[-1] - part.time_us[0]) / (part.n_points - 1)
    period = 1e6 / float(part.frequency_hz[0])
    if begin > late * step:
        return [
            f"the trace begins {begin:g} us after the start of the drive, more than {late:g} samples; do its times"
            " count from there?"
        ]
    if step > period and not part.drive.recorded:
        asked = in_another_unit("us", ["ms"], ["ns"], large=True)
        return [f"samples are {step:.4g} us apart, and a period of the drive lasts {period:.4g} us; {asked}?"]
    return []


def _suspicious_trace(
    part: Group, most: int = 2000, early: float = 0.1, far: float = 0.5, late: float = 0.9, turned: float = 2.0
) -> list[str]:
    """What the samples of a trace say together.

    Parameters
    ----------
    part : Group
    most : int
        Samples beyond which more of them say little: their errors are correlated.
    early, far : float
        A trace that begins within this part of its length, this part of its reach from zero, and changes nowhere as
        fast as it would have had to until then, is not counted from rest.
    late, turned : float
        The drive throws the ball to the positive side. A trace that lies below zero from this part of its length on,
        and reaches so many times farther there than above, is counted the other way.
    """
    if part.time_us is None:
        return []
    found = _suspicious_clock(part)
    if part.n_points > most:
        every = -(-part.n_points // most)
        found.append(f"{part.n_points} samples; one in {every} says nearly as much, and is fitted in less time")
    begins = part.time_us[0] < early * part.time_us[-1]
    least = far * np.abs(part.reading).max()
    if begins and abs(part.reading[0]) > max(
        least, part.time_us[0] * np.abs(np.diff(part.reading) / np.diff(part.time_us)).max()
    ):
        found.append(
            f"{part.observable.column} begins at {part.reading[0]:g} {part.observable.unit}; is it counted from rest?"
        )
    last = part.reading[part.time_us >= late * part.time_us[-1]]
    if not part.observable.tip and last.max() < 0 and -part.reading.min() > turned * part.reading.max():
        found.append(
            f"{part.observable.column} ends at {last[-1]:g} {part.observable.unit}: the ball is thrown to the negative"
            " side; is the sign turned?"
        )
    return found


def _suspicious_pairs(group: Group, constants: Constants | None, most: float = 3.0) -> list[str]:
    r"""Name ranges and speeds of the same launches that no free flight joins.

    A pendulum of length `l` that starts with the speed `v` swings by about :math:`v \sqrt{l/g}`. Friction and a lean
    take from that, and a place ahead of rest adds to it: by less than the factor `most`, the median over the launches.
    """
    parts = {part.observable.name: part for part in group.parts}
    if constants is None or not {"launch_range", "launch_speed"} <= parts.keys():
        return []
    ranges, speeds = parts["launch_range"], parts["launch_speed"]
    _, one, two = np.intersect1d(ranges.row, speeds.row, return_indices=True)
    swing = 1e3 * speeds.reading[two] * math.sqrt(constants.l / constants.g)
    both = (swing > 0) & (ranges.reading[one] > 0)
    if not both.any():
        return []
    ratio = float(np.median(ranges.reading[one][both] / swing[both]))
    if 1 / most <= ratio <= most:
        return []
    return [
        f"launch ranges are {ratio:.3g} times what a ball of the launch speeds swings; is one of them another quantity,"
        " or in another unit?"
    ]


def _copied_rows(group: Group, least: int = 5) -> list[str]:
    """Name repetitions that all equal the first reading: rows that were copied, or a mean that was entered each time.

    Parameters
    ----------
    group : Group
    least : int
        Of fewer repetitions, rounded as instruments do, all may be equal by chance.
    """
    repeated = group.n_points - np.unique(group.conditions, axis=0).shape[0]
    copied = group.n_points - np.unique(_rows(group), axis=0).shape[0]
    if repeated < least or copied < repeated or not group.reading.any():
        return []
    return [f"all {repeated} repeated readings equal the first to the last digit; were rows copied? Each is a reading"]


def copied_groups(groups: Sequence[Group], least: int = 5) -> list[str]:
    """One line for each two groups of the same readings at the same conditions: those of a copied file count twice.

    Parameters
    ----------
    groups : sequence of Group
    least : int
        Groups of fewer readings may be the same by chance.
    """
    found = []
    for first, second in itertools.combinations(groups, 2):
        if first.n_points < least or first.n_points != second.n_points or not first.reading.any():
            continue
        one, other = (np.unique(_rows(g), axis=0) for g in (first, second))
        if np.array_equal(one, other):
            text = f"readings and conditions are those of group {first.id} to the last digit; was its file copied?"
            found.append(one_line(f"{second.file}: group {second.id}: {text} They count twice"))
    return found


def traced_together(groups: Sequence[Group]) -> list[str]:
    """One line for each two traces of several quantities over the same times: of one launch neither is new to a fit."""
    found = []
    for first, second in itertools.combinations(groups, 2):
        if first.time_us is None or second.time_us is None or first.observable is second.observable:
            continue
        if (first.drive, first.changed) != (second.drive, second.changed):
            continue
        if _of_one_condition(first, second) and np.array_equal(first.time_us, second.time_us):
            text = f"its times are those of group {first.id}; if both are of one launch, neither is new to a fit of the"
            found.append(one_line(f"{second.file}: group {second.id}: {text} other: give both to --group"))
    return found


def _rows(group: Group) -> FloatArray:
    """Conditions with their readings, (n_points, 4), of a trace (n_points, 5)."""
    return np.column_stack([group.conditions, group.reading])


def doubtful_instruments(groups: Sequence[Group]) -> list[str]:
    """One line for each instrument that reads no column of the groups, and for names that differ in case alone."""
    named = dict(pair for group in groups for pair in group.instruments)
    read = {o.column for group in groups for o in group.observables}
    found = [
        f"{DEFINITION}: {name} is to read {column}, which no group has; is another column meant?"
        for column, name in named.items() if column not in read
    ]  # fmt: skip
    spelt: dict[str, list[str]] = {}
    for name in dict.fromkeys(named.values()):
        spelt.setdefault(name.casefold(), []).append(name)
    twice = [names for names in spelt.values() if len(names) > 1]
    found += [f"{DEFINITION}: {' and '.join(names)} count as different instruments; is one meant?" for names in twice]
    return list(map(one_line, found))


def disagreeing_groups(groups: Sequence[Group], least: float = 1.37) -> list[str]:
    """One line for each two groups whose readings differ by a factor where they share conditions.

    Of two traces of one condition these are samples at the same times.

    Parameters
    ----------
    groups : sequence of Group
    least : float
        The least factor that is reported, the median over the shared conditions. Sessions of one rig differ by less,
        those of the study by up to 1.33, and RMS for peak makes 1.41: the bound lies between the two.
    """
    found = []
    for first, second in itertools.combinations(groups, 2):
        if first.changed != second.changed or not _of_one_drive(first.drive, second.drive):
            continue
        for o in OBSERVABLES:
            ratios = _over_time(first, second, o) if o.traced else _of_launches(first, second, o)
            ratio = float(np.median(ratios)) if ratios else 1.0
            factor = max(abs(ratio), 1 / abs(ratio)) if ratio else math.inf
            if factor < least and ratio > 0:
                continue
            places = "sample" if o.traced else "condition"
            places = f"one shared {places}" if len(ratios) == 1 else f"{len(ratios)} shared {places}s"
            text = f"{o.titles} are {ratio:.3g} times those of group {first.id} at {places}"
            if ratio < 0:
                asked = "is the sign of one of them turned?"
            elif o.grows:
                asked = _factor_asked(factor, first.drive)
            else:
                asked = "is one of them in another unit, or counted from another moment?"
            found.append(one_line(f"{second.file}: group {second.id}: {text}; {asked}"))
    return found


def rescaled_groups(
    groups: Sequence[Group], least: int = 5, near: float = 0.01, close: float = 0.1, plain: float = 1.37
) -> list[str]:
    """One line for each two groups of the same readings whose volts or frequencies differ by a factor.

    Parameters
    ----------
    groups : sequence of Group
    least : int
        Groups of fewer readings may be the same by chance.
    near : float
        Readings and factors that differ by no more than this part are the same, rounded differently.
    close, plain : float
        Readings that differ by no more than the first part, as a rule, at volts that differ by the second or more: what
        grows with the voltage would differ by at least as much.
    """
    found = []
    for first, second in itertools.combinations(groups, 2):
        same = (first.drive, first.changed, first.n_points) == (second.drive, second.changed, second.n_points)
        scales, read = _scales(first, second, near) if same and first.n_points >= least else ({}, np.empty((2, 0)))
        other = {name: ratio for name, ratio in scales.items() if abs(ratio - 1.0) > near}
        if len(other) != 1:
            continue
        ((name, ratio),) = other.items()
        factor = max(ratio, 1.0 / ratio)
        exactly = bool((np.abs(read[1] - read[0]) <= near * np.abs(read[0])).all())
        if not exactly and not (name == "amplitudes" and factor >= plain and _stays(first, read, close)):
            continue
        asked = _factor_asked(factor, first.drive) if name == "amplitudes" else "is one of them in another unit?"
        asked = asked if exactly else f"{asked.removesuffix('?')}, or does the drive saturate?"
        if name == "frequencies" and abs(factor / math.tau - 1.0) <= near:
            asked = "is one of them in rad/s?"
        those = f"readings are {'' if exactly else 'about '}those of group {first.id}"
        text = f"{those}, and {name} are {ratio:.4g} times those there; {asked}"
        found.append(one_line(f"{second.file}: group {second.id}: {text}"))
    return found


def _scales(first: Group, second: Group, near: float) -> tuple[dict[str, float], FloatArray]:
    """Frequencies and amplitudes of the second group over those of the first, and what both read, (2, n).

    Empty where other things were read, or where these ratios vary.
    """
    one, two = (
        np.column_stack([g.measured, g.frequency_hz, g.amplitude_v, g.reading])[
            np.lexsort((g.reading, g.amplitude_v, g.frequency_hz, g.measured))
        ].T
        for g in (first, second)
    )
    if not (np.array_equal(one[0], two[0]) and one[3].any() and one[2].all() and two[2].all()):
        return {}, np.empty((2, 0))
    with np.errstate(over="ignore", invalid="ignore"):  # infinite ratios are steady in nothing
        ratios = {name: two[k] / one[k] for k, name in ((1, "frequencies"), (2, "amplitudes"))}
        steady = all(float(np.ptp(each)) <= near * float(each.min()) for each in ratios.values())
    scales = {name: float(np.median(each)) for name, each in ratios.items()} if steady else {}
    return scales, np.array([one[3], two[3]])


def _stays(group: Group, read: FloatArray, close: float) -> bool:
    """Whether what grows with the voltage, (2, n), is about the same, though nothing but that voltage drives it."""
    plain = group.drive.bias_v == group.drive.idle_v and all(OBSERVABLES[k].grows for k in group.measured)
    both = read[:, (read > 0.0).all(axis=0)]
    return plain and both.size > 0 and bool(np.median(np.abs(both[1] / both[0] - 1.0)) <= close)


def _factor_asked(factor: float, drive: Drive) -> str:
    """What is asked of readings that differ by a factor: how volts are counted, where it is near what that makes."""
    form, both = WAVEFORMS.get(drive.waveform), peak_to_peak(drive)
    effective = math.sqrt(form.crest_squared or 1.0) if form else 1.0
    counted = (
        (effective, "are volts of one of them RMS?"),
        (both, "are volts of one of them peak to peak?"),
        (both * effective, "are volts of one of them peak to peak, and of the other RMS?"),
    )
    near, asked = min(counted, key=lambda one: abs(math.log(factor / one[0])))
    # A voltage that is counted the same either way, or recorded, explains nothing.
    explains = not drive.recorded and near > 1.0 and abs(math.log2(factor / near)) <= 0.25
    return asked if explains else "is one of them in another unit?"


def _of_launches(first: Group, second: Group, o: Observable) -> list[float]:
    """Readings of the second group over those of the first, at conditions that they share."""
    mine, others = (_means(g, o) for g in (first, second))
    if not (mine and others):
        return []
    there, values = np.array([*others]), [*others.values()]
    found = {_shared(np.array(condition), there): value for condition, value in mine.items()}
    return [values[k] / value for k, value in found.items() if k is not None]


def _shared(condition: FloatArray, others: FloatArray, near: float = 0.01) -> int | None:
    """Which of some conditions, (n, 2), is the same but for this part, as instruments round it; the nearest."""
    apart = (np.abs(others - condition) / np.maximum(np.abs(condition), 1e-300)).max(axis=1)
    nearest = int(np.argmin(apart))
    return nearest if apart[nearest] <= near else None


def _of_one_drive(first: Drive, second: Drive, near: float = 0.05) -> bool:
    """Whether two drives are the same; voltages that were recorded, but for noise of this part of them."""
    one, two = first.table, second.table
    if one is None or two is None or not (one.recorded and two.recorded):
        return first == second
    away, apart = one.value - first.idle_v, np.interp(one.at, two.at, two.value) - one.value
    as_long = abs(two.at[-1] - one.at[-1]) <= near * one.at[-1]
    at_rest = abs(second.idle_v - first.idle_v) <= near * np.abs(away).max()
    return bool(as_long and at_rest and np.linalg.norm(apart) <= near * np.linalg.norm(away))


def _of_one_condition(first: Group, second: Group) -> bool:
    """Whether two traces are, but for rounding."""
    return _shared(first.conditions[0, :2], second.conditions[:1, :2]) is not None


def _over_time(first: Group, second: Group, o: Observable, far: float = 0.5) -> list[float]:
    """Samples of the second trace over those of the first, of one condition, beyond `far` of what that reaches."""
    if any(g.time_us is None or g.observable is not o for g in (first, second)):
        return []
    if not _of_one_condition(first, second):
        return []
    mine, others = first.time_us, second.time_us
    assert mine is not None and others is not None
    size = np.abs(first.reading)
    shared = (mine >= others[0]) & (mine <= others[-1]) & (size > 0) & (size >= far * size.max())
    return list(np.interp(mine[shared], others, second.reading) / first.reading[shared])


def _means(group: Group, o: Observable) -> dict[tuple[float, float], float]:
    """Mean of an observable's readings at each frequency and amplitude, those within the scatter left out."""
    read: dict[tuple[float, float], list[float]] = {}
    for k in np.flatnonzero(group.measured == OBSERVABLES.index(o)):
        condition = float(group.frequency_hz[k]), float(group.amplitude_v[k])
        read.setdefault(condition, []).append(float(group.reading[k]))
    means = {condition: float(np.mean(values)) for condition, values in read.items()}
    return {condition: mean for condition, mean in means.items() if mean > o.still}
