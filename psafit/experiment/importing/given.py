"""Values that a command line gives: constants of the rig, and conditions that were held."""

from __future__ import annotations

from decimal import Decimal

from psafit.errors import InputError
from psafit.experiment.definition import LIMITS as CONSTANT_LIMITS
from psafit.experiment.drive_table import SETTING_LIMITS
from psafit.experiment.importing.chosen import HELD
from psafit.experiment.importing.numerals import NOTATIONS
from psafit.experiment.importing.quantities import COLUMNS, Volts
from psafit.experiment.importing.units import factor_of, spacing, unit
from psafit.experiment.records import CONSTANT_UNITS
from psafit.experiment.table import CellFault, within
from psafit.experiment.text import shown


def value(name: str, text: str, place: str) -> float:
    """The value of a constant, SI, or of a condition, in psafit's unit; volts as they are `counted`.

    Parameters
    ----------
    name : str
    text : str
        A number with a decimal point, and behind a colon its unit, if it is not psafit's.
    place : str
        Where it was given, for a message.

    Raises
    ------
    InputError
        If it is no number, has no such unit, or is impossible.
    """
    number, colon, said = (part.strip() for part in text.partition(":"))
    target = CONSTANT_UNITS.get(name) or COLUMNS[name].unit
    found = NOTATIONS["."].value(number)
    if found is None or "," in number:
        raise InputError(f"{place}: {shown(number)} is no number", f"write for example {name}=1.2:{target}")
    factor = Decimal(1) if not colon else _factor(name, said, target)
    if factor is None:
        raise InputError(f"{place}: {shown(said)} is no unit of {name}", f"give it in {target}")
    result = float(found * factor)
    if name in HELD:
        try:
            return within(result, name, text)
        except CellFault as fault:
            raise InputError(f"{place}: {fault.what}", fault.remedy) from fault
    low, high = {**CONSTANT_LIMITS, **SETTING_LIMITS}[name]
    if not low <= result <= high:
        raise InputError(f"{place} is beyond the limits {low:g} to {high:g} {target}", f"give it in {target}")
    return result


def moment(text: str, place: str) -> float:
    """A time, us, such as ``1.5:ms``; arguments and errors as of `value`."""
    number, colon, said = (part.strip() for part in text.partition(":"))
    found, factor = NOTATIONS["."].value(number), factor_of(said, "us") if colon else Decimal(1)
    if found is None or factor is None or "," in number:
        raise InputError(f"{place}: {shown(text)} is no time", "write for example 1.5:ms")
    if found and not colon:
        raise InputError(f"{place}: {shown(text)} has no unit", f"say {text}:us, or {text}:ms or {text}:s")
    return float(found * factor)


def step(text: str, place: str) -> Decimal:
    """The time from one sample to the next, us, such as ``1:us``, or a rate, ``1:MHz``; errors as of `value`."""
    number, colon, said = (part.strip() for part in text.partition(":"))
    found = NOTATIONS["."].value(number)
    result = None if found is None or "," in number else spacing(found, said if colon else "us")
    if result is None:
        what = f"{place}: {shown(text)} is no time between samples and no rate"
        raise InputError(what, "write for example 1:us or 1:MHz; us without a unit")
    return result


def _factor(name: str, said: str, target: str) -> Decimal | None:
    if name in CONSTANT_UNITS:
        return factor_of(said, target)
    found = unit(said)
    factor = found.factor(target) if found else None
    if factor is None or (found and found.volts and name != "amplitude_v"):
        return None
    return factor


def counted(text: str) -> Volts:
    """How the volts of a condition are counted, given as for `value`."""
    said = unit(text.partition(":")[2])
    return (said.volts if said else None) or "peak"
