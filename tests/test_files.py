"""Names of folders and commands."""

from __future__ import annotations

from pathlib import Path

from psafit.files import portable_command, usual_fit_folder


def test_no_two_choices_of_groups_share_a_folder() -> None:
    choices = ([1, 2], ["1-2"], ["1-", 2], ["1--2"], ["a-b", "c"], ["a", "b-c"], ["a", "b", "c"], ["a-b-c"])
    names = [usual_fit_folder(Path("rig"), ids, []).name for ids in choices]
    assert len(set(names)) == len(choices) and names[0] == "rig-group1-2" and names[1] == "rig-group1--2"


def test_paths_are_cut():
    assert portable_command(["psafit", "fit", "/a/b/psa", "--out=/x/y"]) == "psafit fit psa --out=y"
    assert portable_command(["psafit", "fit", r"C:\Users\me\psa"]) == "psafit fit psa"
    assert portable_command(["fit", "~/psa", Path("experiments/psa"), "a b"]) == "fit psa experiments/psa 'a b'"
