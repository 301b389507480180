"""Writes a recording as CitySim's csv: feet in an image whose y grows down, 30 Hz, boxes by their corners."""

from pathlib import Path

import polars as pl

from rampcast.formats.steps.units import FOOT
from rampcast.recording import Recording
from rampcast.recording import columns as c
from tests.formats.writers.common import planar

RATE = 30.0


def write_citysim(recording: Recording, folder: Path) -> list[Path]:
    """Returns the files written, one a window."""
    paths = []
    for number, name in enumerate(recording.names, start=1):
        tracks = planar(recording.window(name)).sort(c.FRAME, c.VEHICLE)
        path = folder / f"FreewayX-{number:02d}.csv"
        tracks.select(
            frameNum=(pl.col(c.FRAME) * recording.time_step * RATE).round().cast(pl.Int64),
            carId=c.VEHICLE,
            **_point("carCenter", ahead=-0.5, left=0.0),
            **_point("head", ahead=0.0, left=0.0),
            **_point("tail", ahead=-1.0, left=0.0),
            **_point("boundingBox1", ahead=0.0, left=-0.5),
            **_point("boundingBox2", ahead=-1.0, left=-0.5),
            **_point("boundingBox3", ahead=-1.0, left=0.5),
            **_point("boundingBox4", ahead=0.0, left=0.5),
            speed=(pl.col("speed") / 0.44704).round(2),
            laneId=c.LANE,
        ).write_csv(path)
        paths.append(path)
    return paths


def _point(name: str, *, ahead: float, left: float) -> dict[str, pl.Expr]:
    """Returns a point of a vehicle [ft], so many lengths ahead of the front centre and widths to its left; y down."""
    along, across = pl.col(c.LENGTH).cast(pl.Float64) * ahead, pl.col(c.WIDTH).cast(pl.Float64) * left
    cos, sin = pl.col("heading").cos(), pl.col("heading").sin()
    return {
        f"{name}Xft": ((pl.col("px") + along * cos - across * sin) / FOOT).round(3),
        f"{name}Yft": (-(pl.col("py") + along * sin + across * cos) / FOOT).round(3),
    }
