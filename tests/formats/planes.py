"""Planes made by hand: vehicles that drive along given paths at given lateral positions."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl

from rampcast.recording import columns as c
from rampcast.roads.plane import PLANE_SCHEMA, PX, PY, SOURCE_LANE, Plane

TIME_STEP = 0.1  # [s]


@dataclass(frozen=True)
class Track:
    """One vehicle: its places [m] at every time step, and the source's lane at each."""

    px: np.ndarray
    py: np.ndarray
    lane: str | Sequence[str | None] | None = None
    first_frame: int = 0


def straight(y, *, start=0.0, end=400.0, speed=20.0, angle=0.0, lane=None, first_frame=0) -> Track:
    """Returns a vehicle that drives from x = start to end [m] at y to the left, the road being turned by the angle."""
    x = np.arange(start, end, np.sign(end - start) * speed * TIME_STEP)
    lateral = np.full(len(x), y) if np.isscalar(y) else y(x)
    cos, sin = np.cos(angle), np.sin(angle)
    return Track(cos * x - sin * lateral, sin * x + cos * lateral, lane, first_frame)


def plane_of(tracks: Sequence[Track], **values) -> Plane:
    """Returns a plane with these vehicles, numbered from 1."""
    parts = []
    for number, track in enumerate(tracks, start=1):
        size = len(track.px)
        lanes = [track.lane] * size if track.lane is None or isinstance(track.lane, str) else list(track.lane)
        parts.append(
            pl.DataFrame(
                {
                    c.VEHICLE: [number] * size,
                    c.FRAME: np.arange(size) + track.first_frame,
                    PX: np.asarray(track.px, float),
                    PY: np.asarray(track.py, float),
                    SOURCE_LANE: pl.Series(lanes, dtype=pl.String),
                }
            )
        )
    given = pl.concat(parts).with_columns(pl.lit("1").alias(c.RECORDING), pl.lit("car").alias(c.KIND))
    given = given.with_columns(pl.lit(4.5).alias(c.LENGTH), pl.lit(1.8).alias(c.WIDTH))
    for name, kind in PLANE_SCHEMA.items():
        if name not in given.columns:
            given = given.with_columns(pl.lit(None, dtype=kind).alias(name))
    rows = given.select(pl.col(name).cast(kind) for name, kind in PLANE_SCHEMA.items())
    return Plane(
        **({"name": "made", "title": "Made by hand", "source": "made", "time_step": TIME_STEP} | values), rows=rows
    )
