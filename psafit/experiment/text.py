"""Text of a file somebody else wrote: read within limits, and quoted in messages."""

from __future__ import annotations

import codecs
import difflib
from collections.abc import Iterable
from pathlib import Path

from psafit.errors import InputError, printable


def shown(text: str) -> str:
    """Quote a value from a file, shortened: an error stays one readable line."""
    return repr(text if len(text) <= 40 else text[:37] + "...")


def listed(names: Iterable[str]) -> str:
    """Join names for a message, at most twenty of them."""
    all_names = list(names)
    return ", ".join(all_names[:20]) + (", ..." if len(all_names) > 20 else "")


def meant(wrong: str, known: Iterable[str]) -> str:
    """Remedy for a name that is none of those known: the nearest of them, or all."""
    names = list(known)
    near = [name for name in names if name.casefold() == wrong.casefold()]
    near = near or difflib.get_close_matches(wrong[:40], names, n=2)
    return f"did you mean {' or '.join(near)}?" if near else f"choose from {listed(names)}"


def one_line(text: str) -> str:
    """Collapse white space and replace what cannot be printed."""
    return printable(" ".join(text.split()))


def unreadable(file: Path, error: Exception, remedy: str = "check its permissions") -> InputError:
    """What the operating system says of a file that it does not let us read."""
    reason = getattr(error, "strerror", None) or str(error)
    return InputError(f"cannot be read ({reason})", remedy, file=file)


def read_text(file: Path, limit: int) -> str:
    """Read UTF-8 with or without a byte order mark, and no more than `limit` bytes."""
    try:
        with file.open("rb") as stream:
            raw = stream.read(limit + 1)
    except (OSError, ValueError) as error:
        raise unreadable(file, error) from error
    if len(raw) > limit:
        raise InputError(f"larger than {limit // 1024**2} MiB", "split it, or keep measurements only", file=file)
    raw = raw.removeprefix(codecs.BOM_UTF8)
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(
            "not UTF-8 text",
            "save it as UTF-8",
            file=file,
            line=raw.count(b"\n", 0, error.start) + 1,
        ) from error
