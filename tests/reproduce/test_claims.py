"""The file of claims and the verdicts on them."""

from __future__ import annotations

import math
import re
import shutil
from pathlib import Path

import pytest

from psafit.errors import InputError
from psafit.reproduce import NOT_REPRODUCED, ONLY_WITH_STEP, REPRODUCED, judge, read_published, reproduce

PSA = Path(__file__).parents[2] / "experiments" / "psa"


def test_judge() -> None:
    assert judge(10.0, 0.1, 10.0, 10.05) == REPRODUCED
    assert judge(10.0, 0.1, 99.0, 9.95) == REPRODUCED
    assert judge(10.0, 0.1, 9.95, 11.0) == ONLY_WITH_STEP
    assert judge(10.0, 0.1, 9.8, 11.0) == NOT_REPRODUCED
    assert judge(10.0, 0.1, math.nan, math.nan) == NOT_REPRODUCED


def _altered(tmp_path: Path, old: str, new: str) -> Path:
    folder = tmp_path / "psa"
    shutil.copytree(PSA, folder)
    file = folder / "published.toml"
    text = file.read_text("utf-8")
    assert old in text
    file.write_text(text.replace(old, new), "utf-8")
    return folder


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("[parameters]", "[parameters", "cannot be read"),
        ("c_c = 68.0", "c_c = -68.0", "[parameters] has no valid c_c"),
        ("c_c = 68.0", 'c_c = "68"', "[parameters] has no valid c_c"),
        ("step = 1e-6", "step = nan", "[scheme] has no valid step"),
        ("step = 1e-6", "step = 0.0", "[scheme] has no valid step"),
        ('"peak_error"', '"peak_eror"', "unknown quantity 'peak_eror'"),
        ('place = "Table 4"\n', "", "lacks 'place'"),
        ("tolerance_relative = 0.003\n", "", "needs one of tolerance and tolerance_relative"),
        ('waveform = "sine"\n', "", "lacks 'waveform'"),
        ("group = 1\n", "", "lacks 'group'"),
        ('waveform = "sine"', 'waveform = "saw"', "has the waveform 'saw'"),
        ("frequency = 1200.0", "frequency = 0.0", "has 0.0 for frequency"),
        ("c_c = 68.0", f"c_c = {'9' * 5000}", "cannot be read"),
        ("c_c = 68.0", f"c_c = {'9' * 400}", "[parameters] has no valid c_c"),
        ("k_c = 1.425e5", "k_c = 0.0", "[parameters] has no valid k_c"),
        ("c_s = 13991.0", "c_s = 1e9", "[parameters] has no valid c_s, from 0 to 1e+06"),
        ("k_c = 50.0", "k_c = 1.42e5", "[rounding] has no valid k_c, from 0 to 141500"),
        ("total = 0.08", "total = 1e300", "[scheme] has no valid total, from 0.001 to 10"),
        ("step = 1e-6", "step = 1e-9", "[scheme] asks for more than 1e+07 steps"),
        ("amplitude = 16.0", "amplitude = 1e300", "has 1e+300 for amplitude"),
        ("amplitude = 16.0", "note = 3\namplitude = 16.0", "has a note that is no text"),
    ],
)
def test_unusable_claims_are_named(tmp_path: Path, old: str, new: str, said: str) -> None:
    with pytest.raises(InputError, match=re.escape(said)) as caught:
        read_published(_altered(tmp_path, old, new))
    assert caught.value.file is not None
    assert caught.value.file.name == "published.toml"


def test_a_group_of_another_rig_is_refused(tmp_path: Path) -> None:
    folder = _altered(tmp_path, "c_c = 68.0", "c_c = 68.0")
    file = folder / "experiment.toml"
    file.write_text(file.read_text("utf-8") + "constants = { l = 0.045 }\n", "utf-8")
    with pytest.raises(InputError, match=r"constants of its own, l = 0\.045 m"):
        reproduce(folder)


def test_a_folder_without_claims_says_so(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no published claims"):
        read_published(tmp_path)
