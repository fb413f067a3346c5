"""Shared: a small rig whose truth is known, and results that cost something.

What only some fixtures need is imported by them: a single fast test does not wait for it.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

# As the command line does: threads of the linear algebra library only wait for each other on our small matrices.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Tests that run side by side part the cores: what starts as many processes as there are cores takes its share.
if side_by_side := int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "0")):
    share = max(1, (os.cpu_count() or 1) // side_by_side)
    os.environ.setdefault("LOKY_MAX_CPU_COUNT", str(share))

import numpy as np
import pytest
from rigs import measure

from psafit.experiment import Experiment, write_experiment
from psafit.simulate.threads import n_threads, set_n_threads

if TYPE_CHECKING:
    from psafit.reproduce import Reproduction

if side_by_side:
    set_n_threads(min(share, n_threads()))

pytest.register_assert_rewrite("campaigns", "folders")  # they assert, though they hold no tests


# The files of the longest tests: begun last, one would leave the other workers idle.
LONGEST = ("test_hidden_effects.py", "test_notebooks.py", "test_docs.py", "test_diagnosis.py", "test_samplers.py")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the longest tests."""
    places = {name: k for k, name in enumerate(LONGEST)}
    items.sort(key=lambda item: places.get(item.path.name, len(places)))


@pytest.fixture
def all_threads() -> Iterator[None]:
    """For a test of threads: several, though other tests run next to it."""
    used = n_threads()
    set_n_threads(4)
    yield
    set_n_threads(used)


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are made, but not drawn: for tests of a page's text."""
    from matplotlib.figure import Figure
    from pictures import blank

    monkeypatch.setattr(Figure, "savefig", blank)


@pytest.fixture(scope="session")
def known() -> Experiment:
    return measure(np.random.default_rng(5))


@pytest.fixture(scope="session")
def known_folder(known: Experiment, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data") / "known"
    write_experiment(known, folder)
    return folder


@pytest.fixture(scope="session")
def sound():
    from truths import experiment, problem

    from psafit.inference.candidate import fit

    return fit(problem(experiment()), (), seed=1, draws=512, most=8)


@pytest.fixture(scope="session")
def hidden():
    from truths import FEW, experiment, problem

    from psafit.model_search import search_models

    return search_models(problem(experiment(["amplifier_lag"], [4e-5], n=24, seed=3)), FEW, seed=1)


@pytest.fixture(scope="session")
def result() -> Reproduction:
    from psafit.reproduce import reproduce

    return reproduce(Path(__file__).parents[1] / "experiments" / "psa")


@pytest.fixture
def sensor(tmp_path: Path) -> Path:
    from sensors import SENSOR

    file = tmp_path / "sensor_compression.py"
    file.write_text(SENSOR)
    return file


@pytest.fixture(scope="session")
def fitted(known: Experiment, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two fits of group 1, too short to converge: nothing here hangs on that."""
    from psafit.inference.run import fit
    from psafit.inference.samplers.emcee import Settings

    folder = tmp_path_factory.mktemp("fits")
    for name, seed in (("one", 1), ("other", 2)):
        fit(known, [1], folder / name, seed=seed, n_starts=2, settings=Settings(chunk=60, max_steps=60, tuned=20))
    return folder / "one", folder / "other"


@pytest.fixture(scope="session")
def by_importance(known: Experiment, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fit of group 1, drawn from by importance sampling: to be copied by what writes into it."""
    from psafit.inference.run import fit

    folder = tmp_path_factory.mktemp("importance") / "r"
    fit(known, [1], folder, seed=1, n_starts=8, sampled_by="importance")
    return folder


@pytest.fixture(scope="session")
def diagnosis(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Experiment]:
    """A made-up diagnosis with its predictions, and the experiment it belongs to."""
    from diagnoses_by_hand import make_experiment, make_record

    from psafit.records import write_json
    from psafit.validate import COLUMNS, prediction_rows, write_table

    folder = tmp_path_factory.mktemp("diagnosis")
    experiment = make_experiment()
    record = make_record(experiment)
    write_json(folder / "diagnosis.json", record, sealed=True)
    rows = (
        row
        for g in experiment.groups
        for row in prediction_rows(g, 1.1 * g.reading, 0.8 * g.reading, 1.3 * g.reading, "fit")
    )
    write_table(folder / record.predictions, COLUMNS, rows)
    return folder, experiment
