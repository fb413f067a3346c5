"""The waveforms of a drive, one small file each. This is their registry.

To add a waveform, write its file in this folder: whatever module there has a `WAVEFORM` is known by its `id`.
"""

from __future__ import annotations

import difflib
import importlib
import pkgutil
import re
from collections.abc import Mapping

from psafit.drives.drive import Drive, Table
from psafit.drives.waveform import Piece, Waveform

__all__ = [
    "NAMES", "TABLE", "WAVEFORMS", "Drive", "Piece", "Table", "Waveform", "from_zero", "instead", "peak_to_peak",
    "span_of",
]  # fmt: skip

_modules = (importlib.import_module(f"{__name__}.{found.name}") for found in pkgutil.iter_modules(__path__))
WAVEFORMS: dict[str, Waveform] = {m.WAVEFORM.id: m.WAVEFORM for m in _modules if hasattr(m, "WAVEFORM")}
TABLE = "table"
"""Name of a drive whose voltage stands in a file."""
NAMES = (*WAVEFORMS, TABLE)
_TABLE = f"none of psafit's: give one period as a {TABLE}"
_VARIED = {
    r"^(cos|kosin)[a-z]*( |$)": "a sine with phase_deg = 90",
    r"(^|\D)1 cos": "unipolar_sine",
    r"\bdc\b|offset|bias": "{} with bias_v, and idle_v if it rests there",
    r"burst": "{} with cycles, the periods that it lasts",
    r"half|rectif|\|": _TABLE,
    r"unipolar ramp": f"unipolar_triangle if it rises as long as it falls, else a {TABLE}",
    r"^single pulse$": f"unipolar_square with cycles = 1 if it is up for half of the period, else a {TABLE}",
    r"^(rect\w* |square )?\w*pulse?s?$": f"unipolar_square if it is up for half of the period, else a {TABLE}",
    r"saw": _TABLE,
    r"ramp": f"triangle if it rises as long as it falls, else a {TABLE}",
    r"\b(from )?0 ?v? (to )?\d+ ?v\b": "a waveform from 0 V, such as unipolar_sine",
}
"""What a waveform is whose name has this in it, by keys of its group."""
_NEARLY = 0.82  # part of the letters that a misspelt word has of another; "bipolar" and "unipolar" share 0.8


def span_of(drive: Drive) -> tuple[float, float]:
    """The lowest and the highest command per volt of amplitude; those of a sine where a table is not known."""
    form = WAVEFORMS.get(drive.waveform)
    return form.span if form else drive.table.span if drive.table else (-1.0, 1.0)


def peak_to_peak(drive: Drive) -> float:
    """The command from its lowest to its highest per volt of amplitude; 1 of one that is constant, up from rest."""
    low, high = span_of(drive)
    return high - low or 1.0


def from_zero(shape: str) -> str:
    """The waveform of the same shape that goes from 0 V; empty where there is none."""
    name = f"unipolar_{shape}"
    return name if name in WAVEFORMS else ""


def instead(wrong: str) -> str:
    """Remedy for a waveform that there is not: the nearest, and all that there are."""
    text = re.sub(r"(?<=\w)[\s_-]+(?=\w)", " ", wrong.strip().casefold())
    every = f'there are {", ".join(NAMES[:-1])}, and {TABLE} with drive = "file.csv" for any other voltage'
    names = {name: w.id for w in WAVEFORMS.values() for name in (w.id.replace("_", " "), *w.names)} | {TABLE: TABLE}
    for pattern, said in _VARIED.items():
        if re.search(pattern, text) and text not in names:
            rest = _named([word for word in text.split() if not re.search(pattern, word)], names)
            return f"that is {said.format(f'a {rest[0]}' if len(rest) == 1 else 'a waveform')}; {every}"
    near = _named(text.split(), names)
    return f"did you mean {' or '.join(near)}? {every}" if near else every


def _named(words: list[str], names: Mapping[str, str]) -> list[str]:
    """Waveforms of which every word is a word of the name, or nearly; a word that none has may change the rest."""
    short = {name: id for name, id in names.items() if " " not in name}
    sets = [(id, {short.get(word, word) for word in name.split()}) for name, id in names.items()]
    vocabulary = sorted({word for name in names for word in name.split()})
    near = [difflib.get_close_matches(word[:40], vocabulary, n=1, cutoff=_NEARLY) for word in words if word.isalpha()]
    if not near or len(near) < len(words) or not all(near):
        return []
    said = {short.get(word, word) for (word,) in near}
    return list(dict.fromkeys([id for id, has in sets if has == said] or [id for id, has in sets if has > said]))
