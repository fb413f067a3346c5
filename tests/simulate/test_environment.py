"""Settings of Numba that psafit cannot run with end in one line, from the command line and from Python."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from commands import psafit
from numba import njit
from numba.core import event

from psafit.errors import InputError
from psafit.simulate import compiled
from psafit.simulate.environment import check_numba

REFUSED = {
    "NUMBA_DISABLE_JIT": ("1", "-1"),
    "NUMBA_NUM_THREADS": ("0", "-2", "100000"),
    "NUMBA_FUNCTION_CACHE_SIZE": ("-1",),
    "NUMBA_CPU_FEATURES": ("avx2", "+avx2,", "+avx2 -x"),
}


@pytest.mark.parametrize(("name", "value"), [(name, values[0]) for name, values in REFUSED.items()])
def test_a_setting_that_breaks_numba_is_refused(known_folder: Path, name: str, value: str) -> None:
    done = psafit("check", known_folder, cwd=known_folder, **{name: value})
    assert done.returncode == 2 and done.stderr.startswith(f"psafit: {name}") and done.stderr.count("\n") == 1
    assert "do not set it" in done.stderr


@pytest.mark.parametrize(("name", "value"), [(name, x) for name, values in REFUSED.items() for x in values[1:]])
def test_so_are_its_other_values(monkeypatch: pytest.MonkeyPatch, name: str, value: str) -> None:
    """By the check that a process begins with."""
    monkeypatch.setenv(name, value)
    with pytest.raises(InputError, match=f"^{name}.*do not set it"):
        check_numba()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("NUMBA_DISABLE_JIT", "0"),
        ("NUMBA_NUM_THREADS", "1"),
        ("NUMBA_FUNCTION_CACHE_SIZE", "0"),
        ("NUMBA_CPU_FEATURES", "+avx2,-avx512f"),
        ("NUMBA_THREADING_LAYER", "none such"),
        ("NUMBA_THREADING_LAYER_PRIORITY", "omp"),
    ],
)
def test_other_settings_are_left_alone(monkeypatch: pytest.MonkeyPatch, name: str, value: str) -> None:
    monkeypatch.setenv(name, value)
    check_numba()


def test_from_python_the_setting_can_be_taken_back(known_folder: Path) -> None:
    """Where it is found before Numba has read it."""
    program = """
import os, sys, psafit
from psafit.errors import InputError
try:
    psafit.open(sys.argv[1])
except InputError as error:
    print(error)
del os.environ["NUMBA_DISABLE_JIT"]
print(len(psafit.open(sys.argv[1]).data))
"""
    words, environment = [sys.executable, "-c", program, str(known_folder)], os.environ | {"NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(words, capture_output=True, text=True, timeout=300, check=False, env=environment)
    assert done.returncode == 0 and done.stdout.split("\n")[1] == "62" and "NUMBA_DISABLE_JIT" in done.stdout


def test_a_program_that_has_switched_compilation_off(monkeypatch: pytest.MonkeyPatch) -> None:
    import numba

    monkeypatch.setattr(numba.config, "DISABLE_JIT", 1)
    with pytest.raises(InputError, match=r"DISABLE_JIT.*numba_config"):
        check_numba()


def test_help_needs_no_numba(tmp_path: Path) -> None:
    assert psafit("--help", cwd=tmp_path, NUMBA_DISABLE_JIT="1").returncode == 0


def test_a_compilation_of_the_engine_is_announced_once(caplog: pytest.LogCaptureFixture) -> None:
    def begun(function: object) -> event.Event:
        return event.Event("numba:compile", event.EventStatus.START, {"dispatcher": njit(function)})

    def foreign(x: float) -> float:
        return x

    listener = compiled._Announced()
    with caplog.at_level("INFO", "psafit"):
        listener.notify(begun(foreign))
        assert not caplog.messages
        foreign.__module__ = "psafit.simulate.stepper"
        for _ in range(2):
            listener.notify(begun(foreign))
    assert caplog.messages == ["compiling the simulator: up to a minute"]
