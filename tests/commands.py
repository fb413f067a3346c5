"""The command line, in this process or in one of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from psafit import cli, plugins
from psafit.cli import commands


def call(*words: object) -> tuple[int, str]:
    done = CliRunner().invoke(commands, ["challenge", *(str(w) for w in words)], standalone_mode=False)
    if done.exception:
        raise done.exception
    return done.return_value, done.output


def run(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr(sys, "argv", ["psafit", *map(str, arguments)])
    with pytest.raises(SystemExit) as caught:
        cli.main()
    return int(caught.value.code or 0)


def psafit(*arguments: object, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """In a process of its own: the registry is read once in each."""
    return subprocess.run(
        [sys.executable, "-m", "psafit", *map(str, arguments)], cwd=cwd, capture_output=True, text=True, timeout=300,
        check=False, env={k: v for k, v in os.environ.items() if k != plugins.VARIABLE} | environment,
    )  # fmt: skip
