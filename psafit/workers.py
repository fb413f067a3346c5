"""Processes of this machine that share work out, and end with the one that started them."""

from __future__ import annotations

import importlib.util
import logging
import multiprocessing
import os
import shutil
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, nullcontext
from functools import cache
from pathlib import Path
from typing import Any

import joblib
from joblib.externals.loky import get_reusable_executor

from psafit import plugins
from psafit.errors import InputError

# How often a worker looks whether its parent is still there, and a parent tells how far its workers are.
_LOOK_UP_S = 1.0
_FOLDER = "psafit-{}-{}-"  # temporary, of a process that another one has started


def cores() -> int:
    """Cores that this process may use."""
    try:
        return int(joblib.cpu_count())
    except ValueError as error:
        raise InputError(f"LOKY_MAX_CPU_COUNT: {error}", "set it to a number of cores, or not at all") from error


@contextmanager
def scratch() -> Iterator[Path]:
    """Lend a temporary folder; of a worker that is killed, whoever outlives it removes what is left."""
    with tempfile.TemporaryDirectory(prefix=_FOLDER.format(os.getppid(), os.getpid())) as name:
        yield Path(name)


def _clear(parent: int, worker: int | str) -> None:
    """Remove what workers have left in temporary folders."""
    for folder in Path(tempfile.gettempdir()).glob(_FOLDER.format(parent, worker) + "*"):
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def processes(jobs: int) -> Iterator[int]:
    """Let joblib use so many processes, which part the cores between them; gives the number that it may use.

    Raises
    ------
    InputError
        If one of them has been ended.
    """
    # joblib's own switch; and it flushes both streams before it starts a process.
    if os.environ.get("JOBLIB_MULTIPROCESSING") == "0" or sys.stdout is None or sys.stderr is None:
        jobs = 1
    try:
        # As many threads of linear algebra as here: another number adds up in another order, to other last digits.
        with joblib.parallel_config(backend="loky") if jobs > 1 else nullcontext():
            yield jobs
        if jobs > 1:  # idle ones hold memory, and joblib takes growth since their first call for a leak
            get_reusable_executor(reuse=True).shutdown(wait=True)
    except BrokenProcessPool as error:
        raise InputError(
            "a worker process was ended from outside, perhaps for want of memory",
            "repeat the same command, which goes on from what is done, with fewer --jobs",
        ) from error
    finally:
        _clear(os.getpid(), "*")


def reachable(scheduler: str | None, patience_s: float = 20.0) -> None:
    """See that a Dask scheduler answers, if one is asked for, before anything is written.

    Raises
    ------
    InputError
        If Dask distributed is not installed, or nobody answers within `patience_s`.
    """
    if scheduler is None:
        return
    if importlib.util.find_spec("distributed") is None:
        raise InputError("Dask distributed is not installed", "install psafit[cluster], or leave --scheduler out")
    from distributed import Client

    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what it logs is said in one line
    try:
        # As the default, a client that fails would stay the one whose locks xarray takes to write a file.
        client: Any = Client(scheduler, timeout=patience_s, set_as_default=False)  # type: ignore[no-untyped-call]
        client.close()
    except Exception as error:  # an address may be wrong in many ways, each with an error of its own
        reason = " ".join(str(error).split())[:200]
        raise InputError(f"no Dask scheduler answers at {scheduler} ({reason})", "check --scheduler") from error


@contextmanager
def cooperating(jobs: int, scheduler: str | None = None) -> Iterator[int]:
    """Let joblib use processes of this machine, or the workers of a Dask scheduler; see `processes`."""
    if scheduler is None:
        with processes(jobs) as usable:
            yield usable
        return
    # joblib brings its own link to Dask, and calls it by this address.
    with joblib.parallel_config(backend="dask", scheduler_host=scheduler, wait_for_workers_timeout=60):
        yield -1


def unordered(jobs: int, work: Callable[..., Any], calls: Iterable[tuple[Any, ...]]) -> Iterator[Any]:
    """Results as they come of `work` with each tuple of arguments.

    One call at a time to each worker: what is not begun is not lost. Workers are born deaf to Ctrl-C: one that is still
    importing would answer it with a traceback.
    """
    asked = (joblib.delayed(_attended)(os.getpid(), work, call) for call in calls)
    parallel = joblib.Parallel(n_jobs=jobs, return_as="generator_unordered", batch_size=1, pre_dispatch="2*n_jobs")
    if jobs < 2 or not hasattr(signal, "pthread_sigmask"):
        return iter(parallel(asked))
    heard = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        return iter(parallel(asked))
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, heard)


def ahead(
    work: Callable[..., object],
    calls: Sequence[tuple[Any, ...]],
    jobs: int,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> None:
    """Do work in processes of its own for what it leaves in files; nothing where one process would do it all.

    Parameters
    ----------
    work : callable
    calls : sequence of tuple
        Its arguments, a tuple a call.
    jobs : int
        Processes.
    progress : callable
        Called with (calls done, calls) every second.
    """
    with processes(min(jobs, len(calls))) as usable:
        if usable < 2:
            return
        done, over = 0, threading.Event()

        def tell() -> None:
            while not over.wait(_LOOK_UP_S):
                progress(done, len(calls))

        teller = threading.Thread(target=tell, name="progress", daemon=True)
        teller.start()
        try:
            for _ in unordered(usable, _forgotten, ((work, *call) for call in calls)):
                done += 1
        finally:
            over.set()
            teller.join()


def _forgotten(work: Callable[..., object], *call: Any) -> None:
    """Do work whose result need not, or cannot, be sent."""
    work(*call)


def _attended(owner: int, work: Callable[..., Any], call: tuple[Any, ...]) -> Any:
    """One call, in a process that `owner` has started; or in the owner itself, where joblib starts none."""
    if os.getpid() != owner:
        _attend()
    try:
        return work(*call)
    except Exception as error:
        if blamed := plugins.blamed(error):  # whose line in whose file is not told to other processes
            raise blamed from error
        raise


@cache
def _attend() -> None:
    """Leave Ctrl-C to whoever started this worker, and end it when that process has been killed: none takes results."""
    parent = multiprocessing.parent_process()
    if parent is None or not parent.pid:
        return
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch(parent: int) -> None:
        while os.getppid() == parent:
            time.sleep(_LOOK_UP_S)
        _clear(parent, os.getpid())
        os._exit(1)

    threading.Thread(target=watch, args=(parent.pid,), name="parent", daemon=True).start()
