"""Tables of readings: valid data survive, bad input ends in one clear line."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from folders import CSV, FUZZ, HEADER, SIGMA, check_outcome, mutated, refusal, write
from hypothesis import given
from hypothesis import strategies as st

from psafit.errors import InputError
from psafit.experiment import describe, read_experiment, table


@pytest.mark.parametrize(
    "content",
    [
        CSV.encode("utf-8-sig"),
        CSV.replace("\n", "\r\n").encode(),
        CSV.replace("\n", "\r").encode(),
        CSV.rstrip("\n").encode(),
        ("\n" + CSV + "\n\n").encode(),
        b"launch_range_um, frequency_hz ,amplitude_v\n.44,1.2e3, 1\n0.37,1200,2.\n76,+1200,20\n",
        b'"frequency_hz","amplitude_v","launch_range_um"\n"1200","1","0.44"\n1200,2,0.37\n1200,20,76\n',
    ],
    ids=["bom", "crlf", "cr", "no-final-newline", "blank-lines", "column-order", "quoted"],
)
def test_layout_of_a_csv_does_not_matter(tmp_path: Path, content: bytes) -> None:
    plain = read_experiment(write(tmp_path / "plain"))
    other = read_experiment(write(tmp_path / "other", a=content))
    assert other.fingerprint == plain.fingerprint


def test_replicates_and_zeros_are_data(tmp_path: Path) -> None:
    csv = HEADER + "50000,20,0\n50000,20,0.4\n50000,20,90\n3,0,0.00\n"
    experiment = read_experiment(write(tmp_path, a=csv))
    assert experiment.warnings == ()
    summary = describe(experiment)["groups"][0]
    assert (summary["n_points"], summary["zeros"], summary["replicates"]) == (4, 2, 2)


def test_sigma_is_read(tmp_path: Path) -> None:
    csv = "frequency_hz,amplitude_v,launch_range_um,sigma_um\n1200,1,0.4,0.02\n"
    group = read_experiment(write(tmp_path, a=csv)).group(1)
    assert group.sigma is not None
    assert group.sigma.tolist() == [0.02]


BAD_CSV: dict[str, tuple[str | bytes, int, str]] = {
    "empty": ("", 1, "the file is empty"),
    "blank": ("\n\n", 1, "the file is empty"),
    "header only": (HEADER, 1, "no readings"),
    "no header": ("1200,1,0.44\n", 1, "unknown column '1200'"),
    "missing column": ("frequency_hz,amplitude_v\n1,1\n", 1, "missing column 'launch_range_um'"),
    "extra column": (HEADER.replace("\n", ",note\n"), 1, "unknown column 'note'"),
    "renamed column": (
        CSV.replace("amplitude_v", "Amplitude_V"),
        1,
        "unknown column 'Amplitude_V'",
    ),
    "repeated column": (HEADER.replace("\n", ",amplitude_v\n"), 1, "repeated column 'amplitude_v'"),
    "a speed by another name": (
        "frequency_hz,amplitude_v,speed\n1200,20,0.5\n",
        1,
        "unknown column 'speed'; the first line must read frequency_hz,amplitude_v,launch_range_um (and sigma_um if"
        " known), or in the place of the range, or next to it, launch_speed_mm_s or contact_time_us or peak_force_n;",
    ),
    "no reading yet": (
        "frequency_hz,amplitude_v,launch_speed_mm_s,contact_time_us\n1200,20,,\n1200,10,,\n",
        2,
        "launch_speed_mm_s is empty in all 2 rows: the group waits for its readings; enter them",
    ),
    "one reading yet": (
        "frequency_hz,amplitude_v,launch_speed_mm_s\n1200,20,0.5\n1200,10,\n",
        3,
        "launch_speed_mm_s is empty; enter the value, or delete the row",
    ),
    "semicolons": (CSV.replace(",", ";"), 1, "separated by semicolons"),
    "tabs": (CSV.replace(",", "\t"), 1, "separated by tabs"),
    "text": (CSV + "1200,20,fell off\n", 5, "launch_range_um 'fell off' is not a number"),
    "unit": (CSV + "1200,20 V,1\n", 5, "without a unit"),
    "comment": (CSV + "# next day\n", 5, "no comments"),
    "empty cell": (CSV + "1200,,1\n", 5, "amplitude_v is empty"),
    "nan": (CSV + "1200,20,NaN\n", 5, "not finite"),
    "inf": (CSV + "1200,20,-inf\n", 5, "not finite"),
    "overflow": (CSV + "1e999,20,1\n", 5, "too large"),
    "negative range": (CSV + "1200,20,-0.1\n", 5, "launch_range_um '-0.1' is negative"),
    "negative amplitude": (CSV + "1200,-20,1\n", 5, "amplitude_v '-20' is negative"),
    "zero frequency": (CSV + "0,20,1\n", 5, "frequency_hz '0' is not positive"),
    "vanishing frequency": (CSV + "1e-999,20,1\n", 5, "not positive"),
    "negative frequency": (CSV + "-5,20,1\n", 5, "frequency_hz '-5' is not positive"),
    "zero sigma": (SIGMA + "1,1,1,0\n", 2, "sigma_um '0' is not positive"),
    "negative sigma": (SIGMA + "1,1,1,1\n1,1,1,-1\n", 3, "sigma_um '-1' is not positive"),
    "absurd frequency": (CSV + "1e150,20,1\n", 5, "frequency_hz '1e150' is beyond the limits 0.001 to 1e+09"),
    "absurd amplitude": (CSV + "1200,1e308,1\n", 5, "amplitude_v '1e308' is beyond the limits"),
    "absurd range": (CSV + "1200,20,1e300\n", 5, "launch_range_um '1e300' is beyond the limits"),
    "absurd sigma": (SIGMA + "1,1,1,1e200\n", 2, "sigma_um '1e200' is beyond the limits"),
    "short row": (CSV + "1200,20\n", 5, "2 cells in the row, 3 in the header"),
    "row of semicolons": (CSV + "1200;20;1\n", 5, "1 cell in the row, 3 in the header; separate cells by commas"),
    "long row": (CSV + "1200,20,1,\n", 5, "4 cells in the row, 3 in the header"),
    "thousands, bare": (CSV + "1,200,20,1\n", 5, "no thousands separators"),
    "thousands, quoted": (CSV + '"1,200",20,1\n', 5, "'1,200' has a thousands separator"),
    "thousands, space": (CSV + "1 200,20,1\n", 5, "has a thousands separator"),
    "decimal comma": (CSV + '1200,20,"1,5"\n', 5, "write a decimal point"),
    "underscore": (CSV + "1_200,20,1\n", 5, "is not a number"),
    "hexadecimal": (CSV + "0x10,20,1\n", 5, "is not a number"),
    "other digits": (CSV + "\u0661\u0662,20,1\n", 5, "is not a number"),
    "open quote": (CSV + '"1200,20,1\n1200,20,2\n', 5, "not valid CSV"),
    "stray quote": (CSV + '"12"00,20,1\n', 5, "not valid CSV"),
    "quoted line feed": (CSV + '1200,20,"1\n2"\n', 5, "is not a number"),
    "huge cell": (CSV + "1200,20," + "1" * 200_000 + "\n", 5, "not valid CSV"),
    "long cell": (CSV + "1200,20," + "x" * 10_000 + "\n", 5, "xxx...'"),
    "NUL": (CSV + "1200,20,1\0\n", 5, ""),
    "not utf-8": (CSV.encode() + b"1200,20,\xb5\n", 5, "not UTF-8"),
    "not utf-8 behind a bom": (b"\xef\xbb\xbf" + CSV.encode() + b"\xb5\n", 5, "not UTF-8"),
    "utf-16": (CSV.encode("utf-16"), 1, "not UTF-8"),
}


@pytest.mark.parametrize("case", BAD_CSV)
def test_bad_csv(tmp_path: Path, case: str) -> None:
    content, line, words = BAD_CSV[case]
    error = refusal(write(tmp_path, b=content))
    assert error.file == tmp_path / "b.csv"
    assert error.line == line
    assert words in str(error)


def test_too_many_rows(tmp_path: Path) -> None:
    file = write(tmp_path, b=CSV + "1200,20,1\n") / "b.csv"
    with pytest.raises(InputError, match="more than 3 rows") as caught:
        table.read_csv(file, most_rows=3)
    assert (caught.value.line, caught.value.file) == (5, file)


def test_csv_too_large(tmp_path: Path) -> None:
    file = write(tmp_path, b=CSV + "1200,20,1\n") / "b.csv"
    with pytest.raises(InputError, match="larger than"):
        table.read_csv(file, most_bytes=len(CSV))


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root reads everything")
def test_unreadable_csv(tmp_path: Path) -> None:
    (write(tmp_path) / "b.csv").chmod(0)
    assert "cannot be read" in refusal(tmp_path).what


@FUZZ
@given(
    content=st.binary(max_size=200)
    | st.text(max_size=100).map(lambda text: (HEADER + text).encode())
    | st.text("0123456789.,eE+-\n\r\"' ;", max_size=100).map(lambda text: (HEADER + text).encode())
    | mutated(CSV)
)
def test_any_bytes_as_csv(tmp_path: Path, content: bytes) -> None:
    check_outcome(write(tmp_path, a=content), "a.csv")
