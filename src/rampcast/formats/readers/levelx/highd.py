"""highD: 25 Hz drone recordings of German motorways; a csv of tracks with two csv of metadata beside it.

Positions are the upper left corner of the vehicle's box in an image whose y grows down; `width` is along the road.
Source: the format page of the highD data set, levelXdata; see docs/formats/highd.md.
"""

import math
import statistics
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from rampcast.errors import FormatError
from rampcast.formats.files.head import Head
from rampcast.formats.format import Format, Recordings
from rampcast.formats.readers.levelx.levelx import Described, ThreeFiles, needs_of, read_location
from rampcast.formats.steps import believed
from rampcast.formats.tables.columns import Column
from rampcast.recording import columns as c
from rampcast.recording.reading import BadRows, ReadReport
from rampcast.roads.plane import PX, PY, ROAD, SOURCE_LANE, Road, plane_rows
from rampcast.roads.project import on_roads
from rampcast.sites import Lane, Site

FARTHEST = believed.FARTHEST_IN_IMAGE
ROADS = {1: "upper", 2: "lower"}  # drivingDirection: 1 drives to the left in the image, on its upper half
MARKINGS = {"upper": "upperLaneMarkings", "lower": "lowerLaneMarkings"}
LONGEST = 200  # letters of a list of markings that a message shows
NARROWEST, WIDEST = 2.0, 8.0  # [m] lanes that are believed; German motorways have 3.5 to 3.75 m

FILES = ThreeFiles(
    name="highD",
    tracks=(
        believed.number("frame", "frame"),
        believed.number("id", "id"),
        believed.place("x", "x", farthest=FARTHEST),
        believed.place("y", "y", farthest=FARTHEST),
        believed.length("width"),
        believed.width("height"),
        believed.speed("v", "xVelocity"),
        believed.acceleration("a", "xAcceleration"),
        Column("lane", ("laneId",), pl.Int16(), 0, 100),
        believed.place("ahead", "frontSightDistance", farthest=FARTHEST, optional=True, may_be_blank=True),
        believed.place("behind", "backSightDistance", farthest=FARTHEST, optional=True, may_be_blank=True),
    ),
    vehicles=(
        believed.number("id", "id"),
        Column("class", ("class",), pl.String()),
        Column("direction", ("drivingDirection",), pl.Int8(), 1, 2),
    ),
    recording=(
        believed.number("id", "id"),
        Column("rate", ("frameRate",), low=1, high=1000),
        believed.number("location", "locationId"),
        Column("limit", ("speedLimit",), low=-1, high=100, optional=True, may_be_blank=True),
        *(Column(name, (spelling,), pl.String()) for name, spelling in MARKINGS.items()),
    ),
)


def read_highd(heads: Sequence[Head], site: Site | None, bad_rows: BadRows) -> tuple[Recordings, ReadReport]:
    """Returns the two directions of a highD location, each a recording of its own, and what reading found.

    The files are NN_tracks.csv, each with NN_tracksMeta.csv and NN_recordingMeta.csv beside it, which may be among
    them. Without a site the lanes are those of the recording's markings.
    """
    shared = ("location", "rate", "upper", "lower")
    parts, plane, report = read_location(heads, FILES, _in_plane, bad_rows, shared=shared)
    return on_roads(replace(plane, roads=_roads(parts[0].values, length=_length(parts))), site, report)


def _seen_length(table: pl.DataFrame) -> float | None:
    """Returns the length of the image [m]: how far it reaches ahead of each vehicle and behind it; None if not told."""
    if not {"ahead", "behind"} <= set(table.columns):
        return None
    length = table.select((pl.col("ahead") + pl.col("behind")).median()).item()
    return length if length and length > 0 else None


def _markings(path: Path, name: str, text: str) -> list[float]:
    """Returns the y [m] of the lines beside and between the lanes of one direction, from the top of the image."""
    where = f"{path}, in the recordingMeta file beside it, {MARKINGS[name]}"
    try:
        values = [float(cell) for cell in text.split(";") if cell.strip()]
    except ValueError as error:
        raise FormatError(f"{where}: expected numbers separated by ';', found '{text[:LONGEST]}'") from error
    if len(values) < 2:
        raise FormatError(f"{where}: expected two markings or more, found '{text[:LONGEST]}'")
    if not all(NARROWEST <= after - before <= WIDEST for before, after in pairwise(values)):
        raise FormatError(
            f"{where}: expected numbers that grow by a lane's width, {NARROWEST:g} to {WIDEST:g} m, found "
            f"'{text[:LONGEST]}'"
        )
    return values


def _in_plane(head: Head, found: Described) -> Described:
    """Returns the rows with y turned up and the front centre as position, and the values with the lanes' markings."""
    values = found.values | {name: _markings(head.path, name, found.values[name]) for name in MARKINGS}
    if values["upper"][-1] >= values["lower"][0]:
        raise FormatError(
            f"{head.path}: in the recordingMeta file beside it {MARKINGS['upper']} end at {values['upper'][-1]} and "
            f"{MARKINGS['lower']} begin at {values['lower'][0]}; expected the upper ones above the lower ones"
        )
    rows = _turned(found.table, str(values["id"]))
    return found._replace(table=rows, values=values | {"length": _seen_length(found.table)})


def _turned(table: pl.DataFrame, recording: str) -> pl.DataFrame:
    """Returns the rows with y turned up and the front centre as position: front is the side in driving direction."""
    is_lower = pl.col("direction") == 2
    forward = pl.when(is_lower).then(1).otherwise(-1).cast(pl.Float32)
    names = {number: str(number) for number in table["lane"].unique()}
    return plane_rows(
        table,
        {
            c.RECORDING: pl.lit(recording, dtype=pl.Categorical()),
            ROAD: pl.when(is_lower).then(pl.lit(ROADS[2])).otherwise(pl.lit(ROADS[1])).cast(pl.Categorical()),
            c.VEHICLE: pl.col("id"),
            c.FRAME: pl.col("frame"),
            PX: pl.col("x") + pl.when(is_lower).then(pl.col(c.LENGTH)).otherwise(0),
            PY: (-pl.col("y") - pl.col(c.WIDTH) / 2),
            SOURCE_LANE: pl.col("lane").replace_strict(names, return_dtype=pl.Categorical()),
            c.RECORDED_V: pl.col("v") * forward,
            c.RECORDED_A: pl.col("a") * forward,
        },
    )


def _length(parts: Sequence[Described]) -> float:
    """Returns the length of the image [m], in whole metres so that all recordings of a location have the same.

    Where the files do not tell it, it is that beyond which there is no vehicle.
    """
    told = [part.values["length"] for part in parts if part.values["length"]]
    if told:
        return float(round(statistics.median(told)))
    return float(math.ceil(max(float(part.table[PX].to_numpy().max()) for part in parts)))


def _roads(values: dict[str, Any], *, length: float) -> tuple[Road, Road]:
    """Returns both directions; y = 0 is the left edge of each, lanes count from it, and both begin at the image's edge.

    laneId 1 lies above the upper direction, whose lanes follow from above; then comes the median and the lower ones.
    """
    upper, lower = values["upper"], values["lower"]
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


HIGHD = Format("highd", "highD, German motorways", "NN_tracks.csv with both Meta.csv", read_highd, needs_of(FILES))
