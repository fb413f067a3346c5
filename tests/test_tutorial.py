"""The pages about rigs and causes of one's own: their Python runs, their commands print what they quote."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from sensors import TUTORIAL

from psafit.experiment import Experiment, read_experiment
from psafit.inference.run import fit
from psafit.inference.samplers.emcee import Settings
from psafit.validate import Prediction, write_predictions

ROOT = Path(__file__).parents[1]
QUICK = Settings(chunk=100, r_hat=1.5, effective_samples=50, autocorrelation_times=5, max_steps=300, tuned=30)


def blocks(name: str, kind: str = "python") -> list[str]:
    return re.findall(rf"```{kind}\n(.*?)```", (ROOT / "docs" / name).read_text("utf-8"), flags=re.DOTALL)


def test_the_page_s_python_reads_a_plugin(sensor: Path, tmp_path: Path) -> None:
    (code,) = blocks("own-causes.md")[1:]
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "sensor_kappa" in done.stdout, done.stderr


def test_what_the_pages_say_of_files(
    known: Experiment, known_folder: Path, tmp_path: Path, monkeypatch, capsys
) -> None:  # type: ignore[no-untyped-def]
    """docs/elsewhere.md, on a run of a small rig in the place of the study's."""
    from psafit.validate import validate

    monkeypatch.chdir(tmp_path)
    validation, _ = validate(fit(known, [1], Path("fits/psa-group1"), n_starts=4, settings=QUICK))
    Path("experiments").mkdir()
    Path("experiments/psa").symlink_to(known_folder)
    for code in blocks("elsewhere.md"):
        exec(code, {})
    said = capsys.readouterr().out
    assert "elpd_loo" in said and "overdamped with probability" in said
    recomputed, scores = re.findall(r"\{1: [^}]*\}", said)
    assert recomputed == scores
    predicted = re.findall(r"^(\d) (\w+) log_rmse ([\d.]+)", said, flags=re.MULTILINE)
    for (group, role, size), s in zip(predicted, validation.groups, strict=True):
        assert (group, role) == (str(s.group), s.role) and float(size) == pytest.approx(s.log_rmse, abs=0.02)


def test_the_pages_show_commands_that_have_said_something() -> None:
    for page in TUTORIAL.PAGES:
        found = TUTORIAL.BLOCK.findall(page.read_text("utf-8"))
        assert len(found) == len(blocks(page.name, "console"))
        assert all(reported for command, reported in found if "--measure" not in command)


def test_the_picture_is_drawn_from_what_a_fit_writes(tmp_path: Path) -> None:
    """The fits themselves take half a minute each."""
    (tmp_path / "rig").mkdir()
    TUTORIAL.measure(tmp_path / "rig")
    for run, role in (("rig-groupsine40V-sine700Hz", "fit"), ("with-sensor", "holdout")):
        (tmp_path / run).mkdir()
        made = []
        for g in read_experiment(tmp_path / "rig").groups:
            y, none = g.reading, np.zeros(g.n_points)
            made.append(Prediction(g, role, y, y, y, 0.9 * y, 1.1 * y, y, y, none, none, none, 0.5, 0.5, none))
        write_predictions(tmp_path / run / "predictions.csv", made)
    TUTORIAL.draw(tmp_path, tmp_path / "picture.png")
    assert (tmp_path / "picture.png").stat().st_size > 10_000


@pytest.mark.slow
def test_the_pages_quote_what_the_commands_print(tmp_path: Path) -> None:
    """Those that take seconds; numbers may differ in their last digits from machine to machine."""

    def plain(text: str) -> str:
        return re.sub(r"\d+(\.\d+)?e[+-]\d+", "#", text)

    TUTORIAL.prepare(tmp_path)
    for page in TUTORIAL.PAGES:
        written = page.read_text("utf-8")
        assert plain(TUTORIAL.fill(written, tmp_path, quick=True)) == plain(written), "run python docs/make_tutorial.py"
