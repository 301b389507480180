"""Writes a recording as exiD's three csv files: 25 Hz, centres from an origin in UTM, lanelets as lanes."""

from dataclasses import replace
from pathlib import Path

import polars as pl

from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.sites import Site
from tests.formats.writers.common import planar

EAST, NORTH = 295_000.0, 5_628_000.0  # [m] near Aachen
FIRST = 1500  # number of lane 1's lanelet
KINDS = {"car": "car", "truck": "truck", "motorcycle": "motorcycle"}


def write_exid(recording: Recording, folder: Path) -> list[Path]:
    """Returns the tracks files written, one a window; each window's origin is another."""
    paths = []
    for number, name in enumerate(recording.names):
        tracks = planar(recording.window(name)).sort(c.VEHICLE, c.FRAME)
        path = folder / f"{number:02d}_tracks.csv"
        half = pl.col(c.LENGTH).cast(pl.Float64).round(2) / 2
        lanelet = (pl.col(c.LANE) + FIRST).cast(pl.String)
        tracks.select(
            recordingId=pl.lit(number),
            trackId=c.VEHICLE,
            frame=c.FRAME,
            trackLifetime=pl.lit(0),
            xCenter=(pl.col("px") - pl.col("heading").cos() * half + 10.0 * number).round(4),
            yCenter=(pl.col("py") - pl.col("heading").sin() * half).round(4),
            heading=(pl.col("heading").degrees() % 360).round(4),
            width=pl.col(c.WIDTH).round(2),
            length=pl.col(c.LENGTH).round(2),
            lonVelocity=pl.col("speed").round(4),
            lonAcceleration=pl.lit(0.0),
            laneletId=pl.when(pl.col(c.FRAME) % 7 == 0).then(lanelet + ";9999").otherwise(lanelet),
        ).write_csv(path)
        _write_meta(recording, tracks, path, number)
        paths.append(path)
    return paths


def site_of(site: Site) -> Site:
    """Returns the site with its lanes' lanelets and its place in UTM."""
    lanes = tuple(replace(lane, sources=(str(FIRST + lane.number),)) for lane in site.lanes)
    reference = site.reference or ((0.0, 0.0), (site.length, 0.0))
    return replace(site, lanes=lanes, reference=tuple((x + EAST, y + NORTH) for x, y in reference))


def _write_meta(recording: Recording, tracks: pl.DataFrame, path: Path, number: int) -> None:
    vehicles = tracks.group_by(c.VEHICLE).agg(pl.col(c.KIND).first()).sort(c.VEHICLE)
    vehicles.select(
        pl.lit(number).alias("recordingId"),
        pl.col(c.VEHICLE).alias("trackId"),
        pl.col(c.KIND).cast(pl.String).replace_strict(KINDS).alias("class"),
    ).write_csv(path.with_name(path.name.replace("tracks", "tracksMeta")))
    pl.DataFrame(
        {
            "recordingId": [number],
            "locationId": [2],
            "frameRate": [1 / recording.time_step],
            "speedLimit": [-1.0],
            "xUtmOrigin": [EAST - 10.0 * number],
            "yUtmOrigin": [NORTH],
            "orthoPxToMeter": [0.1],
        }
    ).write_csv(path.with_name(path.name.replace("tracks", "recordingMeta")))
