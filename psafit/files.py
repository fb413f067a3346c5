"""Files that are either whole or not there, and paths that say nothing of the machine."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import re
import shlex
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath, PureWindowsPath

from psafit.errors import InputError

_BUSY = "wait until the process that holds it open has ended, then repeat the command"
_REMEDIES = {
    errno.EACCES: "check its permissions",
    errno.EPERM: "check its permissions",
    errno.EAGAIN: _BUSY,
    errno.EBUSY: _BUSY,
    errno.EDEADLK: _BUSY,
    errno.ETXTBSY: _BUSY,
    errno.ENOLCK: "set HDF5_USE_FILE_LOCKING=FALSE: this file system keeps no locks",
    errno.EISDIR: "move the folder of this name elsewhere",
    errno.ENOTDIR: "give a path that leads through folders",
    errno.ENOSPC: "make room, or write elsewhere",
    errno.EDQUOT: "make room, or write elsewhere",
    errno.EROFS: "write elsewhere",
    errno.EMFILE: "close other programs, then repeat the command",
    errno.ENFILE: "close other programs, then repeat the command",
}
_TEMPORARY = re.compile(r"\..+\.\d+\.tmp")
_ELSEWHERE = "choose a place that can be written and has room"


class Refused(InputError):
    """The system does not let a file be read: nothing is known of its content."""


def remedy_of(error: OSError) -> str:
    """What to do about an error of the operating system."""
    return _REMEDIES.get(error.errno or 0, "check the disk and the connection to it, then repeat the command")


def read_error(error: Exception, path: Path, what: str, remedy: str) -> InputError:
    """Turn an exception raised while a file was read into one line.

    Parameters
    ----------
    error : Exception
    path : Path
        The file.
    what, remedy : str
        What is wrong with the content and what to do then. Where the operating system refused the file, its own reason
        and remedy take their place.

    Returns
    -------
    InputError
        A `Refused` where the system refused.
    """
    # Libraries raise OSError for damaged content, too, but then without a number of the system's.
    if isinstance(error, OSError) and error.errno and not isinstance(error, FileNotFoundError):
        return Refused(f"cannot be read ({os.strerror(error.errno)})", remedy_of(error), file=path)
    return InputError(what, remedy, file=path)


def read_bytes(path: Path, missing: str) -> bytes:
    """Read a whole file; `missing` is what to do where there is none.

    Raises
    ------
    InputError
        If it is missing or the system refuses it.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise read_error(error, path, "is missing", missing) from error


@contextmanager
def _explained(path: Path, remedy: str = _ELSEWHERE, *, also: type[Exception] = ValueError) -> Iterator[None]:
    """Turn what the operating system says of a file into one line; `ValueError` is a NUL in its name."""
    try:
        yield
    except (OSError, also) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"cannot be written ({reason})", remedy, file=path) from error


def _takes_bytes_as_they_come(path: Path) -> bool:
    """Whether it is a device or a pipe, which nothing may replace."""
    return path.exists() and not path.is_file() and not path.is_dir()


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Hand out a temporary file next to `path`, and move it there in one step when the block ends well.

    A link stays: what it points to is replaced.

    Raises
    ------
    InputError
        If the folder cannot be made or the file not be written.
    """
    with _explained(path):
        target = Path(os.path.realpath(path))
        if target.exists() and not target.is_file():
            raise InputError("is not a file", "give the name of a file", file=path)
    with _explained(path, also=OSError):  # a ValueError of the block is its own fault
        temporary = target.with_name(f".{target.name}.{os.getpid()}.tmp")
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            yield temporary
            with temporary.open("rb") as f:
                os.fsync(f.fileno())  # the rename must not reach the disk before the content
            temporary.replace(target)
        finally:
            with suppress(OSError):  # where the folder cannot be, neither can the file
                temporary.unlink()


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file in one step, so that no reader ever sees half of it; a device or a pipe is written directly."""
    if _takes_bytes_as_they_come(path):
        with _explained(path):
            path.write_bytes(content)
        return
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def reserve(path: Path, n_bytes: int) -> None:
    """See that a file of this size has room at `path`, where nothing is left.

    HDF5 does not survive a disk that fills up while it writes: it ends the process.

    Raises
    ------
    OSError
        If there is no room.
    """
    with path.open("wb") as f:
        for _ in range(n_bytes >> 20):
            f.write(bytes(1 << 20))
        f.write(bytes(n_bytes & 0xFFFFF))
    path.unlink()


def is_temporary(path: Path) -> bool:
    """Whether a killed `replacing` left it."""
    return _TEMPORARY.fullmatch(path.name) is not None and path.is_file()


def refuse_foreign(folder: Path) -> None:
    """Refuse a folder that holds anything but what a killed `replacing` left."""
    foreign = sorted(p.name for p in folder.iterdir() if not is_temporary(p))
    if foreign:
        raise InputError(f"already holds other files ({foreign[0]})", "choose an empty folder with --out", file=folder)


def remove_temporaries(folder: Path) -> None:
    """Remove what a killed `replacing` left in a folder of ours."""
    for path in folder.iterdir():
        if is_temporary(path):
            path.unlink()


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep a folder, made if need be, to this process while it works there.

    The lock lies on the folder itself and ends with the process, however that ends. Where the system or the file
    system knows no such locks there is none.

    Raises
    ------
    InputError
        If another process works there, or it is a file.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError("is a file", "choose another --out", file=folder)
    with _explained(folder):
        folder.mkdir(parents=True, exist_ok=True)
    try:
        import fcntl
    except ImportError:  # Windows
        yield
        return
    with _explained(folder):
        handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            remedy = "wait until it has ended, or give another --out"
            raise InputError("another psafit works in this folder", remedy, file=folder) from error
        except OSError:
            pass
        yield
    finally:
        os.close(handle)


def in_use(folder: Path) -> bool | None:
    """Whether a process works in a folder (`locked`); None where that cannot be known."""
    try:
        import fcntl

        handle = os.open(folder, os.O_RDONLY)
    except (ImportError, OSError):
        return None
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return None
    finally:
        os.close(handle)
    return False


def digest(content: object) -> str:
    """SHA-256 of what JSON can say, whatever the order of its keys."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def sha256(path: Path) -> str:
    """SHA-256 of a file's bytes."""
    try:
        with path.open("rb") as f:
            return hashlib.file_digest(f, "sha256").hexdigest()
    except OSError as error:
        raise read_error(error, path, "is missing", "give the folder of a finished run of psafit fit") from error


def ensure_writable(path: Path, option: str, *, folder: bool = False, inputs: Iterable[Path] = ()) -> None:
    """Refuse an output before any work is done for it.

    Parameters
    ----------
    path : Path
    option : str
        That named it, for the message.
    folder : bool
        Whether a folder is meant; it must have nothing in common with an input.
    inputs : iterable of Path
        Files and folders that are read; no file of theirs is replaced.

    Raises
    ------
    InputError
        If it cannot be written, is of the wrong kind, or would overwrite an input.
    """
    remedy = f"choose another place with {option}"
    with _explained(path, f"choose a writable place with {option}"):
        real = Path(os.path.realpath(path))
        read = [Path(os.path.realpath(i)) for i in inputs]
        if folder:
            if real.exists() and not real.is_dir():
                raise InputError("is a file", remedy, file=path)
            if any(real.is_relative_to(i) or i.is_relative_to(real) for i in read):
                raise InputError("lies in the input, or the input in it", remedy, file=path)
        elif real.is_dir():
            raise InputError("is a folder", f"give a file with {option}", file=path)
        elif _takes_bytes_as_they_come(path):
            if not os.access(path, os.W_OK):
                raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
            return
        elif real.exists() and any(real.is_relative_to(i) for i in read):
            raise InputError("is a file of the input", remedy, file=path)
        place = real if folder else real.parent
        while not place.exists():
            place = place.parent
        with tempfile.TemporaryFile(dir=place):
            pass


@contextmanager
def filling(folder: Path) -> Iterator[None]:
    """Fill a new folder, or leave things as they were; `InputError` where it holds something already."""
    if folder.is_dir():
        if not all(map(is_temporary, folder.iterdir())):
            raise InputError("holds something already", "give the name of a new folder", file=folder)
        remove_temporaries(folder)
    missing = [place for place in (folder, *folder.parents) if not place.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    try:
        yield
    except BaseException:
        for path in folder.iterdir() if folder.is_dir() else ():
            shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
        for place in missing:
            with suppress(OSError):
                place.rmdir()
        raise


def usual_folder(experiment: Path, *what: str) -> Path:
    """Where a result goes by default: below `fits`, named after the experiment and what was done."""
    return Path("fits") / "-".join([experiment.resolve().name, *what])


def usual_fit_folder(experiment: Path, groups: Iterable[object], terms: Iterable[str]) -> Path:
    """Where a fit goes by default; the hyphens of an id are doubled, since one stands between two of them."""
    ids = (str(group).replace("-", "--") for group in groups)
    return usual_folder(experiment, f"group{'-'.join(ids)}", *terms)


def encodable(text: str) -> str:
    """Text that UTF-8 can hold: a file name that is no UTF-8 has surrogates in it."""
    return re.sub(r"[\ud800-\udfff]", "\N{REPLACEMENT CHARACTER}", text)


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

    return encodable(shlex.join(cut(str(word)) for word in words))
