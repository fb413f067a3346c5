"""Causes that change what is read, of whatever observable: the fast path against the literal reference."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from psafit.challenge.hide import simulate_literally
from psafit.drives import Drive
from psafit.experiment import Conditions, Occasions, session_name
from psafit.observables import CONTACT_TIME, LAUNCH_RANGE, OBSERVABLES, OF_LAUNCHES, PEAK_FORCE
from psafit.physics import term
from psafit.physics.term import ReferenceRig, Term, idle
from psafit.simulate import Design, readings
from psafit.simulate.contract import STUDY, of_ranges

GAIN = term("reading_gain")


def _slower(x: Any, p: Any, group: Any) -> Any:
    return x * (1.0 + p[:, :1] * (1 + group))


def _slower_literally(rig: ReferenceRig, p: Any) -> None:
    before, strength = rig.reading, p[0]
    rig.reading = lambda x, group: before(x, group) * (1.0 + strength * (1 + group))


def _louder_literally(rig: ReferenceRig, p: Any) -> None:
    before, strength = rig.reading, p[0]
    rig.reading = lambda x, group: before(x, group) * (1.0 + strength * rig.frequency * rig.amplitude * 1e-5)


FLOOR = term("reading_offset")
SLOWER = replace(FLOOR, id="slower", reading=_slower, literal=_slower_literally, reads=("contact_time",))
LOUDER = replace(
    FLOOR,
    id="louder",
    reading=None,
    condition=lambda f, v, p: 1.0 + p[:, :1] * f * v * 1e-5,
    literal=_louder_literally,
    reads=("peak_force", "contact_time"),
)


def groups() -> list[Conditions]:
    """Every observable: those of launches under two drives, and the traces of one launch each."""
    n = len(OF_LAUNCHES)
    f, v, kinds = np.tile([700.0, 1900.0], n), np.tile([20.0, 13.0], n), np.repeat(np.arange(n), 2)
    launches = [Conditions(d, Drive(d), f"{d}.csv", f, v, measured=kinds) for d in ("sine", "square")]
    times = np.array([20.0, 60.0, 300.0])
    traces = [
        Conditions(
            o.name, Drive("sine"), f"{o.name}.csv", np.full(3, 900.0), np.full(3, 20.0),
            measured=np.full(3, OBSERVABLES.index(o), np.int8), time_us=times,
        )
        for o in OBSERVABLES if o.traced
    ]  # fmt: skip
    return launches + traces


@pytest.mark.parametrize("causes", [(GAIN,), (SLOWER,), (GAIN, SLOWER, LOUDER), (LOUDER, SLOWER)])
def test_what_is_read_is_what_the_reference_reads(causes: tuple[Term, ...]) -> None:
    given = groups()
    design = Design.of(STUDY, given)
    theta = [1.4e6, 3e3, 30.0]
    parameters = dict(zip(("k_c", "c_s", "c_c"), theta, strict=True))
    row, names = list(theta), {o.name for t in causes for o in OBSERVABLES if o.name in t.reads}
    latent = [0.5, -1.0, 0.3, 2.0, -0.4]
    for k, cause in enumerate(causes):
        if cause is GAIN:
            parameters["reading_gain_spread"] = 0.2
            parameters |= {session_name("reading_gain_z", g.id): z for g, z in zip(given, latent, strict=True)}
            row += [0.2, *latent]
        else:  # one name of a parameter, for both
            causes = (
                *causes[:k],
                replace(cause, parameters=(replace(cause.strength, name=cause.id),)),
                *causes[k + 1 :],
            )
            parameters[cause.id] = 0.1
            row += [0.1]
    fast, plain = readings(design, row, causes)[0], readings(design, theta)[0]
    literal = simulate_literally(design, parameters, causes, Occasions.of(given))
    assert fast == pytest.approx(literal, rel=1e-6, abs=1e-9)
    for k, o in enumerate(OBSERVABLES):
        changed = fast[design.measured == k] != plain[design.measured == k]
        assert changed.all() if o.name in names else not changed.any(), o.name


def _later_literally(rig: ReferenceRig, p: Any) -> None:
    before, delay = rig.reading, p[0]
    rig.reading = lambda x, group: before(x, group) + delay


def test_what_a_failed_launch_does_not_have_is_not_read() -> None:
    """A speed of zero has a reading; a contact time and a force that are not there have none."""
    moved = groups()[0]
    both = [moved, replace(moved, id="still", amplitude_v=0.0 * moved.amplitude_v)]
    design, theta = Design.of(STUDY, both), [1.4e6, 3e3, 30.0]
    for name, delay in (("launch_speed", 1e-4), ("contact_time", 2e-6), ("peak_force", 0.01)):
        later = replace(
            FLOOR,
            id="later",
            reads=(name,),
            parameters=(replace(FLOOR.strength, name="later"),),
            literal=_later_literally,
            reading=lambda x, p, group: x + p[:, :1],
        )
        parameters = dict(zip(("k_c", "c_s", "c_c"), theta, strict=True)) | {"later": delay}
        fast = readings(design, [*theta, delay], [later])[0]
        assert fast == pytest.approx(simulate_literally(design, parameters, [later], Occasions.of(both)), rel=1e-6)
        rows = (design.amplitude == 0.0) & (design.measured == [o.name for o in OBSERVABLES].index(name))
        assert rows.any() and (fast[rows] > 0.0).all() == (name == "launch_speed")


def test_a_gain_of_the_instrument_is_that_of_all_that_it_reads() -> None:
    design = Design.of(STUDY, groups())
    theta, z = [1.4e6, 3e3, 30.0], [0.5, -1.0, 0.3, 2.0, -0.4]
    factor = readings(design, [*theta, 0.2, *z], [GAIN])[0] / readings(design, theta)[0]
    reads = np.array([o.name in GAIN.reads for o in OBSERVABLES])[design.measured]
    assert factor == pytest.approx(np.where(reads, np.exp(0.2 * np.array(z)[design.group]), 1.0), rel=1e-12)


def test_what_a_cause_reads_says_where_it_acts() -> None:
    launches, *_ = groups()
    times, forces, ranges = (
        replace(launches, measured=np.full(8, OBSERVABLES.index(o))) for o in (CONTACT_TIME, PEAK_FORCE, LAUNCH_RANGE)
    )
    assert idle([GAIN, SLOWER, LOUDER], [times]) == ["reading_gain"]
    assert idle([GAIN, SLOWER, LOUDER], [forces]) == ["reading_gain", "slower"]
    assert idle([GAIN, SLOWER, LOUDER], [ranges, forces]) == ["slower"]
    friction, height, floor = map(term, ("flight_friction", "separation_height", "reading_offset"))
    traces = groups()[2:]
    assert idle([friction, height, floor], traces[:1]) == ["separation_height", "reading_offset"]
    assert idle([friction, height, floor], traces[2:]) == [friction.id, height.id, floor.id], "the tip's"


def test_what_changes_readings_of_others_does_nothing_else() -> None:
    with pytest.raises(ValueError, match="can do nothing else"):
        replace(term("flight_friction"), reads=("launch_speed",))
    with pytest.raises(ValueError, match="no observable 'speed' to read; there are launch_range, launch_speed"):
        replace(SLOWER, reads=("speed",))
    for reads in ("launch_speed", (), ("launch_speed", "launch_speed")):
        with pytest.raises(ValueError, match="give a tuple of observables, each once"):
            replace(SLOWER, reads=reads)  # type: ignore[arg-type]


def test_the_contract_looks_at_ranges() -> None:
    """A usual contact time, 1 ms, stands for a usual range, 100 um."""
    late = replace(FLOOR, reading=lambda x, p, group: x + p[:, :1], literal=_later_literally, reads=("contact_time",))
    seen = of_ranges(late)
    assert seen.reads == ("launch_range",) and of_ranges(GAIN) is GAIN and seen.reading is not None
    assert seen.reading(np.array([[1e-4]]), np.array([[1e-3]]), np.array([0])) == pytest.approx(2e-4)
    rig = ReferenceRig(k_c=1.0, c_s=1.0, c_c=1.0, m=1.0, M=1.0, k_s=1.0, q=1.0, l=1.0, g=1.0)
    seen.literal(rig, [1e-3])
    assert rig.reading(1e-4, 0) == pytest.approx(2e-4)
