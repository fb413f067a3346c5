"""`experiment.toml`: valid data survive, bad input ends in one clear line."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path

import pytest
from folders import CSV, FUZZ, TOML, check_outcome, mutated, refusal, write
from hypothesis import given
from hypothesis import strategies as st

from psafit.errors import InputError
from psafit.experiment import Constants, definition, describe, read_experiment, read_plan, write_experiment
from psafit.parameters import Belief, LogNormal, Normal


def test_toml_with_bom_and_crlf(tmp_path: Path) -> None:
    plain = read_experiment(write(tmp_path / "plain"))
    toml = TOML.replace("\n", "\r\n").encode("utf-8-sig")
    assert read_experiment(write(tmp_path / "other", toml)).fingerprint == plain.fingerprint


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
    limits = "[limits]\nl = [0.06, 1]\nread = ['contact_time_us', 'displacement_um']\nfrequency_hz = [10, 20]\n"
    experiment = read_experiment(write(tmp_path / "two", TOML + limits))
    assert experiment.limits == (("l", (0.06, 1.0)), ("frequency_hz", (10.0, 20.0)))
    assert experiment.readable == ("contact_time_us", "displacement_um") == read_plan(tmp_path / "two").readable
    write_experiment(experiment, tmp_path / "again")
    again = read_experiment(tmp_path / "again")
    assert (again.limits, again.readable) == (experiment.limits, experiment.readable)
    assert again.fingerprint == experiment.fingerprint
    plain = read_experiment(write(tmp_path / "plain"))
    assert plain.limits == plain.readable == () and plain.fingerprint == experiment.fingerprint


def test_what_is_known_of_the_rig_is_read(tmp_path: Path) -> None:
    """And written, and reported; it is no reading, so that the data stay the same data."""
    toml = TOML + (
        '[prior.k_c]\nmedian = 4e6\nfactor = 1.5\nsource = "Hertz"\n[prior."stroke"]\nsd = 2\nmean = -1\nsource = "é"\n'
    )
    experiment = read_experiment(write(tmp_path / "two", toml))
    beliefs = (Belief("k_c", LogNormal(4e6, 1.5), "Hertz"), Belief("stroke", Normal(-1.0, 2.0), "é"))
    assert experiment.beliefs == beliefs and [b.line for b in experiment.beliefs] == [21, 25]
    assert read_plan(tmp_path / "two").beliefs == beliefs
    reported = {"name": "k_c", "prior": "log-normal, median 4e+06, factor 1.5 for one sd", "source": "Hertz"}
    reported["derived"] = False
    assert describe(experiment)["priors"][0] == reported
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
    "group key in another unit": (TOML + "phase_rad = 1.5\n", 21, "did you mean phase_deg? Its name says its unit"),
    "group key of another meaning": (TOML + "duty_cycle = 0.2\n", 21, "unknown key 'duty_cycle'; known keys: id,"),
    "single brackets": (TOML.replace("[[group]]", "[group]"), 17, "[[group]], in double brackets"),
    "a drive's key": (
        TOML.replace('waveform = "square"', 'waveform = "table"\ndrives = "d.csv"', 1),
        20,
        "did you mean drive?",
    ),
    "group key typo": (TOML.replace("waveform", "wavform", 1), 14, "did you mean waveform?"),
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
    "unknown waveform": (TOML.replace("square", "wobbly"), 19, "unknown waveform 'wobbly'"),
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
    "another rig, unknown": (TOML + "constants = { L = 1 }\n", 21, "did you mean l?"),
    "another rig, no number": (TOML + 'constants = { l = "1" }\n', 21, "constant l is not a number"),
    "another rig, impossible": (TOML + "constants = { l = -1 }\n", 21, "constant l = -1"),
    "another rig, own table": (TOML + "[group.constants]\nl = 1e9\n", 22, "beyond the limits"),
    "another rig, no table": (TOML + "constants = 0.06\n", 21, "write for example constants = { l = 0.06 }"),
    "limits, no table": ("limits = 1\n" + TOML, 1, "limits is no table; write for example"),
    "limits, unknown": (TOML + "[limits]\nfrequency = [1, 2]\n", 22, "did you mean frequency_hz?"),
    "limits, what is read": (TOML + '[limits]\nread = ["speed"]\n', 22, "nothing is read as 'speed'"),
    "limits, no list": (TOML + '[limits]\nread = "launch_range_um"\n', 22, "read is no list of columns"),
    "limits, none": (TOML + "[limits]\nread = []\n", 22, "write for example read = ["),
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
    "rig, no table": ("rig = 1\n" + TOML, 1, "rig is no table"),
    "rig, unknown key": (TOML + "[rig]\nball_size = 1\n", 22, "unknown key 'ball_size'"),
    "rig, unknown material": (TOML + '[rig]\nball_material = "stel"\n', 22, "did you mean steel"),
    "rig, unheard-of material": (TOML + '[rig]\nface_material = "wxyz"\n', 22, "choose from steel, stainless"),
    "rig, material no text": (TOML + "[rig]\nface_material = 3\n", 22, "face_material is no text"),
    "rig, negative": (TOML + "[rig]\ncapacity = -1e-6\n", 22, "capacity is not a positive number"),
    "rig, text": (TOML + '[rig]\nrated_voltage = "150"\n', 22, "rated_voltage is not a positive number"),
    "prior, no table": ("prior = 1\n" + TOML, 1, "prior is no table"),
    "prior, a number": (TOML + "[prior]\nk_c = 3e6\n", 22, "prior of 'k_c' is no table"),
    "prior, half": (TOML + '[prior.k_c]\nmedian = 3e6\nsource = "x"\n', 21, "gives median; write for example"),
    "prior, both": (TOML + '[prior.k_c]\nmedian = 3e6\nsd = 1\nsource = "x"\n', 21, "gives median, sd"),
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

    def reported(closed: Path) -> InputError:
        def stat(path: Path, **options: bool) -> os.stat_result:
            if closed in path.parents:
                raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
            return real(path, **options)

        with monkeypatch.context() as patched:
            patched.setattr(Path, "stat", stat)
            return refusal(folder)

    assert reported(folder).file == folder / "experiment.toml" and reported(tmp_path).file == folder
    assert reported(folder).what == reported(tmp_path).what == "cannot be read (Permission denied)"
    (folder / "below").mkdir()
    (folder / "b.csv").rename(folder / "below" / "b.csv")
    (folder / "experiment.toml").write_text(TOML.replace("b.csv", "below/b.csv"))
    assert "'below/b.csv' cannot be read (Permission denied)" in reported(folder / "below").what


def test_definition_too_large(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="larger than"):
        definition.Definition(write(tmp_path), most_bytes=100)


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


@FUZZ
@given(content=st.binary(max_size=200) | st.text(max_size=100).map(str.encode) | mutated(TOML))
def test_any_bytes_as_definition(tmp_path: Path, content: bytes) -> None:
    check_outcome(write(tmp_path, content), "experiment.toml", "a.csv", "b.csv")


@FUZZ
@given(value=st.text(st.characters(exclude_categories=["Cs"]), max_size=60))
def test_any_text_as_a_toml_value(tmp_path: Path, value: str) -> None:
    quoted = json.dumps(value).replace("\x7f", "\\u007f")
    for original in ('"a rig"', '"late-2"', '"square"', '"b.csv"'):
        check_outcome(write(tmp_path, TOML.replace(original, quoted)), "experiment.toml", "b.csv")


@pytest.mark.parametrize(("key", "meant"), [("offset_v", "bias_v"), ("burst", "cycles"), ("Cycles", "cycles")])
def test_keys_of_other_names_lead_to_ours(key: str, meant: str, tmp_path: Path) -> None:
    error = refusal(write(tmp_path, TOML.replace('waveform = "sine"', f'waveform = "sine"\n{key} = 3')))
    assert str(error).endswith(f"unknown key '{key}'; did you mean {meant}?")
