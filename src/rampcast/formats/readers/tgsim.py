"""TGSIM: 10 Hz trajectories of American freeways filmed from the air, of the US Federal Highway Administration.

Positions are taken as the vehicles' centres, in the plane of an aerial image; the source gives no heading.
Source of columns and codes: the data sets' pages on data.transportation.gov; see docs/formats/tgsim.md.
"""

from collections.abc import Sequence

import polars as pl

from rampcast.formats.files.head import Head
from rampcast.formats.format import Format, Recordings, table_of
from rampcast.formats.steps import believed
from rampcast.formats.steps.clock import numbered
from rampcast.formats.steps.motion import with_fronts
from rampcast.formats.steps.vehicles import with_sizes
from rampcast.formats.tables.columns import Column
from rampcast.formats.tables.rows import read_rows
from rampcast.formats.tables.thousands import whole_name
from rampcast.recording import columns as c
from rampcast.recording.reading import BadRows, ReadReport, join_reports
from rampcast.recording.translation import as_words
from rampcast.roads.plane import PLANE_SCHEMA, SOURCE_LANE, Plane, plane_rows
from rampcast.roads.project import on_roads
from rampcast.sites import Site

TIME_STEP = 0.1  # [s]
FARTHEST = 100_000.0  # [m] no image reaches as far
KINDS = {  # type-most-common without the ending "-vehicle"; codes are those of I-395. Any other is a car
    "2": "truck",
    "3": "truck",
    "large": "truck",
    "truck": "truck",
    "bus": "truck",
    "motorcycle": "motorcycle",
}

COLUMNS = (
    believed.number("id", "ID"),
    Column("time", ("time",), low=0, high=c.LARGEST * TIME_STEP),
    believed.place("px", "xloc-kf", farthest=FARTHEST),
    believed.place("py", "yloc-kf", farthest=FARTHEST),
    Column("lane", ("lane-kf",), pl.Int16(), -1000, 1000, may_be_blank=True),
    believed.speed("v", "speed-kf", may_be_blank=True),
    believed.acceleration("a", "acceleration-kf", optional=True, may_be_blank=True),
    believed.length("length-smoothed", may_be_blank=True),
    believed.width("width-smoothed", optional=True, may_be_blank=True),
    Column("type", ("type-most-common",), pl.Categorical(), may_be_blank=True),
    Column("run", ("run-index",), pl.Categorical(), optional=True),
)


def read_tgsim(heads: Sequence[Head], site: Site | None, bad_rows: BadRows) -> tuple[Recordings, ReadReport]:
    """Returns the recordings in TGSIM files of one place, one a road, each run a part; and what reading found."""
    parts, reports = [], []
    for number, head in enumerate(heads, start=1):
        found = read_rows(head, COLUMNS, bad_rows=bad_rows)
        rows, filled = with_sizes(_completed(found.table, run=str(number)))
        parts.append(rows)
        reports.append(found.report("TGSIM trajectories"))
        reports[-1] = join_reports([reports[-1], ReadReport((), (), 0, sizes_filled=filled)])
    rows = pl.concat(parts)
    frames, slips = numbered(", ".join(head.name for head in heads), rows["time"], TIME_STEP)
    rows = rows.with_columns(pl.Series(c.FRAME, frames))
    plane = Plane("tgsim", "TGSIM", "tgsim", _in_plane(rows), TIME_STEP)
    return on_roads(plane, site, join_reports([*reports, ReadReport((), (), 0, clock_slips=slips)]))


def _completed(table: pl.DataFrame, *, run: str) -> pl.DataFrame:
    """Returns the rows with kinds and names of runs (one of its own for a file without), and nothing for what it lacks.

    Args:
        table: the rows of a file.
        run: name of its run where it names none: ids repeat across files.
    """
    absent = {
        column.name: pl.lit(run if column.name == "run" else None, column.type)
        for column in COLUMNS
        if column.name not in table.columns
    }
    table = table.with_columns(**absent)
    kinds = {name: _kind(name) for name in table["type"].unique().drop_nulls()}
    runs = {name: whole_name(name) for name in table["run"].unique()}
    return table.with_columns(
        pl.col("type").replace_strict(kinds, default="car", return_dtype=PLANE_SCHEMA[c.KIND]).alias(c.KIND),
        pl.col("run").replace_strict(runs, return_dtype=PLANE_SCHEMA[c.RECORDING]),
    )


def _kind(name: str) -> str:
    return KINDS.get(whole_name(name).lower().replace("_", "-").removesuffix("-vehicle"), "car")


def _in_plane(rows: pl.DataFrame) -> pl.DataFrame:
    """Returns the rows as those of a plane, with front centres."""
    centres = plane_rows(
        rows,
        {
            c.RECORDING: pl.col("run"),
            c.VEHICLE: pl.col("id"),
            SOURCE_LANE: as_words(rows["lane"]),
            c.RECORDED_V: pl.col("v"),
            c.RECORDED_A: pl.col("a"),
        },
    )
    return with_fronts(centres, time_step=TIME_STEP)


TGSIM = Format(
    "tgsim", "TGSIM, American freeways", ".csv of the portal or its API, .parquet", read_tgsim, table_of(COLUMNS)
)
