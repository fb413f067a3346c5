"""A run that the command line has made."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def fitted(known_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("cli") / "run"
    done = subprocess.run(
        [sys.executable, "-m", "psafit", "fit", known_folder, "--group", "1", "--out", out, "--starts", "6"],
        capture_output=True, text=True, timeout=300, check=False, env=os.environ | {"XDG_CACHE_HOME": str(out.parent)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert " of 6 starts reached the best" in done.stdout and "group 2 (holdout): log_rmse" in done.stdout
    assert "sample the posterior" in done.stderr
    assert "Warning" not in done.stderr  # the first import of ArviZ has something to announce
    return out
