"""Files as instruments and spreadsheets write them: read right, or asked about in one clear line."""

from __future__ import annotations

import json
import random
import re
from dataclasses import replace
from datetime import date
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import run
from foreign import draw, held_by

from psafit.drives import Drive
from psafit.errors import InputError
from psafit.experiment import GroupId, read_experiment, read_plan
from psafit.experiment.importing import Mapping, Options, Table, read_files
from psafit.experiment.importing.headings import heading
from psafit.experiment.importing.numerals import NOTATIONS
from psafit.experiment.importing.units import Unit, unit

RIG = [
    word
    for value in ("M=27:g", "m=5:g", "q=120:nm/V", "l=90:mm", "k_s=48.9:N/um", "g=9.81")
    for word in ("--set", value)
]
Rows = list[tuple[float, float, float]]
SINE = Options(waveforms=("sine",))


def rows_of(tables: list[Table]) -> Rows:
    found: Rows = []
    for table in tables:
        for group in table.groups:
            columns = (group.frequency_hz, group.amplitude_v, group.reading)
            found += zip(*(column.tolist() for column in columns), strict=True)
    return found


def write(file: Path, content: str | bytes | list[list[Any]]) -> Path:
    """Text as UTF-8, bytes as they are, rows as a workbook."""
    if isinstance(content, list):
        from openpyxl import Workbook

        book = Workbook()
        for row in content:
            book.active.append(row)
        file = file.with_suffix(".xlsx")
        book.save(file)
        return file
    file.write_bytes(content.encode() if isinstance(content, str) else content)
    return file


def imported(folder: Path, content: Any, options: Options = SINE) -> Rows:
    return rows_of(read_files([write(folder / "sweep.csv", content)], options))


def refused(folder: Path, content: Any, options: Options = SINE) -> InputError:
    with pytest.raises(InputError) as caught:
        imported(folder, content, options)
    lines = str(caught.value).splitlines()
    assert all(line.isprintable() and len(line) < 600 for line in lines)
    return caught.value


GERMAN = "Frequenz [kHz];Upp [V];Wurfweite [µm];Bemerkung\n1,2;40;76,00;ok\n1,3;40;75,5;\n"
TWO: Rows = [(1200, 20, 76), (1300, 20, 75.5)]
SEVEN = {
    "semicolons, decimal commas, Windows-1252": GERMAN.encode("cp1252"),
    "UTF-16 with tabs": GERMAN.replace(";", "\t").encode("utf-16"),
    "workbook": [["Frequency (kHz)", "Vpp (V)", "Launch range (µm)"], [1.2, 40, 76.0], [1.3, 40, 75.5]],
    "oscilloscope: preamble, row of units": (
        "Model,DSOX2024A\nRecord Length,41,points\n\n"
        "Frequency,Pk-Pk(1),Launch range\nkHz,mV,um\n1.2,40000,76.00\n1.3,40000,75.5\n"
    ),
    "comments, thousands, blanks": (
        '# logger 2.1\n# gain 20\n"f (Hz)" "Drive (Vp)" "Range (um)"\n"1,200" 20 76\n# a pause\n"1,300" 20 75.5\n'
    ),
    "byte order mark, quotes, DOS lines": (
        "\ufeff"
        + '"Frequency (Hz)","Peak voltage (V)","Launch range (mm)"\r\n"1200","20","0.076"\r\n1300,20,0.0755\r\n'
    ),
    "bars, RMS, exponents, a footer": (
        "Freq. / MHz|Voltage / Vrms|Launch distance / nm\n1.2E-3|14.142135623730951|7.60E+4\n"
        "1.3E-3|14.142135623730951|7.55E+4\nEnd of file\n"
    ),
}


@pytest.mark.parametrize("content", SEVEN.values(), ids=SEVEN.keys())
def test_seven_kinds_of_files_are_read_right(content: Any, tmp_path: Path) -> None:
    np.testing.assert_allclose(imported(tmp_path, content), TWO, rtol=1e-15)


HEAD = "Frequency (Hz);Amplitude (Vp);Launch range (µm)\n"
READ: dict[str, tuple[Any, Rows]] = {
    "psafit's own": ("frequency_hz,amplitude_v,launch_range_um\n1200,20,76\n1300,20,75.5\n", TWO),
    "repetitions, one left out": (
        "f (Hz);U (Vp);R1 (um);R2 (um)\n1200;20;76;75.5\n1300;20;;74\n",
        [(1200, 20, 76), (1200, 20, 75.5), (1300, 20, 74)],
    ),
    "repetitions of one name": (
        "f (Hz);U (Vp);Range (um);Range (um)\n1200;20;76;75.5\n",
        [(1200, 20, 76), (1200, 20, 75.5)],
    ),
    "a unit in each cell": (
        "Frequency;Amplitude;Launch range\n800 Hz;40 Vpp;76 µm\n1.2 kHz;20 Vp;0.0755 mm\n",
        [(800, 20, 76), (1200, 20, 75.5)],
    ),
    "thousands by points": (HEAD + "1.200;20;76,00\n1.300;20;75,5\n", TWO),
    "thousands by apostrophes": (HEAD + "1'200;20;76\n1'300;20;75.5\n", TWO),
    "thousands by narrow blanks": (HEAD + "1\u202f200;20;76\n1\u202f300;20;75.5\n", TWO),
    "columns in another order": ("Range (um);Vpp;No.;f (kHz)\n76;40;1;1.2\n75.5;40;2;1.3\n", TWO),
    "an index without a name": (",f (Hz),Vpp,Range (um)\n0,1200,40,76\n1,1300,40,75.5\n", TWO),
    "headings in a comment": ("# frequency_hz amplitude_v launch_range_um\n1200 20 76\n1300 20 75.5\n", TWO),
    "units that capitals fail": ("F (KHZ);U (VPP);RANGE (UM)\n1.2;40;76\n1.3;40;75.5\n", TWO),
    "old Macintosh lines": ((HEAD + "1200;20;76\n1300;20;75.5\n").replace("\n", "\r"), TWO),
    "a peak force": ("f (kHz);Vpp;Peak force (mN)\n1.2;40;3\n", [(1200, 20, 0.003)]),
    "no offset": (HEAD.strip() + ";DC offset (V)\n1200;20;76;0.0\n1300;20;75.5;0\n", TWO),
}  # fmt: skip


@pytest.mark.parametrize(("content", "rows"), READ.values(), ids=READ.keys())
def test_more_is_read_right(content: Any, rows: Rows, tmp_path: Path) -> None:
    assert imported(tmp_path, content) == rows


ASKED: dict[str, tuple[Any, str, int | None]] = {
    "thousands or decimals": (HEAD + "1.200;20;76\n1.300;20;75\n", "'1.200' may be 1.200 or 1200", 2),
    "volts": ("f (Hz);Amplitude (V);Range (um)\n1200;20;76\n", "zero to peak, peak to peak or RMS --volts pp,", 1),
    "units of heading and row": ("frequency_hz;Vpp;Range\nkHz;V;um\n1;2;3\n", "is in 'Hz', and in 'kHz' by the row", 1),
    "volts of heading and row": ("f;amplitude_v;Range\nkHz;Vpp;um\n1;2;3\n", "'amplitude_v' peak to peak or RMS", 1),
    "volts of heading and cell": (HEAD + "1200;40 Vpp;3\n", "'40 Vpp' is peak to peak, and its column zero to peak", 2),
    "no unit": ("Frequency;Vpp;Range (um)\n1200;40;76\n", "'Frequency' gives no unit Frequency=frequency_hz:Hz", 1),
    "a number with its uncertainty": (HEAD + "1200;20;76±2\n", "a column of its own: sigma_um", 2),
    "a LabVIEW file": ("TDSm\0\0", "a TDMS file (LabVIEW), no table", 1),
    "a speed that is no range": (
        "f (Hz);Vpp;v\n1200;40;76\n", "or as one of launch_speed_mm_s, contact_time_us, peak_force_n", 1
    ),
    "a unit of another kind": ("f (Hz);Vpp;Range (mm/s)\n1200;40;76\n", "another reading among Range", 1),
    "mega or milli": ("Frequency (mhz);Vpp;Range (um)\n1;40;76\n", "no frequency_hz among", 1),
    "radians a second": ("f (rad/s);Vpp;Range (um)\n1200;40;76\n", "no frequency_hz among", 1),
    "two of one": ("f set (Hz);f (Hz);f (Hz);Vpp;Range (um)\n1;1;1;4;7\n", "could all be frequency_hz --column", 1),
    "no repetitions": ("f (Hz);Vpp;Range 10 (um);Range 20 (um)\n1;2;3;4\n", "could all be launch_range_um", 1),
    "a displacement": ("f (Hz);Vpp;Displacement (µm)\n1;2;3\n", "'Displacement (µm)=launch_range_um'", 1),
    "an offset": (HEAD.strip() + ";DC offset (V)\n1200;20;76;10\n", "rests at before its start --set idle_v=10", 2),
    "an offset peak to peak": (HEAD.strip() + ";DC offset (Vpp)\n1200;20;76;10\n", "is bias_v, peak to peak", 1),
    "a trace": ("Time (s),CH1 (V)\n0,1\n1e-6,2\n", "no frequency_hz  'CH1 (V)=velocity_mm_s:5mm/s/V'", 1),
    "a trace below its preamble": (
        "Vertical Units,V,V\nVertical Offset,0,0\nTIME,CH1,CH2\n0,1,2\n1e-6,2,3\n", "'TIME' looks like a trace", 3,
    ),
    "two channels of one name": (
        "x-axis,1,2\nsecond,Volt,Volt\n0,1,2\n1e-6,2,3\n", "no frequency_hz --column '#3=velocity_mm_s:5mm/s/V'", 1,
    ),
    "a mean": (HEAD + "1200;20;76\n1300;20;75\nMean;20;75.5\n", "'Mean' sums up readings put # before it", 4),
    "a second table": (HEAD + "1200;20;76\n" + HEAD + "1300;20;75\n", "another table a file of its own", 3),
    "words between readings": (HEAD + "1200;20;76\nSquare\n1300;20;75\n", "'Square' stands between readings", 3),
    "an overflow": (HEAD + "1200;20;9.9E37\n", "beyond the limits", 2),
    "a word": (HEAD + "1200;20;76\n1300;20;over\n", "'over' is not a number delete the row", 3),
    "an empty cell": (HEAD + "1200;;76\n", "amplitude_v is empty enter the value", 2),
    "no reading": (HEAD + "1200;20;\n", "launch_range_um is empty", 2),
    "a date": (
        [["f (Hz)", "Vpp", "Range (um)"], [1200, 40, date(2026, 2, 1)]], "is no number but a date turn 1.2 into", 2,
    ),
    "decimal commas between commas": ("f (Hz),Vpp,Range (um)\n1200,40,76,0\n", "4 cells another separator", 2),
    "decimals in a note": ("f (Hz),Vpp,Range (um),Note\n1200,40,76,05\n", "may be the decimals Note=ignore", 2),
    "two marks": (HEAD + "1200;20;76.5\n1300;20;75.5\n1400;20;74,5\n", "mix decimal marks '74,5' (line 4)", 4),
    "a heading too many": ("f (Hz);R 1 (um);Vp;R 2 (um);No.\n1;20;7;3\n", "5 headings, and no row of more than", 1),
    "a damaged heading": ("f (Hz);U (V\x8ep);R (um)\n1;20;7\n", "no amplitude_v among", 1),
    "a unit between blanks": ("f No. Vp R\nkHz V um\n1 1 40 76\n", "no launch_range_um nor another reading among", 2),
    "a cell between blanks": ("f_Hz Vpp R_um\n1200 40 76\n1300 76\n", "2 cells in the row, 3 headings", 3),
    "numbers without a name": ("f (Hz);Vpp;Range (um);\n1;2;3;4\n", "headings give each column a heading", 2),
    "no heading known": ("a;b;c\n1;2;3\n", "no column is recognised --column", 1),
    "nothing": (" \n\n", "the file is empty", 1),
    "a reading below zero": (HEAD + "1200;20;76\n1300;20;-0.02\n", "is negative, by no more than scatter enter 0", 3),
    "binary": (b"\x00\x01\x02\xff" * 50, "", 1),
    "a broken workbook": (b"PK\x03\x04" + b"x" * 200, "no workbook save it anew", None),
}  # fmt: skip


@pytest.mark.parametrize(("content", "said", "line"), ASKED.values(), ids=ASKED.keys())
def test_what_is_unclear_is_asked_for(content: Any, said: str, line: int | None, tmp_path: Path) -> None:
    error = refused(tmp_path, content)
    message = " ".join(str(error).split())
    for words in said.split(" " * 2):
        assert all(word in message for word in words.split()), message
    assert error.line == line
    assert error.file is not None and error.file.stem == "sweep"
    assert len(error.remedy) > 5


def test_volts_are_not_counted_against_every_heading(tmp_path: Path) -> None:
    error = refused(tmp_path, HEAD + "1200;40;3\n", replace(SINE, volts="rms"))
    assert error.what == "--volts rms is given, and column 'Amplitude (Vp)' says zero to peak"
    assert error.remedy == "leave out --volts, or correct the heading" and error.line == 1
    wide = "Frequency (Hz);Range (um) at 20 {0};Range (um) at 10 {0}\n1200;40;3\n"
    assert imported(tmp_path, wide.format("V"), replace(SINE, volts="rms"))[0][1] == pytest.approx(20 * 2**0.5)
    assert "says peak to peak" in refused(tmp_path, wide.format("Vpp"), replace(SINE, volts="rms")).what
    files = [tmp_path / "a.csv", tmp_path / "b.csv"]
    for file, text in zip(files, (HEAD + "1200;40;3\n", wide.format("V")), strict=True):
        file.write_text(text, encoding="utf-8")
    assert len(read_files(files, replace(SINE, volts="rms"))) == 2
    held = replace(SINE, volts="rms", values=(("amplitude_v", 20.0),), counted=("pp",))
    error = refused(tmp_path, "Frequency (Hz);Range (um)\n1200;3\n", held)
    assert error.what == "--volts rms is given, and --set amplitude_v says peak to peak"


@pytest.mark.parametrize(
    ("content", "options", "rows"),
    [
        (HEAD + "1.200;20;76\n", {"decimal": "."}, [(1.2, 20, 76)]),
        (HEAD + "1.200;20;76\n", {"decimal": ","}, [(1200, 20, 76)]),
        ("f (Hz);U (V);Range (um)\n1200;40;76\n", {"volts": "pp"}, [(1200, 20, 76)]),
        ("Freq;Vpp;Range (um)\n1.2;40;76\n", {"columns": (Mapping("Freq", "frequency_hz", Unit("kHz")),)}, TWO[:1]),
        ("f (Hz);Range (um)\n1200;76\n", {"values": (("amplitude_v", 20.0),)}, TWO[:1]),
        (
            "1,2;40;76\n",
            {
                "columns": (
                    Mapping("1", "frequency_hz", Unit("kHz")),
                    Mapping("2", "amplitude_v", Unit("V", "pp")),
                    Mapping("3", "launch_range_um", Unit("um")),
                )
            },
            TWO[:1],
        ),
        (
            "F;a;b\n1.2;40;76\n",  # by name and by number
            {
                "columns": (
                    Mapping("F", "frequency_hz", Unit("kHz")),
                    Mapping("2", "amplitude_v", Unit("V", "pp")),
                    Mapping("3", "launch_range_um", Unit("um")),
                )
            },
            TWO[:1],
        ),
        (
            "f (kHz);a;b\n1.2;40;76\n",
            {
                "columns": (
                    Mapping("2", "amplitude_v", Unit("V", "pp")),
                    Mapping("3", "launch_range_um", Unit("um")),
                )
            },
            TWO[:1],
        ),
        ("Set (Hz);f (Hz);Vpp;Range (um)\n1;1200;40;76\n", {"columns": (Mapping("Set", "ignore"),)}, TWO[:1]),
        ("F (Hz)^Vp^Range (um)\n1200^20^76\n", {"separator": "^"}, TWO[:1]),
        ("f (Hz);Vpp;Weite (µm)\n1200;40;76\n".encode("cp850"), {"encoding": "cp850"}, TWO[:1]),
    ],
)
def test_what_is_said_settles_it(content: Any, options: dict[str, Any], rows: Rows, tmp_path: Path) -> None:
    assert imported(tmp_path, content, Options(waveforms=("sine",), **options)) == rows


def test_a_bias_and_what_the_drive_rests_at_are_its_own(tmp_path: Path) -> None:
    """In columns, where each bias is a group, or held."""
    text = HEAD.strip() + ";Offset (mV);Idle (V)\n1200;20;76;10000;5\n1300;20;75.5;10000;5\n1200;20;76;0;0\n"
    (table,) = read_files([write(tmp_path / "a.csv", text)], SINE)
    assert [g.drive for g in table.groups] == [Drive("sine", bias_v=10.0, idle_v=5.0), Drive("sine")]
    assert rows_of([table])[:2] == TWO
    held = replace(SINE, values=(("bias_v", 10.0), ("idle_v", 10.0)))
    (table,) = read_files([write(tmp_path / "b.csv", HEAD + "1200;20;76\n")], held)
    assert [g.drive for g in table.groups] == [Drive("sine", bias_v=10.0, idle_v=10.0)]
    with pytest.raises(InputError, match=r"bias_v is given, and column 'Offset \(mV\)' holds it"):
        read_files([tmp_path / "a.csv"], held)


def test_phase_and_periods_are_given_for_a_table_or_each(tmp_path: Path) -> None:
    """A recorded drive has them in it."""
    files = [write(tmp_path / name, HEAD + "1200;20;76\n") for name in ("a.csv", "b.csv")]
    held = replace(SINE, values=(("phase_deg", 30.0), ("cycles", (5.0, 3.0))))
    drives = [g.drive for table in read_files(files, held) for g in table.groups]
    assert drives == [Drive("sine", phase_deg=30.0, cycles=5.0), Drive("sine", phase_deg=30.0, cycles=3.0)]
    scope = write(tmp_path / "scope.csv", "Time (us),CH1 (V)\n" + "".join(f"{10 * i},{i}\n" for i in range(12)))
    with pytest.raises(InputError, match="cycles is given, and no table takes it"):
        read_files(files[:1], Options(drive_file=scope, values=(("cycles", 5.0),)))


LABELLED = [("A", 1200), ("A", 1300), ("B", 1200), ("B", 1300), ("C", 1200), ("C", 1300)]


@pytest.mark.parametrize(
    ("rows", "labelled"),
    [
        (LABELLED, (("Messreihe", 3),)),
        (LABELLED[::2], ()),  # a label for each row
        (LABELLED[:2], ()),  # one for all of them
        ([*LABELLED, *LABELLED], ()),  # the same ones again
    ],
)
def test_a_column_of_labels_over_blocks_of_rows_is_proposed_as_groups(
    rows: list[tuple[str, int]], labelled: tuple[tuple[str, int], ...], tmp_path: Path
) -> None:
    text = "Messreihe;f (Hz);Vp;Range (um)\n" + "".join(
        f"{label};{f};20;{76 + k}\n" for k, (label, f) in enumerate(rows)
    )
    file = write(tmp_path / "a.csv", text)
    (table,) = read_files([file], SINE)
    assert (table.unused, table.labelled) == (("Messreihe",), labelled)
    (grouped,) = read_files([file], replace(SINE, columns=(Mapping("Messreihe", "group"),)))
    assert not grouped.labelled and len(grouped.groups) == len(set(label for label, _ in rows))
    (ignored,) = read_files([file], replace(SINE, columns=(Mapping("Messreihe", "ignore"),)))
    assert not ignored.labelled


@pytest.mark.parametrize(
    ("labels", "ids"),
    [
        (["Montag früh", "Di., 3.11."], ["Montag_fruh", "Di_3_11"]),
        (["12", "7"], [12, 7]),
        (["01", "02"], [1, 2]),  # no number as it would be written: they are counted
        (["A b", "A-b", "A.b"], [1, 2, 3]),  # two come to the same
        (["A", "a"], [1, 2]),  # and so would their files
        (["A", "µ?"], [1, 2]),
        (["x" * 33, "y"], [1, 2]),
    ],
)
def test_groups_are_called_by_their_labels(
    labels: list[str], ids: list[int | str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    rows = "".join(f"{label};{f};20;76\n" for label in labels for f in (1200, 1300))
    write(Path("a.csv"), f"Day;f (Hz);Vp;Range (um)\n{rows}")
    given = ["--waveform", "sine", "--column", "Day=group", "--out", "rig"]
    assert run(monkeypatch, "import", "a.csv", *given) == 0
    text = Path("rig", "experiment.toml").read_text("utf-8")
    assert re.findall(r"^\[\[group\]\].*\nid = (.*)$", text, re.MULTILINE) == [json.dumps(i) for i in ids]
    files = [f"group{i}.csv" if isinstance(i, int) else f"group-{i}.csv" for i in ids]
    assert re.findall(r'^file = "(.*)"$', text, re.MULTILINE) == files
    assert [f"# {label}\n" in text for label in labels] == [
        label != str(i) for label, i in zip(labels, ids, strict=True)
    ]


@pytest.mark.parametrize(("volts", "several"), [("20", False), ("40", True)])
def test_sweeps_that_have_become_one_group_are_asked_about(
    volts: str, several: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write(Path("a.csv"), f"f (Hz);Vp;Range (um)\n1000;20;76\n1500;20;70\n1000;{volts};150\n1500;{volts};140\n")
    assert run(monkeypatch, "import", "a.csv", "--waveform", "sine", "--out", "rig") == 0
    assert ("\none group, in which frequency and amplitude vary: if" in capsys.readouterr().out) is several
    write(Path("b.csv"), Path("a.csv").read_text("utf-8"))
    assert run(monkeypatch, "import", "a.csv", "b.csv", "--waveform", "sine", "--out", "two") == 0
    out = capsys.readouterr().out
    assert ("\ngroups 1 and 2, in which frequency and amplitude vary: if" in out) is several
    assert 'of one session write session = "NAME" in two' in out


def test_an_import_takes_sessions_from_a_column(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Readings of two sessions are two groups; a number is no group's id."""
    monkeypatch.chdir(tmp_path)
    rows = "".join(f"{day};{f};20;76\n" for day in ("1", "Tue 3rd") for f in (1200, 1300))
    write(Path("a.csv"), f"Day;f (Hz);Vp;Range (um)\n{rows}")
    given = ["--waveform", "sine", "--set", "M=27:g", "--set", "m=5:g", "--set", "q=120:nm/V", "--set", "l=90:mm",
             "--set", "k_s=48.9:N/um", "--set", "g=9.81"]  # fmt: skip
    assert run(monkeypatch, "import", "a.csv", *given, "--column", "Day=session", "--out", "rig") == 0
    assert "counts as a session of its own" not in capsys.readouterr().out
    assert [(g.id, g.session, g.n_points) for g in read_experiment(tmp_path / "rig").groups] == [
        (1, "session1", 2), (2, "Tue_3rd", 2)
    ]  # fmt: skip
    write(Path("b.csv"), f"Day;f (Hz);Vp;Range (um)\n{rows};1400;20;70\n")
    assert run(monkeypatch, "import", "b.csv", *given, "--column", "Day=session", "--out", "other") == 2
    assert "b.csv:6: session '' is no name of a session" in capsys.readouterr().err


def test_an_import_takes_a_session_of_each_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in "abc":
        write(Path(f"{name}.csv"), "Day;f (Hz);Vp;Range (um)\nmon;1200;20;76\nmon;1300;20;75\n")

    def imported(*words: str) -> list[GroupId | None] | str:
        files = ["a.csv", "b.csv", "c.csv", "--waveform", "sine", "--out", f"rig{len(list(tmp_path.iterdir()))}"]
        if run(monkeypatch, "import", *files, *words) == 2:
            return capsys.readouterr().err.rstrip("\n")
        return [g.session for g in read_plan(Path(files[-1])).groups]

    rig = [w for c in ("M=27:g", "m=5:g", "q=120:nm/V", "l=90:mm", "k_s=48.9:N/um", "g=9.81") for w in ("--set", c)]
    assert imported(*rig) == [None, None, None]
    assert imported(*rig, "--session", "mon") == ["mon", "mon", "mon"]
    assert imported(*rig, "--session", "2, ,Tue 3rd") == ["session2", None, "Tue_3rd"]
    assert str(imported("--session", "mon,tue")).endswith("2 sessions for 3 tables; give one, or one for each, blank"
                                                          " where there is none")  # fmt: skip
    assert "--session: '@' is no name of a session; write letters or digits" in str(imported("--session", "@,a,b"))
    both = str(imported("--session", "mon", "--column", "Day=session"))
    assert "--session is given, and column 'Day' names the sessions; leave out --session, or say" in both


def test_an_import_ends_with_what_it_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write(Path("a.csv"), "f (Hz);Vp;Range (um);Contact (us)\n1200;20;76;310\n1300;20;75;300\n")
    assert run(monkeypatch, "import", "a.csv", "--waveform", "sine", "--out", "rig") == 0
    assert "# [instruments]\n" in Path("rig/experiment.toml").read_text()
    *_, wrote, left, then = capsys.readouterr().out.splitlines()
    assert wrote.startswith("wrote rig/experiment.toml") and then.endswith("then: psafit check rig")
    assert left == "without 'Contact (us)', which may be readings, too: see above"


def test_an_import_prints_its_labels_and_proposes_what_new_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The tables that may be there, as comments with which the rig is described, word for word."""
    monkeypatch.chdir(tmp_path)
    rows = "".join(f"{label};{f};20;76\n" for label, f in LABELLED)
    write(Path("a.csv"), f"Day 1;f (Hz);Vp;Range (um)\n{rows}")
    given = ["--waveform", "sine", "--set", "cycles=5:periods", "--set", "phase_deg=-30", "--out", "rig"]
    assert run(monkeypatch, "import", "a.csv", *given) == 0
    printed = capsys.readouterr().out
    assert "\n  'Day 1' has 3 labels; --column 'Day 1=group' makes a group of each (with another --out)\n" in printed
    assert "group 1: sine at -30 degrees for 5 periods, -20 to 20 V, 6 readings" in printed
    assert run(monkeypatch, "new", "begun") == 0
    written, begun = (Path(folder, "experiment.toml").read_text("utf-8") for folder in ("rig", "begun"))
    assert run(monkeypatch, "import", "a.csv", *given[:-1], "parted", "--column", "Day 1=group") == 0
    for label in dict.fromkeys(label for label, _ in LABELLED):
        assert f"  group {label}: sine at -30 degrees" in (printed := printed + capsys.readouterr().out)
        assert f'[[group]]\nid = "{label}"\n' in Path("parted", "experiment.toml").read_text("utf-8")
    for table in ("rig", "limits"):
        (block,) = (part for part in begun.split("\n\n") if f"# [{table}]\n" in part)
        assert f"\n\n{block}\n\n" in written
    assert "cycles = 5\n" in written and "phase_deg = -30\n" in written


def test_the_drive_is_printed_with_its_voltages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Those of a row when it is imported, those of a group when it is checked; `waveform` in JSON is the bare name."""
    monkeypatch.chdir(tmp_path)
    write(Path("a.csv"), HEAD.strip() + ";DC offset (V)\n1200;20;76;10\n1300;20;75.5;10\n")
    rig = [w for name in ("M=0.02", "m=0.008", "q=1.5e-7", "l=0.2", "k_s=3.5e7", "g=9.81") for w in ("--set", name)]
    given = ["--waveform", "unipolar_sine", "--column", "DC offset (V)=bias_v", "--set", "idle_v=5", *rig]
    assert run(monkeypatch, "import", "a.csv", *given, "--out", "rig") == 0
    assert "->  1200 Hz, 20 V, 76 um, bias 10 V\n" in capsys.readouterr().out
    assert run(monkeypatch, "check", "rig", "--json", "said.json") == 0
    assert "group 1: unipolar sine (bias 10 V, idle 5 V), 2 readings" in capsys.readouterr().out
    assert json.loads(Path("said.json").read_text("utf-8"))["groups"][0]["waveform"] == "unipolar_sine"


def test_a_bias_is_in_a_recorded_drive(tmp_path: Path) -> None:
    scope = write(tmp_path / "scope.csv", "Time (us),CH1 (V)\n" + "".join(f"{10 * i},{i}\n" for i in range(12)))
    said = Options(drive_file=scope)
    with pytest.raises(InputError, match="holds bias_v, and the drive is a recording"):
        read_files([write(tmp_path / "a.csv", HEAD.strip() + ";Offset (V)\n1200;20;76;3\n")], said)
    (table,) = read_files([write(tmp_path / "b.csv", HEAD.strip() + ";Offset (V)\n1200;20;76;0\n")], said)
    assert table.groups[0].drive.recorded and table.unused == ("Offset (V)",)


def test_a_column_may_give_waveform_and_group(tmp_path: Path) -> None:
    text = "Waveform;f (Hz);Vrms;Range (um);Day\nSinus;1200;14;76;1\nRechteck;1200;20;93;1\nsine;1200;14;75;2\n"
    (table,) = read_files([write(tmp_path / "a.csv", text)], Options(columns=(Mapping("Day", "group"),)))
    assert [(g.id, g.waveform, g.n_points) for g in table.groups] == [(1, "sine", 1), (2, "square", 1), (3, "sine", 1)]
    assert [float(g.amplitude_v[0]) for g in table.groups] == pytest.approx([14 * 2**0.5, 20, 14 * 2**0.5], rel=1e-15)


def test_a_drive_that_is_not_known_is_not_called_another(tmp_path: Path) -> None:
    error = refused(tmp_path, GERMAN, Options(waveforms=("sawtooth",)))
    assert "'sawtooth'" in str(error) and "for any other voltage" in str(error)
    assert "--waveform sine" in str(refused(tmp_path, GERMAN, Options()))


def test_a_pulse_is_not_taken_for_a_waveform(tmp_path: Path) -> None:
    file = tmp_path / "sweep.csv"
    file.write_text("frequency_hz,amplitude_v,waveform,launch_range_um\n1000,20,PULSE,25\n", "utf-8")
    with pytest.raises(InputError, match="'PULSE' is no waveform that psafit knows"):
        read_files([file], Options())


def test_a_table_is_no_waveform_to_import(tmp_path: Path) -> None:
    error = refused(tmp_path, HEAD + "1200;20;76\n", Options(waveforms=("table",)))
    assert "say --drive FILE" in str(error) and "did you mean" not in str(error)


def test_sheets(tmp_path: Path) -> None:
    from openpyxl import Workbook

    book = Workbook()
    for name, volts in (("low", 20), ("high", 40)):
        sheet = book.create_sheet(name)
        sheet.append(["f (kHz)", "Vpp", "Range (µm)"])
        sheet.append([1.2, volts, 76])
    file = tmp_path / "book.xlsx"
    book.save(file)
    with pytest.raises(InputError, match=r"sheets low, high hold tables; say which: --sheet"):
        read_files([file], SINE)
    tables = read_files([file], Options(waveforms=("sine", "square"), sheets=("high", "low")))
    assert [t.place for t in tables] == ["book.xlsx, sheet high", "book.xlsx, sheet low"]
    assert [(g.id, g.waveform, float(g.amplitude_v[0])) for t in tables for g in t.groups] == [
        (1, "sine", 20), (2, "square", 10),
    ]  # fmt: skip
    wrong = book.create_sheet("wrong")
    wrong.append(["f (kHz)", "Vpp", "Range (µm)"])
    wrong.append([1.2, "forty", 76])
    book.save(file)
    with pytest.raises(InputError, match=r"book\.xlsx:2: sheet 'wrong': amplitude_v 'forty' is not a number"):
        read_files([file], Options(waveforms=("sine", "square"), sheets=("high", "wrong")))
    with pytest.raises(InputError, match="no sheet 'mid'"):
        read_files([file], Options(waveforms=("sine",), sheets=("mid",)))


def test_a_number_is_read_as_a_spreadsheet_shows_it(tmp_path: Path) -> None:
    """A formula left 0.1 times 7, which is not 0.7."""
    from openpyxl import Workbook

    book = Workbook()
    for row in (["f (kHz)", "Vp", "Range (µm)"], [0.1 * 7, 20, 76], [1.2, 20, 50]):
        book.active.append(row)
    book.save(tmp_path / "book.xlsx")
    (table,) = read_files([tmp_path / "book.xlsx"], SINE)
    assert table.groups[0].frequency_hz.tolist() == [700.0, 1200.0]


def test_drawn_files_are_read_right_or_asked_about(tmp_path: Path) -> None:
    asked = 0
    for number in range(300):
        made = draw(random.Random(f"test-{number}"), tmp_path)
        said: dict[str, Any] = dict(zip(made.options[::2], made.options[1::2], strict=True))
        waves = (said["--waveform"],) if "--waveform" in said else ()
        try:
            tables = read_files([made.file], Options(waveforms=waves, volts=said.get("--volts")))
        except InputError:
            asked += 1
            continue
        assert held_by([g for t in tables for g in t.groups]) == sorted(made.readings), number
    assert asked < 45  # 15 %; a reader that refuses everything is never wrong


def test_import_check_and_values(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write(Path("sinus.csv"), GERMAN.encode("cp1252"))
    write(Path("rechteck.csv"), HEAD + "1200;12;30\n")
    words = [
        "import",
        "sinus.csv",
        "rechteck.csv",
        "--waveform",
        "sine,square",
        "--out",
        "rig",
        "--json",
        "import.json",
    ]
    assert run(monkeypatch, *words, *RIG) == 0
    said = capsys.readouterr().out
    assert "amplitude_v      from 'Upp [V]', V, peak to peak" in said
    assert "line 2: 1,2 | 40 | 76,00 | ok  ->  1200 Hz, 20 V, 76 um" in said
    assert "not used: 'Bemerkung'" in said
    assert run(monkeypatch, "check", "rig") == 0
    data = read_experiment("rig")
    assert data.source == "sinus.csv; rechteck.csv"
    assert not data.warnings
    assert (data.constants.M, data.constants.m, data.constants.q) == (0.027, 0.005, 1.2e-7)
    assert (data.constants.l, data.constants.k_s, data.constants.g) == (0.09, 4.89e7, 9.81)
    first, second = data.groups
    assert (first.waveform, second.waveform) == ("sine", "square")
    columns = (first.frequency_hz, first.amplitude_v, first.reading)
    assert list(zip(*(c.tolist() for c in columns), strict=True)) == TWO
    reported = json.loads(Path("import.json").read_text("utf-8"))
    assert reported["missing_constants"] == [] and len(reported["tables"]) == 2
    assert reported["tables"][0]["columns"][1] == {
        "column": "amplitude_v", "headings": ["Upp [V]"], "unit": "V", "factor": 1.0, "volts": "pp", "zero": 0.0,
    }  # fmt: skip
    assert run(monkeypatch, "import", "sinus.csv", "--waveform", "sine", "--rig", "rig", "--out", "more") == 0
    assert read_experiment("more").constants == data.constants


def test_another_unit_is_suspected_before_the_rig_is_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write(Path("a.csv"), "Frequency (Hz);Vpp;Range (um)\n1.2;40;76\n1.35;40;75\n")
    assert run(monkeypatch, "import", "a.csv", "--waveform", "sine", "--out", "rig") == 0
    assert "every frequency is at or below 50 Hz (greatest 1.35); given in kHz?" in capsys.readouterr().err


def test_constants_that_nobody_gave_are_left_to_be_filled_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write(Path("sinus.csv"), GERMAN)
    assert run(monkeypatch, "import", "sinus.csv", "--waveform", "sine", "--out", "rig", "--set", "M=27:g") == 0
    assert "not in the files: m, q, l, k_s, g; write what is missing into" in capsys.readouterr().out
    assert run(monkeypatch, "check", "rig") == 2
    assert "experiment.toml:4: constants m, q, l, k_s, g are missing" in capsys.readouterr().err
    assert "# l = # m, the string" in " ".join(Path("rig/experiment.toml").read_text("utf-8").split())


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--column", "Freq"], "is not HEADING=COLUMN:UNIT"),
        (["--column", "Freq=frequenzy_hz"], "did you mean frequency_hz"),
        (["--column", "Freq=frequency_hz:parsec"], "'parsec' is no unit"),
        (["--column", "Nothing=ignore"], "there is no column 'Nothing'"),
        (["--set", "mass=3"], "there is no 'mass'"),
        (["--set", "amplitude_vpp=40"], "there is no 'amplitude_vpp'; say for example amplitude_v=40:Vpp"),
        (["--set", "M=3:V"], "'V' is no unit of M; give it in kg"),
        (["--set", "M=1,5"], "'1,5' is no number"),
        (["--set", "M=1e9"], "beyond the limits"),
        (["--set", "cycles=0"], "beyond the limits 0.001 to 1e+09 periods"),
        (["--set", "cycles=5:ms"], "'ms' is no unit of cycles; give it in periods"),
        (["--set", "M=1", "--set", "M=1"], "gives M twice"),
        (["--set", "amplitude_v=20"], "amplitude_v is given, and column 'Upp [V]' holds it"),
        (["--encoding", "klingon"], "unknown encoding 'klingon'"),
        (["--waveform", "sine,sine"], "2 waveforms for 1 tables"),
        (["sinus.csv"], "a file is named twice"),
        (["missing.csv"], "missing.csv: cannot be read (No such file or directory)"),
    ],
)
def test_bad_options_end_in_one_line_and_leave_nothing(
    words: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write(Path("sinus.csv"), GERMAN)
    given = words if "--waveform" in words else [*words, "--waveform", "sine"]
    assert run(monkeypatch, "import", "sinus.csv", "--out", "rig", *given) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
    assert not Path("rig").exists()


CELLS = "frequency_hz,amplitude_v,launch_range_um\nHz,V,um\n1200,20,76\n"


def test_check_points_to_import(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from folders import TOML
    from folders import write as write_folder

    for content in (GERMAN, GERMAN.encode("utf-16"), GERMAN.encode("cp1252"), "f,V,L\n1,2,3\n", b"PK\x03\x04x", CELLS):
        folder = write_folder(tmp_path / "rig", TOML, a=content)
        assert run(monkeypatch, "check", folder) == 2
        assert "psafit import" in capsys.readouterr().err.splitlines()[0], content


def test_another_observable_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A quantity that the tables know is recognised by name, unit and number; that it cannot be used yet is said."""
    from psafit.experiment.importing import headings, quantities

    new = quantities.Quantity("rebound_height_um", "um", ("rebound height",), "reading")
    monkeypatch.setattr(headings, "QUANTITIES", (*quantities.QUANTITIES, new))
    monkeypatch.setitem(quantities.COLUMNS, new.column, new)
    (table,) = read_files([write(tmp_path / "a.csv", HEAD.strip() + ";Rebound height 1 (mm)\n1200;20;76;3\n")], SINE)
    assert table.not_yet == (("Rebound height 1 (mm)", "rebound_height_um"),)


@pytest.mark.parametrize(
    ("text", "target", "factor"),
    [
        ("kHz", "Hz", "1000"), ("KHZ", "Hz", "1000"), ("MHz", "Hz", "1000000"), ("µm", "um", "1"), ("μm", "um", "1"),
        ("nm", "um", "0.001"), ("inch", "um", "25400"), ("m/s", "mm/s", "1000"), ("mV", "V", "0.001"),
        ("ms", "us", "1000"), ("mN", "N", "0.001"),
    ],
)  # fmt: skip
def test_factors_are_exact(text: str, target: str, factor: str) -> None:
    assert Unit(text).factor(target) == Decimal(factor)


@pytest.mark.parametrize("text", ["rad/s", "rpm", "mhz", "pp", "9**9**9", "dBV", "°C", "parsec", "", "a" * 5000, "()"])
def test_what_is_no_unit(text: str) -> None:
    assert unit(text) is None


@pytest.mark.parametrize(
    ("text", "column", "volts", "number"),
    [
        ("Frequency (kHz)", "frequency_hz", None, None),
        ("f/kHz", "frequency_hz", None, None),
        ("FREQUENCY_MHz", "frequency_hz", None, None),
        ("Launch velocity (mm·s⁻¹)", "launch_speed_mm_s", None, None),
        ("Launch velocity / m s^-1", "launch_speed_mm_s", None, None),
        ("U_pp / V", "amplitude_v", "pp", None),
        ("Peak-to-peak voltage [mV]", "amplitude_v", "pp", None),
        ("Drive voltage (Vrms)", "amplitude_v", "rms", None),
        ("Amplitude (V)", "amplitude_v", None, None),
        ("amplitude_v", "amplitude_v", "peak", None),
        ("Amplitude_V", "amplitude_v", None, None),
        ("Generator voltage (Vpp)", "", None, None),
        ("Launch range 2 [µm]", "launch_range_um", None, 2),
        ("Reading 3 in um", "launch_range_um", None, 3),
        ("Range (V)", "", None, None),
        ("Amplitude (µm)", "", None, None),
        ("v (mm/s)", "launch_speed_mm_s", None, None),
        ("Contact time (ms)", "contact_time_us", None, None),
        ("Peak force (mN)", "peak_force_n", None, None),
    ],
)
def test_headings(text: str, column: str, volts: str | None, number: int | None) -> None:
    found = heading(text)
    of_launches = [q.column for q in found.quantities() if q.role != "trace"]
    assert of_launches == ([column] if column else [])
    if column:
        assert (found.volts, found.number) == (volts, number)


@pytest.mark.parametrize(
    ("text", "point", "comma"),
    [
        ("1200", "1200", "1200"), ("1.2", "1.2", None), ("1,2", None, "1.2"), ("1.234", "1.234", "1234"),
        ("1,234", "1234", "1.234"), ("0.123", "0.123", None), ("1234.567", "1234.567", None),
        ("1.234.567", None, "1234567"), ("1.234,5", None, "1234.5"), ("1 234", "1234", "1234"),
        ("1'234.5", "1234.5", None),
        ("1.5e3", "1.5E+3", None), (".5", "0.5", None), ("1_000", None, None), ("nan", None, None), ("--5", None, None),
        ("1.2.3", None, None), ("١", None, None), ("1,20,000", None, None), ("", None, None),
    ],
)  # fmt: skip
def test_numbers(text: str, point: str | None, comma: str | None) -> None:
    for mark, expected in ((".", point), (",", comma)):
        found = NOTATIONS[mark].value(text)
        assert found == (None if expected is None else Decimal(expected))
