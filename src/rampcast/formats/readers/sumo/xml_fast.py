"""SUMO's floating car data as xml: read line by line as SUMO writes it, and with a real parser from the first line on
that is not so.

SUMO writes one element a line with its attributes in the same order, so a line is cells between quotes, which a csv
reader finds fast. What is not so (faults, other programs' files) goes to an event parser that builds no tree.
"""

import io
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import BufferedIOBase
from itertools import chain
from pathlib import Path

import numpy as np
import polars as pl
from jaxtyping import Float, Int

from rampcast.errors import FormatError
from rampcast.formats.files.sources import CHUNK, open_source, read_start
from rampcast.formats.files.xml_text import expect_root
from rampcast.formats.readers.sumo.xml_careful import (
    NO_VEHICLES,
    ROOT,
    TIME,
    Careful,
    Piece,
    Place,
    cut_off,
    fcd_schema,
)
from rampcast.formats.steps.clock import seconds
from rampcast.formats.tables.columns import Column, Rows
from rampcast.recording.reading import MOST_LISTED, BadRows

END = b"</fcd-export>"
VEHICLE, STEP, STEP_END = "<vehicle id=", "<timestep time=", "</timestep>"
FIRST_VEHICLE = re.compile(rb'^[ \t]*<vehicle id="[^\n]*$', re.MULTILINE)
LABEL = re.compile(r" ([A-Za-z_][\w.:-]*)=")  # what stands between two values: a blank, the next name and "="


def read_fcd_xml(path: Path, columns: Sequence[Column], bad_rows: BadRows) -> tuple[Rows, int]:
    """Returns the vehicles of a file (plain, .gz or in a .zip) with their `time` [s], and how many persons it has.

    Args:
        path: of the file.
        columns: the wanted attributes of a vehicle.
        bad_rows: whether a vehicle that is not as it should be is an error or is skipped and counted.

    Raises:
        FormatError: the file is not as SUMO's are, is cut off, or has a bad row and those are not to be skipped.
    """
    with open_source(path) as (name, stream):
        parts = list(_read(name, stream, columns, bad_rows))
    faults = tuple(fault for part in parts for fault in part.faults)[:MOST_LISTED]
    table = pl.concat([pl.DataFrame(schema=fcd_schema(columns)), *(part.table for part in parts)])
    rows = Rows(name, table, faults, sum(part.faults_counted for part in parts))
    if not table.height and faults:
        raise FormatError(f"{name}: none of its {rows.faults_counted:,} vehicles can be read. {faults[0]}")
    if not table.height:
        raise FormatError(f"{name}: there is no vehicle in it; was anything driving where SUMO wrote?")
    return rows, sum(part.others for part in parts)


def _read(name: str, stream: BufferedIOBase, columns: Sequence[Column], bad_rows: BadRows) -> Iterator[Piece]:
    blocks = _blocks(name, stream)
    first = next(blocks, b"")
    root = expect_root(name, first, ROOT)
    start, body = first[: root.end], first[root.end :]
    if start.endswith(b"/>"):
        return
    place = Place(start.count(b"\n") + 1)
    careful = None if root.is_utf8 else Careful(name, start, place, columns, bad_rows)
    for block in chain([body], blocks):
        found = _parse_fast(block, place, columns) if careful is None else None
        if found is not None:
            table, place = found
            yield table
            continue
        careful = careful or Careful(name, start, place, columns, bad_rows)
        yield careful.parse(block)
    if careful is not None:
        careful.close()
    elif not place.is_past_end:
        raise FormatError(cut_off(name, place.line))


def _blocks(name: str, stream: BufferedIOBase) -> Iterator[bytes]:
    """Yields the stream in blocks of whole lines; a file without line ends comes as it is read."""
    rest = b""
    while block := read_start(name, stream, size=CHUNK):
        whole, newline, rest_of_line = block.rpartition(b"\n")
        yield rest + (whole + newline if newline else block)
        rest = rest_of_line if newline else b""
    if rest:
        yield rest


@dataclass(frozen=True)
class _LineShape:
    """How the vehicles of a block are written: the cells that all lines share, and the index of each wanted value."""

    labels: Mapping[int, str]
    wanted: Mapping[int, Column]

    @property
    def size(self) -> int:
        return 2 * len(self.labels) - 1


def _shape(block: bytes, columns: Sequence[Column]) -> _LineShape | None:
    """Returns the shape of the block's first vehicle, or None if it is not as SUMO writes it."""
    line = FIRST_VEHICLE.search(block)
    if line is None:  # steps without vehicles
        return _LineShape({0: VEHICLE, 2: "/>"}, {1: columns[0]})
    labels = dict(enumerate(line[0].decode("utf-8", "replace").split('"')[::2]))
    names = ["id"]
    for index in range(1, len(labels) - 1):
        label = LABEL.fullmatch(labels[index])
        if label is None:
            return None
        names.append(label[1])
    if labels[len(labels) - 1] != "/>" or len(set(names)) < len(names):
        return None
    known = {spelling: column for column in columns for spelling in column.spellings}
    wanted = {2 * index + 1: known[name] for index, name in enumerate(names) if name in known}
    has_all = all(column.optional or column in wanted.values() for column in columns)
    return _LineShape({2 * index: label for index, label in labels.items()}, wanted) if has_all else None


def _parse_fast(block: bytes, place: Place, columns: Sequence[Column]) -> tuple[Piece, Place] | None:
    """Returns what a block of lines as SUMO writes them holds, and the place after it; None if anything is not so."""
    block = block.replace(b"\r\n", b"\n")
    body, end, tail = block.partition(END)
    lines = body.strip(b"\n").rstrip(b" \t\n")
    if place.is_past_end or tail.strip():
        return None if block.strip() else (Piece(pl.DataFrame(schema=fcd_schema(columns))), place)
    shape = _shape(body, columns)
    table = _read_lines(lines, shape) if shape is not None else None
    found = _vehicles(table, shape, place, columns) if shape is not None and table is not None else None
    if found is None:
        return None
    vehicles, others, time = found
    if end and time is not None:
        return None
    return Piece(vehicles, others), Place(place.line + block.count(b"\n"), time, bool(end))


def _read_lines(lines: bytes, shape: _LineShape) -> pl.DataFrame | None:
    """Returns the cells between the quotes of each line, or None if a line is not one element."""
    count = lines.count(b"\n") + 1 if lines else 0
    if lines.count(b"<") != count or b"&" in lines or b"\0" in lines:
        return None
    names = [f"{index}" for index in range(shape.size)]
    types = {names[index]: column.type for index, column in shape.wanted.items()}
    try:
        table = pl.read_csv(
            io.BytesIO('"'.join(names).encode() + b"\n" + lines),
            separator='"',
            quote_char=None,
            columns=sorted({*shape.labels, *shape.wanted, 1}),
            schema=dict.fromkeys(names, pl.String()) | types | {"1": pl.String()},
        )
    except pl.exceptions.PolarsError:
        return None
    return table if table.height == count else None


def _vehicles(
    table: pl.DataFrame, shape: _LineShape, place: Place, columns: Sequence[Column]
) -> tuple[pl.DataFrame, int, float | None] | None:
    """Returns the vehicles, the number of persons, and the time of the step that is open at the end; None if odd."""
    first = pl.col("0") == shape.labels[0]
    table = table.with_row_index("line").with_columns(first.fill_null(False).alias("is_vehicle"))
    vehicles, rest = table.filter("is_vehicle"), table.filter(~pl.col("is_vehicle"))
    same = vehicles.select(
        pl.col(f"{index}").eq_missing(pl.lit(label)).all() for index, label in shape.labels.items() if index
    )
    tag = rest["0"].str.strip_chars_start(" \t")
    steps = _steps(rest, tag, place)
    others = int(tag.is_in([f"<{name} id=" for name in NO_VEHICLES]).sum())
    if steps is None or not all(same.row(0)) or len(steps[0]) - 1 + others != rest.height:
        return None
    starts, times = steps
    inside = times[np.searchsorted(starts, vehicles["line"].to_numpy(), side="right") - 1]
    found = vehicles.select(pl.Series(TIME, inside), *_values(shape, columns))
    if np.isnan(inside).any() or _breaks_rules(found, shape.wanted.values()):
        return None
    return found, others, None if np.isnan(times[-1]) else float(times[-1])


def _values(shape: _LineShape, columns: Sequence[Column]) -> Iterator[pl.Expr]:
    places = {column.name: f"{index}" for index, column in shape.wanted.items()}
    for column in columns:
        cell = pl.col(places[column.name]) if column.name in places else pl.lit(None)
        yield cell.cast(column.type).alias(column.name)


def _steps(
    rest: pl.DataFrame, tag: pl.Series, place: Place
) -> tuple[Int[np.ndarray, "step"], Float[np.ndarray, "step"]] | None:
    """Returns the lines from which on a time holds, and these times [s], NaN outside of steps; None if steps overlap.

    The first entry is where the block begins.
    """
    marks = rest.filter(tag.is_in([STEP, STEP_END]))
    is_start = marks["0"].str.contains(STEP, literal=True).to_numpy()
    is_whole = (marks["2"] == "/>").fill_null(False).to_numpy()
    has_more = is_start & ~is_whole & (marks["2"] != ">").fill_null(True).to_numpy()
    is_open = [place.time is not None, *(is_start & ~is_whole).tolist()]
    if has_more.any() or any(a == b for a, b in zip(is_start.tolist(), is_open[:-1], strict=True)):
        return None
    try:
        texts = marks["1"].fill_null("")
        times = [seconds(text) if start else np.nan for text, start in zip(texts, is_start.tolist(), strict=True)]
    except ValueError:
        return None
    before = np.nan if place.time is None else place.time
    times = [time if inside else np.nan for time, inside in zip([before, *times], is_open, strict=True)]
    return np.array([-1, *marks["line"]], np.int64), np.array(times, float)


def _breaks_rules(found: pl.DataFrame, columns: Iterable[Column]) -> bool:
    checks = [pl.lit(False)]
    for column in columns:
        cell = pl.col(column.name)
        if not column.may_be_blank:
            checks.append(cell.has_nulls() if not column.is_text else (cell.has_nulls() | (cell == "").any()))
        if not column.is_text:
            checks.append((~cell.is_finite()).any() | (cell.min() < column.low) | (cell.max() > column.high))
    return any(found.select(check.fill_null(False).alias(f"{index}") for index, check in enumerate(checks)).row(0))
