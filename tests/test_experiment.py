"""The experiment reader: valid data survive unchanged, bad input ends in one clear line."""

from __future__ import annotations

import errno
import json
import math
import os
from collections.abc import Callable
from dataclasses import FrozenInstanceError, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from psafit.errors import InputError
from psafit.experiment import (
    Conditions,
    Constants,
    Experiment,
    Group,
    definition,
    describe,
    fingerprint,
    read_experiment,
    read_plan,
    table,
    write_experiment,
)
from psafit.experiment.records import OPTIONAL_COLUMNS, REQUIRED_COLUMNS
from psafit.parameters import Belief, LogNormal, Normal

HEADER = "frequency_hz,amplitude_v,launch_range_um\n"
CSV = HEADER + "1200,1,0.44\n1200,2,0.37\n1200,20,76.00\n"
TOML = """\
title = "a rig"
source = "a notebook"

[constants]
M = 0.027
m = 0.005
q = 1.2e-7
l = 0.09
k_s = 4.89e7
g = 9.81

[[group]]
id = 1
waveform = "sine"
file = "a.csv"

[[group]]
id = "late-2"
waveform = "square"
file = "b.csv"
"""


def write(folder: Path, toml: str | bytes = TOML, a: str | bytes = CSV, b: str | bytes = CSV) -> Path:
    """Write an experiment folder."""
    folder.mkdir(exist_ok=True)
    for name, content in (("experiment.toml", toml), ("a.csv", a), ("b.csv", b)):
        (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
    return folder


def refusal(folder: Path | str) -> InputError:
    """The error that reading ends in, after the checks that hold for every one of them."""
    with pytest.raises(InputError) as caught:
        read_experiment(folder)
    error = caught.value
    assert len(str(error).splitlines()) == 1
    assert str(error).isprintable()
    assert len(error.what) < 250
    assert len(error.remedy) > 5
    assert error.file is not None
    assert str(error).endswith(error.remedy)
    return error


# --- valid input ----------------------------------------------------------------------------------


def test_reads_what_is_written(tmp_path: Path) -> None:
    experiment = read_experiment(write(tmp_path))
    assert experiment.title == "a rig"
    assert experiment.source == "a notebook"
    assert experiment.constants == Constants(0.027, 0.005, 1.2e-7, 0.09, 4.89e7, 9.81)
    assert experiment.ids == (1, "late-2")
    assert experiment.folder == tmp_path
    assert experiment.warnings == ()
    group = experiment.group(1)
    assert (group.waveform, group.file, group.n_points) == ("sine", "a.csv", 3)
    assert group.frequency_hz.tolist() == [1200, 1200, 1200]
    assert group.amplitude_v.tolist() == [1, 2, 20]
    assert group.launch_range_um.tolist() == [0.44, 0.37, 76]
    assert group.sigma_um is None
    assert experiment.group("1") is group  # a command line knows text only
    assert experiment.select(["late-2", 1]) == (experiment.groups[1], group)


def test_a_sweep_is_filled_between_its_conditions() -> None:
    """What was held stays as it was, replicates are one, and what is no sweep stays as it is."""
    f = np.array([4000.0, 100.0, 100.0, 1000.0])
    held = Conditions(1, "square", "a.csv", f, np.array([20.0, 20.1, 20.1, 20.0]), changed=(("l", 0.05),))
    found = held.filled()
    assert (found.id, found.waveform, found.changed) == (1, "square", (("l", 0.05),))
    assert (np.diff(found.frequency_hz) > 0).all() and set(f) < set(found.frequency_hz) and found.n_points == 17
    assert found.frequency_hz[4] == pytest.approx(math.sqrt(100 * 1000))  # even in the logarithm
    assert found.amplitude_v.max() == 20.1 and found.amplitude_v.min() == pytest.approx(20.0, rel=1e-15)
    still = Conditions(1, "sine", "a.csv", np.full(3, 700.0), np.array([0.0, 4.0, 8.0])).filled()
    assert still.amplitude_v.tolist() == [x / 2 for x in range(17)] and set(still.frequency_hz) == {700.0}
    many = Conditions(1, "sine", "a.csv", np.geomspace(100, 1e4, 400), np.full(400, 5.0))
    assert many.filled().n_points == 400
    for f, v in (([700.0, 800.0], [3.0, 5.0]), ([700.0, 700.0], [3.0, 3.0])):
        one = Conditions(1, "sine", "a.csv", np.array(f), np.array(v))
        assert one.filled() is one


def test_records_cannot_be_changed(tmp_path: Path) -> None:
    experiment = read_experiment(write(tmp_path))
    with pytest.raises(FrozenInstanceError):
        experiment.title = "x"  # type: ignore[misc]
    for array in (experiment.groups[0].frequency_hz, experiment.groups[0].launch_range_um):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


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


def test_toml_with_bom_and_crlf(tmp_path: Path) -> None:
    plain = read_experiment(write(tmp_path / "plain"))
    toml = TOML.replace("\n", "\r\n").encode("utf-8-sig")
    assert read_experiment(write(tmp_path / "other", toml)).fingerprint == plain.fingerprint


def test_replicates_and_zeros_are_data(tmp_path: Path) -> None:
    csv = HEADER + "50000,20,0\n50000,20,0.4\n50000,20,90\n3,0,0.00\n"
    experiment = read_experiment(write(tmp_path, a=csv))
    assert experiment.warnings == ()
    summary = describe(experiment)["groups"][0]
    assert (summary["n_points"], summary["zeros"], summary["replicates"]) == (4, 2, 2)


def test_sigma_is_read(tmp_path: Path) -> None:
    csv = "frequency_hz,amplitude_v,launch_range_um,sigma_um\n1200,1,0.4,0.02\n"
    group = read_experiment(write(tmp_path, a=csv)).group(1)
    assert group.sigma_um is not None
    assert group.sigma_um.tolist() == [0.02]


def test_check_tells_of_a_sweep_that_is_none(tmp_path: Path) -> None:
    experiment = read_experiment(write(tmp_path, a="frequency_hz,amplitude_v,launch_range_um\n1200,1,0.4\n"))
    assert experiment.warnings == ()  # it is no reason to doubt the reading
    assert describe(experiment)["warnings"] == [
        "a.csv: group 1: one reading is no sweep; it tells a level and no trend"
    ]


def test_description_is_json(tmp_path: Path) -> None:
    experiment = read_experiment(write(tmp_path))
    summary = json.loads(json.dumps(describe(experiment), allow_nan=False))
    assert summary["n_points"] == 6
    assert summary["fingerprint"] == experiment.fingerprint
    assert summary["constants"]["k_s"] == 4.89e7
    assert summary["groups"][1] == {
        "id": "late-2",
        "waveform": "square",
        "file": "b.csv",
        "n_points": 3,
        "constants": {},
        "frequency_hz": [1200.0, 1200.0],
        "amplitude_v": [1.0, 20.0],
        "launch_range_um": [0.37, 76.0],
        "zeros": 0,
        "replicates": 0,
        "has_sigma": False,
    }


def test_a_group_may_be_of_another_rig(tmp_path: Path) -> None:
    """Constants changed for a sweep are its own, and warned of like those of the folder."""
    toml = TOML + "constants = { M = 0.05, l = 0.045 }\n"
    experiment = read_experiment(write(tmp_path / "two", toml))
    first, second = experiment.groups
    assert first.rig(experiment.constants) == experiment.constants
    assert second.rig(experiment.constants) == Constants(0.05, 0.005, 1.2e-7, 0.045, 4.89e7, 9.81)
    assert describe(experiment)["groups"][1]["constants"] == {"M": 0.05, "l": 0.045}
    write_experiment(experiment, tmp_path / "again")
    again = read_experiment(tmp_path / "again")
    assert again.fingerprint == experiment.fingerprint and again.groups[1].changed == second.changed
    heavy = read_experiment(write(tmp_path / "heavy", TOML + "constants = { M = 27 }\n"))
    assert [w for w in heavy.warnings if "constant M = 27" in w and "grams" in w]


def test_limits_of_a_next_experiment_are_read_and_written(tmp_path: Path) -> None:
    """They are no reading either."""
    experiment = read_experiment(write(tmp_path / "two", TOML + "[limits]\nl = [0.06, 1]\nfrequency_hz = [10, 20]\n"))
    assert experiment.limits == (("l", (0.06, 1.0)), ("frequency_hz", (10.0, 20.0)))
    write_experiment(experiment, tmp_path / "again")
    again = read_experiment(tmp_path / "again")
    assert again.limits == experiment.limits and again.fingerprint == experiment.fingerprint
    plain = read_experiment(write(tmp_path / "plain"))
    assert plain.limits == () and plain.fingerprint == experiment.fingerprint


def test_what_is_known_of_the_rig_is_read(tmp_path: Path) -> None:
    """And written, and told; it is no reading, so that the data stay the same data."""
    toml = TOML + (
        '[prior.k_c]\nmedian = 4e6\nfactor = 1.5\nsource = "Hertz"\n[prior."stroke"]\nsd = 2\nmean = -1\nsource = "é"\n'
    )
    experiment = read_experiment(write(tmp_path / "two", toml))
    beliefs = (Belief("k_c", LogNormal(4e6, 1.5), "Hertz"), Belief("stroke", Normal(-1.0, 2.0), "é"))
    assert experiment.beliefs == beliefs and [b.line for b in experiment.beliefs] == [21, 25]
    assert read_plan(tmp_path / "two").beliefs == beliefs
    told = {"name": "k_c", "prior": "log-normal, median 4e+06, factor 1.5 for one sd", "source": "Hertz"}
    assert describe(experiment)["priors"][0] == told
    write_experiment(experiment, tmp_path / "again")
    again = read_experiment(tmp_path / "again")
    assert again.beliefs == beliefs and again.fingerprint == experiment.fingerprint
    assert again.fingerprint == read_experiment(write(tmp_path / "plain")).fingerprint


def test_file_may_lie_in_a_subfolder(tmp_path: Path) -> None:
    write(tmp_path, TOML.replace('"a.csv"', '"raw/../raw/a.csv"'))
    (tmp_path / "raw").mkdir()
    (tmp_path / "a.csv").rename(tmp_path / "raw" / "a.csv")
    assert read_experiment(tmp_path).group(1).n_points == 3


def test_title_and_source_have_defaults(tmp_path: Path) -> None:
    experiment = read_experiment(write(tmp_path / "rig", TOML.split("\n", 2)[2]))
    assert experiment.title == "rig"
    assert len(experiment.warnings) == 1
    assert "source" in experiment.warnings[0]


# --- fingerprint ----------------------------------------------------------------------------------


def test_fingerprint_ignores_place_and_wording(tmp_path: Path) -> None:
    first = read_experiment(write(tmp_path / "one"))
    toml = TOML.replace("a rig", "another title").replace("1.2e-7", "0.12e-6").replace("a.csv", "c.csv")
    folder = write(tmp_path / "two", toml)
    (folder / "a.csv").rename(folder / "c.csv")
    assert read_experiment(folder).fingerprint == first.fingerprint
    assert len(first.fingerprint) == 64


@pytest.mark.parametrize(
    "change",
    [
        {"toml": TOML.replace("9.81", "9.82")},
        {"toml": TOML.replace("id = 1", "id = 3")},
        {"toml": TOML + "constants = { l = 0.045 }\n"},
        {"toml": TOML.replace('"sine"', '"square"')},
        {"a": CSV.replace("0.37", "0.38")},
        {"a": CSV.replace("1200,2,", "1201,2,")},
        {"a": CSV + "1200,1,0.44\n"},
        {"a": HEADER + "1200,2,0.37\n1200,1,0.44\n1200,20,76.00\n"},
        {"a": CSV.replace("\n", ",1\n").replace("um,1", "um,sigma_um")},
    ],
    ids=["constant", "id", "another rig", "waveform", "range", "frequency", "replicate", "row-order", "sigma"],
)
def test_fingerprint_follows_the_numbers(tmp_path: Path, change: dict[str, str]) -> None:
    first = read_experiment(write(tmp_path / "one"))
    assert read_experiment(write(tmp_path / "two", **change)).fingerprint != first.fingerprint


# --- bad input: experiment.toml -------------------------------------------------------------------

BAD_TOML: dict[str, tuple[str | bytes, int | None, str]] = {
    # what is wrong: (file content, line, words of the message)
    "syntax": (TOML.replace("id = 1\n", "id = \n"), 13, "not valid TOML"),
    "unclosed text": (TOML.replace('"sine"', '"sine'), 14, "not valid TOML"),
    "key twice": (TOML.replace("m = 0.005", "M = 0.005"), 6, "not valid TOML"),
    "ends early": (TOML + "x", 21, "not valid TOML"),
    "nested": ("x = " + "[" * 100_000, None, "nested too deeply"),
    "integer of 5000 digits": ("M = " + "9" * 5000, None, "not valid TOML"),
    "not utf-8": (TOML.encode() + b"# \xb5m", 21, "not UTF-8"),
    "utf-16": (TOML.encode("utf-16"), 1, "not UTF-8"),
    "unknown key": ("titel = 1\n" + TOML, 1, "did you mean title?"),
    "unknown table": (TOML + "[extra]\n", 21, "unknown key 'extra'"),
    "plural groups": (TOML.replace("[[group]]", "[[groups]]"), 12, "did you mean group?"),
    "unknown group key": (TOML + "sigma = 1\n", 21, "unknown key 'sigma'"),
    "group key typo": (TOML.replace("waveform", "wavform"), 14, "did you mean waveform?"),
    "extra constant": (TOML.replace("g = ", "k_c = 1e5\ng = "), 10, "unknown key 'k_c'"),
    "constant of another name": (TOML.replace("l = 0.09", "lenght = 0.09"), 8, "M, m, q, l, k_s, g; l is missing"),
    "constant typo": (TOML.replace("k_s", "ks"), 9, "did you mean k_s?"),
    "missing constant": (TOML.replace("g = 9.81\n", ""), 4, "constant g is missing"),
    "no constants": (TOML.replace("[constants]", "[[group]]"), None, "no [constants] table"),
    "constants a number": ("constants = 1\n[[group]]\nid = 1\n", 1, "no [constants] table"),
    "zero constant": (TOML.replace("0.09", "0"), 8, "constant l = 0 is not positive"),
    "negative constant": (TOML.replace("9.81", "-9.81"), 10, "constant g = -9.81"),
    "nan constant": (TOML.replace("9.81", "nan"), 10, "constant g = nan"),
    "infinite constant": (TOML.replace("9.81", "1e999"), 10, "constant g = inf"),
    "enormous constant": (TOML.replace("9.81", "9" * 400), 10, "constant g = inf"),
    "text constant": (TOML.replace("9.81", '"9.81"'), 10, "constant g is not a number"),
    "true constant": (TOML.replace("9.81", "true"), 10, "constant g is not a number"),
    "title a number": (TOML.replace('"a rig"', "3"), 1, "title is not text"),
    "no groups": (TOML.split("[[group]]")[0], None, "no groups"),
    "empty groups": ("group = []\n" + TOML.split("[[group]]")[0], 1, "no groups"),
    "group a table": (
        TOML.rsplit("[[group]]", 1)[0].replace("[[group]]", "[group]"),
        12,
        "[[group]]",
    ),
    "no id": (TOML.replace("id = 1\n", ""), 12, "group number 1 has no id"),
    "no waveform": (
        TOML.replace('waveform = "square"\n', ""),
        17,
        "group number 2 has no waveform",
    ),
    "no file": (TOML.replace('file = "b.csv"\n', ""), 17, "group number 2 has no file"),
    "unknown waveform": (TOML.replace("square", "triangle"), 19, "unknown waveform 'triangle'"),
    "waveform a list": (TOML.replace('"square"', "[1]"), 19, "unknown waveform 'list'"),
    "duplicate id": (TOML.replace('"late-2"', "1"), 18, "group id 1 is used twice"),
    "duplicate id as text": (TOML.replace('"late-2"', '"1"'), 18, "group id 1 is used twice"),
    "id a float": (TOML.replace("id = 1", "id = 1.5"), 13, "group id '1.5'"),
    "id true": (TOML.replace("id = 1", "id = true"), 13, "group id 'true'"),
    "id negative": (TOML.replace("id = 1", "id = -1"), 13, "group id '-1'"),
    "id enormous": (TOML.replace("id = 1", "id = " + "9" * 4000), 13, "out of range"),
    "id an option": (TOML.replace("late-2", "-x"), 18, "group id '-x'"),
    "id with a path": (TOML.replace("late-2", "../x"), 18, "group id '../x'"),
    "id too long": (TOML.replace("late-2", "x" * 33), 18, "group id 'xxx"),
    "id empty": (TOML.replace("late-2", ""), 18, "group id ''"),
    "id with a line feed": (TOML.replace("late-2", "a\\n"), 18, "group id 'a\\n'"),
    "file a number": (TOML.replace('"b.csv"', "2"), 20, "file is not a file name"),
    "file empty": (TOML.replace("b.csv", " "), 20, "file is not a file name"),
    "file missing": (TOML.replace("b.csv", "c.csv"), 20, "does not exist"),
    "file outside": (TOML.replace("b.csv", "../b.csv"), 20, "outside the experiment folder"),
    "file absolute": (TOML.replace("b.csv", "/etc/passwd"), 20, "outside the experiment folder"),
    "file on a drive": (TOML.replace("b.csv", "C:/b.csv"), 20, "outside the experiment folder"),
    "file a directory": (TOML.replace("b.csv", "."), 20, "is a directory"),
    "file with NUL": (TOML.replace("b.csv", "b\\u0000"), 20, "cannot be a file name"),
    "file name too long": (TOML.replace("b.csv", "b" * 5000), 20, "cannot be a file name"),
    "another rig, unknown": (TOML + "constants = { L = 1 }\n", 21, "known keys: M, m, q"),
    "another rig, no number": (TOML + 'constants = { l = "1" }\n', 21, "constant l is not a number"),
    "another rig, impossible": (TOML + "constants = { l = -1 }\n", 21, "constant l = -1"),
    "another rig, own table": (TOML + "[group.constants]\nl = 1e9\n", 22, "beyond the limits"),
    "another rig, no table": (TOML + "constants = 0.06\n", 21, "write for example constants = { l = 0.06 }"),
    "limits, no table": ("limits = 1\n" + TOML, 1, "limits is no table; write for example"),
    "limits, unknown": (TOML + "[limits]\nfrequency = [1, 2]\n", 22, "did you mean frequency_hz?"),
    "limits, one number": (TOML + "[limits]\nl = 0.1\n", 22, "limits of l are not two numbers"),
    "limits, texts": (TOML + '[limits]\nl = ["a", 1]\n', 22, "limits of l are not two positive numbers"),
    "limits, reversed": (
        TOML + "[limits]\nfrequency_hz = [20, 1]\n",
        22,
        "the smaller first, within 0.001 to 1e+09; give them",
    ),
    "limits, beyond the simulator's": (
        TOML + "[limits]\nfrequency_hz = [1, 1e12]\n",
        22,
        "within 0.001 to 1e+09; give them",
    ),
    "limits, beyond": (TOML + "[limits]\nM = [1, 1e9]\n", 22, "first, within 1e-09 to 1e+06; give them"),
    "prior, no table": ("prior = 1\n" + TOML, 1, "prior is no table"),
    "prior, a number": (TOML + "[prior]\nk_c = 3e6\n", 22, "prior of 'k_c' is no table"),
    "prior, half": (TOML + '[prior.k_c]\nmedian = 3e6\nsource = "x"\n', 21, "has median; write for example"),
    "prior, both": (TOML + '[prior.k_c]\nmedian = 3e6\nsd = 1\nsource = "x"\n', 21, "has median, sd"),
    "prior, unknown": (TOML + "[prior.k_c]\nmedian = 3e6\nfaktor = 2\n", 23, "did you mean factor?"),
    "prior, no source": (TOML + "[prior.k_c]\nmedian = 3e6\nfactor = 2\n", 21, "has no source"),
    "prior, factor of one": (TOML + '[prior.k_c]\nmedian = 3e6\nfactor = 1\nsource = "x"\n', 23, "number above 1"),
    "prior, not finite": (TOML + '[prior.x]\nmean = nan\nsd = 1\nsource = "x"\n', 22, "mean is not a finite number"),
    "prior, text": (TOML + '[prior.x]\nmean = 0\nsd = "1"\nsource = "x"\n', 23, "sd is not a finite number above 0"),
    "same file": (TOML.replace("b.csv", "./a.csv"), 20, "read the same file"),
}


@pytest.mark.parametrize("case", BAD_TOML)
def test_bad_definition(tmp_path: Path, case: str) -> None:
    content, line, words = BAD_TOML[case]
    error = refusal(write(tmp_path / "rig", content))
    assert error.file == tmp_path / "rig" / "experiment.toml"
    assert error.line == line
    assert words in str(error)


@pytest.mark.parametrize("name", definition.LIMITS)
def test_a_constant_beyond_its_limits_is_refused(tmp_path: Path, name: str) -> None:
    for number, value in enumerate((1e-300, 1e300)):
        lines = [f"{name} = {value}" if line.startswith(f"{name} = ") else line for line in TOML.splitlines()]
        error = refusal(write(tmp_path / str(number), "\n".join(lines)))
        assert error.line == lines.index(f"{name} = {value}") + 1
        low, high = definition.LIMITS[name]
        assert f"constant {name} = {value:g} is beyond the limits {low:g} to {high:g}" in str(error)


def test_line_counts_past_a_multi_line_string(tmp_path: Path) -> None:
    toml = TOML.replace('"a notebook"', '"""page 1\n[constants]\ng = 1\n"""').replace("9.81", "-1")
    assert refusal(write(tmp_path, toml)).line == 13


def test_missing_folder(tmp_path: Path) -> None:
    error = refusal(tmp_path / "nowhere")
    assert error.file == tmp_path / "nowhere"
    assert "no such experiment folder" in str(error)


@pytest.mark.parametrize("name", ["", "\0", "x" * 5000])
def test_impossible_folder_name(tmp_path: Path, name: str) -> None:
    assert refusal(f"{tmp_path}/none/{name}").line is None


def test_folder_is_the_definition_file(tmp_path: Path) -> None:
    error = refusal(write(tmp_path) / "experiment.toml")
    assert "give the folder" in error.remedy


def test_missing_definition(tmp_path: Path) -> None:
    error = refusal(tmp_path)
    assert error.file == tmp_path / "experiment.toml"
    assert "no such file" in error.what


def test_a_folder_that_may_not_be_searched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Root may search every folder: the refusal of the system is played."""
    folder = write(tmp_path / "rig")
    real = Path.stat

    def told(closed: Path) -> InputError:
        def stat(path: Path, **options: bool) -> os.stat_result:
            if closed in path.parents:
                raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
            return real(path, **options)

        with monkeypatch.context() as patched:
            patched.setattr(Path, "stat", stat)
            return refusal(folder)

    assert told(folder).file == folder / "experiment.toml" and told(tmp_path).file == folder
    assert told(folder).what == told(tmp_path).what == "cannot be read (Permission denied)"
    (folder / "below").mkdir()
    (folder / "b.csv").rename(folder / "below" / "b.csv")
    (folder / "experiment.toml").write_text(TOML.replace("b.csv", "below/b.csv"))
    assert "'below/b.csv' cannot be read (Permission denied)" in told(folder / "below").what


def test_definition_too_large(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(definition, "MAX_TOML_BYTES", 100)
    assert "larger than" in refusal(write(tmp_path)).what


def test_link_out_of_the_folder(tmp_path: Path) -> None:
    folder = write(tmp_path / "rig")
    (tmp_path / "secret.csv").write_text(CSV)
    (folder / "b.csv").unlink()
    (folder / "b.csv").symlink_to(tmp_path / "secret.csv")
    error = refusal(folder)
    assert error.line == 20
    assert "outside the experiment folder" in error.what


def test_loop_of_links(tmp_path: Path) -> None:
    folder = write(tmp_path / "rig")
    (folder / "b.csv").unlink()
    (folder / "b.csv").symlink_to(folder / "b.csv")
    assert refusal(folder).line == 20


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    folder = write(tmp_path / "rig")
    (folder / "b.csv").unlink()
    os.mkfifo(folder / "b.csv")
    assert "not a regular file" in refusal(folder).what


def test_unknown_group_names_the_known(tmp_path: Path) -> None:
    experiment = read_experiment(write(tmp_path))
    with pytest.raises(InputError, match="no group '7'; choose one of 1, late-2") as caught:
        experiment.group(7)
    assert caught.value.file == tmp_path / "experiment.toml"


def test_selecting_a_group_twice(tmp_path: Path) -> None:
    experiment = read_experiment(write(tmp_path))
    with pytest.raises(InputError, match="named twice"):
        experiment.select([1, "1"])


# --- bad input: CSV -------------------------------------------------------------------------------

SIGMA = HEADER.rstrip("\n") + ",sigma_um\n"
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


def test_too_many_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table, "MAX_ROWS", 3)
    error = refusal(write(tmp_path, b=CSV + "1200,20,1\n"))
    assert (error.line, error.file) == (5, tmp_path / "b.csv")
    assert "more than 3 rows" in error.what


def test_csv_too_large(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table, "MAX_CSV_BYTES", 10)
    assert "larger than" in refusal(write(tmp_path)).what


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root reads everything")
def test_unreadable_csv(tmp_path: Path) -> None:
    (write(tmp_path) / "b.csv").chmod(0)
    assert "cannot be read" in refusal(tmp_path).what


# --- warnings -------------------------------------------------------------------------------------

CONSTANT_UNITS = {"M": 27.0, "m": 50.0, "q": 0.12, "l": 90.0, "k_s": 48.9, "g": 981.0}


@pytest.mark.parametrize("name", CONSTANT_UNITS)
def test_constant_in_another_unit_is_named(tmp_path: Path, name: str) -> None:
    lines = [
        f"{name} = {CONSTANT_UNITS[name]}" if line.startswith(f"{name} = ") else line for line in TOML.splitlines()
    ]
    warnings = read_experiment(write(tmp_path, "\n".join(lines))).warnings
    assert len(warnings) == 1
    assert f"constant {name} = {CONSTANT_UNITS[name]:g}" in warnings[0]
    assert "is it given in" in warnings[0]


SUSPICIOUS: dict[str, Callable[[float, float, float], tuple[float, float, float]]] = {
    "given in kHz": lambda f, v, r: (f / 1e3, v, r),
    "given in mHz": lambda f, v, r: (f * 1e3, v, r),
    "given in kV": lambda f, v, r: (f, v / 1e3, r),
    "given in mV": lambda f, v, r: (f, v * 1e3, r),
    "given in mm or m": lambda f, v, r: (f, v, r / 1e3),
    "given in nm": lambda f, v, r: (f, v, r * 1e4),
    "nothing drives the ball": lambda f, v, r: (f, 0, r),
    "nothing to fit": lambda f, v, r: (f, v, 0),
}


@pytest.mark.parametrize("words", SUSPICIOUS)
def test_readings_in_another_unit_are_named(tmp_path: Path, words: str) -> None:
    rows = [SUSPICIOUS[words](f, 20, r) for f, r in ((1200, 76), (3000, 34.4), (25000, 0.67))]
    csv = HEADER + "".join(f"{f},{v},{r}\n" for f, v, r in rows)
    warnings = read_experiment(write(tmp_path, a=csv)).warnings
    assert len(warnings) == 1
    assert warnings[0].startswith("a.csv: group 1: ")
    assert words in warnings[0]
    assert warnings[0].isprintable()


def test_sigma_in_another_unit_is_named(tmp_path: Path) -> None:
    csv = SIGMA + "1200,20,76,400\n3000,20,34,400\n"
    warnings = read_experiment(write(tmp_path, a=csv)).warnings
    assert ["every sigma_um exceeds" in line for line in warnings] == [True]


# --- records made in code -------------------------------------------------------------------------


def test_other_readings_at_the_same_conditions(tmp_path: Path) -> None:
    experiment = read_experiment(write(tmp_path))
    other = experiment.with_readings(np.arange(6.0))
    assert [g.launch_range_um.tolist() for g in other.groups] == [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]
    assert other.fingerprint == fingerprint(other.constants, other.groups) != experiment.fingerprint
    same = np.concatenate([g.launch_range_um for g in experiment.groups])
    assert other.with_readings(same).fingerprint == experiment.fingerprint


def test_group_checks_itself() -> None:
    one = np.ones(2)
    group = Group("x", "sine", "", one, one, one)
    one[0] = 5.0
    assert group.frequency_hz.tolist() == [1, 1]  # a copy: the caller's array stays the caller's
    for field, bad in (
        ("frequency_hz", [0.0, 1.0]),
        ("amplitude_v", [-1.0, 1.0]),
        ("launch_range_um", [np.nan, 1.0]),
        ("sigma_um", [0.0, 1.0]),
        ("launch_range_um", [1.0]),
    ):
        with pytest.raises(ValueError, match=field):
            replace(group, **{field: np.array(bad)})  # type: ignore[arg-type]


def test_constants_check_themselves() -> None:
    with pytest.raises(ValueError, match="constant g"):
        Constants(0.027, 0.005, 1.2e-7, 0.09, 4.89e7, -9.81)


# --- properties -----------------------------------------------------------------------------------

FUZZ = settings(
    deadline=None,
    max_examples=100,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


def within(name: str) -> st.SearchStrategy[float]:
    return st.floats(*(definition.LIMITS | table.LIMITS)[name])


ids = st.integers(0, 999_999_999) | st.from_regex(r"[A-Za-z0-9_][A-Za-z0-9_-]{0,31}", fullmatch=True)


@st.composite
def columns(draw: st.DrawFn) -> dict[str, list[float]]:
    n = draw(st.integers(1, 6))
    names = (*REQUIRED_COLUMNS, *(OPTIONAL_COLUMNS if draw(st.booleans()) else ()))
    return {name: draw(st.lists(within(name), min_size=n, max_size=n)) for name in names}


@FUZZ
@given(
    constants=st.tuples(*(within(name) for name in ("M", "m", "q", "l", "k_s", "g"))),
    groups=st.lists(
        st.tuples(ids, st.sampled_from(["sine", "square"]), columns()),
        min_size=1,
        max_size=4,
        unique_by=lambda g: str(g[0]),
    ),
)
def test_round_trip(
    tmp_path_factory: pytest.TempPathFactory,
    constants: tuple[float, ...],
    groups: list[tuple[int | str, str, dict[str, list[float]]]],
) -> None:
    """Valid data, written and read, come back to the last bit."""
    folder = tmp_path_factory.mktemp("rig")
    toml = "[constants]\n" + "".join(
        f"{k} = {v!r}\n" for k, v in zip(("M", "m", "q", "l", "k_s", "g"), constants, strict=True)
    )
    for i, (group_id, waveform, data) in enumerate(groups):
        toml += f'[[group]]\nid = {json.dumps(group_id)}\nwaveform = "{waveform}"\nfile = "{i}.csv"\n'
        rows = zip(*data.values(), strict=True)
        text = ",".join(data) + "\n" + "".join(",".join(map(repr, row)) + "\n" for row in rows)
        (folder / f"{i}.csv").write_text(text)
    (folder / "experiment.toml").write_text(toml)
    experiment = read_experiment(folder)
    assert experiment.constants == Constants(*constants)
    assert experiment.ids == tuple(g[0] for g in groups)
    for group, (_, waveform, data) in zip(experiment.groups, groups, strict=True):
        assert group.waveform == waveform
        for name in (*REQUIRED_COLUMNS, "sigma_um"):
            column = getattr(group, name)
            assert (None if column is None else column.tolist()) == data.get(name)
    assert fingerprint(experiment.constants, experiment.groups) == experiment.fingerprint
    assert all(line.isprintable() for line in experiment.warnings)
    json.dumps(describe(experiment), allow_nan=False)


def check_outcome(folder: Path, *files: str) -> None:
    """Either a checked experiment, or one line that names the file."""
    refused: InputError | None = None
    try:
        experiment = read_experiment(folder)
    except InputError as error:
        refused = error
    if refused is not None:
        assert str(refused).isprintable()
        assert any(name in str(refused) for name in files)
        assert refused.remedy
        return
    assert isinstance(experiment, Experiment)
    assert all(line.isprintable() for line in experiment.warnings)
    json.dumps(describe(experiment), allow_nan=False)


def mutated(text: str) -> st.SearchStrategy[bytes]:
    """Bytes close to a valid file: slices of it cut out and replaced."""
    raw = text.encode()
    marks = b'\n|\r|"|\'|,|=|[|]]|\0|\xff|-|e9|nan|0|.|#|[[group]]\n|"""|../|{}|1979-05-27'
    snippets = st.sampled_from([*marks.split(b"|"), b"", b"\xef\xbb\xbf", b"\xe2\x80\xa8", b"9" * 400])
    edit = st.tuples(st.integers(0, len(raw)), st.integers(0, 12), snippets | st.binary(max_size=4))

    def apply(edits: list[tuple[int, int, bytes]]) -> bytes:
        result = raw
        for start, length, new in edits:
            result = result[:start] + new + result[start + length :]
        return result

    return st.lists(edit, max_size=4).map(apply)


@FUZZ
@given(content=st.binary(max_size=200) | st.text(max_size=100).map(str.encode) | mutated(TOML))
def test_any_bytes_as_definition(tmp_path: Path, content: bytes) -> None:
    check_outcome(write(tmp_path, content), "experiment.toml", "a.csv", "b.csv")


@FUZZ
@given(
    content=st.binary(max_size=200)
    | st.text(max_size=100).map(lambda text: (HEADER + text).encode())
    | st.text("0123456789.,eE+-\n\r\"' ;", max_size=100).map(lambda text: (HEADER + text).encode())
    | mutated(CSV)
)
def test_any_bytes_as_csv(tmp_path: Path, content: bytes) -> None:
    check_outcome(write(tmp_path, a=content), "a.csv")


@FUZZ
@given(value=st.text(st.characters(exclude_categories=["Cs"]), max_size=60))
def test_any_text_as_a_toml_value(tmp_path: Path, value: str) -> None:
    quoted = json.dumps(value).replace("\x7f", "\\u007f")
    for original in ('"a rig"', '"late-2"', '"square"', '"b.csv"'):
        check_outcome(write(tmp_path, TOML.replace(original, quoted)), "experiment.toml", "b.csv")
