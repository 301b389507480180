"""The body of a chunk as csv that polars reads: text is cut at its blank columns, or else its spaces are squeezed."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Int, UInt8

from rampcast.formats.readers.ngsim.layout import Layout


@dataclass(frozen=True)
class Body:
    """Rows as csv.

    Attributes:
        text: the rows.
        layout: of the text; fewer columns than in the file where the text was cut.
        rows: number of rows.
        lines: number of lines of the chunk, blank ones among them.
        is_whole: False if a row may have too few columns.
    """

    text: bytes
    layout: Layout
    rows: int
    lines: int
    is_whole: bool


def body_of(chunk: bytes, layout: Layout) -> Body:
    """Returns a chunk of whole lines as csv."""
    if layout.separator == " ":
        return _cut(chunk, layout) or _counted(chunk, _single_spaces(chunk, layout), layout)
    return _counted(chunk, chunk.strip(b"\r\n"), layout)


def _counted(chunk: bytes, text: bytes, layout: Layout) -> Body:
    """Returns a body whose separators are counted; with quotes in it that says nothing."""
    letters = np.frombuffer(text, np.uint8)
    rows = _count(letters, "\n") + 1 if text else 0
    is_whole = b'"' in text or _count(letters, layout.separator) == rows * (len(layout.names) - 1)
    return Body(text, layout, rows, _count(np.frombuffer(chunk, np.uint8), "\n"), is_whole)


def _count(letters: UInt8[np.ndarray, "letter"], letter: str) -> int:
    return int(np.count_nonzero(letters == ord(letter)))


def _cut(chunk: bytes, layout: Layout) -> Body | None:
    """Returns the wanted columns of lines whose columns stand below each other, or None where they do not.

    A column of bytes that is blank in every line parts two columns of numbers. Numbers keep their leading spaces, which
    polars allows.
    """
    width = chunk.find(b"\n") + 1
    letters = np.frombuffer(chunk, np.uint8)
    if not width or len(letters) % width or _count(letters, "\n") * width != len(letters):
        return None
    table = letters.reshape(-1, width)
    ink = np.concatenate([[False], table.max(axis=0) > ord(" "), [False]])
    starts, ends = (np.flatnonzero(edge) for edge in (~ink[:-1] & ink[1:], ink[:-1] & ~ink[1:]))
    if len(ends) != len(layout.names) or not _cells_are_words(table[-1], ends):
        return None
    wanted = [index for index, name in enumerate(layout.names) if name in layout.wanted]
    columns = [np.arange(starts[index], ends[index] + 1) for index in wanted]  # each with the blank behind it
    cells = np.take(table, np.concatenate(columns), axis=1)
    cells[:, np.cumsum([len(column) for column in columns]) - 1] = ord(",")
    cells[:, -1] = ord("\n")
    names = tuple(layout.names[index] for index in wanted)
    return Body(cells.tobytes(), replace(layout, separator=",", names=names), len(table), len(table), is_whole=True)


def _cells_are_words(line: UInt8[np.ndarray, "letter"], ends: Int[np.ndarray, "column"]) -> bool:
    cells = [part.tobytes() for part in np.split(line, ends)[:-1]]
    return [cell.strip() for cell in cells] == line.tobytes().split()


def _single_spaces(chunk: bytes, layout: Layout) -> bytes:
    """Returns the lines with one space between columns and none at their ends."""
    if b"\t" in chunk or b"\r" in chunk:
        chunk = chunk.replace(b"\t", b" ").replace(b"\r", b" ")
    letters = np.frombuffer(chunk, np.uint8)
    ink, ends = letters > ord(" "), letters == ord("\n")
    keep = ink.copy()
    keep[1:] |= ink[:-1]  # the first space after a column ...
    keep[:-1] &= ink[:-1] | ~ends[1:]  # ... unless it ends the line
    keep |= ends
    lines = letters[keep].tobytes().strip(b" \n")
    if lines.count(b" ") != (lines.count(b"\n") + 1) * (len(layout.names) - 1):  # slow, and seldom needed
        lines = lines.replace(b" \n", b"\n")
    return lines
