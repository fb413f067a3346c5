"""Files as rows of cells: text by charset-normalizer, clevercsv and csv, workbooks by calamine."""

from __future__ import annotations

import codecs
import csv
import io
import json
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from xml.etree import ElementTree
from zipfile import ZipFile

from psafit.errors import InputError
from psafit.experiment.importing.quantities import BLANKS, SEPARATORS
from psafit.experiment.importing.records import Options
from psafit.experiment.text import listed, shown, signed
from psafit.files import read_error

Cell = object
"""Text; a number of a workbook; or what else a workbook may hold, such as a date."""
# Encodings of instruments and spreadsheets: more of them would take each other's place in files of a few letters.
_ENCODINGS = ["ascii", "utf_8", "utf_16", "utf_16_le", "utf_16_be", "cp1252"]
_MARKUP = re.compile(r"\s*<(?:!doctype|\?xml|html|head|body|meta|table|svg)\b", re.IGNORECASE)
_WORKBOOKS = (b"PK\x03\x04", b"\xd0\xcf\x11\xe0")


@dataclass(frozen=True)
class Row:
    """A row: the line where it begins, its cells up to the last that is filled, and how many there are in all."""

    line: int
    cells: tuple[Cell, ...]
    width: int

    @cached_property
    def texts(self) -> tuple[str, ...]:
        """The cells as text."""
        return tuple(text_of(cell) for cell in self.cells)

    @property
    def is_blank(self) -> bool:
        """Whether nothing stands in it."""
        return not any(self.texts)


@dataclass(frozen=True)
class Grid:
    """The rows of a text file, under one separator, or of a sheet.

    Parameters
    ----------
    file : Path
    rows : tuple of Row
    sheet : str
        Empty for text.
    encoding, separator : str
        Of text; no separator where it has but one column.
    counts : int or None
        The column that counts samples, if it was added: it is not in the file.
    """

    file: Path
    rows: tuple[Row, ...]
    sheet: str = ""
    encoding: str = ""
    separator: str = ""
    counts: int | None = None


def text_of(cell: Cell) -> str:
    """A cell as text; whole numbers of a workbook without a point."""
    if cell is None:
        return ""
    if isinstance(cell, float):
        return repr(cell).removesuffix(".0")
    return " ".join(str(cell).split())


def grids(file: Path, options: Options) -> list[Grid]:
    """What a file may be read as: a text under each separator, the likeliest first, or the sheets of a workbook.

    Raises
    ------
    InputError
        If it cannot be read, or is no table.
    """
    try:
        with file.open("rb") as stream:
            raw = stream.read(options.most_bytes + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise read_error(error, file, f"cannot be read ({reason})", "check its name") from error
    if len(raw) > options.most_bytes:
        raise InputError(
            f"larger than {options.most_bytes // 1024**2} MiB", "split it, or keep measurements only", file=file
        )
    if raw.startswith(_WORKBOOKS):
        return _sheets(file, raw, options)
    if kind := signed(raw):
        raise InputError(f"{kind}, no table", "save what it holds as CSV or .xlsx", file=file, line=1)
    text, encoding = _decoded(raw, file, options.encoding)
    if kind := _structured(text):
        remedy = "open it with what wrote it, or in a spreadsheet, and save its table as CSV or .xlsx"
        raise InputError(f"{kind}, no table of text", remedy, file=file, line=1)
    tries = [options.separator] if options.separator else _separators(text)
    found, faults = [], []
    for separator in tries:
        try:
            rows = tuple(_rows(text, separator, file))
        except InputError as fault:
            faults.append(fault)
            continue
        found.append(
            Grid(file, rows, encoding=encoding, separator=separator if separator in text or options.separator else "")
        )
    if not found:
        raise faults[0]
    return found


def _structured(text: str) -> str:
    """What a text is that begins so and is no table; empty where it may be one."""
    if _MARKUP.match(text):
        return "HTML or XML"
    if not text.lstrip().startswith(("{", "[")):
        return ""
    for part in (text, text.lstrip().partition("\n")[0]):  # or one record a line
        try:
            found = json.loads(part)
        except (ValueError, RecursionError):
            continue
        if isinstance(found, dict) or any(isinstance(one, dict | list) for one in found):
            return "JSON"
    return ""


def _decoded(raw: bytes, file: Path, encoding: str | None) -> tuple[str, str]:
    from charset_normalizer import from_bytes

    remedy = "name its encoding: --encoding cp850, or cp932 of Japanese, or save it as UTF-8"
    if encoding is None:
        best = from_bytes(raw, cp_isolation=_ENCODINGS).best()
        if best is None:
            raise InputError("not UTF-8, UTF-16 or Windows-1252 text", remedy, file=file, line=1)
        encoding = best.encoding
        if raw.startswith(codecs.BOM_UTF8):
            encoding = "utf_8_sig"
    try:
        text = raw.decode(encoding)
    except LookupError as error:
        raise InputError(f"unknown encoding {shown(encoding)}", "write for example --encoding cp1252") from error
    except (UnicodeError, ValueError) as error:  # codecs that make no text of bytes raise others, too
        line = raw.count(b"\n", 0, getattr(error, "start", 0)) + 1
        raise InputError(f"not text in {encoding}", remedy, file=file, line=line) from error
    if not isinstance(text, str):
        raise InputError(f"{encoding} is no encoding of text", "write for example --encoding cp1252")
    text = text.removeprefix("\ufeff").rstrip("\x1a")
    if (at := text.find("\0")) >= 0:
        line = len(re.findall(r"\r\n|\r|\n", text[:at])) + 1
        remedy = "check that nothing was lost around it, and delete it, or name the encoding with --encoding"
        raise InputError("holds a NUL byte", remedy, file=file, line=line)
    return text, encoding


def _separators(text: str, sample: int = 20_000) -> list[str]:
    """Separators that a text may have, the likeliest first; `sample` is the number of characters that are looked at."""
    import clevercsv

    marks = [mark for mark in SEPARATORS if len(mark) == 1]
    dialect = clevercsv.Detector().detect(text[:sample], delimiters=marks)
    first = [dialect.delimiter] if dialect and dialect.delimiter else []
    alone = [mark for mark in marks if mark not in text][:1]  # with it the text is one column
    return list(dict.fromkeys([*first, *(mark for mark in SEPARATORS if mark in text), *alone]))


def _rows(text: str, separator: str, file: Path) -> Iterator[Row]:
    if separator in BLANKS:  # aligned by any number of them
        text = re.sub(rf"[ \t]{{{len(separator)},}}", "\t", re.sub(r"(?m)^[ \t]+|[ \t]+$", "", text))
        separator = "\t"
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True)
    while True:
        line = reader.line_num + 1
        try:
            cells = [cell.strip() for cell in next(reader)]
        except StopIteration:
            return
        except csv.Error as error:
            remedy = "close the quotes, or write plain numbers, without quotes"
            raise InputError(f"not valid CSV ({error})", remedy, file=file, line=line) from error
        yield Row(line, _trimmed(cells), len(cells))


def _uncalculated(raw: bytes, sheets: Sequence[str]) -> str:
    """The first cell of an .xlsx whose formula has no value, as programs write it that do not calculate; else empty."""
    with suppress(Exception), ZipFile(io.BytesIO(raw)) as parts:  # an older form, or damaged: its reader says so
        book = ElementTree.fromstring(parts.read("xl/workbook.xml"))
        links = ElementTree.fromstring(parts.read("xl/_rels/workbook.xml.rels"))
        targets = {link.get("Id"): link.get("Target", "").removeprefix("/xl/") for link in links}
        for sheet in (sheet for sheet in book.iter() if sheet.tag.endswith("}sheet") and sheet.get("name") in sheets):
            place = next(value for name, value in sheet.attrib.items() if name.endswith("}id"))
            text = parts.read(f"xl/{targets[place]}")
            for cell in ElementTree.fromstring(text).iter() if b"<f" in text else ():
                held = {part.tag.rpartition("}")[2]: part.text for part in cell}
                if "f" in held and not held.get("v") and cell.get("t") != "str":
                    return f"{cell.get('r', '')} of sheet {shown(sheet.get('name', ''))}"
    return ""


def _sheets(file: Path, raw: bytes, options: Options) -> list[Grid]:
    import python_calamine

    damaged = InputError("a zip or old office file, but no workbook", "save it anew as .xlsx or CSV", file=file)
    try:
        book = python_calamine.CalamineWorkbook.from_path(file)
        names = list(book.sheet_names)
        if missing := [name for name in options.sheets if name not in names]:
            raise InputError(f"has no sheet {shown(missing[0])}", f"its sheets are {listed(names)}", file=file)
        chosen = options.sheets or names
        tables = {name: book.get_sheet_by_name(name).to_python(skip_empty_area=False) for name in chosen}
    except InputError:
        raise
    except (KeyboardInterrupt, SystemExit, MemoryError):
        raise
    except BaseException as error:  # a panic of calamine's is no Exception
        raise damaged from error
    if cell := _uncalculated(raw, chosen):
        what = f"cell {cell} holds a formula without its value"
        raise InputError(what, "open the workbook in a spreadsheet program and save it", file=file)
    return [
        Grid(file, tuple(Row(number, _trimmed(row), len(row)) for number, row in enumerate(rows, 1)), sheet=name)
        for name, rows in tables.items()
    ]


def _trimmed(row: Sequence[object]) -> tuple[Cell, ...]:
    cells = [cell.strip() if isinstance(cell, str) else _displayed(cell) for cell in row]
    while cells and cells[-1] in ("", None):
        del cells[-1]
    return tuple(cells)


def _displayed(cell: Cell) -> Cell:
    """A number as a spreadsheet shows it, to 15 digits: a formula may leave 0.7000000000000001."""
    return float(f"{cell:.15g}") if isinstance(cell, float) else cell
