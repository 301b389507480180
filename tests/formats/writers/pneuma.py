"""Writes a recording as pNEUMA's csv: a row a vehicle, degrees with all digits, centres, no lanes, no sizes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl

from rampcast.formats.steps.earth import in_metres
from rampcast.formats.steps.vehicles import TYPICAL_SIZES
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.sites import Site
from tests.formats.writers.common import planar

LATITUDE, LONGITUDE = 37.98, 23.73  # of the plane's origin, in Athens
HEADER = "track_id; type; traveled_d; avg_speed; lat; lon; speed; lon_acc; lat_acc; time"
TYPES = {"motorcycle": "Motorcycle", "car": "Taxi", "truck": "Heavy Vehicle"}


def origin() -> tuple[float, float]:
    """Returns where the origin of a written plane is in the reader's [m]."""
    (x,), (y,) = in_metres(np.array([LATITUDE]), np.array([LONGITUDE]))
    return float(x), float(y)


def site_of(site: Site) -> Site:
    """Returns the site with its place in the reader's plane."""
    east, north = origin()
    reference = site.reference or ((0.0, 0.0), (site.length, 0.0))
    return replace(site, reference=tuple((float(x + east), float(y + north)) for x, y in reference))


def degrees(px: np.ndarray, py: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns latitudes and longitudes of places around the origin, by solving for what the reader makes of them."""
    east, north = origin()
    guess = np.concatenate([LATITUDE + py / 111e3, LONGITUDE + px / 88e3])
    step = np.array([1 / 111e3, 1 / 88e3])
    for _ in range(6):  # Newton's with the scales alone: they are right to a few parts in a hundred
        latitude, longitude = np.split(guess, 2)
        x, y = in_metres(latitude, longitude)
        guess = np.concatenate([latitude + (py + north - y) * step[0], longitude + (px + east - x) * step[1]])
    return tuple(np.split(guess, 2))


def write_pneuma(recording: Recording, folder: Path) -> list[Path]:
    """Returns the files written, one a window."""
    paths = []
    for number, name in enumerate(recording.names):
        tracks = planar(recording.window(name)).sort(c.VEHICLE, c.FRAME)
        half = (
            pl.col(c.KIND).cast(pl.String).replace_strict({kind: size / 2 for kind, (size, _) in TYPICAL_SIZES.items()})
        )
        centres = tracks.select(
            x=pl.col("px") - pl.col("heading").cos() * half, y=pl.col("py") - pl.col("heading").sin() * half
        )
        latitude, longitude = degrees(centres["x"].to_numpy(), centres["y"].to_numpy())
        moments = tracks.select(
            c.VEHICLE,
            c.KIND,
            lat=pl.Series(latitude).round(8),
            lon=pl.Series(longitude).round(8),
            speed=(pl.col("speed") * 3.6).round(4),
            lon_acc=pl.lit(0.0),
            lat_acc=pl.lit(0.0),
            time=(pl.col(c.FRAME) * recording.time_step).round(6),
        )
        path = folder / f"20181024_d1_08{number:02d}_0900.csv"
        path.write_text("\n".join([HEADER, *map(_row, moments.partition_by(c.VEHICLE))]) + "\n")
        paths.append(path)
    return paths


def _row(vehicle: pl.DataFrame) -> str:
    cells = [vehicle[c.VEHICLE][0], TYPES[vehicle[c.KIND][0]], 48.85, 9.77]
    moments = vehicle.select("lat", "lon", "speed", "lon_acc", "lat_acc", "time").rows()
    return "; ".join(map(str, [*cells, *(cell for moment in moments for cell in moment)])) + "; "
