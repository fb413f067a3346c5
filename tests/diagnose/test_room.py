"""The largest effect that the readings leave to a cause that is not named."""

from __future__ import annotations

import numpy as np
from truths import FEW, TRUTH, experiment, problem

from psafit.diagnose.room import room
from psafit.model_search import ModelSet, search_models
from psafit.model_search.visibility import VISIBLE
from psafit.physics import terms
from psafit.simulate import MICRO, Design, simulate

LAG, FRICTION = (next(t for t in FEW if t.id == id) for id in ("amplifier_lag", "flight_friction"))


def test_sharper_readings_leave_less() -> None:
    rough, fine = (search_models(problem(experiment(relative=r)), (FRICTION,), seed=1) for r in (0.04, 0.01))
    assert rough.best_model.ids == fine.best_model.ids == ()
    left = [room(model_set, (), FRICTION, seed=1) for model_set in (rough, fine)]
    assert all(x is not None for x in left)
    assert 0.0 < left[1].share < 0.5 * left[0].share < 0.05  # type: ignore[union-attr]
    # In standard deviations of the scatter it is about the same.
    assert all(0.3 < x.size < 5 for x in left)  # type: ignore[union-attr]


def test_what_is_at_work_has_as_much_room_as_its_effect(hidden: ModelSet) -> None:
    """Added to a baseline that fails, the hidden lag changes ranges by about what it truly does."""
    left = room(hidden, (), LAG, seed=1)
    e = hidden.baseline.problem.experiment
    plain, lagging = (
        np.concatenate(
            [
                simulate(Design.sweep(e.constants, g.waveform, g.frequency_hz, g.amplitude_v), [*TRUTH, *own], causes)
                .launch_range[0] * MICRO
                for g in e.groups
            ]
        )
        for own, causes in (((), ()), ((4e-5,), terms(["amplifier_lag"])))
    )  # fmt: skip
    true = np.max(np.abs(lagging - plain) / (plain + 0.3))
    assert left is not None and 0.2 * true < left.share < 5 * true and left.size > VISIBLE


def test_what_was_not_fitted_has_no_number(hidden: ModelSet) -> None:
    assert room(hidden, ("reading_offset", "stack_stiffness", "flight_friction"), LAG, seed=1) is None


def test_weights_that_are_not_to_be_trusted_give_no_number(hidden: ModelSet) -> None:
    """Of 16 draws none is surely beyond a quantile of 95 %."""
    assert room(hidden, (), LAG, seed=1) is not None
    assert room(hidden, (), LAG, seed=1, draws=16, rounds=1) is None
