"""`psafit diagnose`, and what it prints."""

from __future__ import annotations

import json
import re
import shlex
from dataclasses import replace
from pathlib import Path

import pytest
from commands import run
from diagnoses_by_hand import make_experiment, make_record, parameters
from sensors import SENSOR

import psafit.diagnose
from psafit import plugins
from psafit.cli.common import shown_path
from psafit.cli.diagnosing import say_diagnosis
from psafit.cli.terminal_words import TerminalWords
from psafit.diagnose.answer import sentences
from psafit.errors import InputError
from psafit.parameters import Belief, LogNormal


def test_a_diagnosis_without_its_page_was_interrupted(known_folder, tmp_path, monkeypatch):  # type: ignore[no-untyped-def]
    """Chains are drawn on by the command after a finished one, and it is finished when its page is there."""
    reported = []

    def examine(*args, draw_on, **options):  # type: ignore[no-untyped-def]
        reported.append(draw_on)
        raise InputError("asked", "enough")

    monkeypatch.setattr(psafit.diagnose, "diagnose", examine)
    out = tmp_path / "found"
    for options in ([], ["--no-report"]):
        assert run(monkeypatch, "diagnose", known_folder, "--out", out, *options) == 2
    out.mkdir(exist_ok=True)
    (out / "diagnosis.html").touch()
    assert run(monkeypatch, "diagnose", known_folder, "--out", out) == 2
    assert reported == [False, True, True]


@pytest.mark.parametrize(
    ("options", "proposed", "unseen", "printed"),
    [
        ([], True, False, ["report: ", "what to measure next, as a folder: "]),
        (["--no-report"], True, False, ["what to measure next, as a folder: "]),
        ([], False, False, ["report: "]),
        ([], False, True, ["report: ", "what would show causes that could not have been seen: "]),
        (["--quiet"], True, True, []),
    ],
)
def test_the_last_lines_say_where_to_go_on(
    known_folder, tmp_path, monkeypatch, capsys, options, proposed, unseen, printed
):  # type: ignore[no-untyped-def]
    from psafit.report import diagnosis as pages

    record, out = make_record(make_experiment()), tmp_path / "an answer"
    if not proposed:
        record = replace(record, next_experiment=replace(record.next_experiment, proposals=[]))
    word = "could not have been seen" if unseen else "not present"
    record = replace(record, screening=[replace(s, verdict=word) for s in record.screening])
    monkeypatch.setattr(psafit.diagnose, "diagnose", lambda *args, **options: record)
    monkeypatch.setattr(pages, "write_diagnosis", lambda *args: out / "diagnosis.html")
    monkeypatch.chdir(tmp_path)
    own = tmp_path / "a cause.py"
    own.write_text(SENSOR)
    monkeypatch.setattr(plugins, "files", lambda: (own,))
    assert run(monkeypatch, "diagnose", known_folder, "--out", out, *options) == 0
    heads = (
        "report: ", "what to measure next, as a folder: ", "what would show causes that could not have been seen: "
    )  # fmt: skip
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith(heads)]
    assert [next(head for head in heads if line.startswith(head)) for line in lines] == printed
    if heads[1] in printed:
        words = ["psafit", "plan", "an answer", "--out", "known-next", "--plugin", "a cause.py"]
        assert shlex.split(lines[-1].removeprefix(heads[1])) == words
    if heads[2] in printed:
        words = ["psafit", "plan", shown_path(known_folder), "--isolability", "--plugin", "a cause.py"]
        assert shlex.split(lines[-1].removeprefix(heads[2])) == words


@pytest.mark.slow
def test_diagnose(known_folder: Path, tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    out = tmp_path / "found"
    for bad, words in (
        (["--group", "9"], "9"),
        (["--group", "1,1"], "not a list of different group ids"),
        (["--group", "1", "--json", out / "diagnosis.json"], "file of the run itself"),
    ):
        assert run(monkeypatch, "diagnose", known_folder, *bad, "--out", out) == 2
        reported = capsys.readouterr()
        assert words in reported.err
        assert reported.err.count("\n") == 1
        assert not out.exists()
    copy = tmp_path / "copy.json"
    words = ["diagnose", known_folder, "--group", "1", "--quick", "--causes", "preload,reading_gain", "--out", out]
    assert run(monkeypatch, *words, "--json", copy) == 0
    reported = capsys.readouterr().out
    assert "verdict: adequate" in reported
    own = json.loads((out / "diagnosis.json").read_text())
    assert own.pop("sha256") and json.loads(copy.read_text()) == own
    assert (out / "diagnosis.html").exists()
    # Once more: the fits are kept.
    assert run(monkeypatch, *words, "--quiet") == 0
    assert capsys.readouterr().out == ""


def test_the_terminal_lists_models_by_their_probability(capsys):
    """What is named first, the rest by their shares; the whole rig of the one, of rivals the causes."""
    record = make_record(make_experiment())
    named, other, nothing = record.causes
    rival = replace(other, terms=["gap"], probability=0.02, parameters=parameters("k_c", "hysteresis_strength"))
    causes = [replace(named, probability=0.1), nothing, rival]
    say_diagnosis(replace(record, alternatives=[["gap"]], causes=causes, unnamed=0.3))
    lines = capsys.readouterr().out.splitlines()
    searched = "164 sets of causes were fitted on all readings, 13 of them sampled"
    assert sum(line.startswith(f"  {searched}; the others have 0.4 % of the probability") for line in lines) == 1
    shares = [line.split(" %  ")[0].strip() for line in lines if " %  " in line]
    assert shares == ["10.0", "30.0", "2.0", "<0.1"]
    sizes = [line for line in lines if "Without launches" not in line]
    assert sum("k_c = " in line for line in sizes) == 1 and sum("hysteresis_strength = " in line for line in sizes) == 1


def test_what_a_parameter_is_stands_behind_the_first_of_its_values(capsys: pytest.CaptureFixture[str]) -> None:
    record = make_record(make_experiment())
    named, other, nothing = record.causes
    rival = replace(other, terms=["gap", "hysteresis"], parameters=parameters("hysteresis_strength"))
    say_diagnosis(replace(record, alternatives=[["gap", "hysteresis"]], causes=[named, rival, nothing]))
    out = capsys.readouterr().out
    assert out.count("hysteresis_strength = 4.10e5 (90 %: 3.80e5 to 4.40e5)") == 2
    assert out.count("(90 %: 3.80e5 to 4.40e5): what hysteresis_strength means") == 1
    assert "what hysteresis_voltage means; implausible under its prior (10000 to 2e+05 V expected)\n" in out


def test_what_had_to_do_is_compared_among_models_of_the_catalogue(capsys: pytest.CaptureFixture[str]) -> None:
    """A discrepancy is none of them, however little of the probability it takes."""
    record = replace(make_record(make_experiment()), verdict="unexplained", named=[], alternatives=[], unnamed=0.09)
    say_diagnosis(record)
    _, rows = capsys.readouterr().out.split("  if the truth were in the catalogue:\n")
    shares = [float(row.split("%")[0].strip(" <>")) for row in rows.splitlines() if " %  " in row]
    assert "a discrepancy without a name" not in rows
    assert shares[0] == pytest.approx(100 * record.causes[0].evidence.share, abs=0.06)


def test_the_terminal_answers_first(capsys: pytest.CaptureFixture[str]) -> None:
    """Then come the models, what is not resolved, and what else the readings say."""
    record = make_record(make_experiment())
    say_diagnosis(replace(record, numerics=replace(record.numerics, converged=False)))
    text = capsys.readouterr().out
    order = (
        "verdict: ",
        "The tests find",
        "log likelihood",
        "has not converged",
        "what these readings say besides:\n",
        "Furthest",
    )
    places = [text.index(part) for part in order]
    assert places == sorted(places)


def in_one_line(text: str) -> str:
    """A text without what lists its parts: `; or`, full stops, or a line each."""
    return re.sub(r"(?:; or|[-.;\s])+", " ", text)


def test_sets_that_exclude_each_other_have_a_line_each(capsys: pytest.CaptureFixture[str]) -> None:
    record = make_record(make_experiment())
    own, *others = record.causes
    tied = [replace(c, probability=0.4) for c in others if c.terms][:1]
    found = replace(
        record, verdict="ambiguous", causes=[replace(own, probability=0.5), *tied], alternatives=[c.terms for c in tied]
    )
    say_diagnosis(found)
    lines = capsys.readouterr().out.splitlines()
    (k,) = (k for k, line in enumerate(lines) if line.startswith("  These readings cannot decide between 2 sets"))
    assert [line[:6] for line in lines[k + 1 : k + 3]] == ["    - "] * 2 and lines[k].endswith(":")
    assert lines[k + 1].startswith(f"    - {' + '.join(own.terms)} (probability 50 %)")
    assert all(line and line == line.rstrip() for line in lines[k : k + 4])


def test_a_command_in_the_terminal_can_be_typed_as_it_stands(capsys: pytest.CaptureFixture[str]) -> None:
    belief = Belief("swing_drag_rate", LogNormal(1.0, 2.0), "sailcloth", probability=0.9)
    say_diagnosis(make_record(make_experiment()), [belief], Path("my rig"))
    assert "psafit fit 'my rig' --group" in capsys.readouterr().out
    assert TerminalWords("my-rig", "--plugin own.py").fit_command([1, 2], ["gap"]) == (
        "psafit fit my-rig --group 1,2 --terms gap --plugin own.py"
    )


def test_record_and_terminal_say_the_same(capsys: pytest.CaptureFixture[str]) -> None:
    """What the experiment believes of causes that the readings do not show is in both."""
    record = make_record(make_experiment())
    belief = Belief("swing_drag_rate", LogNormal(1.0, 2.0), "sailcloth", probability=0.9)
    said = sentences(record, [belief])
    say_diagnosis(record, [belief])
    printed = capsys.readouterr().out
    assert any("swing_drag (90 % by [prior]" in text for text in said)
    (left,) = (text for text in said if in_one_line(text) not in in_one_line(printed))
    assert left.startswith("Size, with 90 % interval")  # the terminal has a table of them
