"""Reading an experiment: what is written comes back unchanged."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from folders import CSV, FUZZ, HEADER, TOML, write
from hypothesis import given
from hypothesis import strategies as st

from psafit.experiment import Constants, definition, describe, fingerprint, read_experiment, table
from psafit.experiment.records import CONDITION_COLUMNS


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
    assert group.reading.tolist() == [0.44, 0.37, 76]
    assert group.sigma is None
    assert experiment.group("1") is group  # a command line knows text only
    assert experiment.select(["late-2", 1]) == (experiment.groups[1], group)


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


def test_other_readings_at_the_same_conditions(tmp_path: Path) -> None:
    experiment = read_experiment(write(tmp_path))
    other = experiment.with_readings(np.arange(6.0))
    assert [g.reading.tolist() for g in other.groups] == [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]
    assert other.fingerprint == fingerprint(other.constants, other.groups) != experiment.fingerprint
    same = np.concatenate([g.reading for g in experiment.groups])
    assert other.with_readings(same).fingerprint == experiment.fingerprint


def within(name: str) -> st.SearchStrategy[float]:
    return st.floats(*(definition.LIMITS | table.LIMITS)[name])


ids = st.integers(0, 999_999_999) | st.from_regex(r"[A-Za-z0-9_][A-Za-z0-9_-]{0,31}", fullmatch=True)


@st.composite
def columns(draw: st.DrawFn) -> dict[str, list[float]]:
    n = draw(st.integers(1, 6))
    names = (*CONDITION_COLUMNS, "launch_range_um", *(("sigma_um",) if draw(st.booleans()) else ()))
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
        held = {"launch_range_um": group.reading, "sigma_um": group.sigma}
        for name, column in (held | {name: getattr(group, name) for name in CONDITION_COLUMNS}).items():
            assert (None if column is None else column.tolist()) == data.get(name)
    assert fingerprint(experiment.constants, experiment.groups) == experiment.fingerprint
    assert all(line.isprintable() for line in experiment.warnings)
    json.dumps(describe(experiment), allow_nan=False)
