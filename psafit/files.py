"""Files that are either whole or not there, and paths that say nothing of the machine."""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath, PureWindowsPath

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


_ABSOLUTE = re.compile(r"^(?:[/\\]|~|[A-Za-z]:[/\\])")


def portable_command(words: Iterable[object]) -> str:
    """A command line of words whose absolute paths are cut to their last part; relative ones stay as typed."""

    def cut(word: str) -> str:
        head, equals, tail = word.partition("=")
        if equals and _ABSOLUTE.match(tail):
            return f"{head}={cut(tail)}"
        if not _ABSOLUTE.match(word):
            return word
        kind = PureWindowsPath if "\\" in word or word[1:2] == ":" else PurePosixPath
        return kind(word).name or word

    return shlex.join(cut(str(word)) for word in words)
