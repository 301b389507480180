"""A thin sample of the trajectories in a plane: enough to draft roads from, whatever the size of the recording."""

import math
from dataclasses import dataclass, replace

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int

from rampcast.recording import columns as c
from rampcast.recording.cutting import FASTEST, NOISE
from rampcast.recording.order import in_order, is_sorted, track_starts
from rampcast.recording.smoothing import SHORTEST_TRACK
from rampcast.roads.plane import PX, PY, ROAD, SOURCE_LANE, Plane

KEY = (c.RECORDING, c.VEHICLE)
INTERVAL = 0.5  # [s] between two rows of a track in the sample; a fast vehicle moves 20 m in it
MOST = 400_000  # rows of a sample
EMPTY = 50.0  # [m] in which a road that is seen has somebody sometime; else strays are looked for
STANDS = 0.5  # [m] a piece of a track that moves less is at a place that stands for none
HARDLY = 10.0  # [m] a track that covers less tells no direction: two lengths of a car


@dataclass(frozen=True)
class Sample:
    """Some rows of every track, its first and its last among them, sorted by track and time.

    Attributes:
        track: number of the track that a point belongs to; every track has a point.
        time: [s].
        px, py: front centre in the plane [m].
        lane: the source's name of the lane; null where it has none.
        speed: as the source gives it [m/s]; null where it does not.
        road: of each track: the source's name of the road; null where it has none.
        tracks: of each track: recording and vehicle.
    """

    track: Int[np.ndarray, "point"]
    time: Float[np.ndarray, "point"]
    px: Float[np.ndarray, "point"]
    py: Float[np.ndarray, "point"]
    lane: pl.Series
    speed: pl.Series
    road: pl.Series
    tracks: pl.DataFrame

    @property
    def size(self) -> int:
        """Returns how many tracks there are."""
        return self.tracks.height

    @property
    def extent(self) -> Float[np.ndarray, "track"]:
        """Returns how far apart the corners of each track are [m]: unlike its path, noise does not add to it."""
        starts = np.flatnonzero(np.r_[True, np.diff(self.track) > 0])
        spans = [np.maximum.reduceat(p, starts) - np.minimum.reduceat(p, starts) for p in (self.px, self.py)]
        return np.hypot(*spans)

    def of_tracks(self, chosen: Bool[np.ndarray, "track"]) -> Bool[np.ndarray, "point"]:
        """Returns which points belong to the chosen tracks."""
        return chosen[self.track]


def without_strays(plane: Plane) -> Plane:
    """Returns the plane without rows to which no vehicle can have driven: places that are not known, written as 0, 0.

    Of a track that jumps, the piece with the most rows is kept, if it has some, and others of some rows that move. A
    single stray row, kilometres away, would make the longest way of all and draw the road.
    """
    rows = plane.rows
    if not any(_has_gap(rows[name].to_numpy()) for name in (PX, PY)):
        return plane
    order = slice(None) if is_sorted(rows) else in_order(rows)
    px, py = (rows[name].to_numpy()[order] for name in (PX, PY))
    elapsed = np.diff(rows[c.FRAME].to_numpy()[order].astype(float)) * plane.time_step
    jumps = np.r_[False, np.hypot(np.diff(px), np.diff(py)) > NOISE + FASTEST * np.abs(elapsed)]
    starts = track_starts(rows, order)
    jumps[starts] = False
    if not jumps.any():
        return plane
    edges = np.flatnonzero(jumps | np.isin(np.arange(rows.height), starts))
    size = np.diff(np.r_[edges, rows.height])
    moves = np.maximum(*(np.maximum.reduceat(p, edges) - np.minimum.reduceat(p, edges) for p in (px, py))) > STANDS
    piece = pl.DataFrame({"size": size, "track": np.searchsorted(starts, edges, "right")})
    is_longest = (pl.col("size").arg_max() == pl.int_range(pl.len())) | (pl.col("size").max() < SHORTEST_TRACK)
    is_kept = piece.select(is_longest.over("track")).to_series().to_numpy() | ((size >= SHORTEST_TRACK) & moves)
    kept = np.repeat(is_kept, size)
    places = np.flatnonzero(kept) if isinstance(order, slice) else np.sort(order[kept])
    return replace(plane, rows=rows[places])


def _has_gap(places: Float[np.ndarray, "row"]) -> bool:
    """Returns whether there is a stretch without any place, as before a stray one: this is told without sorting."""
    if not len(places):
        return False
    is_driven = np.bincount(((places - places.min()) / EMPTY).astype(np.int64)) > 0
    return bool((~is_driven[1:-1]).any())


def sample_of(plane: Plane) -> Sample:
    """Returns a thin sample of a plane's rows."""
    rows = plane.rows
    order = slice(None) if is_sorted(rows) else in_order(rows)
    first = track_starts(rows, order)
    last = np.r_[first[1:], rows.height] - 1
    every = max(round(INTERVAL / plane.time_step), math.ceil(rows.height / MOST))
    between = np.flatnonzero(rows[c.FRAME].to_numpy()[order] % every == 0)
    chosen = np.sort(np.concatenate([between, first, last]))
    places, starts = (index if isinstance(order, slice) else order[index] for index in (chosen, first))
    points = rows.select(c.FRAME, PX, PY, SOURCE_LANE, c.RECORDED_V)[places]
    tracks = rows.select(*KEY)[starts]
    return Sample(
        track=np.searchsorted(first, chosen, side="right") - 1,
        time=points[c.FRAME].to_numpy() * plane.time_step,
        px=points[PX].to_numpy(),
        py=points[PY].to_numpy(),
        lane=points[SOURCE_LANE],
        speed=points[c.RECORDED_V],
        road=_roads(rows, tracks).cast(pl.String),
        tracks=tracks,
    )


def _roads(rows: pl.DataFrame, tracks: pl.DataFrame) -> pl.Series:
    """Returns the first road that the source names in each track; null where it names none."""
    named = rows.select(*KEY, ROAD).drop_nulls(ROAD)
    if named.is_empty():
        return pl.Series(ROAD, [None] * tracks.height, pl.Categorical())
    first = named.group_by(KEY).agg(pl.col(ROAD).first())
    return tracks.join(first, on=KEY, how="left", maintain_order="left")[ROAD]


def track_mean(
    values: Float[np.ndarray, "point"], track: Int[np.ndarray, "point"], size: int
) -> Float[np.ndarray, "track"]:
    """Returns the mean of the values of each track; NaN for tracks that have none."""
    count = np.bincount(track, minlength=size)
    total = np.bincount(track, weights=values, minlength=size)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
