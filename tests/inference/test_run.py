"""Runs: what they keep, go on with, and refuse."""

from __future__ import annotations

import errno
import json
import math
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from rigs import TRUTH, rig

from psafit.errors import InputError
from psafit.experiment import Experiment, fingerprint
from psafit.files import sha256
from psafit.inference import identify
from psafit.inference import run as running
from psafit.inference.candidate import candidate_at
from psafit.inference.optimiser import Effort
from psafit.inference.polish import polish
from psafit.inference.problem import Problem
from psafit.inference.run import fit
from psafit.inference.run_folder import Run, load
from psafit.inference.sample import sample
from psafit.inference.samplers import emcee as ensembles
from psafit.inference.samplers.emcee import Settings
from psafit.inference.summary import held_apart
from psafit.numerics import audit
from psafit.parameters import Belief, LogNormal
from psafit.physics import terms
from psafit.records import Fit, read_json, write_json

SHORT = Settings(chunk=40, max_steps=80, tuned=30)

QUICK = Settings(r_hat=1.03, max_steps=6000)


def test_groups_held_out_have_no_part_in_a_fit(known: Experiment, tmp_path: Path) -> None:
    """Search, draws and what is called determined are the same, whatever the other groups read."""
    others = (replace(g, reading=3 * g.reading) for g in known.groups[1:])
    changed = replace(known, groups=(known.groups[0], *others))
    one, two = (
        running.fit(data, [1], tmp_path / name, seed=1, n_starts=3, sampled_by="importance")
        for name, data in (("as-read", known), ("changed", changed))
    )
    assert one.fit.minima == two.fit.minima and one.fit.lmfit_report == two.fit.lmfit_report
    assert (one.draws.values == two.draws.values).all()
    assert one.summary.parameters == two.summary.parameters


def test_a_fit_of_causes_begins_where_smaller_models_lead(
    known: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Unless places are known."""

    class Begun(Exception):
        pass

    def begun(problem: Problem, known: list[Any], **options: object) -> None:
        raise Begun([len(c.modes) for c in known])

    chosen = terms(["gap", "preload", "swing_drag"])
    problem = Problem(known, (1,), chosen)
    modes = problem.prior_transform(np.full((2, 9), 0.5)) + np.array([[0.0], [0.3]])
    built = candidate_at(problem, np.clip(modes, *problem.bounds.T))
    monkeypatch.setattr(running, "sample", begun)
    monkeypatch.setattr(running, "built_up", lambda problem, **options: built)
    for n, expected in ((0, r"\[\]"), (3, rf"\[{len(built.modes)}\]")):
        with pytest.raises(Begun, match=expected):
            running.fit(known, [1], tmp_path / str(n), terms=chosen[:n], n_starts=2, settings=SHORT)
    place = dict(zip(problem.names, problem.to_physical(modes[:1])[0].tolist(), strict=True))
    with pytest.raises(Begun, match=r"\[1\]"):
        running.fit(known, [1], tmp_path / "k", terms=chosen, n_starts=2, settings=SHORT, known=[place])


@pytest.mark.slow
def test_a_run_is_described_by_the_places_it_was_given(known: Experiment, tmp_path: Path) -> None:
    names = Problem(known, (1,)).names
    place = dict(zip(names, [*TRUTH, 0.05, 0.05, 6.0], strict=True))
    fitted = running.fit(known, [1], tmp_path / "r", n_starts=2, known=[place], settings=SHORT)
    assert fitted.fit.known == [place] and load(fitted.folder).fit.known == [place]
    place["k_c"] = int(place["k_c"])  # a whole number is no other place
    assert running.fit(known, [1], fitted.folder, n_starts=2, known=[place], settings=SHORT).fit.known == [place]
    for wrong, words in (({"k_d": 1.0}, "k_d"), ({"k_c": np.nan}, "k_c = nan"), ({"c_s": -1.0}, "c_s = -1")):
        with pytest.raises(InputError, match=words):
            running.fit(known, [1], tmp_path / "w", n_starts=2, known=[place | wrong], settings=SHORT)
    assert not (tmp_path / "w").exists()
    for other in ([], [place | {"k_c": 2e6}]):
        with pytest.raises(InputError, match="what differs: known places"):
            running.fit(known, [1], fitted.folder, n_starts=2, known=other, settings=SHORT)


def test_posterior_covers_the_truth(finished: Run) -> None:
    assert finished.summary.converged, finished.summary.message
    for p, true in zip(finished.summary.parameters, [*TRUTH, 0.05], strict=False):
        spread = np.log(p.upper / p.lower) / 3.29
        assert abs(np.log(p.median / true)) < 4.5 * spread, p.text  # 4.5 sd: fails by chance once in 100,000
        assert p.r_hat < 1.05 and p.ess_bulk > 500
    assert finished.summary.autocorrelation_times >= 50


def test_a_chain_between_several_places_says_so() -> None:
    r_hat, names = np.array([1.001, 1.03]), ["k_c", "c_c"]
    said = held_apart(names, [-10.0, -12.0, -14.9, -30.0], r_hat, 1.01)
    assert "c_c mixes least" in said and "in 3 places" in said
    assert held_apart(names, [-10.0, -16.0], r_hat, 1.01) == ""
    assert held_apart(names, [-10.0, -12.0], r_hat - 0.03, 1.01) == ""


@pytest.mark.slow
def test_a_run_says_what_each_session_has(known: Experiment, tmp_path: Path) -> None:
    """As it was read with a factor of 0.8 in one session; and the record holds it."""
    first, *others = known.groups
    groups = (replace(first, reading=0.8 * first.reading), *others)
    dull = replace(known, groups=groups, fingerprint=fingerprint(known.constants, groups))
    run = fit(dull, known.ids, tmp_path / "r", terms=terms(["reading_gain"]), sampled_by="importance")
    gains = {s.group: s for s in load(run.folder).summary.sessions or []}
    assert gains == {s.group: s for s in run.summary.sessions or []} and [*gains] == [*known.ids]
    ratio = gains[first.id].median / np.mean([gains[g.id].median for g in others])
    assert ratio == pytest.approx(0.8, rel=0.08) and gains[first.id].upper < gains[others[0].id].lower
    spread = next(p for p in run.summary.parameters if p.name == "reading_gain_spread")
    assert spread.profile == [] and spread.verdict != "bounded below"
    flagged = {p.name for p in run.summary.parameters if p.implausible}
    assert not any(name.startswith("reading_gain_z") for name in flagged)


@pytest.mark.slow
def test_repeating_an_unconverged_run_draws_on(
    known: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(identify, "profiles", lambda problem, *a: [[]] * problem.n_physical)  # slow, and not the point
    first = running.fit(known, [1], tmp_path / "a", seed=2, n_starts=3, settings=SHORT)
    assert not first.summary.converged and "repeat the command to draw on" in first.summary.message
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(identify, "profiles", lambda *a, **k: (_ for _ in ()).throw(KeyboardInterrupt))
        running.fit(known, [1], tmp_path / "a", seed=2, n_starts=3, settings=SHORT)
    more = running.fit(known, [1], tmp_path / "a", seed=2, n_starts=3, settings=SHORT)
    at_once = running.fit(
        known, [1], tmp_path / "b", seed=2, n_starts=3, settings=replace(SHORT, max_steps=2 * SHORT.max_steps)
    )
    assert (first.summary.n_steps, more.summary.n_steps) == (SHORT.max_steps, 2 * SHORT.max_steps)
    assert more.fit == at_once.fit and np.array_equal(more.draws.values, at_once.draws.values)


@pytest.mark.slow
def test_a_minimum_that_the_search_missed_is_added(
    known: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = Problem(known, (1,))
    true = sample(problem, seed=1)[0]
    wrong = true.modes[0].copy()
    wrong[:3] += [1.5, -1.0, 1.0]
    poor = candidate_at(problem, wrong[None], np.array([3]), Effort(6, 0, 10))
    assert poor.log_posterior < true.log_posterior - 10
    monkeypatch.setattr(running, "sample", lambda *a, **k: (poor, None))

    def stuck(problem: Problem, start: np.ndarray) -> Any:
        """Lmfit, which does not get away from where the search has ended."""
        top, log_posterior, result = polish(problem, start)
        return (start, poor.log_posterior, result) if (start == wrong).all() else (top, log_posterior, result)

    monkeypatch.setattr(running, "polish", stuck)
    monkeypatch.setattr(identify, "profiles", lambda problem, *a: [[]] * problem.n_physical)
    arguments: dict[str, Any] = {"seed": 2, "n_starts": 3, "settings": replace(SHORT, max_steps=400)}
    run = running.fit(known, [1], tmp_path / "a", **arguments)
    best = run.fit.minima[0]
    assert run.fit.n_missed >= 1 and best.starts == 0 and run.fit.n_followed == 6
    assert best.log_posterior > true.log_posterior - 1 and run.draws.log_posterior.max() <= best.log_posterior + 1
    assert read_json(tmp_path / "a" / "fit.json", Fit, sealed=True) == run.fit
    # Killed where it hurts most, between the chain and the record, it comes to the same.
    written = running.write_json

    def killed(path: Path, record: Any, **options: Any) -> None:
        if isinstance(record, Fit) and record.n_missed:
            raise KeyboardInterrupt
        written(path, record, **options)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(running, "write_json", killed)
        running.fit(known, [1], tmp_path / "b", **arguments)
    again = running.fit(known, [1], tmp_path / "b", **arguments)
    assert again.fit == run.fit and np.array_equal(again.draws.values, run.draws.values)


def test_many_readings_are_stored_thinned(known: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(identify, "profiles", lambda problem, *a: [[]] * problem.n_physical)
    few = {"chunk": 40, "max_steps": 80, "tuned": 30, "stored": 30 * 64 * 4, "thin": 2.0}
    run = running.fit(known, [1], tmp_path / "a", seed=2, n_starts=3, settings=few)
    slowest = min(p.autocorrelation_time for p in run.summary.parameters)
    assert run.summary.thinning == int(2 * slowest) and run.draws.values.shape[1] == math.ceil(50 / int(2 * slowest))
    with h5py.File(tmp_path / "a" / "posterior.nc") as f:
        stored = f["log_likelihood/launch_range_um"]
        assert stored.dtype == np.float32 and stored.shape[0] == 64 and stored.size <= 30 * 64 * 4
        u = run.problem.to_sampling(run.draws.values[:, 0])
        assert stored[:, 0] == pytest.approx(run.problem.pointwise_log_likelihood(u), rel=1e-5)


def test_a_run_killed_between_stages_goes_on(
    known: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = {"seed": 2, "n_starts": 3, "settings": SHORT}
    whole = running.fit(known, [1], tmp_path / "whole", **arguments)
    # The profile never closes the run: as if killed there.
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(identify, "profiles", lambda *a, **k: (_ for _ in ()).throw(KeyboardInterrupt))
        running.fit(known, [1], tmp_path / "cut", **arguments)
    with pytest.raises(InputError, match="interrupted run"):
        load(tmp_path / "cut")
    resumed = running.fit(known, [1], tmp_path / "cut", **arguments)
    assert np.array_equal(resumed.draws.values, whole.draws.values)
    assert resumed.summary == whole.summary
    assert not whole.summary.converged and "autocorrelation times" in whole.summary.message


def test_run_reads_back(finished: Run) -> None:
    again = load(finished.folder)
    assert again.fit == finished.fit and again.summary == finished.summary
    assert np.array_equal(again.draws.values, finished.draws.values)
    assert again.problem.experiment.fingerprint == finished.fit.fingerprint
    import arviz as az

    stored = az.from_netcdf(str(finished.folder / "posterior.nc"))
    assert set(finished.problem.names) <= set(stored["posterior"].data_vars)
    assert stored["log_likelihood"]["launch_range_um"].shape[-1] == finished.problem.observed.size


@pytest.mark.filterwarnings("ignore:Passing a dict")  # ArviZ' pictures, by matplotlib 3.11
@pytest.mark.filterwarnings("ignore::UserWarning")  # ArviZ doubts so few draws
def test_what_arviz_computes_runs_on_the_file(finished: Run) -> None:
    """LOO, LOO-PIT and the sensitivity to prior and likelihood; the groups are those of the same draws."""
    import arviz as az

    stored, problem = az.from_netcdf(str(finished.folder / "posterior.nc")), finished.problem
    n = problem.observed.size
    assert {"prior", "posterior_predictive", "log_likelihood", "log_prior", "observed_data"} <= set(stored.groups())
    assert math.isfinite(az.loo(stored).elpd_loo)
    pit = az.loo_pit(stored, y="launch_range_um")
    assert pit.shape == (n,) and 0.2 < pit.mean() < 0.8
    assert az.plot_ppc(stored, num_pp_samples=5, random_seed=1) is not None
    assert set(az.psens(stored, component="prior").data_vars) == set(problem.names)
    each = np.stack([stored["log_prior"][name].values for name in problem.names], axis=-1)
    u = problem.to_sampling(finished.draws.flat)
    assert each.sum(axis=-1).ravel() == pytest.approx(problem.log_prior(u))
    prior = np.stack([stored["prior"][name].values[0] for name in problem.names], axis=-1)
    assert np.isfinite(problem.log_prior(problem.to_sampling(prior))).all()
    made = stored["posterior_predictive"]["launch_range_um"].values
    assert made.shape == stored["log_likelihood"]["launch_range_um"].shape and (made >= 0).all()


def test_repeating_a_finished_run_changes_nothing(finished: Run, known: Experiment) -> None:
    before = {p.name: p.read_bytes() for p in finished.folder.iterdir() if p.is_file()}
    running.fit(known, [1, 2], finished.folder, seed=4, n_starts=12, settings=QUICK)
    assert {p.name: p.read_bytes() for p in finished.folder.iterdir() if p.is_file()} == before


def _edit(path: Path, change: Callable[[dict[str, Any]], object]) -> None:
    content = json.loads(path.read_text("utf-8"))
    change(content)
    path.write_text(json.dumps(content), "utf-8")


# Whatever is edited: the seal shows it.
EDITS: dict[str, Callable[[dict[str, Any]], object]] = {
    "fit.json seed": lambda c: c.update(seed=-1),
    "fit.json value": lambda c: c["minima"][0]["values"].update(k_c=1.0),
    "fit.json no seal": lambda c: c.pop("sha256"),
    "posterior.json median": lambda c: c["parameters"][0].update(median=None),
    "posterior.json identity": lambda c: c.update(identity="0" * 64),
}


def _break(folder: Path, how: str) -> None:
    if how == "foreign json":
        (folder / "fit.json").write_text('{"hello": 1}')
    elif how == "truncated json":
        (folder / "fit.json").write_bytes((folder / "fit.json").read_bytes()[:200])
    elif how == "wrong type":
        content = json.loads((folder / "posterior.json").read_text())
        content["n_steps"] = "many"
        (folder / "posterior.json").write_text(json.dumps(content))
    elif how in EDITS:
        _edit(folder / how.split()[0], EDITS[how])
    elif how == "scaled draws":
        with h5py.File(folder / "posterior.nc", "r+") as f:
            f["posterior/k_c"][...] *= 3
    elif how == "no draws":
        (folder / "posterior.nc").unlink()
    elif how == "corrupt draws":
        (folder / "posterior.nc").write_bytes(b"not HDF5")
    elif how == "foreign draws":
        with h5py.File(folder / "posterior.nc", "w") as f:
            f["x"] = 1
    elif how == "changed data":
        table = folder / "experiment" / "1.csv"
        lines = table.read_text().splitlines()
        table.write_text("\n".join([*lines[:-1], "123.0,20.0,4.0"]) + "\n")


@pytest.mark.parametrize(
    "how",
    ["foreign json", "truncated json", "wrong type", "no draws", "corrupt draws", "foreign draws", "changed data",
     "scaled draws", *EDITS],
)  # fmt: skip
def test_a_damaged_run_folder_gets_one_line(finished: Run, tmp_path: Path, how: str) -> None:
    folder = tmp_path / "damaged"
    shutil.copytree(finished.folder, folder)
    _break(folder, how)
    with pytest.raises(InputError, match="was changed after psafit wrote it" if how in EDITS else None) as caught:
        load(folder)
    assert "\n" not in str(caught.value) and caught.value.file is not None and caught.value.remedy


def test_a_posterior_of_another_run_is_reported(finished: Run, tmp_path: Path) -> None:
    folder = tmp_path / "swapped"
    shutil.copytree(finished.folder, folder)
    write_json(folder / "posterior.json", replace(finished.summary, identity="0" * 64), sealed=True)
    with pytest.raises(InputError, match="belongs to another run"):
        load(folder)


def test_a_record_from_another_run_is_reported(finished: Run, tmp_path: Path) -> None:
    """Well-formed and sealed, but not of these data, or not what its own identity says."""
    for number, (change, words) in enumerate((
        ({"fingerprint": "0" * 64}, "was changed after the fit"),
        ({"parameters": finished.fit.parameters[1:]}, r"is of another version of psafit \(priors differ\)"),
        ({"groups": [1]}, "contradicts itself"),
        ({"seed": 5}, "contradicts itself"),
        ({"n_starts": 5}, "contradicts itself"),
    )):  # fmt: skip
        folder = tmp_path / str(number)
        shutil.copytree(finished.folder, folder)
        write_json(folder / "fit.json", replace(finished.fit, **change), sealed=True)
        files = finished.summary.files | {"fit.json": sha256(folder / "fit.json")}
        write_json(folder / "posterior.json", replace(finished.summary, files=files), sealed=True)
        with pytest.raises(InputError, match=words):
            load(folder)


def test_what_is_not_a_number_reads_back_as_such(finished: Run, tmp_path: Path) -> None:
    first = replace(finished.summary.parameters[0], ess_tail=float("nan"))
    write_json(tmp_path / "p.json", replace(finished.summary, parameters=[first]))
    assert np.isnan(read_json(tmp_path / "p.json", type(finished.summary)).parameters[0].ess_tail)


def test_only_an_interrupted_run_of_ours_goes_on_in_a_folder_without_a_fit(
    known: Experiment, known_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(identify, "profiles", lambda problem, *a: [[]] * problem.n_physical)
    arguments: dict[str, Any] = {"seed": 2, "n_starts": 3, "settings": SHORT}
    shutil.copytree(known_folder, tmp_path / "mine" / "experiment")
    before = {p.name: p.read_bytes() for p in (tmp_path / "mine" / "experiment").iterdir()}
    with pytest.raises(InputError, match="already holds other files"):
        running.fit(known, [1], tmp_path / "mine", **arguments)
    assert {p.name: p.read_bytes() for p in (tmp_path / "mine" / "experiment").iterdir()} == before
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(running, "sample", lambda *a, **k: (_ for _ in ()).throw(KeyboardInterrupt))
        running.fit(known, [1], tmp_path / "cut", **arguments)
    (tmp_path / "cut" / ".fit.json.123.tmp").write_text("{")
    with pytest.raises(InputError, match="holds another run, interrupted"):
        running.fit(known, [2], tmp_path / "cut", **arguments)
    running.fit(known, [1], tmp_path / "cut", **arguments)
    assert not [p for p in (tmp_path / "cut").iterdir() if p.name.startswith(".")]
    (tmp_path / "killed").mkdir()
    (tmp_path / "killed" / ".fit.json.123.tmp").write_text("{")
    running.fit(known, [1], tmp_path / "killed", **arguments)


def test_a_refusal_says_what_differs(known: Experiment, finished: Run) -> None:
    for change, words in (
        ({"seed": 5}, "seed"), ({"n_starts": 5}, "starts"), ({"settings": SHORT}, "sampler settings"),
    ):  # fmt: skip
        arguments: dict[str, Any] = {"seed": 4, "n_starts": 12, "settings": QUICK} | change
        with pytest.raises(InputError, match=rf"\(what differs: {words}\)"):
            running.fit(known, [1, 2], finished.folder, **arguments)
    reported = replace(known, beliefs=(Belief("k_c", LogNormal(1e6, 2.0), "Hertz"),))
    with pytest.raises(InputError, match=r"\(what differs: priors\)"):
        running.fit(reported, [1, 2], finished.folder, seed=4, n_starts=12, settings=QUICK)
    with pytest.raises(InputError, match=r"\(what differs: groups\)"):
        running.fit(known, [1], finished.folder, seed=4, n_starts=12, settings=QUICK)


def test_folders_of_others_are_left_alone(known: Experiment, finished: Run, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="already holds other files"):
        running.fit(known, [1], tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["notes.txt"]
    with pytest.raises(InputError, match="holds another run"):
        running.fit(known, [1], finished.folder)
    with pytest.raises(InputError, match="is a file"):
        running.fit(known, [1], tmp_path / "notes.txt")


@pytest.mark.slow
def test_run_carries_its_causes(tmp_path: Path) -> None:
    experiment = rig(["swing_drag"], [3.0], seed=3)
    quick = Settings(chunk=100, r_hat=1.5, effective_samples=50, autocorrelation_times=5, max_steps=300, tuned=30)
    chosen = terms(["swing_drag"])
    fit(experiment, [1], tmp_path / "run", terms=chosen, n_starts=4, settings=quick)
    run = load(tmp_path / "run")
    assert (run.fit.terms, run.fit.engine, run.problem.terms) == (["swing_drag"], "closed form", chosen)
    assert "swing_drag_rate" in [p.name for p in run.summary.parameters]
    reported = audit(run)
    assert reported.converged and reported.engine == "closed form" and (tmp_path / "run" / "numerics.json").exists()
    worst = [r.worst for r in reported.refinement]
    # Both paths are right to 1e-8: below that no finer step need be nearer to the closed form.
    distinct = np.maximum(worst, 1e-8).tolist()
    assert distinct == sorted(distinct, reverse=True) and worst[-1] < 1e-3 * worst[0]
    with pytest.raises(InputError, match="another run"):
        fit(experiment, [1], tmp_path / "run", n_starts=4, settings=quick)


HOLD = "import h5py, sys; f = h5py.File(sys.argv[1], 'r+'); print('held', flush=True); sys.stdin.read()"


@contextmanager
def held(file: Path) -> Iterator[None]:
    """A file that another process holds open for writing, until that is killed."""
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(file)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout is not None and process.stdout.readline().strip() == b"held"
        try:
            yield
        finally:
            process.kill()


def test_a_chain_that_another_process_holds_open_is_sound(
    finished: Run, known: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = shutil.copytree(finished.folder, tmp_path / "run")
    (folder / "posterior.json").unlink()
    before = (folder / "chain.h5").read_bytes()
    again = partial(running.fit, known, [1, 2], folder, seed=4, n_starts=12, settings=QUICK)
    with (
        held(folder / "chain.h5"),
        pytest.raises(InputError, match="wait until the process that holds it open") as reported,
    ):
        again()
    assert reported.value.file == folder / "chain.h5" and "remove" not in str(reported.value)
    with monkeypatch.context() as patch, pytest.raises(InputError, match="check its permissions"):
        refuse = PermissionError(errno.EACCES, "Unable to open file")
        patch.setattr(ensembles.h5py, "File", lambda *a, **k: (_ for _ in ()).throw(refuse))
        again()
    after = (folder / "chain.h5").read_bytes()
    assert len(after) == len(before)


def test_a_posterior_that_a_killed_program_left_marked_is_rebuilt_from_the_chain(
    finished: Run, known: Experiment, tmp_path: Path
) -> None:
    folder = shutil.copytree(finished.folder, tmp_path / "run")
    whole = {name: (folder / name).read_bytes() for name in ("posterior.nc", "posterior.json", "chain.h5", "fit.json")}
    with held(folder / "posterior.nc"), pytest.raises(InputError, match="wait until the process") as reported:
        load(folder)
    assert reported.value.file == folder / "posterior.nc"
    assert (folder / "posterior.nc").read_bytes() != whole["posterior.nc"]  # the flag of HDF5
    again = partial(running.fit, known, [1, 2], folder, seed=4, n_starts=12, settings=QUICK)
    for read in (lambda: load(folder), again):
        with pytest.raises(InputError, match=r"remove posterior\.json and repeat the command that made it"):
            read()
    (folder / "posterior.json").unlink()
    again()
    assert {name: (folder / name).read_bytes() for name in whole} == whole and load(folder).summary == finished.summary
    for name in ("posterior.nc", "posterior.json"):
        (folder / name).write_bytes(b"{")
        with pytest.raises(InputError, match=r"remove posterior\.json"):
            load(folder)
        (folder / name).write_bytes(whole[name])


def test_records_of_a_run_print_as_what_they_are(finished: Run) -> None:
    assert repr(finished).startswith("Run(folder=") and len(repr(finished)) < 1000
    assert "converged=True" in repr(finished.summary) and "parameters: 6" in repr(finished.summary)
