"""What a diagnosis keeps."""

from __future__ import annotations

import errno
from pathlib import Path

import numpy as np
import pytest
from truths import CHEAP, FEW, experiment, problem

from psafit.errors import InputError
from psafit.inference.memory import Memory, lent
from psafit.model_search import search_models
from psafit.parameters import Belief, Normal
from psafit.physics import informed


def test_memory_is_used_checked_and_repaired(tmp_path):
    memory = Memory(tmp_path)
    one = problem(experiment())
    calls = []

    def make():
        calls.append(1)
        return {"x": np.arange(3.0)}

    for _ in range(2):
        assert memory.recall("fit", one, 1, make)["x"].tolist() == [0, 1, 2]
    assert len(calls) == 1
    memory.recall("fit", one, 2, make)  # another seed is another thing
    assert len(calls) == 2
    for path in tmp_path.glob("*.npz"):
        path.write_bytes(path.read_bytes()[:40])
    assert memory.recall("fit", one, 1, make)["x"].tolist() == [0, 1, 2]
    assert len(calls) == 3
    memory.recall("fit", one, 2, make)
    # Whole, but not what was kept.
    for path in tmp_path.glob("*.npz"):
        with np.load(path) as stored:
            kept = dict(stored)
        np.savez(path, **{name: a + (name == "x") for name, a in kept.items()})
    assert memory.recall("fit", one, 1, make)["x"].tolist() == [0, 1, 2]
    assert len(calls) == 5


@pytest.mark.slow
def test_what_is_kept_belongs_to_the_priors_it_was_found_with(tmp_path):
    """A prior stated after a first diagnosis: no fit and no evidence of the old one may be recalled."""
    one, memory = problem(experiment(n=8)), Memory(tmp_path)
    (wide,) = informed((Belief("amplifier_lag_tau", Normal(0.0, 4e-4), "seen"),), FEW[:1])[1]
    found = {}
    for term in (FEW[0], wide):
        found[term] = search_models(one, (term,), seed=1, settings=CHEAP, memory=memory)
        fresh = search_models(one, (term,), seed=1, settings=CHEAP)
        assert found[term].log_evidence == fresh.log_evidence
    assert found[FEW[0]].log_evidence != found[wide].log_evidence


def test_a_step_that_the_system_refuses_is_not_worked_out_anew(tmp_path, monkeypatch):
    memory, one = Memory(tmp_path), problem(experiment(n=8))
    memory.recall("fit", one, 1, lambda: {"x": np.arange(3.0)})

    def refused(path):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(Path, "read_bytes", refused)
    with pytest.raises(InputError, match="check its permissions"):
        memory.recall("fit", one, 1, lambda: {"x": np.arange(3.0)})


def test_what_is_kept_on_another_machine_is_sent(tmp_path):
    """A worker that does not see the folder keeps in one of its own, and sends the files."""
    one, here = problem(experiment(n=8)), Memory(tmp_path / "steps")

    def work(memory, value):
        memory.recall("fit", one, value, lambda: {"x": np.full(3, value)})

    assert not here.within_reach
    files = lent(work, here, 2.0)
    assert len(files) == 1 and not (tmp_path / "steps").exists()
    here.begin()
    here.receive(files)
    assert here.within_reach and here.count("fit") == 1
    assert here.recall("fit", one, 2.0, lambda: 1 / 0)["x"].tolist() == [2.0] * 3
    assert lent(work, here, 3.0) == {} and here.count("fit") == 2


def test_without_a_folder_things_are_kept_as_long_as_the_memory():
    one, memory = problem(experiment(n=8)), Memory(None)
    key = memory.key("fit", one, 1)
    assert memory.look(key) is None and not memory.holds(key)
    memory.recall("fit", one, 1, lambda: {"x": np.arange(3.0)})
    assert memory.holds(key) and memory.recall("fit", one, 1, lambda: 1 / 0)["x"].tolist() == [0, 1, 2]
    assert Memory(None).look(key) is None
