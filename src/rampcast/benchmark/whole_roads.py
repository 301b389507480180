"""The data sets of the benchmark that show every vehicle of a road for a short while: each file becomes cases."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import polars as pl

from rampcast.benchmark.cases import LEAST_TRUTH, WHOLE_TRUTH, Cases, led, make_cases, names, regular_anchors
from rampcast.traffic.platoons import TYPICAL_LENGTH, tracks_of_table

SPACING = 1.0  # [s] between anchors: the sets last 48 and 100 s
THIRTY_HZ, TWENTY_FIVE_HZ = 1 / 30, 1 / 25  # [s] between frames
WINDOW = 1  # there is one


def i75_platoon(files: Sequence[Path]) -> Cases:
    """Returns the cases of all vehicles with a leader, in any lane; case = "1-vehicle-frame".

    The file has the places of the middles of vehicles, and no lengths: all are taken to be typical cars.
    """
    table = pl.concat([pl.read_parquet(file) for file in files])
    return _cases(
        "i75_platoon",
        table.with_columns(x=pl.col("x") + TYPICAL_LENGTH / 2),
        time_step=THIRTY_HZ,
        least_truth=WHOLE_TRUTH,
    )


def i24_scene(files: Sequence[Path]) -> Cases:
    """Returns the cases of all vehicles with a leader, in any lane; case = "1-vehicle-frame".

    The file has the places of rears, as all files of I-24 MOTION (docs/formats/i24.md). Truth goes as far as it was
    seen, 1 s at least.
    """
    table = pl.concat([pl.read_parquet(file) for file in files])
    return _cases(
        "i24_scene",
        table.with_columns(x=pl.col("x") + pl.col("length")),
        time_step=TWENTY_FIVE_HZ,
        least_truth=LEAST_TRUTH,
    )


def with_leaders(table: pl.DataFrame) -> pl.DataFrame:
    """Returns the table with the column leader: the next vehicle ahead in the same lane at the same frame."""
    return table.sort("frame", "lane", "x", "vehicle").with_columns(
        leader=pl.col("vehicle").shift(-1).over("frame", "lane")
    )


def _cases(name: str, table: pl.DataFrame, *, time_step: float, least_truth: float) -> Cases:
    tracks = tracks_of_table(with_leaders(table).with_columns(road=WINDOW), time_step=time_step)
    rows = led(tracks, regular_anchors(tracks, spacing=SPACING, least_truth=least_truth))
    window, vehicle = np.full(len(rows), WINDOW), tracks.vehicle[rows]
    return make_cases(
        name,
        tracks,
        rows,
        case=names(window, vehicle, tracks.frame[rows]),
        group=names(window, vehicle),
        t0=tracks.frame[rows] * time_step,
    )
