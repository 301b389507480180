"""INTERACTION: drone and camera recordings of merges, crossings and roundabouts, 10 Hz; vehicle_tracks_NNN.csv.

Positions are centres of boxes in metres, y to the left of x; `psi_rad` is the heading, counter-clockwise from x. There
are no lanes. Source: the format page of the INTERACTION data set; see docs/formats/interaction.md.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import polars as pl

from rampcast.errors import FormatError
from rampcast.formats.files.head import Head
from rampcast.formats.format import Format, Recordings, table_of
from rampcast.formats.steps import believed
from rampcast.formats.steps.clock import check_one_step, whole_frames
from rampcast.formats.steps.headings import WITHOUT_HEADINGS, check_headings
from rampcast.formats.steps.places import different_names, one_place
from rampcast.formats.steps.vehicles import (
    KINDS,
    front_centre,
    whole_ids,
    whole_names,
    with_sizes,
    without_odd_numbers,
    without_vehicles,
)
from rampcast.formats.tables.columns import SHOWN, Column, Rows
from rampcast.formats.tables.rows import read_rows
from rampcast.recording import columns as c
from rampcast.recording.reading import BadRows, ReadReport, join_reports
from rampcast.recording.translation import translated
from rampcast.roads.plane import PLANE_SCHEMA, PX, PY, Plane, plane_rows
from rampcast.roads.project import on_roads
from rampcast.sites import Site

TURN = 6.2832  # [rad] a little above two pi
SCENARIO = re.compile(r"(DR|TC)_[A-Z]{3}_[A-Za-z]+_[A-Z]{2}")  # from a drone or a traffic camera; country, kind, place
NUMBER = re.compile(r"\d+$")  # of vehicle_tracks_000
BLANK = "nan"  # as pandas writes it
NOT_VEHICLES = ("pedestrian", "bicycle", "pedestrian/bicycle", "person", "cyclist")

COLUMNS = (
    Column("id", ("track_id",), pl.Categorical()),
    Column("time", ("timestamp_ms",), pl.Int64(), 0, 1e13),  # or since 1970
    Column("type", ("agent_type",), pl.Categorical(), optional=True, may_be_blank=True),  # blank: a car
    believed.place("x", "x", farthest=believed.FARTHEST_UTM),
    believed.place("y", "y", farthest=believed.FARTHEST_UTM),
    believed.speed("vx", "vx"),
    believed.speed("vy", "vy"),
    Column("psi", ("psi_rad",), pl.Float32(), -TURN, TURN, may_be_blank=True),  # of pedestrians
    believed.length("length", may_be_blank=True),  # likewise
    believed.width("width", may_be_blank=True),  # likewise
    believed.number("case", "case_id", optional=True),
)


def read_interaction(heads: Sequence[Head], site: Site | None, bad_rows: BadRows) -> tuple[Recordings, ReadReport]:
    """Returns the roads of a place of INTERACTION, each a recording of its own, and what reading found.

    Each file is a part of a recording; where a file has cases, each is a part, since ids repeat across cases.
    """
    paths = [head.path for head in heads]
    place = _place(paths)
    parts = [_read_part(head, bad_rows) for head in heads]
    steps = [time_step for _, time_step, _ in parts]
    check_one_step(paths, steps)
    plane = Plane(
        name="-".join(["interaction", *place.lower().split("_")]) if place else "interaction",
        title=f"INTERACTION, {place}" if place else "INTERACTION",
        source="interaction",
        rows=pl.concat([rows for rows, _, _ in parts]),
        time_step=steps[0],
    )
    return on_roads(plane, site, join_reports([report for _, _, report in parts]))


def _place(paths: Sequence[Path]) -> str:
    """Returns the name of the place, which folders or files have in INTERACTION; "" where they have none."""
    found = [SCENARIO.search(path.stem) or SCENARIO.search(path.absolute().parent.name) for path in paths]
    places = [match.group() if match else "" for match in found]
    different_names(paths, [path.stem for path in paths])
    return one_place(paths, places)


def _read_part(head: Head, bad_rows: BadRows) -> tuple[pl.DataFrame, float, ReadReport]:
    """Returns the rows of a file in its plane, its time step [s], and what reading found."""
    rows, others, cars = _vehicles(read_rows(head, COLUMNS, bad_rows=bad_rows))
    rows = replace(rows, table=rows.table.with_columns(whole_names(rows.table["id"]).alias("id")))
    rows = without_odd_numbers(rows, "track_id", bad_rows)
    ids, renumbered = whole_ids(rows.table["id"])
    rows = replace(rows, table=rows.table.with_columns(ids.alias("id")))
    reason = "its heading psi_rad is missing. Mend the file"
    rows = without_vehicles(rows, rows.table["psi"].is_null(), reason, bad_rows)
    frames, time_step, slips = whole_frames(rows.file, rows.table["time"] / 1000)
    table, filled = with_sizes(rows.table.with_columns(pl.Series(c.FRAME, frames)))
    report = rows.report("INTERACTION tracks" + (" with cases" if "case" in table.columns else ""))
    found = NUMBER.search(head.path.stem)
    read = report.rows_read + others
    report = replace(
        report,
        rows_read=read,
        rows_not_vehicles=others,
        vehicles_renumbered=renumbered,
        clock_slips=slips,
        sizes_filled=filled,
        kinds_filled=cars,
    )
    track = ["case", "id"] if "case" in table.columns else ["id"]
    headings = table.select(*track, c.FRAME, "x", "y", heading="psi")
    check_headings(rows.file, headings, track, time_step=time_step, advice=WITHOUT_HEADINGS)
    return _in_plane(table, found.group() if found else head.path.stem), time_step, report


def _vehicles(rows: Rows) -> tuple[Rows, int, int]:
    """Returns the rows of vehicles, with their kind, how many others there were, and how many of no type, now cars."""
    car = pl.lit("car", PLANE_SCHEMA[c.KIND])
    if "type" not in rows.table.columns:
        return replace(rows, table=rows.table.with_columns(car.alias(c.KIND))), 0, rows.table.height
    types = rows.table["type"].unique().drop_nulls()
    words = types.cast(pl.String)
    lower = words.str.to_lowercase()
    unknown = words.filter(~lower.is_in([*KINDS, *NOT_VEHICLES, BLANK])).sort()
    if unknown.len():
        raise FormatError(
            f"{rows.file}: there is an agent_type '{unknown[0][:SHOWN]}'; expected one of "
            f"{', '.join((*KINDS, *NOT_VEHICLES))}. Name it so in the file, or describe the table with "
            "--mapping, whose values say what it is (docs/formats/plain.md)"
        )
    kinds = lower.replace_strict(KINDS, default=None, return_dtype=PLANE_SCHEMA[c.KIND])
    kind = translated(rows.table["type"], types, kinds)
    is_blank = translated(rows.table["type"], types, lower == BLANK).fill_null(True)
    table = rows.table.with_columns(pl.when(is_blank).then(car).otherwise(kind).alias(c.KIND))
    vehicles = table.drop_nulls(c.KIND) if table[c.KIND].has_nulls() else table
    if vehicles.is_empty():
        raise FormatError(f"{rows.file}: it holds no vehicles, only {', '.join(words.sort())}")
    return replace(rows, table=vehicles), table.height - vehicles.height, int(is_blank.sum())


def _in_plane(table: pl.DataFrame, name: str) -> pl.DataFrame:
    part = pl.lit(name, dtype=pl.Categorical())
    if "case" in table.columns:
        cases = table["case"].unique()
        names = pl.select(pl.lit(f"{name}.") + cases.cast(pl.String).str.zfill(len(str(cases.max())))).to_series()
        part = pl.col("case").replace_strict(cases, names, return_dtype=pl.Categorical())
    px, py = front_centre(pl.col("x"), pl.col("y"), pl.col("psi"), pl.col(c.LENGTH))
    return plane_rows(
        table,
        {
            c.RECORDING: part,
            c.VEHICLE: pl.col("id"),
            PX: px,
            PY: py,
            c.RECORDED_V: pl.col("vx") * pl.col("psi").cos() + pl.col("vy") * pl.col("psi").sin(),
        },
    )


INTERACTION = Format("interaction", "INTERACTION", "vehicle_tracks_NNN.csv", read_interaction, table_of(COLUMNS))
