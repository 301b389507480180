"""Parquet files that others may have damaged: read, or refused with what is wrong and never with a library's error."""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import polars as pl

from rampcast.errors import FormatError

# A damaged file can make polars panic, which is no Exception.
DAMAGED = (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError, ValueError, OverflowError)
SHOWN = 200  # letters of the library's message that are shown
THREAD = re.compile(r"Id\(\d+\), ")  # of a panic: another number each time
MANY = 1_000_000  # rows: with more of them a file is suspected to be made to fill the memory
DENSEST = 2  # rows in a byte of a file that are believed; recordings have one in 10 bytes


def read_head(path: Path) -> tuple[dict[str, Any], dict[str, str]]:
    """Returns the types of a parquet file's columns by their names, and its metadata.

    Raises:
        FormatError: the file is damaged.
    """
    with refusing_damage(path):
        return dict(pl.read_parquet_schema(path)), pl.read_parquet_metadata(path)


def read_table(path: Path, columns: Sequence[str] | None = None) -> pl.DataFrame:
    """Returns the rows of a parquet file.

    Args:
        path: of the file.
        columns: names of those to read; None reads all.

    Raises:
        FormatError: the file is damaged, or claims more rows than it can hold.
    """
    with refusing_damage(path):
        rows = int(pl.scan_parquet(path).select(pl.len()).collect().item())
        size = path.stat().st_size
    if rows > MANY and rows > DENSEST * size:
        raise FormatError(
            f"{path}: expected {DENSEST} rows a byte at most, found {rows:,} rows in {size:,} bytes. Is it damaged, or "
            "made to fill the memory?"
        )
    with refusing_damage(path):
        return pl.read_parquet(path, columns=None if columns is None else list(columns))


@contextmanager
def refusing_damage(path: Path) -> Iterator[None]:
    """Turns what a library says of a damaged file into a FormatError that names the file."""
    try:
        yield
    except DAMAGED as error:
        reason = THREAD.sub("", next(iter(str(error).splitlines()), ""))[:SHOWN]
        raise FormatError(f"{path}: a damaged parquet file ({reason}); get the file again") from error
