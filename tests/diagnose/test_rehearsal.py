"""Rehearsals with simulated readings."""

from __future__ import annotations

import numpy as np
import pytest

from psafit.diagnose.next_experiment import Proposal, separating
from psafit.diagnose.rehearsal import NEW, readings_to_come, rehearse, repeat
from psafit.inference.evidence import importance_sample


def test_a_trace_is_rehearsed_with_its_correlated_scatter(sound):
    """Samples of either sign, which errors join that last longer than a sample."""
    times = [float(t) for t in range(1, 121)]
    trace = Proposal("", "sine", [1200.0], [20.0], {}, 1.0, None, 0.1, observable="tip_displacement", time_us=times)
    new = [readings_to_come(sound.problem, sound.modes[:1], trace, np.random.default_rng(seed)) for seed in range(40)]
    assert all((g.id, g.n_points) == (NEW, 120) and g.time_us.tolist() == times for g in new)
    first = np.array([g.reading for g in new])[:, :12]  # while the tip hardly moves
    off = first - first.mean(axis=0)
    assert first.min() < 0 and np.mean(off[:, 1:] * off[:, :-1]) > 0.7 * np.mean(off**2)


@pytest.mark.slow
def test_rehearsal_finds_the_truth_whichever_it_is(hidden):
    """Readings from either of two causes, added to what was measured: the cause that made them comes out ahead."""
    models = [(c, importance_sample(c, seed=1)) for c in (hidden.best_model, hidden.of(("flight_friction",)))]
    best = next(p for p in separating(models, seed=1) if p.as_it_is)
    found = rehearse(models, [0.0, 0.0], best, seed=1)
    assert found.proposal == best.text
    assert found.truth[0] == list(hidden.best_model.ids)
    assert found.truth[-1] == ["flight_friction"]
    assert sum(found.before[i] for i in (0, -1)) == pytest.approx(1)
    # What was measured names the best model already; a truth that it refutes needs much to come out first.
    assert all(
        after > 0.9 for ids, after in zip(found.truth, found.after, strict=True) if ids == list(hidden.best_model.ids)
    )
    assert np.mean(found.after[-3:]) > found.before[-1]
    assert found == rehearse(models, [0.0, 0.0], best, seed=1)
    # So it is with a constant of the rig changed, or another observable read.
    other = next(p for p in separating(models, seed=1) if not p.as_it_is)
    found = rehearse(models, [0.0, 0.0], other, seed=1)
    assert all(
        after > 0.9 for ids, after in zip(found.truth, found.after, strict=True) if ids == list(hidden.best_model.ids)
    )


@pytest.mark.slow
def test_the_same_experiment_again_shows_what_it_can_separate(hidden):
    """A lag and friction, each as fitted to readings that a lag has made; and a model against its own double."""
    models = [(c, importance_sample(c, seed=1)) for c in (hidden.best_model, hidden.of(("flight_friction",)))]
    found = repeat(models, [0.0, 0.0], seed=1)
    assert found.before == pytest.approx([0.5] * 6)
    # Friction that stands for a lag came with a wide scatter, in which a lag may do as well: two of three at most.
    assert min(found.after[:3]) > 0.9 and found.first >= 4
    double = np.array(repeat([models[0], models[0]], [0.0, 0.0], seed=1).after)
    assert np.sqrt(np.mean(np.log(double / (1 - double)) ** 2)) < 0.6  # nats by which evidences err
