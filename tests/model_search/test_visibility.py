"""Whether a cause shows."""

from __future__ import annotations

import itertools
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from psafit.inference.evidence import RoundSettings
from psafit.inference.memory import Memory
from psafit.model_search import ModelSet, SearchSettings
from psafit.model_search.fitter import Fitted, ProblemFitter
from psafit.model_search.loop import Ids, Model, reduced
from psafit.model_search.visibility import VISIBLE, Effects, effects, may_hide, shown

LAG = ("amplifier_lag",)


def found(model_set: ModelSet, ids: Ids, rounds: RoundSettings | None = None) -> Effects:
    """Effects in one of the sets that were fitted."""
    parts = [model_set.of(part) for part in reduced(ids)]
    own, draws = model_set.of(ids), model_set.samples.get(ids)
    return Effects(**effects(own.problem, own, draws, parts, 1, rounds or SearchSettings().effects))


def test_an_effect_is_what_least_squares_leave_of_it(hidden: ModelSet) -> None:
    """Next to the same draw with a neutral cause, or next to the best without it: the smaller of the two."""
    own, plain = hidden.of(LAG), hidden.baseline
    draws = hidden.samples[LAG].resampled(128)
    neutral = draws.copy()
    (lag,) = own.problem.terms[0].parameters
    neutral[:, own.problem.names.index(lag.name)] = lag.to_sampling(lag.neutral)
    columns, sizes = (plain.slope / own.scatter).T, []
    for there in (own.problem.predict(neutral), plain.predicted):
        change = (own.problem.predict(draws) - there) / own.scatter
        left = change.T - columns @ np.linalg.lstsq(columns, change.T, rcond=None)[0]
        sizes.append(np.linalg.norm(left, axis=0))
    assert found(hidden, LAG).size[:, 0] == pytest.approx(np.minimum(*sizes), rel=1e-3)


@pytest.mark.parametrize("wanted", [3.0, 5.0, 5.5, 6.5])
def test_a_part_is_asked_about_where_draws_may_be_like_its_own(wanted: float) -> None:
    """One strength with a flat prior: what the readings want of it, its evidence and its draws are known."""
    wide = 40.0  # standard deviations
    effect = np.linspace(wanted - wide / 2, wanted + wide / 2, 20_001)
    likelihood = np.exp(wanted * effect - effect**2 / 2)
    gain = float(np.log(likelihood.mean()))
    hidden = float(likelihood[np.abs(effect) < VISIBLE].sum() / likelihood.sum())
    assert gain < wanted**2 / 2
    assert may_hide(0.0, gain, 0.0) or hidden < 1e-3
    assert may_hide(0.0, gain, 4.0) or hidden < 1e-4
    assert not may_hide(0.0, 40.0, 0.0) and may_hide(0.0, 40.0, 30.0)


def test_a_cause_that_does_nothing_in_a_draw_does_not_show_there_wherever_it_is(hidden: ModelSet) -> None:
    """A straight line from the best of the model without it would not lead there."""
    both = next(ids for ids in hidden.at_work if len(ids) == 2 and {*LAG, "reading_offset"} == {*ids})
    own = hidden.of(both)
    far = own.placed(own.problem)
    (offset,) = next(t for t in own.terms if t.id == "reading_offset").parameters
    far[:, own.problem.names.index(offset.name)] = offset.to_sampling(offset.neutral)
    far[:, own.problem.names.index("k_c")] += 1.0
    part = hidden.of(LAG)
    straight = own.project_out(own.problem.predict(far) - part.predicted, slope=part.slope)
    draws: Any = SimpleNamespace(resampled=lambda n: np.repeat(far, n, axis=0))
    parts = [part if id == "reading_offset" else None for id in both]
    size = effects(own.problem, own, draws, parts, 1, SearchSettings().effects)["size"]
    assert size[:, both.index("reading_offset")].max() < 0.1 < VISIBLE < np.linalg.norm(straight)
    assert np.isinf(size[:, both.index("amplifier_lag")]).all()


def test_an_effect_is_at_least_as_large_as_its_gain_says(hidden: ModelSet) -> None:
    """Half its square is what a cause is worth on average, less what the other scatter of the model without it is."""
    size = found(hidden, LAG).size[:, 0]
    assert size.min() > VISIBLE
    assert np.median(size) > 0.8 * np.sqrt(2 * hidden.gain(LAG))


def test_a_further_cause_hardly_shows_where_only_one_is_at_work(hidden: ModelSet) -> None:
    both = next(ids for ids in hidden.at_work if len(ids) == 2 and {*LAG, "reading_offset"} == {*ids})
    seen = found(hidden, both)
    share = dict(zip(both, seen.weights @ (seen.size > VISIBLE), strict=True))
    assert share["amplifier_lag"] > 0.99 and share["reading_offset"] < 0.2
    assert seen.weights.sum() == pytest.approx(1)


def test_what_shows_does_not_hang_on_how_many_draws_are_taken(hidden: ModelSet) -> None:
    """Of draws of a sample, and of draws that are made for a model that was not sampled."""
    both = next(ids for ids in hidden.at_work if len(ids) == 2 and {*LAG, "reading_offset"} == {*ids})
    for ids in (LAG, both):
        few, many = (found(hidden, ids, RoundSettings(draws=n, least=1, most=4, effective=n / 4)) for n in (32, 256))
        share, exact = (one.weights @ (one.size > VISIBLE) for one in (few, many))
        assert share == pytest.approx(exact, abs=0.15)


def test_probabilities_move_to_parts_down_to_nothing() -> None:
    """As a literal count of draws does it, one by one."""
    rng = np.random.default_rng(3)
    sets = [ids for k in range(4) for ids in itertools.combinations("abc", k)]
    for _ in range(30):
        raw = rng.dirichlet(np.ones(len(sets)))
        share = dict(zip(sets, raw.tolist(), strict=True))
        mass = {ids: float(np.log(p)) for ids, p in share.items()}
        seen = {
            ids: Effects(rng.dirichlet(np.ones(5)), rng.uniform(0, 2 * VISIBLE, (5, len(ids))))
            for ids in sets
            if ids and rng.uniform() < 0.8
        }
        end = dict(share)
        for ids in reversed(sets):
            if ids not in seen:
                continue
            before = end[ids]
            for weight, sizes in zip(seen[ids].weights, seen[ids].size, strict=True):
                parts = [
                    tuple(i for i in ids if i != id) for id, size in zip(ids, sizes, strict=True) if size < VISIBLE
                ]
                if parts:
                    end[max(parts, key=lambda part: mass[part])] += before * weight
                    end[ids] -= before * weight
        after = shown(
            share, mass, lambda wanted, seen=seen: {ids: seen[ids] for ids in wanted if ids in seen}, unasked=0.0
        )
        assert sum(after.values()) == pytest.approx(1) and min(after.values()) >= 0
        assert after == {ids: pytest.approx(p, abs=1e-12) for ids, p in end.items()}


def test_a_cause_shows_where_the_model_without_it_was_not_fitted(hidden: ModelSet) -> None:
    own = hidden.of(LAG)
    seen = effects(own.problem, own, None, [None], 1, SearchSettings().effects)
    assert np.isinf(seen["size"]).all()


def test_what_a_larger_set_leaves_to_a_smaller_one_is_asked_about_there() -> None:
    """Two causes that both do not show end at nothing, though the set between hardly has a share of its own."""
    share = {(): 0.01, ("a",): 1e-6, ("a", "b"): 0.98999, ("b",): 9e-6}
    mass = {ids: float(np.log(p)) for ids, p in share.items()}
    unseen = {ids: Effects(np.ones(1), np.zeros((1, len(ids)))) for ids in share if ids}
    after = shown(share, mass, lambda wanted: {ids: unseen[ids] for ids in wanted})
    assert after[()] == pytest.approx(1, abs=1e-5) and after["a", "b"] == 0


def test_a_search_asks_about_parts_that_come_near_alone(hidden: ModelSet) -> None:
    """A part 50 nats lower has no draws of the set; one whose fit may fall short by so much may have."""
    both = next(ids for ids in hidden.at_work if len(ids) == 2 and {*LAG, "reading_offset"} == {*ids})
    own = hidden.of(both)
    fitter = ProblemFitter(hidden.baseline.problem, own.terms, SearchSettings(), 1, Memory(None))
    for lower, earnest, seen in ((50.0, True, False), (20.0, True, False), (20.0, False, True), (0.0, True, True)):
        part = Model(LAG, -lower, 0.0, False, Fitted(hidden.of(LAG)), earnest=earnest)
        models = {LAG: part, both: Model(both, 0.0, 0.0, False, Fitted(own))}
        size = fitter.effects(models, [both])[both].size[:, both.index("reading_offset")]
        assert np.isfinite(size).all() == seen


def test_what_has_five_per_cent_was_sampled(hidden: ModelSet) -> None:
    assert hidden.likely and {*hidden.likely} <= {*hidden.samples}
