"""Files that read as something else than they are: asked about in one line, with a remedy that reads them right."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from psafit.drives import Drive
from psafit.errors import InputError
from psafit.experiment.importing import Mapping, Options, Table, read_files

RESTS = (("idle_v", 0.0),)
OFFSET = "Frequency (Hz);Amplitude (Vpp);DC offset (V);Range (um)\n1200;20;10;76\n1300;20;10;75\n1400;20;10;73.5\n"


def tables(folder: Path, content: str, **said: Any) -> list[Table]:
    file = folder / "sweep.csv"
    file.write_text(content, encoding="utf-8")
    return read_files([file], Options(**({"waveforms": ("sine",)} | said)))


def refused(folder: Path, content: str, **said: Any) -> str:
    with pytest.raises(InputError) as caught:
        tables(folder, content, **said)
    (line,) = str(caught.value).splitlines()
    assert line.isprintable() and len(line) < 400
    return line


@pytest.mark.parametrize("waveform", ["unipolar_sine", "unipolar_square"])
def test_an_offset_that_makes_a_drive_unipolar_is_counted_once(waveform: str, tmp_path: Path) -> None:
    said: dict[str, Any] = {"waveforms": (waveform,), "values": RESTS}
    asked = refused(tmp_path, OFFSET, **said)
    plain = waveform.removeprefix("unipolar_")
    assert f"column 'DC offset (V)' adds 10 V; say --waveform {plain} " in asked
    assert "'DC offset (V)=ignore'" in asked and "'DC offset (V)=bias_v'" in asked
    for column, drive in (("ignore", Drive(waveform)), ("bias_v", Drive(waveform, bias_v=10.0))):
        (table,) = tables(tmp_path, OFFSET, **said, columns=(Mapping("DC offset (V)", column),))
        assert table.groups[0].drive == drive and table.groups[0].amplitude_v[0] == 20.0
    (table,) = tables(tmp_path, OFFSET, values=RESTS)
    assert table.groups[0].drive == Drive("sine", bias_v=10.0) and table.groups[0].amplitude_v[0] == 10.0
    (table,) = tables(tmp_path, OFFSET.replace(";10;", ";0;"), **said)
    assert table.groups[0].drive == Drive(waveform)


@pytest.mark.parametrize(("name", "said"), [("offset sine", "a sine with bias_v"), ("Cosine", "phase_deg = 90")])
def test_a_waveform_of_another_name_is_not_guessed(name: str, said: str, tmp_path: Path) -> None:
    rows = "".join(f"{name};{row}\n" for row in OFFSET.splitlines()[1:])
    asked = refused(tmp_path, f"Waveform;{OFFSET.splitlines()[0]}\n{rows}", waveforms=(), values=RESTS)
    assert said in asked
