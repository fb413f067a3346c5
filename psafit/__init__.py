"""psafit: fit the simulation of a piezo stack that kicks a ball, and find what it gets wrong.

For a notebook: ``rig = psafit.open("experiments/psa")``, then ``rig.fit([1])`` and ``rig.diagnose(quick=True)``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from psafit.api import Diagnosed, Fitted, Rig

__version__ = "0.2.0.dev0"


def open(folder: str | Path) -> Rig:
    """Open an experiment folder: see `psafit.api.Rig`."""
    from psafit.api import Rig
    from psafit.prior_check import read

    return Rig(read(folder))


def load(folder: str | Path) -> Fitted:
    """Open the folder of a finished fit: see `psafit.api.Fitted`."""
    from pathlib import Path

    from psafit.api import Fitted
    from psafit.inference.run_folder import load

    return Fitted(load(Path(folder)))


def load_diagnosis(folder: str | Path, experiment: str | Path | None = None) -> Diagnosed:
    """Open the folder of a finished diagnosis: see `psafit.api.Diagnosed`.

    Parameters
    ----------
    folder : path-like
    experiment : path-like, optional
        The measurements; the copy that the diagnosis keeps by default.
    """
    from pathlib import Path

    from psafit.api import Diagnosed

    return Diagnosed.of(Path(folder), None if experiment is None else Path(experiment))
