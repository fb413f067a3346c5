"""Which files hold causes of the user's own.

They are named in the environment, where `make` and worker processes find them too; `psafit.physics` reads them when it
is imported.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterable
from pathlib import Path

from psafit.errors import InputError

VARIABLE = "PSAFIT_PLUGINS"


def files() -> tuple[Path, ...]:
    """The files named so far, each once."""
    named = os.environ.get(VARIABLE, "").split(os.pathsep)
    return tuple(dict.fromkeys(Path(name) for name in named if name))


def add(more: Iterable[str | Path]) -> None:
    """Name further files, for this process and those that it starts.

    Raises
    ------
    InputError
        If a name cannot stand in the environment, or `psafit.physics` has been imported without the file.
    """
    wanted = [Path(path).absolute() for path in more]
    for path in wanted:
        if os.pathsep in str(path):
            raise InputError(f"{os.pathsep!r} in a plugin's path parts it from the next", "rename it", file=path)
    new = [path for path in wanted if path not in files()]
    if new and "psafit.physics" in sys.modules:
        raise InputError(
            "psafit has read its causes before this plugin was named",
            f"name it in {VARIABLE}, or before psafit's modules are imported",
            file=new[0],
        )
    if new:
        os.environ[VARIABLE] = os.pathsep.join(map(str, [*files(), *new]))


def place(error: BaseException, file: str | Path) -> int | None:
    """Line of a file at which an error came up: of its text, or the last that ran; None where it has no part in it."""
    if isinstance(error, SyntaxError) and error.filename == str(file):
        return error.lineno
    line, trace = None, error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == str(file):
            line = trace.tb_lineno
        trace = trace.tb_next
    return line


def message_of(error: BaseException) -> str:
    """An error's kind and what it says, in one line that is not too long."""
    said = " ".join(re.sub(r"\x1b\[[0-9;]*m", "", str(error)).split())  # numba colours what it says
    said = said if len(said) <= 200 else said[:197] + "..."
    return f"{type(error).__name__}: {said}" if said else type(error).__name__


def blamed(error: BaseException) -> InputError | None:
    """An error as one line, where it came up in a plugin."""
    for file in files():
        if line := place(error, file):
            return InputError(f"the cause fails ({message_of(error)})", "see psafit check-cause", file=file, line=line)
    return None
