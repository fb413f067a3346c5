"""Data sets drawn from an answer and diagnosed again."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest
from diagnoses_by_hand import build, make_experiment, make_record
from truths import CHEAP, FEW, experiment, problem

from psafit.diagnose import calibration, diagnose
from psafit.diagnose.answer import answer
from psafit.diagnose.answer.grounds import Calibrated
from psafit.diagnose.calibration import calibrate, drawn
from psafit.diagnose.record import RESULT, Diagnosis
from psafit.diagnose.settings import Settings
from psafit.diagnose.trials import Rate, Trial, VerdictWord, summed
from psafit.diagnose.words import PLAIN
from psafit.inference.memory import Memory
from psafit.model_search import search_models
from psafit.records import read_json, write_json
from psafit.report.diagnosis.answer import kind

LAG = FEW[:1]
LITTLE = Settings(simulated=29, search=CHEAP)


def trial(
    truth: str, verdict: VerdictWord, named: str, *others: str, printed: float | None = 0.9, held: int = 4
) -> Trial:
    return Trial(truth.split(), verdict, named.split(), [ids.split() for ids in others], printed, held, 4)


TRIALS = [
    trial("gap", "explained", "gap", printed=0.97),
    trial("gap", "ambiguous", "preload", "gap", printed=0.6, held=3),
    trial("gap preload", "unexplained", "preload gap", printed=None, held=0),
    trial("", "adequate", "", printed=0.99),
    trial("gap", "adequate", "", printed=0.7),
    trial("", "unexplained", "", printed=None),
]


def test_what_is_counted() -> None:
    found = summed(TRIALS)
    # An unexplained one names its best extension as no explanation, but reports it.
    assert (found.exact.n, found.reported.n, found.exact.of) == (2, 4, 6)
    assert (found.right.n, found.right.of) == (2, 4) and found.printed == pytest.approx((0.97 + 0.6 + 0.99 + 0.7) / 4)
    assert (found.held, found.intervals) == (4 + 3 + 0 + 4 + 4 + 4, 24)
    assert [(r.lower, r.upper, r.right.n, r.right.of) for r in found.reliability] == [
        (0.5, 0.8, 0, 2),
        (0.95, 1.0, 2, 2),
    ]
    assert [(one.truth, one.exact.n, one.exact.of) for one in found.truths] == [
        (["gap"], 1, 3), ([], 1, 2), (["gap", "preload"], 0, 1),
    ]  # fmt: skip


def test_what_counts_as_named() -> None:
    """The same for trials and for campaigns: a set at implausible values is named, one that explains nothing is not."""
    odd = replace(trial("gap", "unexplained", "gap"), why="values")
    assert odd.exact and not any(replace(odd, why=why).exact for why in ("structure", "smooth", "law"))
    assert not replace(odd, verdict="ambiguous", why="law").exact and not trial("", "unexplained", "").exact
    assert summed([odd, replace(odd, why="structure", printed=None)]).right == Rate.counted([True])


def test_names_and_intervals_that_promise_too_much_are_said_to() -> None:
    right = [trial("gap", "explained", "gap", held=4 - k % 3 // 2) for k in range(12)]
    wrong = [trial("gap", "ambiguous", "preload", held=2 + k % 2) for k in range(6)]
    sound, found = summed(right), summed([*right[:3], *wrong])
    assert not (sound.overstated or sound.narrow) and found.overstated and found.narrow
    assert found.behind("ambiguous", ["preload"]) == [(["gap"], 6)] and not found.behind("explained", ["preload"])
    said = Calibrated(found, True, "ambiguous", ["preload"]).say(PLAIN)
    assert "the probabilities here are too high. Those with the verdict and the name given here (6) were" in said
    assert "they are too narrow here." in said
    said = Calibrated(sound, True, "explained", ["gap"]).say(PLAIN)
    assert "too high" not in said and "too narrow" not in said
    seldom = summed([replace(right[0], held=held, intervals=of) for held, of in [(1, 2)] * 4 + [(20, 20)] * 3])
    assert not seldom.narrow, "94 % of all intervals hold"
    assert not summed([replace(right[0], held=7, intervals=8)] * 2).narrow, "two data sets of the same share say little"
    many = [trial(f"c{k}", "explained", "gap") for k in range(6)]
    said = Calibrated(summed(many), True, "explained", ["gap"]).say(PLAIN)
    assert "c3 (1) and others (2)." in said


def test_a_rate_knows_how_little_a_few_data_sets_say() -> None:
    assert Rate.counted([]) == Rate(0, 0, 0.0, 1.0)
    few, many = Rate.counted([True] * 4), Rate.counted([True] * 40)
    assert few.upper == many.upper == 1.0
    assert few.lower == pytest.approx(0.05 ** (1 / 4)) and many.lower == pytest.approx(0.05 ** (1 / 40))


def test_data_sets_are_drawn_from_models_and_their_posteriors(hidden) -> None:
    lag, friction = ("amplifier_lag",), ("flight_friction",)
    even = replace(hidden, probability=dict.fromkeys(hidden.probability, 0.0) | {lag: 0.5, friction: 0.5})
    found = drawn(even, 40, seed=1)
    assert {one.ids for one in found} == {lag, friction} and 8 <= sum(one.ids == lag for one in found) <= 32
    again = drawn(even, 5, seed=1)
    assert all((a.readings == b.readings).all() for a, b in zip(again, found[:5], strict=True))
    assert not (drawn(even, 1, seed=2)[0].readings == found[0].readings).all()
    # Values are of the posterior, and readings scatter about what these values predict.
    own = [one for one in found if one.ids == lag]
    tau = [one.values["amplifier_lag_tau"] for one in own]
    model, samples = even.of(lag).problem, even.draws(lag, 1)
    k = model.names.index("amplifier_lag_tau")
    ends = samples.quantiles(model.to_physical(samples.draws)[:, k], (0.02, 0.25, 0.75, 0.98))
    assert ends[1] < np.median(tau) < ends[2]
    assert np.mean((ends[0] < np.array(tau)) & (np.array(tau) < ends[3])) > 0.8 and len(set(tau)) > 0.7 * len(tau)
    u = model.to_sampling(np.array([[one.values[name] for name in model.names] for one in own]))
    sigma = np.hypot(model.to_physical(u)[:, [-3]] * model.predict(u), model.to_physical(u)[:, [-2]])
    z = (np.array([one.readings for one in own]) - model.predict(u)) / sigma
    assert abs(np.median(z)) < 0.2 and 0.5 < np.median(np.abs(z)) < 0.9


def test_a_calibration_goes_on_where_it_stopped(tmp_path, monkeypatch) -> None:
    model_set = search_models(problem(experiment(["amplifier_lag"], [4e-5], n=6)), LAG, seed=1, settings=CHEAP)
    memory, seen = Memory(tmp_path), []

    def run(n: int) -> list[Trial]:
        asked = {"seed": 1, "memory": memory, "settings": LITTLE, "progress": lambda k, n: seen.append((k, n))}
        return calibrate(model_set, LAG, n, **asked).trials

    one = run(1)
    both = run(2)
    assert both[:1] == one and seen[-1] == (2, 2)
    assert all(t.intervals >= 3 and 0 <= t.held <= t.intervals for t in both)
    monkeypatch.setattr(calibration, "tried", None)  # nothing is worked out again
    assert run(2) == both


@pytest.mark.slow
def test_a_calibrated_diagnosis_is_the_same_for_any_number_of_workers(tmp_path) -> None:
    e = experiment(["amplifier_lag"], [4e-5], n=8, groups=("a", "b"))
    asked = {"quick": True, "catalogue": FEW[:2], "settings": LITTLE, "calibrate": 2}
    found = [diagnose(e, ["a"], tmp_path / "1", jobs=1, **asked)]
    # The rest of a diagnosis by two workers is compared elsewhere: here they find it done.
    shutil.copytree(tmp_path / "1", tmp_path / "2", ignore=shutil.ignore_patterns(RESULT, "calibration-*"))
    found.append(diagnose(e, ["a"], tmp_path / "2", jobs=2, **asked))
    assert found[0].calibration == found[1].calibration
    assert found[0].calibration.exact.of == 2 and found[0].calibration.reported.n >= 1
    assert read_json(tmp_path / "1" / RESULT, Diagnosis, sealed=True) == found[0]
    assert any(isinstance(s, Calibrated) for s in answer(found[0]))


@pytest.mark.usefixtures("undrawn")
def test_what_is_said_of_it(tmp_path) -> None:
    e = make_experiment()
    record = replace(make_record(e), calibration=summed(TRIALS))
    (said,) = [s.say(PLAIN) for s in answer(record) if isinstance(s, Calibrated)]
    assert said == (
        "Of 6 data sets drawn from this answer and diagnosed again, the set that made it was named in 2"
        " (6 % to 73 %, 90 %) and reported in 4. What was named had a probability of 82 % on average, and was right in"
        " 2 of 4. 90 % intervals held 19 of the 24 true values (79 %)."
    )
    tied = replace(record, verdict="ambiguous", named=["preload"])
    (said,) = [s.say(PLAIN) for s in answer(tied) if isinstance(s, Calibrated)]
    assert "Those with the verdict and the name given here (1) were made by gap (1)." in said
    nameless = replace(tied, verdict="unexplained", unexplained_by="structure", named=[])
    assert "Those with" not in next(s for s in answer(nameless) if isinstance(s, Calibrated)).say(PLAIN)
    sure = replace(
        record, verdict="explained", alternatives=[], calibration=summed([trial("gap", "explained", "x")] * 8)
    )
    assert kind(sure) == "warn" and kind(replace(sure, calibration=None)) == "good"
    assert kind(replace(sure, unexplained_by="law")) == "bad", "a broken law is worse than a name that is too sure"
    left = replace(record, verdict="unexplained", unexplained_by="structure")
    (said,) = [s.say(PLAIN) for s in answer(left) if isinstance(s, Calibrated)]
    whose = "drawn from the best models of the catalogue, none of which explains these readings"
    assert said.startswith(f"Of 6 data sets {whose}, and diagnosed again, the set")
    assert whose.replace("drawn ", "") in " ".join(build(left, e, tmp_path / "left").text.split())
    page = build(record, e, tmp_path)
    assert "How often is such a verdict right here?" in page.first_screen and "Calibration" in page.headings
    assert "gap at rest 3 1 2" in page.text
    plain = build(make_record(e), e, tmp_path / "without")
    assert ['href="#calibration"' in one.html for one in (page, plain)] == [True, False]
    write_json(tmp_path / RESULT, record, sealed=True)
    assert read_json(tmp_path / RESULT, Diagnosis, sealed=True).calibration == record.calibration
