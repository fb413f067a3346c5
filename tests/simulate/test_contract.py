"""The contract finds what is broken in a cause."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sensors import CUBIC, SENSOR

from psafit.experiment import Experiment
from psafit.physics import plugin, terms
from psafit.simulate import Design, contract
from psafit.simulate.reference import Point


def outcomes(source: str, folder: Path, **options: Any) -> dict[str, contract.Outcome]:
    file = folder / "mine.py"
    file.write_text(source)
    return {o.check: o for o in contract.check(plugin.read(file), **{"draws": 8, **options})}


@pytest.mark.parametrize("source", [SENSOR, CUBIC], ids=["reading", "law"])
def test_a_sound_cause_keeps_the_contract(source: str, tmp_path: Path) -> None:
    found = outcomes(source, tmp_path)
    assert [o for o in found.values() if not o.passed] == []
    assert len(found) == (12 if "def law" in source else 11)
    assert all(o.text and "\n" not in o.text for o in found.values())


def test_a_cause_is_held_to_the_contract_on_any_rig(known: Experiment, tmp_path: Path) -> None:
    design = Design.of(replace(known.constants, M=0.004, q=3e-7), known.groups)
    found = outcomes(SENSOR, tmp_path, design=design)
    assert all(o.passed for o in found.values()) and "x 62 readings" in found["neutral"].text


# What is broken in a sound file: by which words, and the checks that must fail for it.
_FAST = {"reference", "bounds", "in company"}
_IDLE = 'Parameter("sensor_idle", "x", "1", Bounds(0.0, 1.0), Normal(0.5, 0.1), "idle", "made up"),'
BROKEN: dict[str, tuple[str, str, str, set[str]]] = {
    "another literal": (SENSOR, "(1.0 + kappa * seen)", "(1.0 + 1.01 * kappa * seen)", _FAST),
    "forgets those before it": (SENSOR, "seen = before(L, group)", "seen = L", {"in company"}),
    "not neutral": (SENSOR, "return L / (1.0", "return L / (1.0 + 1e-8", {"by hand", "neutral", *_FAST}),
    "jumps": (SENSOR, "return L / (1.0", "return L / (1.0 + 1e-3 * (p[:, :1] > 0)", {"by hand", "continuous", *_FAST}),
    "wrong by hand": (SENSOR, "1e-3 / 11", "1e-4 / 11", {"by hand"}),
    "asks nobody": (SENSOR, "_read(4e-4, 2.5e3), 2e-4", "2e-4, 2e-4", {"by hand"}),
    "wrong sign": (SENSOR, "sign=-1", "sign=1", {"symptom"}),
    "wrong trend": (SENSOR, 'amplitude="grows"', 'amplitude="flat"', {"symptom"}),
    "nothing said": (SENSOR, 'reference="the sensor\'s calibration sheet"', 'reference=""', {"declaration"}),
    "LaTeX": (SENSOR, 'equation=r"L', 'equation=r"{L', {"declaration"}),
    "idle parameter": (SENSOR, "    ),\n    symptom=", f"        {_IDLE}\n    ),\n    symptom=", {"parameters"}),
    "raises": (SENSOR, "return L / (1.0", "raise OSError('boo')\n    return L / (1.0", {"by hand", "path", *_FAST}),
    "derivative": (CUBIC, "out[0] * 2.0 * p[0]", "out[0] * 2.1 * p[0]", {"derivatives"}),
    "derivative's sign": (CUBIC, "out[1] * factor + out[0]", "out[1] * factor - out[0]", {"derivatives"}),
    "beyond the array": (CUBIC, "    out[2] *= factor", "    out[6] = factor", {"by hand", "compiled"}),
    "before the array": (CUBIC, "    out[2] *= factor", "    out[-1] = factor", {"compiled"}),
    "another's parameter": (CUBIC, "1.0 + p[0] * size", "1.0 + p[1] * size", {"by hand", "compiled"}),
    "not to be compiled": (CUBIC, "size = d / 1e-6", "size = eval('d') / 1e-6", {"compiled"}),
}  # fmt: skip


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_cause_fails_where_it_is_broken(case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In few draws, and in the company of four: what is broken shows in each."""
    monkeypatch.setattr(contract, "TERMS", terms(["amplifier_lag", "gap", "flight_friction", "reading_gain"]))
    source, old, new, expected = BROKEN[case]
    assert source.count(old) == 1
    found = outcomes(source.replace(old, new), tmp_path, draws=3)
    failed = {name for name, o in found.items() if not o.passed}
    assert expected <= failed and all("\n" not in o.text for o in found.values())
    # A function that does not compile, or writes where it must not, is not let near the simulator.
    assert ("neutral" in found) is ("compiled" not in failed)


@pytest.mark.parametrize(("fast", "agrees"), [(1.0, True), (2.0, True), (2.001, True), (1.5, False), (0.0, False)])
def test_a_bifurcation_excuses_nothing_but_its_other_side(fast: float, agrees: bool, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    one = contract.Draw(Point("sine", 1000.0, 20.0), [1e6, 1e3, 30.0])
    monkeypatch.setattr(contract.Draw, "fast", lambda self, tolerance: (fast, "stepper"))
    monkeypatch.setattr(contract.Draw, "reference", lambda self, factor=1.0: 2.0 if factor > 1.0 else 1.0)
    assert (one.disagreement() <= 1.0) is agrees


@pytest.mark.parametrize("length", [0.02, 0.03, 0.2])
@pytest.mark.parametrize("causes", [["preload"], ["session_lean"], ["preload", "session_lean"]], ids="+".join)
def test_no_lean_is_longer_than_half_of_the_string(causes: list[str], length: float) -> None:
    """Neither path loses the pendulum, and none reads a range that is negative."""
    rig, rng = replace(contract.STUDY, l=length), np.random.default_rng(5)
    longest = {"preload_offset": 0.045, "session_lean_offset": 0.045, "session_lean_spread": 1.0, "session_lean_z": 5.0}
    draws = [contract.draw(rng, terms(causes), rig, **longest) for _ in range(6)]
    assert contract.agreement(draws).passed
    assert all(one.fast()[0] >= 0.0 for one in draws)
