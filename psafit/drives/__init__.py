"""The waveforms of a drive, one small file each. This is their registry.

To add a waveform, write its file in this folder: whatever module there has a `WAVEFORM` is known by its `id`.
"""

from __future__ import annotations

import difflib
import importlib
import pkgutil

from psafit.drives.drive import Drive, Table
from psafit.drives.waveform import Piece, Waveform

__all__ = ["NAMES", "TABLE", "WAVEFORMS", "Drive", "Piece", "Table", "Waveform", "instead"]

_modules = (importlib.import_module(f"{__name__}.{found.name}") for found in pkgutil.iter_modules(__path__))
WAVEFORMS: dict[str, Waveform] = {m.WAVEFORM.id: m.WAVEFORM for m in _modules if hasattr(m, "WAVEFORM")}
TABLE = "table"
"""Name of a drive whose voltage stands in a file."""
NAMES = (*WAVEFORMS, TABLE)
_VARIED = {
    "cosine": "a sine with phase_deg = 90",
    "cos": "a sine with phase_deg = 90",
    "offset_sine": "a sine with bias_v, and idle_v if it rests there",
    "biased_sine": "a sine with bias_v, and idle_v if it rests there",
    "burst": "the waveform with cycles, the periods that it lasts",
    "sine_burst": "a sine with cycles, the periods that it lasts",
    "half_sine": f"none of psafit's: give one period as a {TABLE}",
    "rectified_sine": f"none of psafit's: give one period as a {TABLE}",
    "pulse": f"unipolar_square if it is up for half of the period, else a {TABLE}",
    "sawtooth": f"none of psafit's: give one period as a {TABLE}",
    "ramp": f"triangle if it rises as long as it falls, else a {TABLE}",
}
"""What a waveform of another name is, by keys of its group."""


def instead(wrong: str) -> str:
    """Remedy for a waveform that there is not: the nearest, and all that there are."""
    text = wrong.strip().casefold().replace(" ", "_").replace("-", "_")
    every = f'there are {", ".join(NAMES[:-1])}, and {TABLE} with drive = "file.csv" for any other voltage'
    if text in _VARIED:
        return f"that is {_VARIED[text]}; {every}"
    other = {name.casefold().replace(" ", "_"): w.id for w in WAVEFORMS.values() for name in w.names}
    near = [other.get(n, n) for n in difflib.get_close_matches(text[:40], [*NAMES, *other], n=1)]
    return f"did you mean {near[0]}? {every}" if near else every
