"""Threads that share the sets of a batch: compiled loops run without the interpreter's lock."""

from __future__ import annotations

import functools
import itertools
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numba
import numpy as np

_CHOSEN: list[int] = []


def n_threads() -> int:
    """Return how many share a batch: one a core, or as many as `NUMBA_NUM_THREADS` or `set_n_threads` says."""
    config: Any = numba.config
    return _CHOSEN[-1] if _CHOSEN else int(config.NUMBA_NUM_THREADS)


def set_n_threads(n: int) -> None:
    """Let so many threads share a batch from now on."""
    _CHOSEN[:] = [n]


@functools.cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="psafit")


if hasattr(os, "register_at_fork"):  # a process that was forked has none of its parent's threads
    os.register_at_fork(after_in_child=_pool.cache_clear)


def share(
    run: Callable[..., object], n_sets: int, arguments: Sequence[object], *, threads: int, parts: int = 4
) -> None:
    """Call ``run(first, last, *arguments)`` for all sets of a batch, in threads.

    Parameters
    ----------
    run : callable
        Compiled; it works on the sets from `first` to before `last`.
    n_sets : int
    arguments : sequence
    threads : int
    parts : int
        Parts of the batch for each thread: sets differ in what they cost.
    """
    if threads < 2 or n_sets < 2:
        run(0, n_sets, *arguments)
        return
    ends = np.unique(np.linspace(0, n_sets, parts * threads + 1).astype(int)).tolist()
    begun = [_pool(threads).submit(run, *part, *arguments) for part in itertools.pairwise(ends)]
    for one in begun:
        one.result()
