"""SUMO's floating car data as xml, element by element: the careful way, which finds each bad row and its line."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import polars as pl
from lxml import etree

from rampcast.errors import FormatError
from rampcast.formats.files.xml_text import first_error
from rampcast.formats.steps.clock import seconds
from rampcast.formats.tables.columns import SHOWN, Column, advice, read_cell
from rampcast.recording.reading import MOST_LISTED, BadRow, BadRows

ROOT = "fcd-export"
TIME = "time"
DEEPEST = 20  # elements in each other; SUMO has four
PIECE = 64 << 10  # [bytes] of a line that are parsed at a time
LARGEST = 1 << 20  # [bytes] without a start tag; SUMO's own elements have some 200
NO_VEHICLES = ("person", "container")


@dataclass(frozen=True)
class Place:
    """Where the reader is: line, time [s] of the step that it is in (None outside of one), whether past the root."""

    line: int
    time: float | None = None
    is_past_end: bool = False


@dataclass(frozen=True)
class Piece:
    """What a piece of the file holds: vehicles, how many others, bad rows (the first 100), and how many of these."""

    table: pl.DataFrame
    others: int = 0
    faults: tuple[BadRow, ...] = ()
    faults_counted: int = 0


def fcd_schema(columns: Sequence[Column]) -> dict[str, Any]:
    """Returns the schema of the vehicles' table: the time and the wanted attributes."""
    return {TIME: pl.Float64()} | {column.name: column.type for column in columns}


class Careful:
    """Parses the rest of a file, whatever its lines are, and keeps the place; nothing of it stays in memory."""

    def __init__(self, name: str, start: bytes, place: Place, columns: Sequence[Column], bad_rows: BadRows) -> None:
        """Begins at a place.

        Args:
            name: of the file.
            start: of the file, up to and with the start tag of its root.
            place: from which it is to parse.
            columns: the wanted attributes of a vehicle.
            bad_rows: what to do with a bad row.
        """
        self._name = name
        self._elements = _Elements(name, columns, bad_rows)
        self._parser = etree.XMLParser(
            target=self._elements, resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False
        )
        self._feed(start)
        if place.time is not None:
            self._feed(f'<timestep time="{place.time!r}">'.encode())
        if place.is_past_end:
            self._feed(f"</{ROOT}>".encode())
        self._elements.line = place.line

    def parse(self, block: bytes) -> Piece:
        """Returns what the next bytes hold.

        Raises:
            FormatError: they are not well-formed xml, or have a bad row and those are not to be skipped.
        """
        for line in block.splitlines(keepends=True):
            for start in range(0, len(line), PIECE):
                self._feed(line[start : start + PIECE])
            self._elements.line += line.endswith(b"\n")
        return self._elements.take()

    def close(self) -> None:
        """Ends the file.

        Raises:
            FormatError: it ends before its root does.
        """
        try:
            self._parser.close()
        except etree.XMLSyntaxError as error:
            raise FormatError(cut_off(self._name, self._elements.line)) from error

    def _feed(self, text: bytes) -> None:
        self._elements.silent += len(text)
        if self._elements.silent > LARGEST:
            raise FormatError(
                f"{self._name}, line {self._elements.line}: more than {LARGEST:,} bytes without an element; expected "
                "<timestep> and <vehicle>. Is this SUMO's floating car data?"
            )
        try:
            self._parser.feed(text)
        except etree.XMLSyntaxError as error:
            _, reason = first_error(self._parser, error)  # its lines count from where this parser began
            raise FormatError(
                f"{self._name}, line {self._elements.line}: not well-formed xml ({reason}); mend it or get it again"
            ) from error


def cut_off(name: str, line: int) -> str:
    """Returns the message for a file that ends too early."""
    return (
        f"{name}, line {line}: the file ends before </{ROOT}>: it is cut off, or SUMO was stopped before its end. Get "
        f"it again, or close what is open at its end (</timestep></{ROOT}>)"
    )


class _Elements:
    """What the parser tells: vehicles are kept until `take`; `line` is set by who feeds the parser."""

    def __init__(self, name: str, columns: Sequence[Column], bad_rows: BadRows) -> None:
        self.line = 1
        self._depth = 0  # of elements in each other
        self.silent = 0  # bytes since the last start tag, counted by who feeds the parser
        self._name = name
        self._columns = columns
        self._bad_rows = bad_rows
        self._time: float | str | None = None  # text if it is no time, None outside of time steps
        self._clear()

    def _clear(self) -> None:
        self._values: dict[str, list[float | int | str | None]] = {name: [] for name in fcd_schema(self._columns)}
        self._faults: list[BadRow] = []
        self._faults_counted = 0
        self._others = 0

    def take(self) -> Piece:
        """Returns what was found since it was last asked."""
        table = pl.DataFrame(self._values, schema=fcd_schema(self._columns))
        found = Piece(table, self._others, tuple(self._faults), self._faults_counted)
        self._clear()
        return found

    def start(self, tag: str, attributes: Mapping[str, str], _namespaces: object = None) -> None:
        """Is told of a start tag."""
        self.silent = 0
        self._depth += 1
        if self._depth > DEEPEST:
            raise FormatError(
                f"{self._name}, line {self.line}: elements in elements, {self._depth} deep; expected <{ROOT}>, "
                "<timestep> and <vehicle>. Get the file again"
            )
        if tag == "timestep":
            self._time = _time(attributes.get("time", ""))
        elif tag == "vehicle":
            self._vehicle(attributes)
        elif tag in NO_VEHICLES:
            self._others += 1

    def end(self, tag: str) -> None:
        """Is told of an end tag."""
        self._depth -= 1
        if tag == "timestep":
            self._time = None

    def close(self) -> None:
        """Is told of the end of the file."""

    def _vehicle(self, attributes: Mapping[str, str]) -> None:
        row: dict[str, float | int | str | None] = {}
        reason = _time_fault(self._time)
        for column in self._columns:
            if not reason:
                row[column.name], reason = _value(attributes, column)
        if not reason:
            for name, value in ({TIME: self._time} | row).items():
                self._values[name].append(value)
            return
        fault = BadRow(self._name, self.line, 0, f"vehicle '{attributes.get('id', '')[:SHOWN]}': {reason}")
        if self._bad_rows is BadRows.RAISE:
            raise FormatError(advice(fault))
        self._faults_counted += 1
        if len(self._faults) < MOST_LISTED:
            self._faults.append(fault)


def _time(text: str) -> float | str:
    try:
        return seconds(text)
    except ValueError:
        return text


def _time_fault(time: float | str | None) -> str:
    if time is None:
        return "expected it inside of a <timestep>, found it outside"
    if isinstance(time, str):
        return f"expected seconds or hours:minutes:seconds as time of its <timestep>, found '{time[:SHOWN]}'"
    return ""


def _value(attributes: Mapping[str, str], column: Column) -> tuple[float | int | str | None, str]:
    """Returns the value of an attribute and "", or None and what is wrong with it."""
    name = next((name for name in column.spellings if name in attributes), None)
    if name is None:
        return None, "" if column.optional else f"no attribute '{column.spellings[0]}'"
    value, reason = read_cell(attributes[name].strip(), column)
    return value, f"{name}: {reason}" if reason else ""
