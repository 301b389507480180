"""Trajectories in the plane of their source: front centres [m], seen from above, y to the left of x.

A reader of such a source turns units, axes and reference points into a `Plane`, and `on_roads` makes recordings of it.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import polars as pl

from rampcast.recording import columns as c
from rampcast.sites import Lane

PX, PY = "px", "py"  # front centre in the plane [m]
ROAD = "road"  # name of the road, where the source knows it
SOURCE_LANE = "source_lane"  # the source's name of the lane, where it has lanes
PLANE_SCHEMA: dict[str, pl.DataType] = {
    c.RECORDING: pl.Categorical(),  # the part's name within the source: "26", "2"
    ROAD: pl.Categorical(),  # null where not known
    c.VEHICLE: pl.Int32(),
    c.FRAME: pl.Int32(),
    PX: pl.Float64(),
    PY: pl.Float64(),
    SOURCE_LANE: pl.Categorical(),  # null where not known
    c.LENGTH: pl.Float32(),
    c.WIDTH: pl.Float32(),
    c.KIND: pl.Enum(c.KINDS),
    c.RECORDED_V: pl.Float32(),  # null where not known
    c.RECORDED_A: pl.Float32(),  # likewise
}


def plane_rows(table: pl.DataFrame, known: Mapping[str, pl.Expr | pl.Series]) -> pl.DataFrame:
    """Returns a table's rows as those of a plane.

    Args:
        table: its columns that are called as the plane's are taken as they are.
        known: other columns of the plane; what neither has is null.
    """
    found: dict[str, pl.Expr | pl.Series] = {name: pl.col(name) for name in table.columns}
    found |= known
    return table.select(found.get(name, pl.lit(None)).cast(kind).alias(name) for name, kind in PLANE_SCHEMA.items())


@dataclass(frozen=True)
class Road:
    """A road that the source knows: its name, the line y = 0 in the plane, and its lanes; () where not known."""

    name: str
    reference: tuple[tuple[float, float], ...] = ()
    lanes: tuple[Lane, ...] = ()


@dataclass(frozen=True)
class Plane:
    """Trajectories in the plane of their source.

    Attributes:
        name: of the place, as "highd-1"; sites drafted from it are named for it.
        title: for figures.
        source: the format's name.
        rows: columns of `PLANE_SCHEMA`, in any order.
        time_step: time between two frames [s].
        simulated: whether no vehicle of it ever existed.
        speed_limit: [m/s]; NaN where not known.
        roads: what the source knows of its roads; () leaves it to the tracks.
    """

    name: str
    title: str
    source: str
    rows: pl.DataFrame
    time_step: float
    simulated: bool = False
    speed_limit: float = math.nan
    roads: tuple[Road, ...] = ()
