"""The beginning of a file: enough to tell its format without reading it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from rampcast.formats.files.sources import open_source, read_start
from rampcast.recording.parquet import read_head

SIZE = 64 << 10  # [bytes] enough for any header
BYTE_ORDER_MARK = b"\xef\xbb\xbf"  # some programs write it before the first letter
PARQUET_MAGIC = b"PAR1"
NO_TABLES = ("<", "{", "[")  # with which xml and json begin
SEPARATORS = (",", ";", "\t")


@dataclass(frozen=True)
class Header:
    """The line that names the columns of a csv.

    Attributes:
        names: of the columns, as the file spells them.
        separator: between two columns.
        lines: of the file up to and with the header.
    """

    names: tuple[str, ...]
    separator: str
    lines: int


@dataclass(frozen=True)
class Head:
    """The beginning of a file.

    Attributes:
        path: of the file.
        name: for messages; with the member's name where the file is an archive.
        text: its first 64 KB, uncompressed; nothing of a parquet file.
        names: of the columns of a parquet file or a csv with a header, as the file spells them; () of any other.
        metadata: of a parquet file.
        is_parquet: whether it is one.
    """

    path: Path
    name: str
    text: bytes = b""
    names: tuple[str, ...] = ()
    metadata: Mapping[str, str] = field(default_factory=dict)
    is_parquet: bool = False


def look(path: Path) -> Head:
    """Returns the beginning of a file.

    Raises:
        FormatError: the file is not there, or its archive or parquet form is damaged.
    """
    with open_source(path) as (name, stream):
        text = read_start(name, stream, size=SIZE)
    if text.startswith(PARQUET_MAGIC):
        return _look_at_parquet(path)
    header = find_header(text)
    return Head(path, name, text, header.names if header else ())


def plain(name: str) -> str:
    """Returns a column's name as names are compared: lower case, with underscores for hyphens and spaces."""
    return name.strip().strip('"').lower().replace("-", "_").replace(" ", "_")


def find_header(text: bytes) -> Header | None:
    """Returns the header of a csv that begins with the text, or None if its first line names no columns."""
    lines = text.removeprefix(BYTE_ORDER_MARK).split(b"\n")
    number = next((index for index, line in enumerate(lines) if line.strip()), None)
    if number is None:
        return None
    line = lines[number].decode("latin-1").rstrip("\r")
    separator = max(SEPARATORS, key=line.count)
    names = tuple(cell.strip().strip('"') for cell in line.split(separator))
    is_text = line.replace("\t", "").isprintable() and not line.lstrip().startswith(NO_TABLES)
    is_header = len(names) > 1 and is_text and not any(_is_number(name) for name in names)
    return Header(names, separator, number + 1) if is_header else None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _look_at_parquet(path: Path) -> Head:
    types, metadata = read_head(path)
    return Head(path, str(path), names=tuple(types), metadata=metadata, is_parquet=True)
