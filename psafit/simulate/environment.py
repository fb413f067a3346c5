"""Settings of Numba under which the engine cannot be compiled, found before Numba ends in a traceback or worse."""

from __future__ import annotations

import os
import re
from typing import Any

from psafit.errors import InputError

_AGAIN = "or do not set it, and start again"


def _whole(name: str) -> int | None:
    """An environment variable that holds a whole number; what Numba cannot read it warns of, and takes its default."""
    try:
        return int(os.environ.get(name) or "x")
    except ValueError:
        return None


def check_numba(most_threads: int = 10_000) -> None:
    """Load Numba, or refuse settings with which it does not work.

    Parameters
    ----------
    most_threads : int
        Threads that Numba can start; with a hundred thousand it ends in a segmentation fault.

    Raises
    ------
    InputError
        Naming the setting.
    """
    threads = _whole("NUMBA_NUM_THREADS")
    if threads is not None and not 0 < threads <= most_threads:
        what = "NUMBA_NUM_THREADS is no possible number of threads"
        raise InputError(what, f"set it to 1 to {most_threads}, {_AGAIN}")
    if (_whole("NUMBA_FUNCTION_CACHE_SIZE") or 0) < 0:
        raise InputError("NUMBA_FUNCTION_CACHE_SIZE is negative", f"set it to zero or more, {_AGAIN}")
    features = os.environ.get("NUMBA_CPU_FEATURES", "")
    if features and not all(re.fullmatch(r"[+-][^\s,+-][^\s,]*", part) for part in features.split(",")):
        what = "NUMBA_CPU_FEATURES is no list of features, each with + or - before it"
        raise InputError(what, f"write for example +avx2,-avx512f, {_AGAIN}")
    if _whole("NUMBA_DISABLE_JIT"):
        raise InputError("NUMBA_DISABLE_JIT is set: psafit runs compiled only", "set it to 0, or do not set it")
    import numba

    config: Any = numba.config
    if config.DISABLE_JIT:  # by a program, or by the file .numba_config.yaml
        what = "Numba is set not to compile (its DISABLE_JIT): psafit runs compiled only"
        raise InputError(what, "remove that from the program or from .numba_config.yaml, and start again")


check_numba()  # when psafit.simulate is imported, before anything that needs Numba
