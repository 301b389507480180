"""Writes a recording as I-24 MOTION's json: one array of vehicles, feet, middle of the rear, driving west."""

import json
from dataclasses import replace
from pathlib import Path

import polars as pl

from rampcast.formats.steps.units import FOOT
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.sites import Site

EAST_END = 63.0 * 5280 * FOOT  # [m] where the road begins, for who drives west
DAY = 1_669_075_200.0  # [s since 1970] 2022-11-22, 00:00 UTC
CLASSES = {"car": 0, "truck": 4, "motorcycle": 6}


def write_i24(recording: Recording, folder: Path) -> list[Path]:
    """Returns the one file written: all windows of the recording are one day."""
    rear = EAST_END - (pl.col(c.X) - pl.col(c.LENGTH).cast(pl.Float64))
    vehicles = (
        recording.tracks.sort(c.VEHICLE, c.FRAME)
        .group_by(c.VEHICLE, maintain_order=True)
        .agg(
            (DAY + pl.col(c.FRAME) * recording.time_step).alias("timestamp"),
            (rear / FOOT).alias("x_position"),
            (-pl.col(c.Y) / FOOT).alias("y_position"),
            *((pl.col(name).cast(pl.Float64).first() / FOOT).alias(name) for name in (c.LENGTH, c.WIDTH)),
            pl.col(c.KIND).cast(pl.String).replace_strict(CLASSES).first().alias("coarse_vehicle_class"),
        )
    )
    rows = vehicles.iter_rows(named=True)
    path = folder / "2022-11-22.json"
    path.write_text(json.dumps([{"_id": {"$oid": str(row.pop(c.VEHICLE))}, "direction": -1, **row} for row in rows]))
    return [path]


def site_of(site: Site) -> Site:
    """Returns the site with its place on the interstate."""
    return replace(site, reference=((EAST_END, 0.0), (EAST_END - site.length, 0.0)))
