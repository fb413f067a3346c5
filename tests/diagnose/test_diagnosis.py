"""The diagnosis from beginning to end."""

from __future__ import annotations

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
from clusters import two_workers
from rigs import RIG
from truths import CHEAP, FEW, experiment, few, problem

from psafit.diagnose import diagnose, diagnosis
from psafit.diagnose.answer import sentences
from psafit.diagnose.folder import claim
from psafit.diagnose.next_experiment import NextExperiment
from psafit.diagnose.record import Confusion, Diagnosis
from psafit.diagnose.settings import Settings as Effort
from psafit.diagnose.significance import lead
from psafit.errors import InputError
from psafit.experiment import fingerprint
from psafit.forecast import Silent
from psafit.inference.memory import Memory
from psafit.inference.problem import Problem
from psafit.inference.run import fit as run_fit
from psafit.inference.run_folder import load
from psafit.inference.samplers.emcee import Settings
from psafit.model_search import SearchSettings, search_models
from psafit.parameters import Belief, Normal
from psafit.physics import TERMS
from psafit.records import read_json

LITTLE = replace(Effort.usual(quick=True), search=CHEAP)


@pytest.mark.slow
def test_no_protocol_sees_what_it_scores(tmp_path):
    """Readings of a group change nothing of what any protocol predicts for it, the search of all groups or no."""
    e = experiment(["amplifier_lag"], [4e-5], groups=("a", "b"), n=8)
    a, b = e.groups
    groups = (a, replace(b, reading=3 * b.reading))
    reported = []
    for name, data in (("as read", e), ("changed", replace(e, groups=groups, fingerprint=fingerprint(RIG, groups)))):
        folder = tmp_path / name
        folder.mkdir()
        effort = Effort(search=CHEAP, draws=8000)  # of 400 limits differ by 5 % by chance
        work = diagnosis.Work(data, ("a",), folder, 1, FEW[:1], 1, Silent(), (), settings=effort)
        measured = work.gains_of(work.search(data.ids))
        for scored in measured.values():
            assert all(not set(entry.saw) & set(entry.scored_on) for entry in scored.ledger)
        for protocol in ("strict", "nested"):
            with (folder / f"predictions-{protocol}.csv").open() as f:
                rows = [row for row in csv.DictReader(f) if row["group"] == "b"]
            assert len(rows) == 2 * 8
            reported.append([[float(row[k]) for k in ("predicted_um", "lower_um", "upper_um")] for row in rows])
    assert reported[0] == reported[2]
    # The searches of the nested protocol begin where all groups have led to, which is another draw of the same.
    assert np.array(reported[1]) == pytest.approx(np.array(reported[3]), rel=0.03, abs=0.05)


@pytest.mark.slow
def test_what_an_adequate_baseline_does_not_exclude_is_distinguished(tmp_path):
    """Else the parameter of which the readings say least is what to measure next."""
    # By the usual seed two readings at one frequency stand out together, at the tests' level: a false alarm.
    found = diagnose(experiment(seed=2), ["a"], tmp_path, quick=True, catalogue=FEW, settings=LITTLE)
    assert found.verdict == "adequate" and found.next_experiment.proposals
    open_ = [c for c in found.causes if c.terms and c.probability >= 0.05]
    assert found.next_experiment.separates == bool(open_)
    assert found.next_experiment.about.startswith("separates the baseline from" if open_ else "determines ")
    assert found.confusion == Confusion()


def test_the_order_in_which_groups_are_named_does_not_matter(tmp_path, monkeypatch):
    e = experiment(n=8)
    asked = {"quick": True, "catalogue": FEW[:1], "settings": LITTLE}
    first = diagnose(e, ["c", "a"], tmp_path, **asked)
    assert first.training == ["a", "c"]
    monkeypatch.delattr(diagnosis.Work, "all")
    assert diagnose(e, ["a", "c"], tmp_path, **asked).identity == first.identity


def test_a_diagnosis_that_makes_no_sense_is_refused(tmp_path):
    for e, groups, seed, said in (
        (few([0.0] * 5), ["a"], 1, "every launch range is zero"),
        (few([50.0] * 5), ["a", "a"], 1, "named twice"),
        (few([50.0] * 5), ["a"], -1, "seed -1"),
    ):
        with pytest.raises(InputError, match=said):
            diagnose(e, groups, tmp_path / "out", quick=True, seed=seed, catalogue=FEW)
    assert not (tmp_path / "out").exists()
    with pytest.raises(InputError, match="named twice"):
        Problem(few([50.0]), ("a", "a"))


def test_without_a_drive_nothing_is_proposed(tmp_path):
    found = diagnose(few([5.0, 0.0, 4.0, 0.0, 6.0], amplitude=0.0), ["a"], tmp_path, quick=True, catalogue=FEW[:1])
    assert found.next_experiment == NextExperiment()


@pytest.mark.parametrize(
    ("groups", "causes", "searches", "steps", "jobs"),
    [
        pytest.param(("a", "b"), FEW[:1], 0, 0, 1, id="small, without a chain"),
        pytest.param(("a", "b"), FEW[:2], 1, 60, 2, id="whole", marks=pytest.mark.slow),
    ],
)
def test_diagnosis_from_beginning_to_end(groups, causes, searches, steps, jobs, tmp_path, monkeypatch):
    e = experiment(["amplifier_lag"], [4e-5], n=4 * len(groups), groups=groups)
    effort = Effort(simulated=99, searches=searches, steps=steps, search=CHEAP)
    asked = {"seed": 1, "catalogue": causes, "settings": effort}
    result = diagnose(e, ["a"], tmp_path / "one", jobs=jobs, **asked)
    stored = json.loads((tmp_path / "one" / "diagnosis.json").read_text())
    assert stored["schema"] == 1
    assert stored["verdict"] in ("explained", "ambiguous")
    assert stored["named"] == ["amplifier_lag"]
    assert set(stored["misfit"]) >= {"p_value", "where"}
    for place in stored["misfit"]["where"]:
        assert set(place) >= {"group", "variable", "from", "to", "text"}
    assert stored["causes"][0]["terms"] == ["amplifier_lag"]
    assert 0 < stored["causes"][0]["probability"] <= 1
    # Without searches of its own it would look into the table, which is of the whole catalogue.
    assert stored["misfit"]["search"]["missing"] == ("" if searches else "catalogue")
    assert stored["misfit"]["search"]["stored"] == (not searches)
    assert set(stored["looked_at"]) == {"fitted", "estimated", "mass_not_looked_at", "neighbours"}
    if searches:
        plain = search_models(Problem(e, e.ids), causes, seed=1, settings=CHEAP)
        assert stored["misfit"]["search"]["lead"] == pytest.approx(lead(plain), abs=1e-9)
        assert stored["misfit"]["search"]["lead"] > max(stored["misfit"]["search"]["null"])
        assert stored["misfit"]["search"]["p_value"] == pytest.approx(1 / (1 + searches))
    tau = stored["causes"][0]["parameters"]["amplifier_lag_tau"]
    assert tau["lower"] < 4e-5 < tau["upper"]
    for protocol, seen in (("strict", {"a"}), ("nested", {*groups} - {"a"})):
        gain = stored["gain"][protocol]
        assert (tmp_path / "one" / gain["predictions"]).exists()
        assert gain["log_rmse_after"] < gain["log_rmse_before"]
        assert seen <= {g for entry in gain["ledger"] for g in entry["saw"]}
    assert (tmp_path / "one" / stored["predictions"]).exists()
    # What the training group names by itself is a run like any other.
    named = {"adopted": stored["named"], "strict": stored["gain"]["strict"]["groups"][0]["named"]}
    seen = {"adopted": list(groups), "strict": ["a"]}
    assert set(stored["extension"]) == {which for which, ids in named.items() if ids and steps}
    for which, reported in stored["extension"].items():
        extension = load(tmp_path / "one" / reported["folder"])
        assert extension.fit.terms == reported["terms"] == named[which]
        # Begun where the search has found these causes, and not left below that.
        place = extension.problem.to_sampling(np.array([list(extension.fit.known[0].values())]))
        assert list(extension.fit.known[0]) == list(extension.problem.names)
        assert extension.fit.minima[0].log_posterior > extension.problem.log_posterior(place)[0] - 0.01
        assert extension.fit.groups == reported["groups"] == seen[which]
        assert reported["scored_on"] == [g for g in e.ids if g not in seen[which]]
        assert reported["converged"] == extension.summary.converged
    # Again from what is kept, and once more from nothing: the same.
    again = diagnose(e, ["a"], tmp_path / "one", draw_on=False, **asked)
    asked["quick"] = True
    quick = diagnose(e, ["a"], tmp_path / "two", **asked)
    assert again.causes == result.causes
    assert quick.causes == result.causes
    assert quick.gain == {} and quick.extension == {} and quick.misfit.search == result.misfit.search
    # A whole answer is read back; what has lost a part is worked out.
    with monkeypatch.context() as m:
        m.delattr(diagnosis.Work, "all")
        assert diagnose(e, ["a"], tmp_path / "two", **asked).causes == result.causes
        for change in ({"seed": 2}, {"catalogue": FEW[1:2]}, {"quick": False}, {"settings": None}):
            with pytest.raises(AttributeError):
                diagnose(e, ["a"], tmp_path / "two", **asked | change)
        (tmp_path / "two" / quick.predictions).unlink()
        with pytest.raises(AttributeError):
            diagnose(e, ["a"], tmp_path / "two", **asked)


def test_what_the_rig_is_held_to_have_is_asked_of_all_groups_alone(monkeypatch):
    """The values of the answer rest on these; nothing else reads it."""
    short = Belief("amplifier_lag_tau", Normal(0.0, 3e-7), "data sheet", probability=0.95)
    rare = Belief("gap_width", Normal(0.0, 3e-7), "seen", probability=0.2)
    data, asked = replace(experiment(n=8), beliefs=(short, rare)), []
    monkeypatch.setattr(diagnosis, "searched", lambda *args, **options: asked.append(options["held"]))
    for groups in (data.ids, data.ids[:2]):
        diagnosis._model_set_of(Memory(None), data, TERMS, 1, SearchSettings(), groups)
    assert asked == [["amplifier_lag"], []]


def test_only_the_causes_asked_for_are_looked_at(tmp_path):
    """The record, its headline and its sentence say so; without a restriction they say nothing.

    The record also has the sentence that rests on what the experiment believes, as the terminal and the page do.
    """
    short = Belief("amplifier_lag_tau", Normal(0.0, 3e-7), "data sheet", probability=0.95)
    data = replace(experiment(n=8), beliefs=(short,))
    asked = {"quick": True, "catalogue": FEW[:2], "settings": replace(LITTLE, simulated=49)}
    found = diagnose(data, ["a"], tmp_path, **asked)
    assert any("amplifier_lag (95 % by [prior]" in text for text in found.sentences)
    assert found.sentences == sentences(found, data.beliefs)
    assert [s.id for s in found.screening] and {s.id for s in found.screening} == {t.id for t in FEW[:2]}
    assert found.left_out == [t.id for t in TERMS if t not in FEW[:2]]
    assert found.headline.endswith("(of 2 causes looked at)")
    assert found.sentences[0].startswith("Only ") and f"{len(TERMS) - 2} other causes" in found.sentences[0]
    whole = replace(found, left_out=[])
    assert not sentences(whole)[0].startswith("Only ") and "looked at" not in whole.headline
    again = diagnose(data, ["a"], tmp_path, **asked)
    assert again == found  # read back
    diagnose(data, ["a"], tmp_path, seed=2, **asked)
    assert read_json(tmp_path / "previous" / "diagnosis.json", Diagnosis, sealed=True) == found


@pytest.mark.slow
def test_diagnosis_of_one_group_with_the_whole_catalogue(tmp_path):
    e = experiment(groups=("only",))
    result = diagnose(e, ["only"], tmp_path, seed=1, quick=True, settings=LITTLE)
    assert result.verdict == "adequate"
    assert len(result.screening) == len(TERMS)


def test_another_rigs_diagnosis_is_not_replaced(tmp_path):
    """Two folders called rig have one usual place for their results."""
    (tmp_path / "diagnosis.json").write_text('{"fingerprint": "of other readings"}')
    with pytest.raises(InputError, match="of other readings"):
        diagnose(experiment(), ["a"], tmp_path, quick=True)
    assert [p.name for p in tmp_path.iterdir() if p.suffix == ".json"] == ["diagnosis.json"]


@pytest.mark.slow
def test_a_late_kill_does_not_draw_an_extension_on(tmp_path, monkeypatch):
    """A chain that did not converge is drawn on by the command after a finished one, not by one that resumes."""
    asked = {"catalogue": FEW[:1], "settings": Effort(simulated=99, steps=60, search=CHEAP)}
    e = experiment(["amplifier_lag"], [4e-5], n=12, groups=("a",))

    def interrupted(*words):
        raise KeyboardInterrupt

    def again(**options):
        return diagnose(e, ["a"], tmp_path, **asked, **options).extension["adopted"]

    first = again()
    assert not first.converged and "after 60 steps" in first.message
    with monkeypatch.context() as m:  # the command that draws on is broken off: what there was stays
        m.setattr(diagnosis.Work, "extend", interrupted)
        with pytest.raises(KeyboardInterrupt):
            again()
    assert (tmp_path / "diagnosis.json").exists()
    (tmp_path / "diagnosis.json").unlink()  # killed after the extension, before the end
    assert again() == first
    assert again(draw_on=False) == first
    assert again().message != first.message


@pytest.mark.slow
def test_a_diagnosis_lies_next_to_the_fit_of_the_same_readings(tmp_path):
    e = experiment(n=8)
    settings = replace(Settings.of(problem(e)), max_steps=60, chunk=20, tuned=15)
    fitted = run_fit(e, ["a"], tmp_path, n_starts=4, settings=settings)
    with pytest.raises(InputError, match="already holds other files"):
        diagnose(experiment(n=8, seed=9), ["a"], tmp_path, quick=True, catalogue=FEW)
    asked = {"quick": True, "catalogue": FEW, "settings": LITTLE}
    found = diagnose(e, ["a"], tmp_path, **asked)
    assert found.fingerprint == fitted.fit.fingerprint
    assert load(tmp_path).summary == fitted.summary
    assert diagnose(e, ["a"], tmp_path, **asked) == found


def test_nothing_that_is_not_a_diagnosis_s_own_is_replaced(tmp_path):
    """Measurements of another rig, a fit, somebody's own notes: reported before any work."""
    one, other = experiment(seed=1), experiment(seed=2)
    for name in ("experiment/experiment.toml", "fit.json", "diagnosis.json"):
        folder = tmp_path / name.replace("/", "-")
        (folder / name).parent.mkdir(parents=True)
        (folder / name).write_text('{"my": "own"}')
        with pytest.raises(InputError, match="already holds other files"):
            diagnose(one, ["a"], folder, quick=True)
        assert [(p, p.read_text()) for p in folder.rglob("*") if p.is_file()] == [(folder / name, '{"my": "own"}')]
    # An interrupted one is known by its mark, and goes on for the same readings alone.
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / ".diagnosis.json.1.tmp").write_text("what a killed process left")
    claim(mine, one)
    (mine / "steps").mkdir()
    claim(mine, one)
    with pytest.raises(InputError, match="of other readings"):
        claim(mine, other)
    (mine / "diagnosis.html").mkdir()
    with pytest.raises(InputError, match="is a folder, where a file of the diagnosis goes"):
        claim(mine, one)


@pytest.mark.slow
def test_a_cluster_diagnoses_as_one_process_does(tmp_path):
    """The search, those without a group, and those where nothing is hidden."""
    e = experiment(["amplifier_lag"], [4e-5], n=8, groups=("a", "b"))
    asked = {"catalogue": FEW[:2], "settings": Effort(simulated=49, searches=1, steps=0, search=CHEAP)}
    alone = diagnose(e, ["a"], tmp_path / "alone", jobs=1, **asked)
    with two_workers() as cluster:
        found = diagnose(e, ["a"], tmp_path / "cluster", scheduler=cluster.scheduler_address, **asked)
    assert found.identity == alone.identity and found.causes == alone.causes and found.gain == alone.gain
    assert found.misfit.search == alone.misfit.search and len(found.misfit.search.null) == 1
    steps = [{p.name for p in (tmp_path / name / "steps").iterdir()} for name in ("alone", "cluster")]
    assert steps[0] <= steps[1]  # what was worked ahead for nothing is there, too
