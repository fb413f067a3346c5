"""What is wrong with a folder is reported at once, by its own name, and with a remedy that loses nothing."""

from __future__ import annotations

import io
import pickle
import zipfile
from pathlib import Path

import pytest
from folders import CSV, HEADER, SIGMA, TOML, refusal, write

from psafit.errors import Faults, InputError, InputErrors
from psafit.experiment import read_experiment, read_plan, write_experiment
from psafit.inference import noise
from psafit.prior_check import read


def refusals(folder: Path) -> list[str]:
    """Lines of the error that reading ends in, without the folder."""
    with pytest.raises(InputErrors) as caught:
        read(folder)
    error = caught.value
    lines = str(error).split("\n")
    assert all(line.isprintable() for line in lines) and len(lines) == len(error.faults) + (error.more > 0)
    assert str(error.faults[0]) == lines[0] and error.faults[0].line == error.line
    return [line.replace(f"{folder}/", "") for line in lines]


# --- several faults -------------------------------------------------------------------------------


def test_all_faults_of_all_files_at_once(tmp_path: Path) -> None:
    toml = TOML.replace("0.027", "-1").replace("9.81", '"x"').replace("square", "squar").replace("title", "titel")
    toml += "constants = { l = 0 }\n[limits]\nl = 1\ng = [2, 1]\n[prior.k_c]\nmedian = 0\nfactor = 1\nsource = 's'\n"
    found = refusals(write(tmp_path, toml, a=CSV + "1200,x,1\n,1\n5,5,nan\n"))
    assert [line.partition("; ")[0] for line in found] == [
        "experiment.toml:1: unknown key 'titel'",
        "experiment.toml:5: constant M = -1 is not positive and finite",
        "experiment.toml:10: constant g is not a number",
        "experiment.toml:19: group late-2: unknown waveform 'squar'",
        "experiment.toml:21: constant l = 0 is not positive and finite",
        "experiment.toml:23: limits of l are not two numbers",
        "experiment.toml:24: limits of g are not two positive numbers, the smaller first, within 0.001 to 1e+06",
        "experiment.toml:26: prior of 'k_c': median is not a finite number above 0",
        "experiment.toml:27: prior of 'k_c': factor is not a finite number above 1",
        "a.csv:5: amplitude_v 'x' is not a number",
        "and 2 more",
    ]


def test_faults_of_each_file_are_named(tmp_path: Path) -> None:
    found = refusals(write(tmp_path, a=CSV + "1200,20,1,\n", b=CSV.replace("amplitude_v", "amplitude")))
    assert found[0].startswith("a.csv:5: 4 cells in the row") and found[1].startswith("b.csv:1: unknown column")
    with pytest.raises(InputErrors):
        read_plan(tmp_path)


def test_ten_are_named_and_the_rest_counted(tmp_path: Path) -> None:
    found = refusals(write(tmp_path, a=CSV + "".join(f"1200,x{k},1\n" for k in range(15))))
    assert len(found) == 11 and found[9].startswith("a.csv:14: ") and found[10] == "and 5 more"


def test_equal_faults_of_many_rows_are_one(tmp_path: Path) -> None:
    error = refusal(write(tmp_path, a=CSV + "1200,x,1\n" * 15))
    assert error.line == 5 and error.what == "amplitude_v 'x' is not a number, as in 15 rows"
    assert len(refusals(write(tmp_path, a=CSV + "1200,x,1\n" * 2))) == 2


@pytest.mark.parametrize(("row", "words"), [("1200,20 V,1\n", "without a unit"), ("1200,20,1,\n", "ends with a comma")])
def test_a_fault_of_all_rows_is_one(tmp_path: Path, row: str, words: str) -> None:
    error = refusal(write(tmp_path, a=HEADER + row * 30))
    assert error.line == 2 and "as in all 30 rows" in error.what and words in str(error)


def test_knowledge_of_what_is_no_parameter_is_reported_at_once(tmp_path: Path) -> None:
    prior = '[prior.{}]\nmedian = 1\nfactor = 2\nsource = "s"\n'
    found = refusals(write(tmp_path, TOML + prior.format("kc") + prior.format("cs")))
    assert len(found) == 2 and ":21: there is no parameter 'kc'" in found[0] and ":25: " in found[1]


@pytest.mark.parametrize(
    "toml",
    [
        TOML.replace("waveform", "wavform", 1),
        TOML.replace("[constants]", "[constant]"),
        TOML.replace("[[group]]", "[[groups]]"),
        TOML.replace("l = 0.09", "lenght = 0.09"),
        TOML.replace("g = 9.81\n\n[[group]]", "g = 9.81\n"),
    ],
)
def test_what_follows_from_a_fault_is_none(tmp_path: Path, toml: str) -> None:
    refusal(write(tmp_path, toml))


def test_missing_constants_are_one_fault(tmp_path: Path) -> None:
    assert "constants g, k_s" not in TOML
    error = refusal(write(tmp_path, TOML.replace("g = 9.81\n", "").replace("k_s = 4.89e7\n", "")))
    assert "constants k_s, g are missing" in error.what


def test_faults_are_kept_and_travel_between_processes() -> None:
    faults = Faults(2)
    for line in (3, 1, 2):
        with faults.kept():
            raise InputError(f"x{line}", "y", file="a", line=line)
    faults.add(InputError("z", "y", file="b"), more=4)
    with pytest.raises(InputErrors) as caught:
        faults.end()
    again = pickle.loads(pickle.dumps(caught.value))
    for error in (caught.value, again):
        assert str(error) == "a:1: x1; y\na:2: x2; y\nand 6 more" and (error.line, error.more) == (1, 6)
    Faults().end()


# --- readings below zero --------------------------------------------------------------------------


def test_what_scatter_took_below_zero_is_a_reading_of_zero(tmp_path: Path) -> None:
    """To delete it would select by outcome."""
    error = refusal(write(tmp_path, a=CSV + "1200,1,-0.05\n"))
    assert error.line == 5 and "'-0.05' is negative" in error.what and "enter 0" in error.remedy
    assert "keep the row" in error.remedy
    assert "enter 0" in refusal(write(tmp_path, a=SIGMA + "1,1,3,1\n1,1,-1.4,0.5\n1,1,7,1\n")).remedy


def test_what_scatter_cannot_have_done_is_a_sign_or_another_column(tmp_path: Path) -> None:
    error = refusal(write(tmp_path, a=CSV + "1200,20,-40\n"))
    assert "by more than scatter" in error.what and "sign" in error.remedy and "enter 0" not in error.remedy
    turned = refusal(write(tmp_path, a=HEADER + "1200,1,-0.44\n1200,2,-0.37\n1200,20,-76\n1200,0,0\n"))
    assert "as 3 of 4 ranges are" in turned.what and "turn the sign" in turned.remedy and turned.line == 2


def test_no_remedy_deletes_a_reading(tmp_path: Path) -> None:
    for row in ("1200,20,-1", "1200,-20,1", "0,20,1", "1200,20,1e300", "1e999,20,1"):
        assert "delete" not in refusal(write(tmp_path, a=CSV + row + "\n")).remedy.replace("deleting it would", "")


def test_scatter_about_zero_is_what_the_prior_holds() -> None:
    (prior,) = (p for p in noise.PARAMETERS if p.name == "sigma_abs")
    assert prior.to_physical(prior.prior_quantile(0.982)) == pytest.approx(1.0, rel=0.02)


# --- what is there is named -----------------------------------------------------------------------


def zipped() -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as book:
        book.writestr("xl/worksheets/sheet1.xml", "<x/>")
    return file.getvalue()


NAMED: dict[str, tuple[str | bytes, int, str]] = {
    "comma after each line": (CSV.replace("\n", ",\n"), 1, "the header ends with a comma; delete it, and the last"),
    "index": ("," + CSV.replace("\n1", "\n0,1"), 1, "the first column has no name: an index, as pandas writes it"),
    "row without content": (CSV + ",,\n1200,20,1\n", 5, "the row is empty"),
    "long cell": (CSV + "1200,20," + "x" * 10_000 + "\n", 5, "xxx...' (10000 characters) is not a number"),
    "huge cell": (CSV + "1200," + "1" * 200_000 + ",20\n", 5, "cell 2 of the row has 200000 characters"),
    "quote left open": (CSV + '1200,20,"1\n' + CSV, 5, "close the quotes"),
    "workbook": (zipped(), 1, "a zip file, such as a workbook (.xlsx, .ods), not text; save what it holds as CSV"),
    "old workbook": (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", 1, "an old workbook (.xls)"),
    "compressed": (b"\x1f\x8b\x08\x00", 1, "a compressed file (gzip)"),
    "utf-16": (CSV.encode("utf-16"), 1, "UTF-16"),
    "utf-16 without a mark": (CSV.encode("utf-16-be"), 1, "UTF-16"),
    "other bytes": (CSV.encode() + b"\xff\0", 5, "binary data, not UTF-8 text"),
    "NUL at the end": (CSV + "\0\0\0", 5, "ends in 3 NUL bytes; check that nothing was lost before them"),
    "NUL": (CSV + "1200,\x0020,1\n1200,20,1\n", 5, "holds a NUL byte; check that nothing was lost around it"),
    "Ctrl-Z inside": (CSV + "\x1a\n1200,20,1\n", 5, "holds a Ctrl-Z (0x1A), the DOS mark of a file's end"),
}


@pytest.mark.parametrize("case", NAMED)
def test_what_is_there_is_named(tmp_path: Path, case: str) -> None:
    content, line, words = NAMED[case]
    error = refusal(write(tmp_path, b=content))
    assert error.file == tmp_path / "b.csv" and error.line == line and words in str(error)


@pytest.mark.parametrize(
    "content",
    ["   \n" + CSV, CSV + "   \n", CSV + "\t", CSV + ",,\n,,\n", ",,\n" + CSV, CSV + "\x1a", CSV + "\x1a\r\n"],
)
def test_what_editors_and_spreadsheets_leave_is_no_reading(tmp_path: Path, content: str) -> None:
    plain = read_experiment(write(tmp_path / "plain"))
    assert read_experiment(write(tmp_path / "other", a=content)).fingerprint == plain.fingerprint


def test_a_decimal_comma_is_named(tmp_path: Path) -> None:
    error = refusal(write(tmp_path, TOML.replace("0.027", "0,027")))
    assert (
        error.line == 5
        and error.what.endswith("'M = 0,027' has a decimal comma")
        and error.remedy.endswith("M = 0.027")
    )
    toml = TOML.replace("0.027", "0,027 # kg").replace("9.81", "9,81").replace("square", "squar")
    found = refusals(write(tmp_path, toml + "constants = { l = 0,06 }\n[limits]\nl = [1,5, 2,5]\n"))
    assert [line.split(":")[1] for line in found] == ["5", "10", "19", "21", "23"]
    assert "decimal points" in refusal(write(tmp_path, TOML + "[limits]\nl = [0,06, 0,12]\n")).remedy
    assert "write a decimal point: l = 0.06" in found[3] and "decimal points, not commas" in found[4]


def test_a_waveform_is_read_whatever_its_capitals(tmp_path: Path) -> None:
    plain = read_experiment(write(tmp_path / "plain"))
    toml = TOML.replace('"sine"', '" Sine "').replace('"square"', '"SQUARE"')
    other = read_experiment(write(tmp_path / "other", toml))
    assert [g.waveform for g in other.groups] == ["sine", "square"] and other.fingerprint == plain.fingerprint
    write_experiment(other, tmp_path / "again")  # as it was written
    assert read_experiment(tmp_path / "again").fingerprint == plain.fingerprint
    assert refusal(write(tmp_path / "sin", TOML.replace('"sine"', '"sin"'))).remedy.startswith("did you mean sine?")
    assert refusal(write(tmp_path / "wob", TOML.replace('"sine"', '"wobble"'))).remedy.startswith(
        "there are sine, square, "
    )


@pytest.mark.parametrize(
    "name",
    [
        "amplitude_vpp", "amplitude_vrms", "amplitude_pp", "peak_to_peak_v", "flight_time_us", "launch_time_us",
        "launch_angle_deg", "tip_speed_mm_s", "mean_force_n", "frequency_rad_s", "min_force_n", "rms_speed_mm_s",
        "contact_time_rms", "sem_um", "sigma_pos_um", "amplitude_div",
    ],
)  # fmt: skip
def test_another_quantity_is_not_said_to_be_meant(name: str, tmp_path: Path) -> None:
    """Renamed, it would describe the rig wrongly."""
    error = refusal(write(tmp_path, a=f"frequency_hz,amplitude_v,{name}\n1200,20,0.3\n"))
    assert "did you mean" not in str(error) and "psafit import" in error.remedy


def test_a_reading_that_is_misnamed_is_the_only_fault(tmp_path: Path) -> None:
    """Whoever reads a speed is not asked for a range as well."""
    (tmp_path / "a").mkdir()
    folder = write(tmp_path / "a", a="frequency_hz,amplitude_v,launch_speed_m_s\n1200,20,0.3\n")
    (line,) = str(refusal(folder)).splitlines()
    assert "unknown column 'launch_speed_m_s'; did you mean launch_speed_mm_s, in mm/s?" in line


@pytest.mark.parametrize("name", ["launch_range_mm", "launch_speed_m_s", "frequency_khz"])
def test_a_column_in_another_unit_leads_to_import(name: str, tmp_path: Path) -> None:
    """Renamed alone it would be wrong by the factor of the unit."""
    header = HEADER.strip().replace("frequency_hz" if "frequency" in name else "launch_range_um", name)
    assert str(refusal(write(tmp_path, a=f"{header}\n1,20,3\n"))).endswith("psafit import reads other forms")
