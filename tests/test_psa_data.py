"""The study's measurements, held to the digit: counts, checksums and the text they come from."""

from __future__ import annotations

import hashlib
import json
import os
import re
from pathlib import Path

import pytest
from scripts import loaded

from psafit.experiment import Constants, Experiment, describe, read_experiment

ROOT = Path(__file__).resolve().parent.parent
STUDY = Path(os.environ.get("PSAFIT_STUDY", ROOT.parent / "shared" / "study.txt"))

# id: (waveform, table, readings, what is held fixed, its value, SHA-256 of the numbers)
GROUPS = {
    1: (
        "sine",
        "A2a",
        64,
        "amplitude_v",
        20.0,
        "39331fcf4b3bfadf5dd7d6542237f21faa169967cf2316ee203341a4d6d7a4ac",
    ),
    2: (
        "sine",
        "A2b",
        57,
        "amplitude_v",
        15.0,
        "48292dfe4ac00aefca67dccbb0954c8ba2701e60b29f617eaa040415c2bd972b",
    ),
    3: (
        "sine",
        "A1a",
        37,
        "frequency_hz",
        1200.0,
        "8e19bdef010596667476fe4688b54cc41da3c8b665b416f77bbccccafd96b32e",
    ),
    4: (
        "sine",
        "A1b",
        35,
        "frequency_hz",
        3000.0,
        "74984acb743181202a99cadcc315493909b5abcaf53929c5be8179922407dfd9",
    ),
    5: (
        "square",
        "A3",
        39,
        "frequency_hz",
        1200.0,
        "2c5a1595cd83f244d8773e5aec1bb97a3474241a7693982da08010324bbe61dd",
    ),
    6: (
        "square",
        "A4",
        56,
        "amplitude_v",
        20.0,
        "add8be98ffac8f0db3d894c1241e22e3b1a64c1e31678afab7db32e65c427ab5",
    ),
}


@pytest.fixture(scope="module")
def psa() -> Experiment:
    return read_experiment(ROOT / "experiments" / "psa")


def rows(psa: Experiment, group_id: int) -> list[tuple[float, float, float]]:
    group = psa.group(group_id)
    return list(
        zip(
            group.frequency_hz.tolist(),
            group.amplitude_v.tolist(),
            group.reading.tolist(),
            strict=True,
        )
    )


def test_groups_and_constants(psa: Experiment) -> None:
    assert psa.ids == (1, 2, 3, 4, 5, 6)
    assert psa.warnings == ()
    assert psa.constants == Constants(M=0.027, m=0.005, q=1.2e-7, l=0.09, k_s=4.89e7, g=9.81)
    assert describe(psa)["n_points"] == 288
    assert psa.fingerprint == "6f99d67581cd57f3c17a1739bca7d21a300beb8bf0138906b387d3f480e52246"


@pytest.mark.parametrize("group_id", GROUPS)
def test_group(psa: Experiment, group_id: int) -> None:
    waveform, _, count, fixed, value, checksum = GROUPS[group_id]
    group = psa.group(group_id)
    assert (group.waveform, group.n_points) == (waveform, count)
    assert set(getattr(group, fixed).tolist()) == {value}
    swept = "frequency_hz" if fixed == "amplitude_v" else "amplitude_v"
    values = getattr(group, swept).tolist()
    assert values == sorted(set(values))  # ascending, no condition twice
    assert group.sigma is None  # the study gives no uncertainty
    text = "".join(f"{f!r},{v!r},{r!r}\n" for f, v, r in rows(psa, group_id))
    assert hashlib.sha256(text.encode()).hexdigest() == checksum


def appendix(text: str) -> dict[str, dict[float, float]]:
    """Tables A1 to A4 of the study's text: {table: {swept value: launch range}}."""
    tables: dict[str, dict[float, float]] = {}
    start = [(m.start(), m[1]) for m in re.finditer(r"^Table A(\d)\.", text, re.MULTILINE)]
    for (begin, number), (end, _) in zip(start, [*start[1:], (len(text), "")], strict=True):
        # The parts of a table begin with a line (a) or (b) of their own.
        parts = re.split(r"^\(([ab])\)\s*$", text[begin:end], flags=re.MULTILINE)
        named = [("", parts[0])] if len(parts) == 1 else list(zip(parts[1::2], parts[2::2], strict=True))
        for letter, body in named:
            cells = [
                float(cell.replace(",", ""))
                for line in body.splitlines()
                if re.fullmatch(r"[\d.,\t ]+", line)
                for cell in line.split("\t")
                if cell.strip()
            ]
            pairs = list(zip(cells[::2], cells[1::2], strict=True))
            tables[f"A{number}{letter}"] = dict(pairs)
            assert len(pairs) == len(tables[f"A{number}{letter}"])
    return tables


@pytest.mark.skipif(not STUDY.is_file(), reason="the study's text is not at hand (PSAFIT_STUDY)")
def test_every_number_is_the_study_s(psa: Experiment) -> None:
    tables = appendix(STUDY.read_text(encoding="utf-8"))
    assert set(tables) == {table for _, table, *_ in GROUPS.values()}
    for group_id, (_, table, count, fixed, value, _) in GROUPS.items():
        measured = {
            (f if fixed == "amplitude_v" else v): r
            for f, v, r in rows(psa, group_id)
            if value == (v if fixed == "amplitude_v" else f)
        }
        assert len(measured) == count
        assert measured == tables[table]


@pytest.mark.skipif(not STUDY.is_file(), reason="the study's text is not at hand (PSAFIT_STUDY)")
def test_every_constant_is_the_study_s(psa: Experiment) -> None:
    text = STUDY.read_text(encoding="utf-8")
    table_3 = re.search(r"^Table 3\..*?\n\n(.*?)\n(.*?)\n", text, re.MULTILINE | re.DOTALL)
    assert table_3
    printed = {
        name: float(value.replace("\N{MULTIPLICATION SIGN}10^", "e").replace("{", "").replace("}", "").replace(",", ""))
        for name, value in zip(table_3[1].split("\t"), table_3[2].split("\t"), strict=True)
    }
    for name in ("M", "m", "q", "l", "k_s"):
        assert getattr(psa.constants, name) == printed[name]


def test_odd_points_stay_as_printed(psa: Experiment) -> None:
    """Nobody has smoothed the data: each of these looks wrong and is what the study prints."""
    odd = {
        1: [(300.0, 20.0, 11.3), (3000.0, 20.0, 45.6), (21000.0, 20.0, 2.01)],
        2: [(6000.0, 15.0, 3.48), (6500.0, 15.0, 3.8)],
        3: [(1200.0, 1.0, 0.44), (1200.0, 2.0, 0.37)],
        4: [(3000.0, 7.5, 3.32), (3000.0, 8.5, 3.06), (3000.0, 20.0, 34.4)],
        5: [(1200.0, 1.0, 0.09), (1200.0, 6.5, 7.3), (1200.0, 15.0, 48.85)],
        6: [(20.0, 20.0, 86.8), (300.0, 20.0, 95.2), (50000.0, 20.0, 0.0)],
    }
    for group_id, points in odd.items():
        assert set(points) <= set(rows(psa, group_id))


def test_documented_numbers_are_current() -> None:
    """docs/figures/data.json, which docs/data.md quotes, follows from the data."""
    pytest.importorskip("matplotlib")
    module = loaded(ROOT / "docs" / "make_data_figures.py")
    groups = {g.id: g for g in read_experiment(ROOT / "experiments" / "psa").groups}
    stored = json.loads((ROOT / "docs" / "figures" / "data.json").read_text(encoding="utf-8"))
    current = json.loads(json.dumps(module.rounded(module.numbers(groups))))

    def compare(a: object, b: object) -> None:
        if isinstance(a, dict):
            assert isinstance(b, dict)
            assert a.keys() == b.keys()
            for key in a:
                compare(a[key], b[key])
        elif isinstance(a, list):
            assert isinstance(b, list)
            assert len(a) == len(b)
            for x, y in zip(a, b, strict=True):
                compare(x, y)
        else:
            # The last of five digits may turn on another processor.
            assert a == (pytest.approx(b, rel=2e-4) if isinstance(b, float) else b)

    compare(stored, current)
