"""One row a vehicle and frame: sorts rows and removes those that come a second time."""

import numpy as np
import polars as pl

from rampcast.recording import columns as c


def sorted_unique(rows: pl.DataFrame) -> tuple[pl.DataFrame, int, int]:
    """Returns the first row of each vehicle and frame, sorted; how many were removed; how many of these differ."""
    key = [c.VEHICLE, c.FRAME]
    order = rows[c.VEHICLE].to_numpy().astype(np.int64) << 32 | rows[c.FRAME].to_numpy()
    steps = np.diff(order)
    if (steps > 0).all():  # the text files are sorted: nothing to do
        return rows, 0, 0
    rows = rows.sort(key, maintain_order=True)
    unique = rows.unique(key, keep="first", maintain_order=True)
    removed = rows.height - unique.height
    differing = rows.unique([*key, c.X, c.Y, c.LANE]).height - unique.height if removed else 0
    return unique, removed, differing
