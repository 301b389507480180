"""exiD: 25 Hz drone recordings of entries and exits of German motorways; tracks with two csv of metadata beside them.

Positions are centres of boxes in metres from an origin that each recording has in UTM; headings are counter-clockwise
from x. Lanes are lanelets of a map that is not read. Source: the format page of exiD, levelXdata; docs/formats/exid.md.
"""

from collections.abc import Sequence
from dataclasses import replace

import polars as pl

from rampcast.formats.files.head import Head, plain
from rampcast.formats.format import Format, Recordings
from rampcast.formats.readers.levelx.levelx import Described, ThreeFiles, needs_of, read_location
from rampcast.formats.steps import believed
from rampcast.formats.steps.headings import WITHOUT_HEADINGS, check_headings
from rampcast.formats.steps.vehicles import front_centre
from rampcast.formats.tables.columns import Column
from rampcast.formats.tables.thousands import whole_name
from rampcast.recording import columns as c
from rampcast.recording.reading import BadRows, ReadReport
from rampcast.roads.plane import PX, PY, SOURCE_LANE, plane_rows
from rampcast.roads.project import on_roads
from rampcast.sites import Site

OF_LEVELX = {"trackid", "xcenter", "ycenter"}  # columns of the tracks of all its data sets but highD
SEPARATOR = ";"  # between lanelets that overlap where the vehicle is

FILES = ThreeFiles(
    name="exiD",
    tracks=(
        believed.number("id", "trackId"),
        believed.number("frame", "frame"),
        believed.place("x", "xCenter", farthest=believed.FARTHEST_IN_IMAGE),
        believed.place("y", "yCenter", farthest=believed.FARTHEST_IN_IMAGE),
        Column("heading", ("heading",), pl.Float32(), -360, 360),
        believed.width("width"),
        believed.length("length"),
        believed.speed("v", "lonVelocity"),
        believed.acceleration("a", "lonAcceleration"),
        Column("lane", ("laneletId",), pl.Categorical(), may_be_blank=True),
    ),
    vehicles=(
        believed.number("id", "trackId"),
        Column("class", ("class",), pl.String()),
    ),
    recording=(
        believed.number("id", "recordingId"),
        Column("rate", ("frameRate",), low=1, high=1000),
        believed.number("location", "locationId"),
        Column("limit", ("speedLimit",), low=-1, high=100, optional=True, may_be_blank=True),
        believed.place("east", "xUtmOrigin", farthest=believed.FARTHEST_UTM),
        believed.place("north", "yUtmOrigin", farthest=believed.FARTHEST_UTM),
    ),
)


def read_exid(heads: Sequence[Head], site: Site | None, bad_rows: BadRows) -> tuple[Recordings, ReadReport]:
    """Returns the roads of an exiD location, each a recording of its own, and what reading found.

    The files are NN_tracks.csv, each with NN_tracksMeta.csv and NN_recordingMeta.csv beside it, which may be among
    them. The reference of a site is in UTM.
    """
    _, plane, report = read_location(heads, FILES, _in_plane, bad_rows, shared=("location", "rate"))
    return on_roads(plane, site, report)


def _in_plane(head: Head, found: Described) -> Described:
    """Returns the rows in UTM: recordings of one location need not have the same origin."""
    table, values = found.table, found.values
    headings = table.select("id", "frame", "x", "y", pl.col("heading").radians())
    check_headings(head.name, headings, ["id"], time_step=1 / values["rate"], advice=WITHOUT_HEADINGS)
    px, py = front_centre(pl.col("x"), pl.col("y"), pl.col("heading").radians(), pl.col(c.LENGTH))
    lanelets = table["lane"].unique().drop_nulls()
    first = [whole_name(name.partition(SEPARATOR)[0]) for name in lanelets.cast(pl.String)]
    rows = plane_rows(
        table,
        {
            c.RECORDING: pl.lit(str(values["id"]), dtype=pl.Categorical()),
            c.VEHICLE: pl.col("id"),
            c.FRAME: pl.col("frame"),
            PX: (px + values["east"]),
            PY: (py + values["north"]),
            SOURCE_LANE: pl.col("lane").replace_strict(lanelets, first, default=None, return_dtype=pl.Categorical()),
            c.RECORDED_V: pl.col("v"),
            c.RECORDED_A: pl.col("a"),
        },
    )
    return found._replace(table=rows)


def _misses_exid(head: Head) -> str | None:
    """Returns the first thing a file lacks to be one of exiD's three, or that it is of those without lanelets."""
    reason = NEEDS.misses(head)
    names = set(map(plain, head.names))
    if reason is None or not OF_LEVELX <= names or "laneletid" in names:
        return reason
    return "no column 'laneletId': inD, rounD and uniD have none, and no on-ramp; nor has exiD before its version 2"


NEEDS = needs_of(FILES)
EXID = Format(
    "exid",
    "exiD, entries and exits",
    "NN_tracks.csv with both Meta.csv",
    read_exid,
    replace(NEEDS, misses=_misses_exid),
)
