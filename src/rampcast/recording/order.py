"""One row a part, vehicle and frame: sorts rows and removes those that come a second time."""

import numpy as np
import polars as pl
from jaxtyping import Int

from rampcast.recording import columns as c

FEW = 10_000  # rows from the beginning that mostly tell that a table is not sorted


def sorted_unique(rows: pl.DataFrame) -> tuple[pl.DataFrame, int, int]:
    """Returns the first row of each part, vehicle and frame, sorted; how many were removed; how many of these differ.

    The part is the column `recording`.
    """
    key = [c.RECORDING, c.VEHICLE, c.FRAME]
    if is_sorted(rows):  # most files are: nothing to do
        return rows, 0, 0
    rows = rows[in_order(rows)]
    if is_sorted(rows):
        return rows, 0, 0
    unique = rows.unique(key, keep="first", maintain_order=True)
    removed = rows.height - unique.height
    differing = rows.unique([*key, c.X, c.Y, c.LANE]).height - unique.height if removed else 0
    return unique, removed, differing


def in_order(rows: pl.DataFrame) -> Int[np.ndarray, "row"]:
    """Returns the order of parts, vehicles and frames; rows sorted by time are sorted so several times faster."""
    vehicle, frame = rows[c.VEHICLE].to_numpy(), rows[c.FRAME].to_numpy()
    is_small = vehicle.min(initial=0) >= 0 and vehicle.max(initial=0) <= np.iinfo(np.uint16).max
    if is_small and (frame[1:] >= frame[:-1]).all():  # numbers of 16 bits are sorted many times faster
        order = np.argsort(vehicle.astype(np.uint16), kind="stable")
    else:
        order = np.argsort((vehicle.astype(np.int64) << 32) + frame, kind="stable")
    if rows[c.RECORDING].n_unique() > 1:
        parts = rows[c.RECORDING].cast(pl.String).rank("dense").to_numpy()
        order = order[np.argsort(parts[order], kind="stable")]
    return order


def track_starts(rows: pl.DataFrame, order: Int[np.ndarray, "row"] | slice) -> Int[np.ndarray, "track"]:
    """Returns where in the order, that of `in_order` or none, the rows of each part's vehicles begin."""
    if rows.is_empty():
        return np.zeros(0, np.int64)
    part, vehicle = (rows[name].to_physical().to_numpy()[order] for name in (c.RECORDING, c.VEHICLE))
    return np.flatnonzero(np.r_[True, (part[1:] != part[:-1]) | (vehicle[1:] != vehicle[:-1])])


def is_sorted(rows: pl.DataFrame) -> bool:
    """Returns whether parts, in them vehicles, and of these frames only grow."""
    return (rows.height <= FEW or _is_sorted(rows.head(FEW))) and _is_sorted(rows)


def _is_sorted(rows: pl.DataFrame) -> bool:
    runs = rows[c.RECORDING].rle().struct.unnest()
    parts = runs["value"].cast(pl.String)
    vehicle, frame = rows[c.VEHICLE].to_numpy(), rows[c.FRAME].to_numpy()
    grows = vehicle[1:] > vehicle[:-1]
    grows |= (vehicle[1:] == vehicle[:-1]) & (frame[1:] > frame[:-1])
    starts = runs["len"].cum_sum().to_numpy()[:-1]  # of all parts but the first
    grows[starts - 1] = True
    return parts.is_sorted() and parts.is_unique().all() and bool(grows.all())
