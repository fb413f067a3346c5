"""Processes that share work out: of this machine, which end with the one that started them, or of a Dask cluster."""

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
from concurrent.futures import FIRST_COMPLETED, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, nullcontext
from contextvars import ContextVar
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

import joblib
from joblib.externals.loky import get_reusable_executor, process_executor

from psafit import plugins
from psafit.errors import InputError
from psafit.heartbeat import repeated

# How often a worker looks whether its parent is still there, and a parent reports how far its workers are.
_LOOK_UP_S = 1.0
# For a scheduler's first worker to come. (How long the scheduler itself may take to answer is Dask's own setting.)
_WORKERS_S = 60
_CLIENT: ContextVar[Any] = ContextVar("client", default=None)  # of the Dask scheduler whose workers share work out
_IS_SHARED: ContextVar[bool] = ContextVar("is_shared", default=False)  # whether this is one process of several
_FOLDER = "psafit-{}-{}-"  # temporary, of a process that another one has started


def cores() -> int:
    """Cores that this process may use: one, where it works for another one."""
    if _IS_SHARED.get():
        return 1
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
def processes(jobs: int, scheduler: str | None = None) -> Iterator[int]:
    """Let joblib use so many processes, which part the cores between them; gives the number that it may use.

    Parameters
    ----------
    jobs : int
        Processes of this machine.
    scheduler : str, optional
        Address of a Dask scheduler whose workers share the work instead (extra ``psafit[cluster]``).

    Raises
    ------
    InputError
        If one of them has been ended, or Dask is asked for and not there.
    """
    if scheduler is not None:
        with _cluster(scheduler) as usable:
            yield usable
        return
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


def reach(scheduler: str) -> None:
    """See that a Dask scheduler answers, before anything is written.

    Raises
    ------
    InputError
        If Dask is not installed, or no scheduler answers.
    """
    if importlib.util.find_spec("distributed") is None:
        raise InputError("Dask distributed is not installed", "install psafit[cluster], or leave --scheduler out")
    from distributed import Client

    for name in ("distributed", "distributed.client"):  # what they log is said in one line
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        # As the default, a client that fails would stay the one whose locks xarray takes to write a file.
        client: Any = Client(scheduler, set_as_default=False)  # type: ignore[no-untyped-call]
        client.close()
    except Exception as error:  # an address may be wrong in many ways, each with an error of its own
        reason = " ".join(str(error).split())[:200]
        raise InputError(f"no Dask scheduler answers at {scheduler} ({reason})", "check --scheduler") from error


@contextmanager
def _cluster(scheduler: str) -> Iterator[int]:
    """Let `unordered` use the workers of a Dask scheduler; gives their number."""
    reach(scheduler)
    from distributed import Client
    from distributed.scheduler import KilledWorker

    # (Not by joblib's link to Dask, which waits for ever for work that Dask has given up.)
    with Client(scheduler, set_as_default=False) as client:  # type: ignore[no-untyped-call]
        try:
            client.wait_for_workers(1, timeout=_WORKERS_S)
        except TimeoutError as error:
            raise InputError(f"the Dask scheduler at {scheduler} has no worker", "start some: dask worker") from error
        before = _CLIENT.set(client)
        try:
            yield max(sum(client.ncores().values()), 2)  # one alone would be this one
        except KilledWorker as error:
            raise InputError(
                "Dask gave up a piece of work that ended one worker after the other, perhaps for want of memory",
                "repeat the same command, which goes on from what is done, with more memory for each worker",
            ) from error
        finally:
            _CLIENT.reset(before)


def _on_cluster(
    client: Any, jobs: int, work: Callable[..., Any], calls: Iterable[tuple[Any, ...]], waiting: int
) -> Iterator[Any]:
    """Results as they come from the workers of a Dask scheduler; parameters as of `unordered`."""
    executor, left, owner = client.get_executor(pure=False), iter(calls), os.getpid()
    begun = {executor.submit(_attended, owner, work, call) for call in islice(left, (1 + waiting) * jobs)}
    while begun:
        done, begun = wait(begun, timeout=_LOOK_UP_S, return_when=FIRST_COMPLETED)
        # A client that has lost its scheduler drops all that was begun, and looks for another: no result would come.
        if client.status != "running":
            raise InputError(
                "the Dask scheduler has gone, and with it the work that was begun",
                "start it and its workers, and repeat the same command, which goes on from what is done",
            )
        for future in done:
            begun |= {executor.submit(_attended, owner, work, call) for call in islice(left, 1)}
            yield future.result()


def unordered(
    jobs: int, work: Callable[..., Any], calls: Iterable[tuple[Any, ...]], *, waiting: int = 1
) -> Iterator[Any]:
    """Results as they come of `work` with each tuple of arguments.

    One call at a time to each worker: what is not begun is not lost. Workers are born deaf to Ctrl-C: one that is still
    importing would answer it with a traceback.

    Parameters
    ----------
    jobs : int
        As `processes` gives it.
    work : callable
    calls : iterable of tuple
        Taken from when a worker needs more.
    waiting : int
        Calls that wait for each worker in addition to the one at which it is.
    """
    if jobs > 1 and (client := _CLIENT.get()):
        return _on_cluster(client, jobs, work, calls, waiting)
    if jobs < 2:
        return (_attended(os.getpid(), work, call) for call in calls)
    asked = (joblib.delayed(_attended)(os.getpid(), work, call) for call in calls)
    # (joblib evaluates the number.)
    ready = f"{1 + waiting}*n_jobs"
    parallel = joblib.Parallel(n_jobs=jobs, return_as="generator_unordered", batch_size=1, pre_dispatch=ready)
    if not hasattr(signal, "pthread_sigmask"):
        return iter(parallel(asked))
    heard = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        return iter(parallel(asked))
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, heard)


def precompute(
    work: Callable[..., Any],
    calls: Sequence[tuple[Any, ...]],
    jobs: int,
    progress: Callable[[int, int], None] = lambda done, total: None,
    *,
    scheduler: str | None = None,
    take: Callable[[Any], None] = lambda result: None,
) -> None:
    """Do work in other processes for what it leaves behind; nothing where one process would do it all.

    Parameters
    ----------
    work : callable
        What it returns must be fit to be sent.
    calls : sequence of tuple
        Its arguments, a tuple a call.
    jobs : int
        Processes.
    progress : callable
        Called with (calls done, calls) every second.
    scheduler : str, optional
        As of `processes`.
    take : callable
        Called with each result.
    """
    with processes(min(jobs, len(calls)), scheduler if calls else None) as usable:
        if usable < 2:
            return
        done = 0
        with repeated(lambda: progress(done, len(calls)), _LOOK_UP_S):
            for result in unordered(usable, work, calls):
                take(result)
                done += 1


def _attended(owner: int, work: Callable[..., Any], call: tuple[Any, ...]) -> Any:
    """One call, in a process that `owner` has started; or in the owner itself, where joblib starts none."""
    if os.getpid() != owner:
        _attend()
        _IS_SHARED.set(True)
    try:
        return work(*call)
    except Exception as error:
        if blamed := plugins.blamed(error):  # whose line in whose file is not passed to other processes
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
    # Compiling takes hundreds of megabytes once: joblib takes that for a leak, ends the worker, and warns of it.
    process_executor._MAX_MEMORY_LEAK_SIZE = sys.maxsize

    def watch(parent: int) -> None:
        while os.getppid() == parent:
            time.sleep(_LOOK_UP_S)
        _clear(parent, os.getpid())
        os._exit(1)

    threading.Thread(target=watch, args=(parent.pid,), name="parent", daemon=True).start()
