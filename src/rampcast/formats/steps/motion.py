"""Directions of travel told from positions, for sources that give vehicles no heading."""

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from rampcast.recording import columns as c
from rampcast.recording.order import in_order, is_sorted, track_starts
from rampcast.roads.plane import PX, PY

BLOCK = 1 << 15  # rows done at once: their arrays fit the cache of a core
AROUND = 0.5  # [s] before and after a moment between which its direction is taken: a lane change takes 3 s and more
MOST_PLACES = 100_000  # with a known direction that are looked through for a vehicle that never moves
MOVED = 2.0  # [m] in that time at which a vehicle moves; below, noise of a decimetre would turn it by several degrees

Row = Float[np.ndarray, "row"]
Track = Int[np.ndarray, "row"]


def with_fronts(rows: pl.DataFrame, *, time_step: float) -> pl.DataFrame:
    """Returns rows of a plane whose positions are vehicles' centres, sorted, with the front centres for these.

    The front is half a length ahead of the centre in the direction of travel.

    Args:
        rows: columns of `PLANE_SCHEMA`, or those that are needed.
        time_step: between two frames [s].
    """
    rows = rows if is_sorted(rows) else rows[in_order(rows)]
    track = np.zeros(rows.height, np.int64)
    track[track_starts(rows, slice(None))] = 1
    ux, uy = directions(np.cumsum(track), rows[PX].to_numpy(), rows[PY].to_numpy(), time_step=time_step)
    half = rows[c.LENGTH].to_numpy() / 2
    return rows.with_columns(pl.col(PX) + pl.Series(ux * half), pl.col(PY) + pl.Series(uy * half))


def directions(track: Track, px: Row, py: Row, *, time_step: float) -> tuple[Row, Row]:
    """Returns the unit vectors of the direction of travel; a vehicle that stands keeps its last one, or has its next.

    A vehicle that never moves has that of whoever was nearest to its place; if nothing moves at all, (0, 0).

    Args:
        track: number of the row's track; rows of a track follow each other in time.
        px, py: positions of a point of the vehicle [m].
        time_step: between two rows of a track [s].
    """
    first, last = _ends(track)
    around = max(round(AROUND / time_step), 1)
    ux, uy, distance = np.empty((3, len(track)))
    for start in range(0, len(track), BLOCK):
        part = slice(start, start + BLOCK)
        row = np.arange(start, min(start + BLOCK, len(track)))
        behind, ahead = np.maximum(row - around, first[part]), np.minimum(row + around, last[part])
        dx, dy = px[ahead] - px[behind], py[ahead] - py[behind]
        distance[part] = np.hypot(dx, dy)
        length = np.maximum(distance[part], MOVED)
        ux[part], uy[part] = dx / length, dy / length
    moves = distance >= MOVED
    if moves.all():
        return ux, uy
    known = _nearest_known(moves, first, last)
    return _of_neighbours(known >= 0, px, py, ux[known], uy[known])


def _of_neighbours(known: Bool[np.ndarray, "row"], px: Row, py: Row, ux: Row, uy: Row) -> tuple[Row, Row]:
    """Returns the unit vectors with those that are not known from the nearest place where one is."""
    if known.all():
        return ux, uy
    if not known.any():
        return np.zeros(len(px)), np.zeros(len(py))
    places = np.flatnonzero(known)
    places = places[:: max(len(places) // MOST_PLACES, 1)]
    tree = cKDTree(np.stack([px[places], py[places]], axis=1))
    _, nearest = tree.query(np.stack([px[~known], py[~known]], axis=1))
    nearest = places[nearest]
    ux[~known], uy[~known] = ux[nearest], uy[nearest]
    return ux, uy


def _ends(track: Track) -> tuple[Int[np.ndarray, "row"], Int[np.ndarray, "row"]]:
    """Returns the first and the last row of each row's track."""
    starts = np.flatnonzero(np.r_[True, track[1:] != track[:-1]]) if len(track) else np.zeros(0, np.int64)
    lengths = np.diff(np.r_[starts, len(track)])
    return np.repeat(starts, lengths), np.repeat(starts + lengths - 1, lengths)


def _nearest_known(moves: np.ndarray, first: np.ndarray, last: np.ndarray) -> Int[np.ndarray, "row"]:
    """Returns the row of the same track that tells the direction: the last that moves, else the next; -1 if none."""
    known = np.arange(len(moves))
    moving, still = np.flatnonzero(moves), np.flatnonzero(~moves)
    place = np.searchsorted(moving, still)
    around = np.r_[-1, moving, len(moves)]
    before, after = around[place], around[place + 1]
    known[still] = np.where(before >= first[still], before, np.where(after <= last[still], after, -1))
    return known
