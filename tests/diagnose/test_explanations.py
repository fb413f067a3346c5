"""What a misfit may follow, and the measurement that would show it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from truths import experiment, problem

from psafit.diagnose.discrepancy import Discrepancy, discrepancy
from psafit.diagnose.explanations import Explanations
from psafit.diagnose.next_experiment import explaining, planned
from psafit.diagnose.possible import near
from psafit.inference.candidate import Candidate, fit
from psafit.simulate import Design

RESONANCE = 1500.0
PLACE = ("a", "frequency", 1000.0, 2200.0)


def resonant(where: str, **options) -> tuple[Candidate, Discrepancy]:  # type: ignore[no-untyped-def]
    """The baseline on a rig that swings along about one frequency: in some sessions."""

    def spoil(name: str, y: np.ndarray) -> np.ndarray:
        f = np.full(y.size, 1200.0) if name == "b" else np.geomspace(200, 2e4, y.size)
        return y * (1 + 0.8 * np.exp(-((np.log(f / RESONANCE) / 0.35) ** 2))) if name in where else y

    found = fit(problem(experiment(spoil=spoil, **options)), (), seed=1)
    return found, discrepancy(found)


@pytest.mark.parametrize(("groups", "kind"), [("abc", "frequency"), ("a", "session"), ("c", "session")])
def test_what_a_misfit_follows_is_read_from_other_groups(groups: str, kind: str) -> None:
    """A resonance in every session, and a bump of the same size and place in one alone."""
    found = Explanations.of(*resonant(groups))
    assert found is not None and found.record[0].kind == kind and found.record[0].probability > 0.95
    assert sum(e.probability for e in found.record) == pytest.approx(1.0)
    assert found.worth_distinguishing(0.05).record[0].kind == kind
    assert len(found.worth_distinguishing(0.05).record) == 2  # it has to stand against another


def test_readings_of_one_session_leave_open_what_it_follows() -> None:
    """... and a measurement where it stands out, in another session, decides."""
    candidate, left = resonant("a", groups=("a",))
    found = Explanations.of(candidate, left)
    assert found is not None
    shares = {e.kind: e.probability for e in found.record}
    # In one sweep of one voltage both are the same law of what was read.
    assert shares["session"] == pytest.approx(shares["frequency"], rel=1e-6) and "amplitude" not in shares
    both = replace(found, laws=tuple(law for law in found.laws if law.kind in ("session", "frequency")))
    first, *_ = explaining(both, [PLACE], seed=1)
    assert first.as_it_is and first.success is not None and first.success > 0.9 and first.separation > 3
    assert min(first.frequency_hz) < RESONANCE < max(first.frequency_hz)
    group = planned(first, "next", candidate.problem.experiment)
    assert group.n_points == 16 and set(group.amplitude_v) <= {10.0, 20.0}


def test_a_stretch_is_measured_again_more_densely_and_elsewhere() -> None:
    e = experiment()
    f = e.group("a").frequency_hz
    found = near(e.constants, e.groups, [("frequency_hz", (200.0, 2e4)), ("amplitude_v", (2.0, 30.0))], [PLACE])
    # To the readings on either side, and with the limits' half amplitude, not with twice as much.
    assert [(p.design.amplitude[0], p.changed) for p in found] == [(20.0, {}), (10.0, {})]
    for p in found:
        assert p.design.frequency.min() == f[f < 1000].max() and p.design.frequency.max() == f[f > 2200].min()
        assert p.design.n_points > np.sum((f > 1000) & (f < 2200)) + 2
    # Without limits, on a longer or shorter string and a lighter or heavier ball, too.
    free = near(e.constants, e.groups, (), [PLACE])
    assert len({(*p.changed.items(),) for p in free}) == 5
    # A sweep by amplitude, at other frequencies.
    swept = near(e.constants, e.groups, [("frequency_hz", (500.0, 2e4))], [("b", "amplitude", 5.0, 9.0)])
    assert [float(p.design.frequency[0]) for p in swept] == [1200.0, 600.0, 2400.0]


def test_where_nothing_was_left_a_repetition_decides_nothing() -> None:
    """A stretch far from the resonance is the same under both."""
    candidate, left = resonant("a", groups=("a",))
    found = Explanations.of(candidate, left)
    assert found is not None
    both = replace(found, laws=tuple(law for law in found.laws if law.kind in ("session", "frequency")))

    def apart(low: float, high: float) -> float:
        design = Design.sweep(candidate.problem.experiment.constants, "sine", np.geomspace(low, high, 16), 20.0)
        (one, root), (other, _) = both.ahead(design)
        return float(np.abs(np.linalg.solve(root, one - other)).max())

    assert apart(1000.0, 2200.0) > 3 * apart(9000.0, 19000.0)
