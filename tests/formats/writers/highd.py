"""Writes a recording as highD's three csv files: 25 Hz, upper left corners, y down, the lower direction."""

from dataclasses import replace
from pathlib import Path

import polars as pl

from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.sites import Site
from tests.formats.writers.common import lane_edges, with_speeds

TOP = 20.0  # [m] where the road's left edge lies in the image
UPPER = (5.0, 8.75, 12.5)  # [m] markings of an empty opposite direction with two lanes


def write_highd(recording: Recording, folder: Path) -> list[Path]:
    """Returns the tracks files written, one a window."""
    lower = [TOP - edge for edge in lane_edges(recording.site)]
    paths = []
    for number, name in enumerate(recording.names, start=1):
        tracks = with_speeds(recording.window(name)).sort(c.FRAME, c.VEHICLE)
        path = folder / f"{number:02d}_tracks.csv"
        tracks.select(
            frame=c.FRAME,
            id=c.VEHICLE,
            x=(pl.col(c.X) - pl.col(c.LENGTH)).round(2),
            y=(TOP - pl.col(c.Y) - pl.col(c.WIDTH) / 2).round(2),
            width=pl.col(c.LENGTH).round(2),
            height=pl.col(c.WIDTH).round(2),
            xVelocity=pl.col("speed").round(2),
            yVelocity=pl.lit(0.0),
            xAcceleration=pl.lit(0.0),
            yAcceleration=pl.lit(0.0),
            thw=pl.lit(0.0),
            laneId=pl.col(c.LANE).replace_strict(_names(recording.site)),
        ).write_csv(path)
        _write_meta(recording, tracks, path, number, lower)
        paths.append(path)
    return paths


def site_of(site: Site) -> Site:
    """Returns the site with highD's names of its lanes and its place in the image."""
    names = _names(site)
    lanes = tuple(replace(lane, sources=(str(names[lane.number]),)) for lane in site.lanes)
    return replace(site, lanes=lanes, reference=((0.0, -TOP), (site.length, -TOP)))


def _names(site: Site) -> dict[int, int]:
    numbers = sorted(lane.number for lane in site.lanes)
    return {number: len(UPPER) + 2 + index for index, number in enumerate(numbers)}


def _write_meta(recording: Recording, tracks: pl.DataFrame, path: Path, number: int, lower: list[float]) -> None:
    vehicles = tracks.group_by(c.VEHICLE).agg(pl.col(c.KIND).first(), frames=pl.len()).sort(c.VEHICLE)
    kinds = {"car": "Car", "truck": "Truck", "motorcycle": "Car"}  # highD knows no motorcycles
    vehicles.select(
        pl.col(c.VEHICLE).alias("id"),
        pl.col(c.KIND).cast(pl.String).replace_strict(kinds).alias("class"),
        pl.lit(2).alias("drivingDirection"),
        pl.col("frames").alias("numFrames"),
    ).write_csv(path.with_name(path.name.replace("tracks", "tracksMeta")))
    pl.DataFrame(
        {
            "id": [number],
            "frameRate": [1 / recording.time_step],
            "locationId": [1],
            "speedLimit": [-1.0],
            "upperLaneMarkings": [";".join(f"{edge:.2f}" for edge in UPPER)],
            "lowerLaneMarkings": [";".join(f"{edge:.2f}" for edge in lower)],
        }
    ).write_csv(path.with_name(path.name.replace("tracks", "recordingMeta")))
