"""What a column may hold, how instruments and spreadsheets call it, and in which unit psafit keeps it.

Another observable is one line in `QUANTITIES`. Whether psafit can use a quantity is not said here: it can, once its
column is one of those that `psafit.experiment.table`, `psafit.experiment.trace_table` or
`psafit.experiment.drive_table` reads.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from psafit.experiment import drive_table, table, trace_table
from psafit.observables import OBSERVABLES, OF_LAUNCHES, VELOCITY

Volts = Literal["peak", "pp", "rms"]


@dataclass(frozen=True)
class Quantity:
    """A quantity that a column may hold.

    Parameters
    ----------
    column : str
        psafit's name of it, which ends in its unit.
    unit : str
        Unit in which psafit keeps it.
    names : tuple of str
        What it is called, in words of small letters.
    role : {"condition", "reading", "error", "drive", "time", "trace", "recording", "other"}
        What of an experiment it is; `"error"` is the known error of a reading, `"trace"` what is read over `"time"`,
        `"recording"` the drive that was recorded next to it, `"other"` what psafit knows and cannot use.
    part : {"", "ball", "drive", "tip"}
        What of the rig it is of, which a heading may name; the tip must be named.
    """

    column: str
    unit: str
    names: tuple[str, ...]
    role: Literal["condition", "reading", "error", "drive", "time", "trace", "recording", "other"]
    part: Literal["", "ball", "drive", "tip"] = ""

    def bare(self, name: str) -> str | None:
        """A name without the words of the part that it is of; None where these are missing."""
        said, of = name.split(), PARTS[self.part]
        if self.part == "tip" and of.isdisjoint(said):
            return None
        return " ".join(word for word in said if word not in of | NEUTRAL)

    @property
    def usable(self) -> bool:
        """Whether psafit can use it."""
        return self.role == "drive" or any(self.column in of.LIMITS for of in (table, trace_table, drive_table))


COUNT = "periods"
"""The unit of a number of periods, which nobody writes."""
# Words that say nothing of what is measured. "Generator", "input" and "monitor" are none: an amplifier lies between.
NEUTRAL = {"measured", "the"}
# Words that say which part of the rig something is of. The tip is the end of the stack.
PARTS: dict[str, set[str]] = {
    "": set(),
    "ball": {"ball", "kugel", "bille", "vib", "vibration"},
    "drive": {"drive", "driving", "excitation", "stack", "piezo", "applied"},
    "tip": {
        "tip", "stack", "piezo", "actuator", "transducer", "drive", "driving", "spitze", "stapel", "aktor", "aktuator",
        "piezoaktor", "piezostapel", "antrieb", "actionneur",
    },
}  # fmt: skip

_FREQUENCIES = ("frequency", "freq", "f", "frequenz", "frequence", "fréquence", "frecuencia", "frequenza", "")
_TENSIONS = (
    "amplitude", "ampl", "amp", "voltage", "voltage amplitude", "amplitude voltage", "spannung", "spannungsamplitude",
    "antriebsspannung", "tension", "tensión", "tensione", "voltaje", "amplitud", "ampiezza", "v", "u", "volt", "volts",
    "",
)  # fmt: skip
_PHASES = ("start phase", "starting phase", "initial phase", "burst phase", "startphase", "anfangsphase")
_CYCLES = (
    "cycles", "n cycles", "number of cycles", "burst cycles", "burst count", "periods", "n periods",
    "number of periods", "burst periods", "zyklen", "perioden", "anzahl perioden", "nombre de cycles",
)  # fmt: skip
_ERRORS = ("sigma", "standard uncertainty", "standardunsicherheit")
_MEASURED = tuple(
    Quantity(o.column, o.unit, o.called or (o.title,), "trace" if o.traced else "reading", "tip" if o.tip else "ball")
    for o in OBSERVABLES
)
_READINGS, _TRACES = (tuple(q for q in _MEASURED if q.role == role) for role in ("reading", "trace"))
SIGMA = {o.column: o.sigma_column for o in OF_LAUNCHES}
"""Column of the known error of each reading."""


def _of(names: tuple[str, ...]) -> tuple[str, ...]:
    """What the known error of a reading with these names is called: ``sigma range``."""
    return tuple(f"{error} {name}" for error in _ERRORS for name in names)


QUANTITIES = (
    Quantity("frequency_hz", "Hz", _FREQUENCIES, "condition", "drive"),
    Quantity("amplitude_v", "V", _TENSIONS, "condition", "drive"),
    *_READINGS,
    *(Quantity(SIGMA[r.column], r.unit, (*_ERRORS, *_of(r.names)), "error", "ball") for r in _READINGS),
    Quantity(
        "bias_v", "V", ("bias", "offset", "dc offset", "dc bias", "offset voltage", "bias voltage"), "drive", "drive"
    ),
    Quantity("idle_v", "V", ("idle", "idle voltage", "rest voltage", "ruhespannung"), "drive", "drive"),
    Quantity("phase_deg", "deg", _PHASES, "drive", "drive"),
    Quantity("cycles", COUNT, _CYCLES, "drive", "drive"),
    Quantity("voltage_v", "V", (), "recording"),  # `Heading.drives` says which column is one
    Quantity("time_us", "us", ("time", "t", "elapsed time", "zeit", "temps", "x axis", "x value", ""), "time"),
    *_TRACES,
    Quantity("tip_velocity_mm_s", "mm/s", (*VELOCITY.called, ""), "other", "tip"),
)
COLUMNS = {quantity.column: quantity for quantity in QUANTITIES}
# What pint calls the units of this field, prefixes left out: it knows hundreds of others, with short names.
BASES = ("hertz", "volt", "meter", "micron", "inch", "thou", "second", "newton", "gram", "degree", "radian", COUNT)
UNITS = tuple(dict.fromkeys(quantity.unit for quantity in QUANTITIES))

# Words of the drive's voltage itself, and those that name where it was recorded.
DRIVING = {"drive", "driving", "excitation", "stack", "piezo", "applied", "antrieb", "antriebsspannung", "ansteuerung"}
CHANNELS = {
    "ch", "chan", "channel", "kanal", "voie", "a", "b", "c", "d", "recorded", "voltage", "spannung", "tension", "u",
    "v", "volt", "volts", "signal",
}  # fmt: skip
# A reading that is called no more than that is the one psafit knows in the unit of its column.
GENERIC = {
    "reading", "measurement", "trial", "shot", "run", "rep", "repeat", "replicate", "r", "messung", "messwert", "wurf",
    "versuch", "essai",
}  # fmt: skip
# How a voltage is counted, in several languages.
COUNTED: dict[Volts, tuple[str, ...]] = {
    "pp": (
        "peak to peak", "peak peak", "peak2peak", "peak to valley", "peak to trough", "pk to pk", "pk pk", "pkpk",
        "pk2pk", "p to p", "p p", "p2p", "pp", "ptp", "spitze spitze", "spitze zu spitze", "spitze tal", "ss",
        "crête à crête", "crete a crete", "crête crête", "crete crete", "c à c", "c a c", "pico a pico", "picco picco",
        "picco a picco",
    ),
    "rms": (
        "rms", "eff", "effektiv", "effektivwert", "effective", "efficace", "valeur efficace", "eficaz",
        "root mean square",
    ),
    "peak": (
        "zero to peak", "0 to peak", "0 peak", "0 pk", "0 p", "0p", "peak", "pk", "p", "spitze", "spitzenwert",
        "scheitel", "scheitelwert", "crête", "crete",
    ),
}  # fmt: skip
# Words of a heading that speak for a way to count volts, and do not say it for sure.
SPEAKS: dict[Volts, re.Pattern[str]] = {
    "pp": re.compile(r"trough|valley|tal|swing"),
    "peak": re.compile(r"(?:scheitel|spitzen)\w*|[vu]?max|maximum|maximal\w*|crest"),
    "rms": re.compile(r"effektiv\w*"),
}
# What a line that says how volts are counted calls them.
VOLTAGES = {
    "voltage", "voltages", "volt", "volts", "amplitude", "amplitudes", "spannung", "spannungen", "amplituden",
    "tension", "tensions",
}  # fmt: skip
SUFFIXES: dict[Volts, str] = {"peak": "p", "pp": "pp", "rms": "rms"}
"""What stands behind a unit of volts that are counted so."""
VOLTS: dict[Volts, str] = {"peak": "zero to peak", "pp": "peak to peak", "rms": "RMS"}
WAVEFORM_NAMES = {
    "waveform", "wave form", "wave", "waveform type", "wave type", "wave shape", "waveform shape", "signal form",
    "signal shape", "signalform", "kurvenform", "wellenform", "forme d onde", "forma de onda", "forma d onda",
}  # fmt: skip
# What a known error may be called, or how readings that were repeated spread: which of both must be said.
SPREADS = {
    "sd", "std", "std dev", "stdev", "stddev", "standard deviation", "se", "sem", "standard error", "error", "err",
    "uncertainty", "σ", "standardabweichung", "fehler", "messfehler", "unsicherheit", "messunsicherheit", "incertitude",
    "erreur", "écart type", "ecart type",
}  # fmt: skip
# What is one over a frequency.
PERIODS = {"period", "period time", "periode", "periodendauer", "période"}
# What generators call the ends of a drive.
LEVELS = (
    {"high level", "high", "level high", "v high", "vhigh", "upper level", "v max", "vmax", "u max", "umax"},
    {"low level", "low", "level low", "v low", "vlow", "lower level", "v min", "vmin", "u min", "umin"},
)
# What a header calls the distance of samples, or their rate, by the unit of psafit's; and the unit of its clock.
STEPS = dict.fromkeys(
    (
        "sample interval", "sampling interval", "sample period", "sampling period", "sample time", "time step",
        "timestep", "time increment", "increment", "x increment", "xincr", "dt", "delta t", "delta x",
        "abtastintervall", "abtastperiode", "zeitschritt", "pas de temps",
    ),
    "us",
) | dict.fromkeys(
    (
        "sample rate", "samplerate", "sampling rate", "samplingrate", "sample frequency", "sampling frequency",
        "abtastrate", "abtastfrequenz", "fréquence d échantillonnage",
    ),
    "Hz",
)  # fmt: skip
# What a header calls the thinning of samples: whether a step is from before or after is not said.
THINNED = {
    "decimation", "decimation factor", "decimation ratio", "downsampling", "downsampling factor", "down sampling",
}  # fmt: skip
# What a header calls the time of the first sample.
ORIGINS = {
    "x0", "t0", "xzero", "x zero", "x origin", "xorigin", "time origin", "start", "x start", "xstart", "t start",
    "tstart", "start time", "horizontal start", "first sample", "startzeit",
}  # fmt: skip
CLOCK_UNITS = {"horizontal unit", "horizontal units", "x unit", "x units", "time unit", "time units"}
# What marks a row that sums up others, alone or before `of` or a number: `Mean of 3`. The first may be of readings.
MEANS = {
    "mean", "average", "ave", "avg", "median", "mittelwert", "mittel", "mw", "durchschnitt", "moyenne", "media",
    "promedio", "平均",
}  # fmt: skip
SUMMARIES = MEANS | {
    "std", "sd", "s d", "sem", "rsd", "cv", "stdev", "stddev", "variance", "min", "max", "minimum", "maximum", "sum",
    "total", "subtotal", "overall", "count", "rms", "std dev", "standard deviation", "std error", "standard error",
    "grand mean", "geomean", "ø", "σ", "standardabweichung", "stabw", "stdabw", "std abw", "summe", "gesamt", "anzahl",
    "ecart type", "écart type", "desv est", "scarto tipo", "標準偏差",
}  # fmt: skip
_OF = {"of", "from", "von", "aus", "de", "n"}
# What loggers and programs write where there is no value.
MISSING = {"nan", "na", "n a", "none", "null", "inf", "ol", "ovld", "overload", "missing"}
SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars", "  ": "two blanks or more", " ": "blanks"}
BLANKS = (" ", "  ")
# What a spreadsheet writes where a formula has no value: no comment.
CELL_ERRORS = {
    "#N/A", "#DIV/0!", "#VALUE!", "#REF!", "#NAME?", "#NUM!", "#NULL!", "#NV", "#WERT!", "#BEZUG!", "#ZAHL!",
    "#VALEUR!", "#NOMBRE!", "#NOM?",
}  # fmt: skip
COMMENTS = ("#", "%", "//", "!")


def sums_up(text: str) -> bool:
    """Whether a cell says that its row, or its column, sums up others."""
    first, *more = words(text).split() or [""]
    return words(text) in SUMMARIES or (first in SUMMARIES and bool(more) and (more[0] in _OF or more[0].isdigit()))


def words(text: str) -> str:
    """Text as words of small letters, signs left out: ``Pk-Pk_1`` is ``pk pk 1``."""
    return " ".join(re.findall(r"[^\W_]+", text.casefold()))
