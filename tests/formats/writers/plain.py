"""Writes a recording as a plain table in rampcast's own columns: millimetres, and times in seconds."""

from pathlib import Path

import polars as pl

from rampcast.recording import Recording
from rampcast.recording import columns as c
from tests.formats.writers.common import with_speeds


def write_plain(recording: Recording, folder: Path) -> list[Path]:
    """Returns the table written."""
    path = folder / "table.csv"
    with_speeds(recording).select(
        c.RECORDING,
        c.VEHICLE,
        time=(pl.col(c.FRAME) * recording.time_step).round(3),
        x=pl.col(c.X).round(3),
        y=pl.col(c.Y).round(3),
        lane=c.LANE,
        length=pl.col(c.LENGTH).round(2),
        width=pl.col(c.WIDTH).round(2),
        kind=c.KIND,
        speed=pl.col("speed").round(2),
    ).write_csv(path)
    return [path]
