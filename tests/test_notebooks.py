"""The notebooks of the docs run, and show what is stored in them."""

from __future__ import annotations

from pathlib import Path

import pytest
from scripts import loaded

DOCS = Path(__file__).parents[1] / "docs"
nbformat = pytest.importorskip("nbformat", reason="make test installs it")
NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.ipynb"))
# What makes the work of a notebook shorter, and leaves what it does: chains that need not converge.
PRELUDES = {
    "first-fit": """
from dataclasses import replace

from psafit.inference.samplers.emcee import Settings

usual = Settings.of


def short(problem):
    less = {"chunk": 50, "tuned": 15, "autocorrelation_times": 1.0, "effective_samples": 1.0, "r_hat": 100.0}
    return replace(usual(problem), **less)


Settings.of = short
"""
}
NOTEBOOK = pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda p: p.stem)


def shown(book) -> list[list[str]]:  # type: ignore[no-untyped-def]
    """What each cell of code shows: kinds of output, and a verdict as it reads."""
    found = []
    for cell in book.cells:
        kinds = []
        for output in cell.get("outputs", ()):
            text = output.get("data", {}).get("text/plain", "")
            kinds.append(text if text.startswith("('") else " ".join(sorted(output.get("data", [output.output_type]))))
        found.append(list(dict.fromkeys(kinds)))
    return found


@NOTEBOOK
def test_a_notebook_is_stored_with_what_it_shows(notebook: Path) -> None:
    book = nbformat.read(notebook, as_version=4)
    nbformat.validate(book)
    outputs = [o for cell in book.cells for o in cell.get("outputs", ())]
    assert any("image/png" in o.get("data", {}) for o in outputs), "run python docs/make_notebooks.py"
    assert not [o for o in outputs if o.output_type == "error"]
    assert "/tmp/" not in notebook.read_text("utf-8"), "a folder of one machine"


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # of the kernel's client
@NOTEBOOK
def test_a_notebook_runs(notebook: Path, tmp_path: Path) -> None:
    """Two minutes each; an error in a cell is raised."""
    pytest.importorskip("nbclient", reason="make test installs it")
    made = loaded(DOCS / "make_notebooks.py").executed(notebook, tmp_path, prelude=PRELUDES.get(notebook.stem, ""))
    assert shown(made) == shown(nbformat.read(notebook, as_version=4)), "run python docs/make_notebooks.py"
