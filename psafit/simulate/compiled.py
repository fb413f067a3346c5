"""Compilation of the engine: once for all causes, kept on disk, and never stale."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from types import FunctionType
from typing import Any

from numba import njit, prange

__all__ = ["compiled", "prange"]

_SOURCES = ("callbacks", "closed_form", "collocation", "compiled", "drive", "flight", "stepper")


def _stamp() -> bytes:
    """Return a fingerprint of all compiled sources."""
    folder = Path(__file__).parent
    return hashlib.sha256(b"".join((folder / f"{name}.py").read_bytes() for name in _SOURCES)).digest()


_STAMP = _stamp()


def compiled(function: Callable[..., Any] | None = None, *, parallel: bool = False) -> Any:
    """Compile with numba, IEEE division, and a cache on disk.

    Numba renews a cached function when its own file changes, not when a function it calls does; here the stamp is
    that of the whole engine. Where no folder can be written to, the function is compiled in every process.
    """
    if function is None:
        return lambda inner: compiled(inner, parallel=parallel)
    if parallel:
        # The cache's file bears the function's name: the threaded twin needs one of its own.
        twin = FunctionType(function.__code__, function.__globals__, f"{function.__name__}_parallel")
        twin.__qualname__, twin.__module__ = twin.__name__, function.__module__
        function = twin
    try:
        dispatcher = njit(cache=True, parallel=parallel, error_model="numpy")(function)
    except RuntimeError:  # no place for the cache
        return njit(parallel=parallel, error_model="numpy")(function)
    cache: Any = getattr(dispatcher, "_cache")  # noqa: B009 - numba does not declare it
    cache._cache_file._source_stamp = _STAMP
    return dispatcher
