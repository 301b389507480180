"""Tables as json: an array of flat objects, one a row, as the APIs of data portals answer."""

import json
from pathlib import Path
from typing import Any

import polars as pl

from rampcast.errors import FormatError
from rampcast.formats.files.json_array import DECODER, SPACES, read_array

LOOKED_AT = 50  # objects whose keys name the columns: a portal leaves out keys of blank cells


def record_names(text: bytes) -> tuple[str, ...]:
    """Returns the keys of the first objects of an array that begins with the text; () where it is no such array."""
    letters = text.decode("utf-8-sig", "ignore")
    place = _past(letters, 0)
    if letters[place : place + 1] != "[":
        return ()
    names: dict[str, None] = {}
    for _ in range(LOOKED_AT):
        try:
            record, place = DECODER.raw_decode(letters, _past(letters, place + 1))
        except (ValueError, RecursionError):  # also where the text is cut off
            break
        if not isinstance(record, dict) or any(isinstance(one, list | dict) for one in record.values()):
            return ()
        names |= dict.fromkeys(record)
        place = _past(letters, place)
        if letters[place : place + 1] != ",":
            break
    return tuple(names) if len(names) > 1 else ()


def records_table(path: Path) -> pl.DataFrame:
    """Returns the rows of a file that is an array of flat objects, all cells as text; what an object lacks is null.

    Raises:
        FormatError: the file is malformed or cut off, or an element is no flat object.
    """
    rows = [_cells(name, number, record) for number, (name, record) in enumerate(read_array(path, element="row"), 1)]
    names = dict.fromkeys(name for row in rows for name in row)
    return pl.DataFrame(
        {name: [row.get(name) for row in rows] for name in names}, schema=dict.fromkeys(names, pl.String)
    )


def _cells(name: str, number: int, record: Any) -> dict[str, str | None]:
    if not isinstance(record, dict) or any(isinstance(one, list | dict) for one in record.values()):
        raise FormatError(f"{name}, row {number}: expected an object of numbers and texts; get the table again, as csv")
    return {key: one if one is None or isinstance(one, str) else json.dumps(one) for key, one in record.items()}


def _past(text: str, place: int) -> int:
    """Returns the place behind spaces."""
    spaces = SPACES.match(text, place)
    return spaces.end() if spaces else place
