"""Processes that share work out: what they leave, what ends them, and how errors come back."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import time
from pathlib import Path

import pytest
from clusters import two_workers

from psafit.errors import ConvergenceError, InputError, PsafitError
from psafit.workers import cores, precompute, processes, unordered


def test_errors_come_back_from_a_process_as_they_were_raised(tmp_path):
    for error in (
        PsafitError("a word"),
        InputError("is wrong", "mend it", file=tmp_path / "it.csv", line=3),
        ConvergenceError("an optimisation", reached=1.0, required=2.0),
    ):
        back = pickle.loads(pickle.dumps(error))
        assert type(back) is type(error) and str(back) == str(error) and vars(back) == vars(error)


def test_work_is_done_ahead_where_several_processes_share_it(tmp_path):
    for jobs, n_calls, made in ((1, 3, 0), (2, 3, 3), (2, 1, 0)):
        place = tmp_path / f"{jobs}-{n_calls}"
        place.mkdir()
        reported: list[tuple[int, int]] = []
        calls = [(str(place / f"{k}"),) for k in range(n_calls)]
        precompute(os.mkdir, calls, jobs, lambda done, total, reported=reported: reported.append((done, total)))
        assert len(list(place.iterdir())) == made
        assert all(done <= total == n_calls for done, total in reported)


@pytest.mark.parametrize("why", ["switch", "closed"])
def test_where_joblib_starts_no_process_nothing_is_done_ahead(why, tmp_path, monkeypatch):
    if why == "switch":
        monkeypatch.setenv("JOBLIB_MULTIPROCESSING", "0")
    else:
        monkeypatch.setattr(sys, "stderr", None)
    precompute(os.mkdir, [(str(tmp_path / name),) for name in "ab"], 2)
    assert not list(tmp_path.iterdir())


def test_a_number_of_cores_that_is_none_is_reported(monkeypatch):
    monkeypatch.setenv("LOKY_MAX_CPU_COUNT", "many")
    with pytest.raises(InputError, match="set it to a number of cores"):
        cores()


def test_one_of_several_processes_has_one_core():
    """Or each data set of a campaign would start as many again."""
    with processes(2) as jobs:
        assert set(unordered(jobs, cores, [()] * 2)) == {1}
    assert list(unordered(1, cores, [()])) == [cores()]


def test_what_a_process_cannot_do_is_raised():
    with pytest.raises(FileNotFoundError):
        precompute(os.rmdir, [("no such folder",)] * 2, 2)


def test_a_process_ended_from_outside_is_reported():
    with pytest.raises(InputError, match="ended from outside"):
        precompute(os._exit, [(1,), (1,)], 2)


def test_a_process_that_grows_is_kept() -> None:
    """As by compiling; joblib alone would end it, and warn of a leak. It looks every second."""
    keep = "(setattr(__import__('builtins'), 'kept', __import__('numpy').ones(int({}))), __import__('time').sleep(1.1))"
    code = f"({keep}, __import__('os').getpid())[1]"
    with processes(2) as jobs:
        pids = list(unordered(jobs, eval, [(code.format(n), {}) for n in (1, 1, 5e7, 5e7, 1, 1)]))
    assert len(set(pids)) <= 2


@pytest.mark.slow
def test_work_that_ends_one_worker_of_a_cluster_after_the_other_is_reported():
    with (
        two_workers() as cluster,
        pytest.raises(InputError, match="Dask gave up a piece of work"),
        processes(1, cluster.scheduler_address) as usable,
    ):
        list(unordered(usable, os._exit, [(1,)]))


CLUSTER = """
import time
from distributed import LocalCluster
cluster = LocalCluster(n_workers=1, processes=False, protocol="tcp://", dashboard_address=":0")
print(cluster.scheduler_address, flush=True)
time.sleep(600)
"""


@pytest.mark.slow
def test_a_scheduler_that_dies_is_reported():
    pytest.importorskip("distributed")
    with subprocess.Popen([sys.executable, "-c", CLUSTER], stdout=subprocess.PIPE, text=True) as cluster:
        assert cluster.stdout is not None
        address = cluster.stdout.readline().strip()
        with pytest.raises(InputError, match="the Dask scheduler has gone"), processes(1, address) as usable:
            for _ in unordered(usable, time.sleep, [(0.2,)] * 50):
                cluster.kill()


def test_a_plugin_that_fails_in_a_process_is_named_with_its_line(tmp_path: Path) -> None:
    mine = tmp_path / "mine.py"
    mine.write_text("import sys\nif 'psafit.workers' in sys.modules:\n    raise ValueError('no')\n")
    (tmp_path / "work.py").write_text(
        "import runpy\nfrom psafit import plugins\nfrom psafit.errors import InputError\n"
        "from psafit.workers import precompute\n"
        f"plugins.add([{str(mine)!r}])\n"
        f"try:\n    precompute(runpy.run_path, [({str(mine)!r},)] * 2, 2)\n"
        "except InputError as error:\n    print(error)\n"
    )
    done = subprocess.run([sys.executable, "work.py"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert "mine.py:3: the cause fails (ValueError: no)" in done.stdout, done.stderr
