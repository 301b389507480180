"""CitySim: 30 Hz drone recordings of American and Asian roads; one csv a video, in pixels, feet and miles per hour.

Positions are in an image whose x grows to the right and y down; `head` is the middle of the front of a vehicle's
rotated box. Source: the data description in the CitySim repository; see docs/formats/citysim.md.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import polars as pl

from rampcast.formats.files.head import Head
from rampcast.formats.format import Format, Recordings, table_of
from rampcast.formats.steps import believed
from rampcast.formats.steps.headings import check_headings
from rampcast.formats.steps.places import different_names, one_place
from rampcast.formats.steps.units import FOOT, MILE_PER_HOUR
from rampcast.formats.steps.vehicles import with_sizes
from rampcast.formats.tables.columns import Column
from rampcast.formats.tables.rows import read_rows
from rampcast.recording import columns as c
from rampcast.recording.reading import BadRows, ReadReport, join_reports
from rampcast.roads.plane import PLANE_SCHEMA, PX, PY, SOURCE_LANE, Plane, plane_rows
from rampcast.roads.project import on_roads
from rampcast.sites import Site

FRAME_RATE = 30.0  # [Hz] of every video
FARTHEST = 50_000.0  # [ft] no image shows more
FASTEST = 350.0  # [mph]
VIDEO = re.compile(r"(?P<place>.+?)[-_](?P<number>\d+)$")  # FreewayC-01
CORNERS = (1, 2, 3)  # of the box, in order around it: two of its sides

COLUMNS = (
    believed.number("frame", "frameNum"),
    believed.number("id", "carId"),
    believed.place("x", "headXft", farthest=FARTHEST),
    believed.place("y", "headYft", farthest=FARTHEST),
    believed.place("middle_x", "carCenterXft", farthest=FARTHEST, optional=True, may_be_blank=True),
    believed.place("middle_y", "carCenterYft", farthest=FARTHEST, optional=True, may_be_blank=True),
    *(
        Column(f"{axis}{corner}", (f"boundingBox{corner}{axis.upper()}ft",), pl.Float32(), -FARTHEST, FARTHEST)
        for corner in CORNERS
        for axis in ("x", "y")
    ),
    Column("speed", ("speed",), pl.Float32(), -FASTEST, FASTEST),
    Column("lane", ("laneId",), pl.Int16(), -1, 1000, may_be_blank=True),
)


def read_citysim(heads: Sequence[Head], site: Site | None, bad_rows: BadRows) -> tuple[Recordings, ReadReport]:
    """Returns the roads of a place of CitySim, each a recording of its own, and what reading found.

    The files are called PLACE-NN.csv; each is a part of the recordings.
    """
    place = _place([head.path for head in heads])
    parts, reports = [], []
    for head in heads:
        rows = read_rows(head, COLUMNS, bad_rows=bad_rows)
        _check_heads(rows.file, rows.table)
        sized, filled = with_sizes(_in_plane(rows.table, _video(head.path)[1]))
        parts.append(sized)
        reports.append(replace(rows.report("CitySim trajectories"), sizes_filled=filled))
    plane = Plane(
        name="-".join(filter(None, ("citysim", place.lower().replace(" ", "")))),
        title=f"CitySim, {place}" if place else "CitySim",
        source="citysim",
        rows=pl.concat(parts),
        time_step=1 / FRAME_RATE,
    )
    return on_roads(plane, site, join_reports(reports))


def _video(path: Path) -> tuple[str, str]:
    """Returns the place and the number of a video, which its file's name tells; no place where it tells none."""
    stem = path.name.partition(".")[0]
    found = VIDEO.match(stem)
    return (found["place"], found["number"]) if found else ("", stem)


def _place(paths: Sequence[Path]) -> str:
    videos = [_video(path) for path in paths]
    place = one_place(paths, [place for place, _ in videos])
    different_names(paths, [number for _, number in videos])
    return place


def _check_heads(name: str, table: pl.DataFrame) -> None:
    """Raises where many heads are not in front of the centres: head and tail are exchanged then."""
    if not {"middle_x", "middle_y"} <= set(table.columns):
        return
    x, y = pl.col("x") * FOOT, pl.col("y") * -FOOT
    ahead, left = x - pl.col("middle_x") * FOOT, y + pl.col("middle_y") * FOOT
    rows = table.select("id", "frame", x=x, y=y, heading=pl.arctan2(left, ahead))
    advice = "Exchange their names, or read carCenterXft and carCenterYft with --mapping (reference = 'centre')"
    check_headings(name, rows, ["id"], time_step=1 / FRAME_RATE, advice=advice)


def _in_plane(table: pl.DataFrame, part: str) -> pl.DataFrame:
    """Returns the rows with y turned up, in metres; sizes are those of the vehicle's median box."""
    sides = [
        (pl.col(f"x{one}") - pl.col(f"x{two}")).pow(2) + (pl.col(f"y{one}") - pl.col(f"y{two}")).pow(2)
        for one, two in ((1, 2), (2, 3))
    ]
    sizes = table.select(
        "id",
        length=pl.max_horizontal(sides).sqrt() * FOOT,
        width=pl.min_horizontal(sides).sqrt() * FOOT,
    )
    sizes = sizes.group_by("id").agg(pl.col(c.LENGTH, c.WIDTH).median().cast(pl.Float32))
    lane = pl.when(pl.col("lane") >= 0).then(pl.col("lane"))
    return plane_rows(
        table.join(sizes, on="id", how="left", maintain_order="left"),
        {
            c.RECORDING: pl.lit(part, pl.Categorical()),
            c.VEHICLE: pl.col("id"),
            c.FRAME: pl.col("frame"),
            PX: pl.col("x") * FOOT,
            PY: pl.col("y") * -FOOT,
            SOURCE_LANE: lane.cast(pl.String).cast(pl.Categorical()),
            c.KIND: pl.lit("car", PLANE_SCHEMA[c.KIND]),
            c.RECORDED_V: pl.col("speed") * MILE_PER_HOUR,
        },
    )


CITYSIM = Format("citysim", "CitySim, American and Asian roads", "PLACE-NN.csv", read_citysim, table_of(COLUMNS))
