"""Experiment folders, sound and spoilt, and what reading them may end in."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from psafit.errors import InputError
from psafit.experiment import Experiment, describe, read_experiment

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


SIGMA = HEADER.rstrip("\n") + ",sigma_um\n"


FUZZ = settings(
    deadline=None,
    max_examples=100,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


def check_outcome(folder: Path, *files: str) -> None:
    """Either a checked experiment, or lines that name the file."""
    refused: InputError | None = None
    try:
        experiment = read_experiment(folder)
    except InputError as error:
        refused = error
    if refused is not None:
        assert all(line.isprintable() for line in str(refused).split("\n"))
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
