"""Drafts of causes, from what no cause explains."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from diagnoses_by_hand import make_experiment, make_record
from truths import CHEAP, FEW, bump, experiment, problem

from psafit.diagnose import diagnose
from psafit.diagnose.answer import answer
from psafit.diagnose.answer.worth import Drafted
from psafit.diagnose.discrepancy import Discrepancy, discrepancy
from psafit.diagnose.draft import FILE, DraftSettings, _widths, draft, drafted
from psafit.diagnose.settings import Settings
from psafit.diagnose.words import PLAIN
from psafit.inference.candidate import Candidate, fit
from psafit.observables import OBSERVABLES
from psafit.physics import plugin
from psafit.simulate.contract import check
from psafit.validate import log_ratio


def made(candidate: Candidate, axis: str, place: float, strength: float = 0.4, width: float = 0.4) -> Discrepancy:
    """What is left where readings differ by a factor about one place."""
    design = candidate.problem.design
    x = {"frequency": design.frequency, "amplitude": design.amplitude, "range": candidate.predicted}[axis]
    mean = strength * np.exp(-0.5 * (np.log(np.maximum(x, 1e-9) / place) / width) ** 2)
    return replace(discrepancy(candidate), mean=0.1 + mean, sd=np.full(mean.size, 0.05), log_bayes=9.0)


@pytest.mark.parametrize(("axis", "place"), [("frequency", 1500.0), ("amplitude", 8.0), ("range", 300.0)])
def test_the_axis_and_the_place_are_found(sound, axis, place, tmp_path) -> None:
    left = made(sound, axis, place, width=0.2)
    found = draft(sound, left, tmp_path)
    assert found.axis == axis and found.place == pytest.approx(place, rel=0.1)
    assert found.share > 0.9 and found.factor == pytest.approx(np.exp(0.4), rel=0.1)
    one = plugin.read(tmp_path / FILE)
    assert one.id == "draft_cause" and "no mechanism" in one.description
    # At a neutral strength it vanishes, and it tends to one at both ends of its axis.
    term = replace(problem(experiment()), terms=(one,))
    u = term.prior_transform(np.full((1, term.n_dim), 0.5))
    u[0, term.names.index("draft_strength")] = term.parameters[term.names.index("draft_strength")].to_sampling(0.0)
    plain = replace(term, terms=())
    assert term.predict(u) == pytest.approx(plain.predict(u[:, [0, 1, 2, -3, -2, -1]]), rel=1e-12)
    at, p = np.array([1e-30, 1e30]), np.array([[1.0, 100.0, 0.5]])
    factors = one.reading(at[None], p, np.zeros(2, int)) / at if one.reading else one.condition(at, at, p)
    assert factors == pytest.approx(np.ones((1, 2)), abs=1e-12)


def test_what_no_axis_describes_is_no_draft(sound, tmp_path) -> None:
    rng = np.random.default_rng(1)
    noise = rng.standard_normal(sound.predicted.size)
    assert draft(sound, replace(made(sound, "range", 300.0), mean=noise), tmp_path) is None
    flat = replace(made(sound, "range", 300.0), mean=np.full(noise.size, 0.3))  # a factor common to all is a refit's
    assert draft(sound, flat, tmp_path) is None
    # Nor is what the readings do not ask for.
    assert draft(sound, replace(made(sound, "range", 300.0), log_bayes=-0.1), tmp_path) is None
    assert not (tmp_path / FILE).exists()


def test_a_draft_describes_what_is_left_of_all_readings(sound, tmp_path) -> None:
    """What readings of another observable leave counts, and readings of no range."""
    left, design = made(sound, "range", 300.0), sound.problem.design
    speed = OBSERVABLES.index(next(o for o in OBSERVABLES if o.name == "launch_speed"))
    other = np.arange(design.n_points) % 2 == 1
    both = replace(design, measured=np.where(other, speed, design.measured))
    noisy = np.where(other, np.random.default_rng(1).standard_normal(other.size), left.mean)
    mixed = SimpleNamespace(problem=SimpleNamespace(design=both), predicted=sound.predicted)
    assert draft(sound, left, tmp_path).share > 0.9
    assert draft(mixed, replace(left, mean=noisy), tmp_path) is None


def read_as(candidate: Candidate, name: str, factor: float = 1.0) -> SimpleNamespace:
    """The same numbers, or so many times as large, of another observable."""
    design = candidate.problem.design
    kind = OBSERVABLES.index(next(o for o in OBSERVABLES if o.name == name))
    other = replace(design, measured=np.full(design.n_points, kind))
    return SimpleNamespace(problem=SimpleNamespace(design=other), predicted=factor * candidate.predicted)


@pytest.mark.parametrize(("axis", "place", "said"), [
    ("frequency", 1500.0, "on launch speeds at a frequency of"),
    ("range", 300.0, "on launch speeds at a predicted launch speed of"),
])  # fmt: skip
def test_a_draft_is_of_what_was_read(sound, axis, place, said, tmp_path) -> None:
    """Of speeds as of ranges; what is read over time is none."""
    left = made(sound, axis, place, width=0.2)
    found = draft(read_as(sound, "launch_speed"), left, tmp_path)
    assert (found.observable, found.axis) == ("launch_speed", axis) and found.place == pytest.approx(place, rel=0.1)
    term = plugin.read(tmp_path / FILE)
    assert term.reads == ("launch_speed",) and "launch speeds differ by a factor" in term.description
    if axis == "range":
        where = term.parameters[1]
        assert where.unit == "m/s" and where.bounds.lower < 1e-3 * place < where.bounds.upper
        assert term.reading(np.array([[1e-3 * place]]), np.array([[0.4, 1e-3 * place, 0.3]]), np.zeros(1, int))[
            0, 0
        ] == pytest.approx(np.exp(0.4) * 1e-3 * place)
    text = Drafted(found).say(PLAIN)
    assert said in text and (axis == "frequency" or " mm/s describes" in text)
    assert draft(read_as(sound, "velocity"), left, tmp_path) is None


def test_a_draft_that_somebody_has_edited_stays(sound, tmp_path) -> None:
    (tmp_path / FILE).write_text("mine")
    found = [draft(sound, made(sound, "range", 300.0), tmp_path).file for _ in range(2)]
    assert found == ["draft_cause_2.py"] * 2 and (tmp_path / FILE).read_text() == "mine"
    assert sorted(p.name for p in tmp_path.iterdir()) == [FILE, "draft_cause_2.py"]


def test_only_what_is_unexplained_is_drafted(sound, tmp_path) -> None:
    left, small = made(sound, "range", 300.0), made(sound, "frequency", 1500.0)
    model_set = SimpleNamespace(best_model=sound, baseline=sound)
    for verdict, named, why, axis in (
        ("explained", ("gap",), "", None), ("unexplained", (), "", "range"),
        ("unexplained", ("gap",), "structure", "range"), ("unexplained", ("gap",), "smooth", "frequency"),
    ):  # fmt: skip
        concluded = SimpleNamespace(verdict=verdict, named=named, unexplained_by=why)
        bare = small if named else left
        judged = SimpleNamespace(verdict=concluded, model_set=model_set, left=left, bare=bare)
        found = drafted(judged, tmp_path)
        assert (found and found.axis) == axis
    record = replace(make_record(make_experiment()), draft=found)
    (said,) = [s.say(PLAIN) for s in answer(record) if isinstance(s, Drafted)]
    along = replace(found, axis="amplitude", place=8.0)
    assert "at an amplitude of 8 V describes" in Drafted(along).say(PLAIN)
    assert not found.added and "of what the baseline leaves." in said, "a smooth curve in the place of the causes"
    assert "of what is left." in Drafted(replace(found, added=True)).say(PLAIN)
    assert (
        said.startswith("A factor of 1.47 at a frequency of 1440 Hz") and "draft_cause_2.py has it as a cause" in said
    )


@pytest.mark.slow
@pytest.mark.parametrize("axis", ["frequency", "amplitude", "range"])
def test_a_draft_keeps_the_contract(sound, axis, tmp_path) -> None:
    place = {"frequency": 1500.0, "amplitude": 8.0, "range": 300.0}[axis]
    draft(sound, made(sound, axis, place), tmp_path)
    term = plugin.read(tmp_path / FILE)
    draft(read_as(sound, "contact_time"), made(sound, axis, place), tmp_path)
    draft(read_as(sound, "peak_force", 0.01), made(sound, axis, place), tmp_path)
    others = [plugin.read(tmp_path / f"draft_cause_{k}.py") for k in (2, 3)]
    assert [one.reads for one in others] == [("contact_time",), ("peak_force",)]
    outcomes = [*check(term, draws=12), *(outcome for one in others for outcome in check(one, draws=4))]
    assert not [f"{one.check}: {one.text}" for one in outcomes if not one.passed]


@pytest.mark.slow
def test_what_has_no_name_becomes_a_draft_that_explains_it(tmp_path) -> None:
    """A resonance that two sweeps of three meet at the same frequency, and causes that do nothing of the kind."""

    def resonance(name, y):
        return bump("a", y) if name in "ac" else y

    e = experiment(spoil=resonance, seed=3)
    asked = {"quick": True, "settings": Settings(simulated=99, search=CHEAP), "jobs": 1}
    found = diagnose(e, ["a"], tmp_path / "without", catalogue=FEW[:2], **asked)
    assert found.verdict == "unexplained" and found.draft.axis == "frequency"
    assert found.draft.place == pytest.approx(e.group("a").frequency_hz[15], rel=0.1)
    term = plugin.read(tmp_path / "without" / FILE)
    again = diagnose(e, ["a"], tmp_path / "with", catalogue=(*FEW[:2], term), **asked)
    assert "draft_cause" in again.named and again.misfit.extended.p_value > 0.02
    # Fitted to one sweep, it describes the other that meets it.
    plain, larger = (problem(e, ("a",)), replace(problem(e, ("a",)), terms=(term,)))
    errors = []
    for one in (plain, larger):
        fitted = fit(one, (), seed=1, draws=512, most=8)
        c = e.group("c")
        errors.append(np.std(log_ratio(one.predict(fitted.modes[:1], ["c"])[0], c.reading)))
    assert errors[1] < 0.6 * errors[0]


def test_a_factor_is_never_larger_than_what_readings_differ_by(sound, tmp_path) -> None:
    """Not even where its middle lies in a gap of the readings, and their ends alone are within its reach."""
    frequency = sound.problem.design.frequency
    low, high = frequency.min(), frequency.max()
    ends = (frequency < 1.5 * low) | (frequency > high / 1.5)
    left = replace(
        discrepancy(sound),
        log_bayes=9.0,
        mean=np.where(frequency == frequency[ends & (frequency < high / 2)].max(), np.log(1.3), 0.0),
        sd=np.where(ends, 0.05, np.inf),
    )
    found = draft(sound, left, tmp_path, DraftSettings(widths=1, share=0.1))
    assert found is not None and found.axis == "frequency" and found.factor == pytest.approx(1.3, rel=0.1)


def test_a_draft_is_as_narrow_as_the_steps_between_conditions(sound, tmp_path) -> None:
    """A resonance that a few readings of each sweep show lies well within the bounds of its file."""
    frequency, group = sound.problem.design.frequency, sound.problem.design.group
    x = np.unique(np.log(frequency[group == 0]))
    step = float(np.ptp(x)) / (x.size - 1)
    found = draft(sound, made(sound, "frequency", 1500.0, width=1.2 * step), tmp_path)
    assert found.width == pytest.approx(1.2 * step, rel=0.35) and found.axis == "frequency"
    width = plugin.read(tmp_path / FILE).parameters[-1]
    assert width.bounds.lower < 0.5 * found.width and found.width < 0.5 * width.bounds.upper
    low, high = width.prior_quantile(np.array([0.05, 0.95]))
    assert low < width.to_sampling(found.width) < high


def test_steps_are_those_along_sweeps() -> None:
    """Two readings close together do not say how fine a sweep is; sweeps of one condition each say it together."""
    x = np.log([100.0, 200.0, 400.0, 800.0, 801.0])
    narrow, wide = _widths(x, np.zeros(5, int))
    assert narrow == pytest.approx(np.log(8.01) / 4) and wide == pytest.approx(np.log(8.01) / 2)
    apart = np.log([100.0, 100.0, 300.0, 900.0])
    assert _widths(apart, np.array([0, 0, 1, 2]))[0] == pytest.approx(np.log(3.0))
