"""Text of a file somebody else wrote: read within limits, and quoted in messages."""

from __future__ import annotations

import codecs
import difflib
import json
import re
from collections.abc import Iterable
from pathlib import Path

from psafit.errors import InputError, printable
from psafit.files import read_error


def shown(text: str) -> str:
    """Quote a value from a file, shortened: an error stays one readable line."""
    return repr(text) if len(text) <= 40 else f"{text[:37] + '...'!r} ({len(text)} characters)"


def listed(names: Iterable[str]) -> str:
    """Join names for a message, at most twenty of them."""
    all_names = list(names)
    return ", ".join(all_names[:20]) + (", ..." if len(all_names) > 20 else "")


# What others call psafit's keys, where no spelling shows it.
_MEANT = {
    "offset": "bias_v", "offset_v": "bias_v", "dc_offset": "bias_v", "dc_offset_v": "bias_v", "dc": "bias_v",
    "burst": "cycles", "bursts": "cycles", "periods": "cycles", "n_cycles": "cycles", "shape": "waveform",
    "signal": "waveform", "rest_v": "idle_v", "standby_v": "idle_v",
}  # fmt: skip


def near_names(wrong: str, known: Iterable[str], n: int = 2) -> list[str]:
    """Return known names that a name may stand for, at most `n`: what others call it, else how it is spelt."""
    names = list(known)
    folded = wrong.casefold()
    same = [name for name in names if name == _MEANT.get(folded) or name.casefold() == folded]
    # A name that shares less than two thirds of its letters is another one: "duty_cycle" is no "cycles".
    return same or difflib.get_close_matches(wrong[:40], names, n=n, cutoff=2 / 3)


def near_columns(wrong: str, known: Iterable[str]) -> list[str]:
    """Return the column that a name may stand for, if there is one, as a list.

    Each word of the name is one of the column's, nearly, or its unit with another prefix: any other word makes it
    another quantity, or counts volts another way (`amplitude_vpp` is no `amplitude_v`).
    """

    def says(word: str, own: str) -> bool:
        prefixed = len(own) <= 2 and len(word) <= 2 and word[-1] == own[-1]
        return prefixed or difflib.SequenceMatcher(None, word, own).ratio() >= 0.8

    said = re.findall(r"[^\W_]+", wrong[:40].casefold())
    meant = [name for name in known if all(any(says(word, own) for own in name.split("_")) for word in said)]
    return difflib.get_close_matches(wrong[:40], meant, n=1)


def did_you_mean(wrong: str, known: Iterable[str], *, columns: bool = False) -> str:
    """Remedy for a name, or a column's, that is none of those known: the nearest of them, or all."""
    names = list(known)
    near = near_columns(wrong, names) if columns else near_names(wrong, names)
    return f"did you mean {' or '.join(near)}?" if near else f"choose from {listed(names)}"


def one_line(text: str) -> str:
    """Collapse white space and replace what cannot be printed."""
    return printable(" ".join(text.split()))


def unreadable(file: Path, error: OSError, remedy: str) -> InputError:
    """What the operating system says of a folder that it does not let us look into."""
    return InputError(f"cannot be read ({error.strerror})", remedy, file=file)


def signed(raw: bytes) -> str:
    """What a file is that begins so and is no text, with its article; empty where nobody knows."""
    kinds = {
        b"PK\x03\x04": "a zip file, such as a workbook (.xlsx, .ods)",
        b"\xd0\xcf\x11\xe0": "an old workbook (.xls)",
        b"\x1f\x8b": "a compressed file (gzip)",
        b"BZh": "a compressed file (bzip2)",
        b"\xfd7zXZ": "a compressed file (xz)",
        b"\x89HDF": "an HDF5 file",
        b"MATLAB": "a MATLAB file",
        b"PAR1": "a Parquet file",
        b"%PDF-": "a PDF file",
        b"TDSm": "a TDMS file (LabVIEW)",
        b"\x0f\x0f:WFM": "an oscilloscope's binary waveform (.wfm)",
        b"\xf0\xf0:WFM": "an oscilloscope's binary waveform (.wfm)",
    }
    return next((kind for start, kind in kinds.items() if raw.startswith(start)), "")


def _wide(raw: bytes) -> bool:
    """Whether bytes look like UTF-16: by their mark, or since every other byte of the first letters is NUL."""
    marked = raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    first = raw[:8]
    return marked or (len(first) == 8 and any(not any(first[k::2]) and all(first[1 - k :: 2]) for k in (0, 1)))


def read_text(file: Path, limit: int, form: str = "CSV (UTF-8)") -> str:
    """Read UTF-8 with or without a byte order mark, and no more than `limit` bytes.

    What DOS programs put at the end of a text, Ctrl-Z, is left out. NUL bytes are refused, at the end, too: a recorder
    that loses power leaves them where readings should be.

    Parameters
    ----------
    file : Path
    limit : int
    form : str
        What the file should be, for a message.
    """
    try:
        with file.open("rb") as stream:
            raw = stream.read(limit + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise read_error(error, file, f"cannot be read ({reason})", "check its name") from error
    if len(raw) > limit:
        raise InputError(f"larger than {limit // 1024**2} MiB", "split it, or keep measurements only", file=file)
    if kind := signed(raw):
        raise InputError(f"{kind}, not text", f"save what it holds as {form}", file=file, line=1)
    if _wide(raw):
        raise InputError("not UTF-8 text but UTF-16", f"save it as {form}", file=file, line=1)
    raw = raw.removeprefix(codecs.BOM_UTF8)
    try:
        text = raw.decode("utf-8")
    except UnicodeDecodeError as error:
        what = "binary data, not UTF-8 text" if b"\0" in raw else "not UTF-8 text"
        line = raw.count(b"\n", 0, error.start) + 1
        raise InputError(what, f"save it as {form}", file=file, line=line) from error
    bare = text.rstrip("\r\n\x1a")
    if "\x1a" in text[len(bare) :]:
        text = bare
    for mark, name in (("\0", "NUL byte"), ("\x1a", "Ctrl-Z (0x1A), the DOS mark of a file's end")):
        if (at := text.find(mark)) >= 0:
            line = len(re.findall(r"\r\n|\r|\n", text[:at])) + 1
            ends = not text[at:].strip(mark + " \t\r\n")
            what = f"ends in {text.count(mark)} NUL bytes" if ends else f"holds a {name}"
            remedy = f"check that nothing was lost {'before them' if ends else 'around it'}, and delete "
            raise InputError(what, remedy + ("them" if ends else "it"), file=file, line=line)
    return text


def quoted(text: str) -> str:
    """A text as TOML has it."""
    # A JSON string is a TOML basic string, but for the DEL character.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def id_text(id: int | str) -> str:
    """The id of a group or session as TOML has it."""
    return str(id) if isinstance(id, int) else quoted(id)
