"""Threads that share a batch."""

from __future__ import annotations

import os
import signal
import sys

import numpy as np
import pytest

from psafit.simulate.threads import share


@pytest.mark.parametrize(("n_sets", "threads"), [(0, 2), (1, 2), (2, 2), (7, 1), (7, 3), (1000, 4)])
def test_every_set_is_done_once(n_sets: int, threads: int) -> None:
    done = np.zeros(n_sets, int)

    def run(first: int, last: int, by: int) -> None:
        done[first:last] += by

    share(run, n_sets, (3,), threads=threads)
    assert (done == 3).all()


def test_what_fails_in_a_thread_fails() -> None:
    def run(first: int, last: int) -> None:
        if last == 40:
            raise MemoryError("the last part")

    with pytest.raises(MemoryError, match="the last part"):
        share(run, 40, (), threads=2)


@pytest.mark.skipif(sys.platform == "win32", reason="no process forks there")
@pytest.mark.filterwarnings("ignore:This process")
def test_a_process_that_was_forked_has_threads_of_its_own() -> None:
    done = np.zeros(8, int)

    def run(first: int, last: int) -> None:
        done[first:last] += 1

    share(run, 8, (), threads=2)
    child = os.fork()
    if not child:
        try:
            signal.alarm(30)
            share(run, 8, (), threads=2)
            os._exit(0 if (done == 2).all() else 1)
        finally:
            os._exit(2)
    assert os.waitpid(child, 0)[1] == 0
