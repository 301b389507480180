"""Writes a recording as INTERACTION's csv files: centres in a plane, no lanes, one file a window."""

from pathlib import Path

import polars as pl

from rampcast.recording import Recording
from rampcast.recording import columns as c
from tests.formats.writers.common import planar


def write_interaction(recording: Recording, folder: Path) -> list[Path]:
    """Returns the files written, one a window."""
    paths = []
    for number, name in enumerate(recording.names):
        tracks = planar(recording.window(name)).sort(c.VEHICLE, c.FRAME)
        path = folder / f"vehicle_tracks_{number:03d}.csv"
        half = pl.col(c.LENGTH).cast(pl.Float64).round(2) / 2
        tracks.select(
            track_id=c.VEHICLE,
            frame_id=c.FRAME,
            timestamp_ms=(pl.col(c.FRAME) * recording.time_step * 1000).round().cast(pl.Int64),
            agent_type=c.KIND,
            x=(pl.col("px") - pl.col("heading").cos() * half).round(3),
            y=(pl.col("py") - pl.col("heading").sin() * half).round(3),
            vx=(pl.col("speed") * pl.col("heading").cos()).round(3),
            vy=(pl.col("speed") * pl.col("heading").sin()).round(3),
            psi_rad=pl.col("heading").round(4),
            length=pl.col(c.LENGTH).round(2),
            width=pl.col(c.WIDTH).round(2),
        ).write_csv(path)
        paths.append(path)
    return paths
