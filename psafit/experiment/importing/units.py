"""Units as they are written, by pint: factors are exact decimal numbers."""

from __future__ import annotations

import re
from dataclasses import dataclass
from decimal import Decimal
from functools import cache

import pint

from psafit.experiment.importing.quantities import BASES, COUNT, COUNTED, UNITS, Volts, words

# What a unit looks like. Anything else is not shown to pint, which would compute it.
_UNIT = re.compile(r"[A-Za-zµμ]+(?:\^-?[1-3]|[²³])?(?:[/*·][A-Za-zµμ]+(?:\^-?[1-3]|[²³])?){0,2}")
_RAISED = str.maketrans("⁻¹²³", "-123")
_SCALED = re.compile(r"([+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d{1,2})?)[\s*]*(\D.*)", re.ASCII)
# How pint's name of a unit ends, where other quantities have its dimension: radians a second of Hz, a slope of degrees.
_OWN: dict[str, str | tuple[str, ...]] = {"Hz": "hertz", "deg": ("degree", "radian")}
_SAMPLES = re.compile(r"^([kMG]?)(?:Sa?|[Ss]amples?)/s(?:ec)?$")
# Of other units those that are no words; a ratio of levels, parts, angles, or what pint knows as a quotient or a power.
_FOREIGN = re.compile(r"dB.*|[%‰]|°.*|rad|deg|rpm")
# What a logarithm is of: its base.
LOGARITHMS = {"log10": "10", "lg": "10", "log": "10", "ln": "e", "log2": "2"}
_VOLTS = re.compile(r"([a-zµμ]?V(?:olts?)?)[\s_.-]*(\S.*)", re.IGNORECASE)


@dataclass(frozen=True)
class Unit:
    """A unit as it is written.

    Parameters
    ----------
    text : str
    volts : {"peak", "pp", "rms"} or None
        How its volts are counted, where that is said.
    scale : Decimal or None
        So many of it are one volt of a sensor, or one step: ``5 mm/s/V``.
    step : Decimal
        Volts of a number in the column that it is the scale of.
    """

    text: str
    volts: Volts | None = None
    scale: Decimal | None = None
    step: Decimal = Decimal(1)

    def factor(self, target: str) -> Decimal | None:
        """Number that a value in this unit is multiplied with to be one in `target`; None where it is another kind."""
        if self.scale is None:
            return factor_of(self.text, target)
        factor = self.per_volt(target) or factor_of(self.text, target)
        return None if factor is None else factor * self.scale * self.step

    def per_volt(self, target: str) -> Decimal | None:
        """Factor to `target` of a unit for each volt, such as ``mm/s/V`` or ``V/mV``; None where it is none."""
        above, _, below = self.text.rpartition("/")
        factor, volts = factor_of(above, target), factor_of(below, "V")
        return None if factor is None or volts is None else factor / volts

    @property
    def said(self) -> str:
        """The unit, behind its scale."""
        return self.text if self.scale is None else f"{self.scale:f} {self.text}"

    @property
    def kind(self) -> str:
        """The unit of psafit's that it can be turned into; empty where there is none."""
        return next((unit for unit in UNITS if self.factor(unit) is not None), "")


def counted(text: str) -> Volts | None:
    """How volts are counted: ``pk-pk`` is peak to peak."""
    said = words(text)
    return next((volts for volts, names in COUNTED.items() if said in names), None)


def unit(text: str) -> Unit | None:
    """The unit that a text is, such as ``kHz``, ``[mV]`` or ``Vpp``, if it is one of a quantity that psafit knows."""
    text = re.sub(r"[⁻¹²³]+", lambda power: f"^{power[0].translate(_RAISED)}", text.strip())
    text = re.sub(r"(?<=[A-Za-zµμ]) (?=[A-Za-z]+\^-)", "·", text)  # a product of what has a negative power
    text = "deg" if text.strip("([<{}>]) ") == "°" else text
    if not text.isprintable():
        return None
    if text[:1] in ("(", "[", "<", "{") and text[-1:] in (")", "]", ">", "}"):
        text = text[1:-1].strip()
    if Unit(text).kind:
        return Unit(text)
    if (found := _VOLTS.fullmatch(text)) and (volts := counted(found[2])) and Unit(found[1]).kind == "V":
        return Unit(found[1], volts)
    return None


def foreign(text: str) -> Unit | None:
    """A unit, of no `kind`, that is none of a quantity that psafit knows: ``dBV``, ``kV/mm``, ``%``, ``rad/s``."""
    text = text.strip().strip("([<{}>])").strip()
    if _FOREIGN.fullmatch(text):
        return Unit(text)
    if len(text) > 20 or text.isalpha() or not _UNIT.fullmatch(text) or unit(text):
        return None
    try:
        _registry().parse_units(text)
    except (pint.PintError, ValueError):
        return None
    return Unit(text)


def related(said: Unit, target: str) -> str:
    """How numbers in a unit that no other quantity has are turned into `target`; empty where they are not."""
    if target == "V" and said.text == "dBV":
        return "give 10^(x/20) of each number x, in V RMS"
    if target == "V" and factor_of(said.text, "V/m") is not None:
        return "give the field times the thickness of a layer, in V"
    if target == "Hz" and factor_of(said.text.replace("rad", "Hz·s", 1), "Hz") is not None:
        return "give it over 2 pi, in Hz"
    return "give it over 60, in Hz" if target == "Hz" and said.text == "rpm" else ""


def conversion(said: Unit, target: str) -> str:
    """How numbers in a unit of another kind are turned into `target`; empty where nothing is known of that."""
    if found := related(said, target):
        return found
    if base := LOGARITHMS.get(said.text.partition(" ")[0]):
        return f"give {base}^x of each number x"
    if said.text.startswith("dB"):
        return "give 10^(x/20) of each number x, times what 0 dB stands for"
    if said.text in ("%", "‰"):
        return f"give the part times what the whole is, in {target}"
    return "give one over the period, in Hz" if target == "Hz" and said.kind == "us" else ""


def scaled(text: str) -> Unit | None:
    """How volts that were recorded are a motion or the drive, if the text says so.

    Such as ``5 mm/s/V``, ``-1um`` (the other way), or ``20V/V`` behind an amplifier.
    """
    found = _SCALED.fullmatch(text.strip())
    scale = Decimal(found[1]) if found else Decimal(0)
    unit = Unit(found[2], scale=scale) if found and scale else None
    return unit if unit and unit.kind else None


def spacing(number: Decimal, text: str, kind: str = "") -> Decimal | None:
    """Microseconds from one sample to the next, of a time or a rate in a unit; None where it is neither, or not `kind`.

    A rate may be in samples a second: ``MSa/s``.
    """
    said = Unit(_SAMPLES.sub(r"\1Hz", text.strip(), count=1))
    if number <= 0 or said.kind not in ({kind} if kind else {"us", "Hz"}):
        return None
    factor = said.factor(said.kind)
    return factor and (number * factor if said.kind == "us" else 10**6 / (number * factor)).normalize()


@cache
def _registry() -> pint.UnitRegistry[Decimal]:
    registry: pint.UnitRegistry[Decimal] = pint.UnitRegistry(non_int_type=Decimal)
    registry.define(f"{COUNT} = [{COUNT}]")
    registry.define("@alias thou = mil = mils")  # pint's own is one of angles
    return registry


@cache
def _parsed(text: str) -> pint.Unit | None:
    """A unit; None where it is none, or could be two: ``MHZ`` is mega or milli."""
    registry = _registry()
    if len(text) > 20 or not _UNIT.fullmatch(text):
        return None
    try:
        found = registry.parse_units(text)
    except pint.UndefinedUnitError:
        spelt = {text.lower(), text[:1].upper() + text[1:].lower()}
        names = {name[:2] for t in spelt for name in registry.parse_unit_name(t, case_sensitive=False)}
        other = {name for name in names if name[1].endswith(BASES)}
        if len(other) != 1:
            return None
        found = registry.parse_units("".join(other.pop()))
    except (pint.PintError, ValueError):  # a number, such as inf
        return None
    return found if all(name.endswith(BASES) for name in re.findall("[a-z_]+", str(found))) else None


@cache
def factor_of(text: str, target: str) -> Decimal | None:
    """Number that a value in a unit is multiplied with to be one in `target`; None where it is another kind."""
    found, registry = _parsed(text), _registry()
    if found is None or found.dimensionality != registry.Unit(target).dimensionality:
        return None
    if not str(found).endswith(_OWN.get(target, "")):
        return None
    return Decimal(registry.Quantity(Decimal(1), found).to(target).magnitude)
