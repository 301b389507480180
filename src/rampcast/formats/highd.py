"""highD: 25 Hz drone recordings of German motorways; a csv of tracks with two csv of metadata beside it.

Positions are the upper left corner of the vehicle's box in an image whose y grows down; `width` is along the road.
Source: the format page of the highD data set, levelXdata; see docs/formats/highd.md.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from rampcast.errors import FormatError
from rampcast.formats.head import Head
from rampcast.formats.on_roads import on_roads
from rampcast.formats.plane import PLANE_SCHEMA, PX, PY, ROAD, SOURCE_LANE, Plane, Road
from rampcast.formats.report import BadRows, ReadReport, join_reports
from rampcast.formats.rows import Column, Rows, missing_column, read_rows
from rampcast.recording import Lane, Recording, Site
from rampcast.recording import columns as c

LARGEST = 2.0**31 - 1
FAR = 10_000.0  # [m] no recorded section is longer
ROADS = {1: "upper", 2: "lower"}  # drivingDirection: 1 drives to the left in the image, on its upper half
KINDS = {"Car": "car", "Truck": "truck"}
UNLIMITED = 50.0  # [m/s] 180 km/h, where speedLimit is -1: no limit; above what highD's cars drove

TRACKS = (
    Column("frame", ("frame",), pl.Int32(), 0, LARGEST),
    Column("id", ("id",), pl.Int32(), 0, LARGEST),
    Column("x", ("x",), low=-FAR, high=FAR),
    Column("y", ("y",), low=-FAR, high=FAR),
    Column("length", ("width",), pl.Float32(), 0, 100),
    Column("width", ("height",), pl.Float32(), 0, 20),
    Column("v", ("xVelocity",), pl.Float32(), -150, 150),
    Column("a", ("xAcceleration",), pl.Float32(), -1000, 1000),
    Column("lane", ("laneId",), pl.Int16(), 0, 100),
    Column("thw", ("thw",), pl.Float32(), optional=True, may_be_blank=True),  # tells highD from other sources
)
VEHICLES = (
    Column("id", ("id",), pl.Int32(), 0, LARGEST),
    Column("class", ("class",), pl.String()),
    Column("direction", ("drivingDirection",), pl.Int8(), 1, 2),
)
RECORDING = (
    Column("id", ("id",), pl.Int32(), 0, LARGEST),
    Column("rate", ("frameRate",), low=1, high=1000),
    Column("location", ("locationId",), pl.Int32(), 0, LARGEST),
    Column("limit", ("speedLimit",), low=-1, high=100),
    Column("upper", ("upperLaneMarkings",), pl.String()),
    Column("lower", ("lowerLaneMarkings",), pl.String()),
)


def misses_highd(head: Head) -> str | None:
    """Returns the first thing a file lacks to be highD's tracks; None if nothing."""
    return missing_column(head, TRACKS[:-1])


def read_highd(
    paths: Sequence[Path], site: Site | None = None, bad_rows: BadRows = BadRows.RAISE
) -> tuple[tuple[Recording, ...], ReadReport]:
    """Returns the two directions of a highD location, each a recording of its own, and what reading found.

    Args:
        paths: files NN_tracks.csv of one location, each with NN_tracksMeta.csv and NN_recordingMeta.csv beside it.
        site: one direction; None takes both, with the lanes of the recording's markings.
        bad_rows: whether a row that is not as it should be is an error or is skipped and counted.

    Raises:
        FormatError: a file is missing or not as highD's are, or the files are of several locations.
    """
    parts, reports, metas = [], [], []
    for path in paths:
        rows = read_rows(path, TRACKS, bad_rows=bad_rows)
        vehicles = read_rows(_beside(path, "tracksMeta"), VEHICLES).table
        metas.append(_recording(_beside(path, "recordingMeta")))
        parts.append(_in_plane(rows, vehicles, str(metas[-1]["id"])))
        reports.append(rows.report("highD tracks"))
    plane = Plane(
        name=f"highd-{metas[0]['location']}",
        title=f"highD, location {metas[0]['location']}",
        source="highd",
        rows=pl.concat(parts),
        time_step=1 / metas[0]["rate"],
        speed_limit=metas[0]["limit"] if metas[0]["limit"] > 0 else UNLIMITED,
        roads=_roads(metas[0], length=_length(parts)),
    )
    _check_one_location(paths, metas)
    return on_roads(plane, site, join_reports(reports))


def _beside(path: Path, kind: str) -> Path:
    other = path.with_name(path.name.replace("_tracks", f"_{kind}"))
    if other == path or not other.is_file():
        name = path.name.partition("_")[0]
        raise FormatError(
            f"{path}: highD's {name}_{kind}.csv is not beside it. Expected NN_tracks.csv, NN_tracksMeta.csv and "
            "NN_recordingMeta.csv in one folder, with their original names"
        )
    return other


def _recording(path: Path) -> dict[str, Any]:
    values: dict[str, Any] = read_rows(path, RECORDING).table.row(0, named=True)
    for name in ("upper", "lower"):
        try:
            values[name] = [float(cell) for cell in values[name].split(";")]
        except ValueError as error:
            raise FormatError(f"{path}, {name}LaneMarkings: expected numbers separated by ';' ({error})") from error
        if len(values[name]) < 2:
            raise FormatError(f"{path}, {name}LaneMarkings: expected two markings or more, found {values[name]}")
    return values


def _in_plane(rows: Rows, vehicles: pl.DataFrame, recording: str) -> pl.DataFrame:
    """Returns the rows with y turned up and the front centre as position: front is the side in driving direction."""
    table = rows.table.join(vehicles, on="id", how="left", maintain_order="left")
    unknown = table.filter(pl.col("direction").is_null())
    if unknown.height:
        raise FormatError(
            f"{rows.file}: vehicle {unknown['id'][0]} is not in the tracksMeta file beside it; get both files again"
        )
    is_lower = pl.col("direction") == 2
    forward = pl.when(is_lower).then(1).otherwise(-1).cast(pl.Float32)
    return table.select(
        pl.lit(recording, dtype=pl.Categorical()).alias(c.RECORDING),
        pl.when(is_lower).then(pl.lit(ROADS[2])).otherwise(pl.lit(ROADS[1])).cast(pl.Categorical()).alias(ROAD),
        pl.col("id").alias(c.VEHICLE),
        pl.col("frame").alias(c.FRAME),
        (pl.col("x") + pl.when(is_lower).then(pl.col("length")).otherwise(0)).alias(PX),
        (-pl.col("y") - pl.col("width") / 2).alias(PY),
        pl.col("lane").cast(pl.String).cast(pl.Categorical()).alias(SOURCE_LANE),
        pl.col("length").alias(c.LENGTH),
        pl.col("width").alias(c.WIDTH),
        pl.col("class").replace_strict(KINDS, default="car").cast(PLANE_SCHEMA[c.KIND]).alias(c.KIND),
        (pl.col("v") * forward).alias(c.RECORDED_V),
        (pl.col("a") * forward).alias(c.RECORDED_A),
    )


def _length(parts: Sequence[pl.DataFrame]) -> float:
    return float(math.ceil(max(float(part[PX].to_numpy().max()) for part in parts)))


def _roads(recording: dict[str, Any], *, length: float) -> tuple[Road, Road]:
    """Returns both directions; y = 0 is the left edge of each, lanes count from it, and both begin at the image's edge.

    laneId 1 lies above the upper direction, whose lanes follow from above; then comes the median and the lower ones.
    """
    upper, lower = recording["upper"], recording["lower"]
    upper_names = list(range(2, len(upper) + 1))[::-1]  # the lowest in the image is the leftmost of who drives to -x
    lower_names = list(range(len(upper) + 2, len(upper) + len(lower) + 1))
    return (
        Road(ROADS[1], ((length, -upper[-1]), (0.0, -upper[-1])), _numbered(upper_names, upper[::-1])),
        Road(ROADS[2], ((0.0, -lower[0]), (length, -lower[0])), _numbered(lower_names, lower)),
    )


def _numbered(names: Sequence[int], markings: Sequence[float]) -> tuple[Lane, ...]:
    edges = np.abs(np.array(markings) - markings[0])
    centres = [-float(left + right) / 2 for left, right in pairwise(edges)]
    return tuple(
        Lane(number, "main", round(centre, 3), (str(name),))
        for number, (name, centre) in enumerate(zip(names, centres, strict=True), start=1)
    )


def _check_one_location(paths: Sequence[Path], metas: Sequence[dict[str, Any]]) -> None:
    for path, meta in zip(paths, metas, strict=True):
        for name in ("location", "rate", "upper", "lower"):
            if meta[name] != metas[0][name]:
                raise FormatError(
                    f"{path}: its {name} is {meta[name]}, that of {paths[0].name} is {metas[0][name]}. "
                    "Convert recordings of different places by themselves"
                )
