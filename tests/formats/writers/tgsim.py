"""Writes a recording as TGSIM's csv, in the portal's spelling: 10 Hz, centres in a plane, no heading."""

from pathlib import Path

import polars as pl

from rampcast.recording import Recording
from rampcast.recording import columns as c
from tests.formats.writers.common import planar

TYPES = {"motorcycle": "motorcycle", "car": "small-vehicle", "truck": "large-vehicle"}


def write_tgsim(recording: Recording, folder: Path) -> list[Path]:
    """Returns the one file written; each window is a run."""
    runs = {name: number for number, name in enumerate(recording.names, start=1)}
    tracks = planar(recording)
    half = pl.col(c.LENGTH).cast(pl.Float64) / 2
    path = folder / "TGSIM_Trajectories.csv"
    tracks.select(
        pl.col(c.VEHICLE).alias("ID"),
        pl.col(c.FRAME).mul(recording.time_step).round(1).alias("time"),
        (pl.col("px") - pl.col("heading").cos() * half).round(3).alias("xloc-kf"),
        (pl.col("py") - pl.col("heading").sin() * half).round(3).alias("yloc-kf"),
        pl.col(c.LANE).alias("lane-kf"),
        pl.col("speed").round(3).alias("speed-kf"),
        pl.lit(0.0).alias("acceleration-kf"),
        pl.col(c.LENGTH).round(2).alias("length-smoothed"),
        pl.col(c.WIDTH).round(2).alias("width-smoothed"),
        pl.col(c.KIND).cast(pl.String).replace_strict(TYPES).alias("type-most-common"),
        pl.lit("no").alias("ACC"),
        pl.col(c.RECORDING).replace_strict(runs).alias("run-index"),
    ).write_csv(path)
    return [path]
