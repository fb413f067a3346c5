"""Files that are either whole or not there."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from psafit.errors import InputError


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Hand out a temporary file beside `path`, and move it there in one step when the block ends well.

    Raises
    ------
    InputError
        If the folder cannot be made or the file not be written.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        with temporary.open("rb") as f:
            os.fsync(f.fileno())  # the rename must not reach the disk before the content
        temporary.replace(path)
    except OSError as error:
        raise InputError(
            f"cannot be written ({error.strerror or error})", "choose a writable folder with --out", file=path
        ) from error
    finally:
        with suppress(OSError):  # where the folder cannot be, neither can the file
            temporary.unlink()


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file in one step, so that no reader ever sees half of it."""
    with replacing(path) as temporary:
        temporary.write_bytes(content)
