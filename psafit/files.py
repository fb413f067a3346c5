"""Files that are either whole or not there."""

from __future__ import annotations

import os
from pathlib import Path

from psafit.errors import InputError


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file through a temporary one in the same folder, so that no reader ever sees half of it."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary.open("wb") as f:
            f.write(content)
            f.flush()
            os.fsync(f.fileno())
        temporary.replace(path)
    except OSError as error:
        raise InputError(
            f"cannot be written ({error.strerror or error})", "choose a writable folder with --out", file=path
        ) from error
    finally:
        temporary.unlink(missing_ok=True)
