"""What is given to read: the beginnings of files, enough to tell their format without reading them, and tables."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import polars as pl

from rampcast.errors import FormatError
from rampcast.formats.files.records import record_names
from rampcast.formats.files.sources import open_source, read_start
from rampcast.recording.parquet import read_head

SIZE = 64 << 10  # [bytes] enough for any header
BYTE_ORDER_MARK = b"\xef\xbb\xbf"  # some programs write it before the first letter
PARQUET_MAGIC = b"PAR1"
NO_TABLES = ("<", "{", "[")  # with which xml and json begin
SEPARATORS = (",", ";", "\t", "|")
EXPECTED = "expected the path of a file, a polars or pandas frame, or a list of them"


class ArrowTable(Protocol):
    """A table with Arrow's interface, such as a pandas frame."""

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object: ...


if TYPE_CHECKING:
    One = str | os.PathLike[str] | pl.DataFrame | ArrowTable
    Source = One | Sequence[One]
else:
    Source = object  # at run time what is none of these gets a sentence, not a checker's error


@dataclass(frozen=True)
class Header:
    """The line that names the columns of a csv.

    Attributes:
        names: of the columns, as the file spells them.
        separator: between two columns.
        lines: of the file up to and with the header.
        decimal: sign of its numbers; "" tells it by the content.
    """

    names: tuple[str, ...]
    separator: str
    lines: int
    decimal: str = ""


@dataclass(frozen=True)
class Head:
    """The beginning of a file, or a whole table that is in memory.

    Attributes:
        path: of the file; of a table in memory its name alone.
        name: for messages; with the member's name where the file is an archive.
        text: its first 64 KB, uncompressed; nothing of a parquet file.
        header: of a csv with one.
        records: names of the columns where the file is json, an array of flat objects.
        types: of the columns of a parquet file or a table in memory, by their names.
        metadata: of a parquet file.
        table: the table in memory; None of a file.
    """

    path: Path
    name: str
    text: bytes = b""
    header: Header | None = None
    records: tuple[str, ...] = ()
    types: Mapping[str, Any] | None = None
    metadata: Mapping[str, str] = field(default_factory=dict)
    table: pl.DataFrame | None = field(default=None, repr=False)

    @property
    def is_text(self) -> bool:
        """Returns whether it is a file of text: no parquet file, no table in memory, and no table as json."""
        return self.types is None and not self.records

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Returns the names of the columns as the file spells them; () of what is no table."""
        if self.types is not None:
            return tuple(self.types)
        return self.records or (self.header.names if self.header else ())


def heads_of(source: Source) -> list[Head]:
    """Returns the beginnings of the files, or the tables in memory, that are to be read.

    Raises:
        FormatError: a file is not there or damaged, there is none, or something is neither a path nor a table.
    """
    many = [source] if isinstance(source, str | os.PathLike | pl.DataFrame) else source
    many = [many] if hasattr(many, "__arrow_c_stream__") else many
    if isinstance(source, bytes) or not isinstance(many, Sequence):
        raise FormatError(f"{EXPECTED}, got {_shown(many)}")
    if not many:
        raise FormatError("expected at least one file to read, got none")
    names = ["table"] if len(many) == 1 else [f"table-{number}" for number in range(1, len(many) + 1)]
    return [_head(one, name) for one, name in zip(many, names, strict=True)]


def _head(one: object, name: str) -> Head:
    if isinstance(one, str | os.PathLike):
        return look(Path(one))
    if not hasattr(one, "__arrow_c_stream__"):
        raise FormatError(f"{EXPECTED}, got {_shown(one)}")
    try:
        table = one if isinstance(one, pl.DataFrame) else pl.DataFrame(one)
    except Exception as error:  # whatever other libraries raise, also where pandas has no pyarrow
        raise FormatError(f"the frame {name} cannot be taken over: {error}. Give it as a polars frame") from error
    return Head(Path(name), name, types=dict(table.schema), table=table)


def _shown(found: object) -> str:
    return f"{found!r:.100} ({type(found).__name__})"


def look(path: Path) -> Head:
    """Returns the beginning of a file.

    Raises:
        FormatError: the file is not there, or its archive or parquet form is damaged.
    """
    with open_source(path) as (name, stream):
        text = read_start(name, stream, size=SIZE)
    if text.startswith(PARQUET_MAGIC):
        return _look_at_parquet(path)
    return Head(path, name, text, find_header(text), record_names(text))


def plain(name: str) -> str:
    """Returns a column's name as names are compared: lower case, with underscores for hyphens and spaces."""
    return name.strip().strip('"').lower().replace("-", "_").replace(" ", "_")


def find_header(text: bytes, separators: Sequence[str] = SEPARATORS) -> Header | None:
    """Returns the header of a csv that begins with the text, or None if its first line names no columns."""
    lines = text.removeprefix(BYTE_ORDER_MARK).split(b"\n")
    number = next((index for index, line in enumerate(lines) if line.strip()), None)
    if number is None:
        return None
    line = _decoded(lines[number]).rstrip("\r")
    separator = max(separators, key=line.count)
    cells = line.split() if separator == " " else line.split(separator)
    names = tuple(cell.strip().strip('"') for cell in cells)
    is_text = line.replace("\t", "").isprintable() and not line.lstrip().startswith(NO_TABLES)
    is_header = len(names) > 1 and is_text and not any(_is_number(name) for name in names)
    if not is_header:
        return None
    more = ("",) if _ends_in_one_more(lines[number + 1 :], separator, len(names)) else ()
    return Header((*names, *more), separator, number + 1)


def _ends_in_one_more(lines: Sequence[bytes], separator: str, count: int) -> bool:
    """Returns whether rows end in a separator that the line of names lacks: a column without name and content."""
    first = _decoded(next((line for line in lines if line.strip()), b"")).rstrip(" \r")
    return separator != " " and '"' not in first and first.endswith(separator) and first.count(separator) == count


def _decoded(line: bytes) -> str:
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("latin-1")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _look_at_parquet(path: Path) -> Head:
    types, metadata = read_head(path)
    return Head(path, str(path), types=types, metadata=metadata)
