"""One text file as `psafit import` reads it, or what it says of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from psafit.errors import InputError
from psafit.experiment.importing import Options, Table, read_files


def tables(folder: Path, content: str, **said: Any) -> list[Table]:
    """The tables of ``in.csv``, by options of `Options`; a sine where they say no waveform."""
    file = folder / "in.csv"
    file.write_text(content, encoding="utf-8")
    return read_files([file], Options(**({"waveforms": ("sine",)} | said)))


def refused(folder: Path, content: str, **said: Any) -> str:
    """The one line that is said of a file."""
    with pytest.raises(InputError) as caught:
        tables(folder, content, **said)
    (line,) = str(caught.value).splitlines()
    assert line.isprintable() and len(line) < 400
    return line
