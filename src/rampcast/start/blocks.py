"""Rows that hold several vehicles, as x_1, y_1, x_2, y_2: one below the other, and how each names its columns."""

import re
from typing import Final

import polars as pl

from rampcast.start.names import columns_named

PATTERNS: Final = (
    re.compile(r"^(?P<base>.*?[A-Za-z])[_ .]?(?P<number>\d+)$"),
    re.compile(r"^(?:car|veh|vehicle|obj|object|track|target)?[_ ]?(?P<number>\d+)[_ .](?P<base>[A-Za-z].*)$"),
)
LEAST: Final = 2  # vehicles in a row, to be several


def blocks_of(table: pl.DataFrame) -> tuple[pl.DataFrame, list[tuple[str, dict[str, str]]]]:
    """Returns a table with one vehicle a row, and how each vehicle's columns are called; none where rows hold one.

    The column `vehicle of the row` is the number of the vehicle in its row, where no column is its id.
    """
    for pattern in PATTERNS:
        groups: dict[str, dict[str, str]] = {}
        for name in table.columns:
            if match := pattern.match(name):
                groups.setdefault(match["number"], {})[match["base"].strip("_ .")] = name
        first = next(iter(groups.values()), {})
        is_place = (columns_named("x", [*first]) and columns_named("y", [*first])) or columns_named(
            "latitude", [*first]
        )
        if len(groups) < LEAST or not is_place:
            continue
        groups = {number: of for number, of in groups.items() if of.keys() == first.keys()}
        own = {name for of in groups.values() for name in of.values()}
        shared = [name for name in table.columns if name not in own]
        parts = [
            table.select(
                *shared,
                *(pl.col(name).alias(base) for base, name in of.items()),
                *([] if "vehicle" in of else [pl.lit(number).alias("vehicle")]),
            )
            for number, of in groups.items()
        ]
        return pl.concat(parts, how="vertical_relaxed"), list(groups.items())
    return table, []
