"""Text whose columns are parted by blanks as csv: cut at the columns of blanks, or else with one space between."""

from dataclasses import replace

import numpy as np
from jaxtyping import Int, UInt8

from rampcast.formats.tables.columns import Layout


def as_csv(text: bytes, layout: Layout) -> tuple[bytes, Layout]:
    """Returns whole lines as csv and the layout of that; unwanted columns may be absent."""
    return _cut(text, layout) or (_single_spaces(text, layout), layout)


def _cut(text: bytes, layout: Layout) -> tuple[bytes, Layout] | None:
    """Returns the wanted columns of lines whose columns stand below each other, or None where they do not.

    A column of bytes that is blank in every line parts two columns of numbers. Numbers keep their leading spaces, which
    polars allows.
    """
    width = text.find(b"\n") + 1
    letters = np.frombuffer(text, np.uint8)
    if not width or len(letters) % width:
        return None
    table = letters.reshape(-1, width)
    ends = letters == ord("\n")
    if not ends[width - 1 :: width].all() or np.count_nonzero(ends) != len(table):
        return None
    ink = np.concatenate([[False], table.max(axis=0) > ord(" "), [False]])
    starts, ends = (np.flatnonzero(edge) for edge in (~ink[:-1] & ink[1:], ink[:-1] & ~ink[1:]))
    if len(ends) != len(layout.header.names) or not _cells_are_words(table[-1], ends):
        return None
    columns = [np.arange(starts[index], ends[index] + 1) for index, _ in layout.wanted]  # each with the blank behind it
    cells = np.take(table, np.concatenate(columns), axis=1)
    cells[:, np.cumsum([len(column) for column in columns]) - 1] = ord(",")
    cells[:, -1] = ord("\n")
    names = tuple(layout.header.names[index] for index, _ in layout.wanted)
    wanted = tuple(enumerate(column for _, column in layout.wanted))
    header = replace(layout.header, names=names, separator=",")
    return cells.tobytes(), replace(layout, header=header, wanted=wanted)


def _cells_are_words(line: UInt8[np.ndarray, "letter"], ends: Int[np.ndarray, "column"]) -> bool:
    cells = [part.tobytes() for part in np.split(line, ends)[:-1]]
    return [cell.strip() for cell in cells] == line.tobytes().split()


def _single_spaces(text: bytes, layout: Layout) -> bytes:
    """Returns the lines with one space between columns and none at their ends."""
    if b"\t" in text or b"\r" in text:
        text = text.replace(b"\t", b" ").replace(b"\r", b" ")
    letters = np.frombuffer(text, np.uint8)
    ink, ends = letters > ord(" "), letters == ord("\n")
    keep = ink.copy()
    keep[1:] |= ink[:-1]  # the first space after a column ...
    keep[:-1] &= ink[:-1] | ~ends[1:]  # ... unless it ends the line
    keep |= ends
    lines = letters[keep].tobytes().strip(b" \n")
    if lines.count(b" ") != (lines.count(b"\n") + 1) * (len(layout.header.names) - 1):  # slow, and seldom needed
        lines = lines.replace(b" \n", b"\n")
    return lines
