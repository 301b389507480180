"""Writes a recording as a csv of I-24 MOTION's version with lanes: metres, middle of the rear, driving west."""

from dataclasses import replace
from pathlib import Path

import polars as pl

from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.sites import Site
from tests.formats.writers.common import lanes_by_number, with_speeds
from tests.formats.writers.i24 import CLASSES, DAY, FOOT

EAST_END = 5000.0  # [m] from the Mill Creek bridge, where the road begins for who drives west


def write_i24_mvt(recording: Recording, folder: Path) -> list[Path]:
    """Returns the one file written: all windows of the recording are one day."""
    path = folder / "mvt.csv"
    with_speeds(recording).select(
        pl.col(c.VEHICLE).alias("trajectory_id"),
        (DAY + pl.col(c.FRAME) * recording.time_step).round(4).alias("timestamp"),
        (EAST_END - pl.col(c.X) + pl.col(c.LENGTH).cast(pl.Float64)).round(4).alias("x_position_meters"),
        (-pl.col(c.Y)).round(4).alias("y_position_corrected_meters"),
        pl.col(c.KIND).cast(pl.String).replace_strict(CLASSES).alias("coarse_vehicle_class"),
        (pl.col(c.LENGTH).cast(pl.Float64) / FOOT).round(4).alias("length"),
        (pl.col(c.WIDTH).cast(pl.Float64) / FOOT).round(4).alias("width"),
        pl.col("speed").round(4).alias("speed_meters_per_second"),
        pl.lit(0.0).alias("acceleration_meters_per_second_per_second"),
        pl.col(c.LANE).alias("lane_number"),
    ).write_csv(path)
    return [path]


def site_of(site: Site) -> Site:
    """Returns the site with its place on the interstate, and its lanes by their numbers."""
    return replace(lanes_by_number(site), reference=((EAST_END, 0.0), (EAST_END - site.length, 0.0)))
