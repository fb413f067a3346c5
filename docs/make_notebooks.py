"""Run the notebooks of the docs, and store what they show: NAMES alone, or all.

Each runs in a folder of its own, as if it stood in docs/notebooks: what it writes is gone afterwards.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient

ROOT = Path(__file__).resolve().parent.parent
NOTEBOOKS = ROOT / "docs" / "notebooks"


def executed(notebook: Path, folder: Path, seconds: int = 1800, prelude: str = "") -> nbformat.NotebookNode:
    """A notebook with its outputs, run in a folder; an error in a cell is an error here.

    Times, the number of the run and what goes to standard error are left out: the file changes only with what it shows.
    A prelude is a first cell that is run and left out.
    """
    place = folder / "docs" / "notebooks"
    place.mkdir(parents=True)
    (folder / "experiments").symlink_to(ROOT / "experiments")
    book = nbformat.read(notebook, as_version=4)
    if prelude:
        book.cells.insert(0, nbformat.v4.new_code_cell(prelude))
    paths = [str(Path(sys.executable).parent), os.environ["PATH"]]
    environment = os.environ | {"PATH": os.pathsep.join(paths)}
    environment.pop("MPLBACKEND", None)  # figures go into the notebook
    client = NotebookClient(
        book, timeout=seconds, kernel_name="python3", resources={"metadata": {"path": str(place)}}, record_timing=False,
        coalesce_streams=True,
    )  # fmt: skip
    client.execute(env=environment)
    if prelude:
        del book.cells[0]
    for cell in book.cells:
        if cell.cell_type == "code":
            cell.outputs = [o for o in cell.outputs if o.get("name") != "stderr"]
            cell.metadata.pop("execution", None)
    return book


def main(names: list[str]) -> None:
    for notebook in sorted(NOTEBOOKS.glob("*.ipynb")):
        if names and notebook.stem not in names:
            continue
        print(notebook.name)
        with tempfile.TemporaryDirectory() as folder:
            nbformat.write(executed(notebook, Path(folder)), str(notebook))


if __name__ == "__main__":
    main(sys.argv[1:])
