"""What highD and exiD share: NN_tracks.csv, described by NN_tracksMeta.csv and NN_recordingMeta.csv beside it."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from rampcast.errors import FormatError
from rampcast.formats.files.head import Head, look
from rampcast.formats.format import Needs, table_of
from rampcast.formats.steps.vehicles import KINDS, with_sizes, without_vehicles
from rampcast.formats.tables.columns import MOST_NAMES, SHOWN, Column, Rows, missing_column
from rampcast.formats.tables.rows import read_rows
from rampcast.recording import columns as c
from rampcast.recording.reading import BadRows, ReadReport, join_reports
from rampcast.roads.plane import PLANE_SCHEMA, Plane

TRACKS = "tracks"
COMPANIONS = {"tracksMeta": "the vehicles", "recordingMeta": "the recording"}
UNLIMITED = 50.0  # [m/s] 180 km/h, where speedLimit is -1: no limit; above what highD's cars drove


@dataclass(frozen=True)
class ThreeFiles:
    """The columns of the three files.

    Attributes:
        name: of the data set.
        tracks: columns wanted of NN_tracks.csv, among them "id".
        vehicles: of NN_tracksMeta.csv, among them "id" and "class".
        recording: of NN_recordingMeta.csv, among them "id", "location", "rate" and "limit".
    """

    name: str
    tracks: tuple[Column, ...]
    vehicles: tuple[Column, ...]
    recording: tuple[Column, ...]


class Described(NamedTuple):
    """One recording: its rows with what its other files say of each vehicle, the recording's values, and the report."""

    table: pl.DataFrame
    values: dict[str, Any]
    report: ReadReport


def needs_of(files: ThreeFiles) -> Needs:
    """Returns what tells that a file is one of the three; a file of none is compared with the tracks."""

    def misses(head: Head) -> str | None:
        if any(missing_column(head, columns) is None for columns in (files.vehicles, files.recording)):
            return None
        return missing_column(head, files.tracks)

    return table_of(files.tracks, misses)


def read_location(
    heads: Sequence[Head],
    files: ThreeFiles,
    in_plane: Callable[[Head, Described], Described],
    bad_rows: BadRows,
    *,
    shared: Sequence[str],
) -> tuple[list[Described], Plane, ReadReport]:
    """Returns the recordings of one location, their plane, and what reading found.

    Args:
        heads: of the files of tracks, and of others among them.
        files: their columns.
        in_plane: gives a recording, whose vehicles have sizes, as rows of a plane.
        bad_rows: what to do with a row that is not as it should be.
        shared: values that the recordings of a location share.

    Raises:
        FormatError: a file is missing or not as these are, or the files are of several locations.
    """
    tracks = _tracks_among(heads)
    parts = []
    for head in tracks:
        found = _described(head, files, bad_rows)
        table, filled = with_sizes(found.table)
        parts.append(in_plane(head, Described(table, found.values, replace(found.report, sizes_filled=filled))))
    values = parts[0].values
    _check_one_location(tracks, [part.values for part in parts], shared)
    plane = Plane(
        name=f"{files.name.lower()}-{values['location']}",
        title=f"{files.name}, location {values['location']}",
        source=files.name.lower(),
        rows=pl.concat([part.table for part in parts]),
        time_step=1 / values["rate"],
        speed_limit=_speed_limit(values),
    )
    return parts, plane, join_reports([part.report for part in parts])


def _tracks_among(heads: Sequence[Head]) -> list[Head]:
    """Returns the files of tracks; those that describe them are read with them.

    Raises:
        FormatError: a file that only describes tracks is given without these.
    """
    tracks = [head for head in heads if _kind(head.path) == TRACKS]
    given = {(head.path.parent, _number(head.path, TRACKS)) for head in tracks}
    for path in (head.path for head in heads):
        kind = _kind(path)
        if kind != TRACKS and (path.parent, _number(path, kind)) not in given:
            raise FormatError(
                f"{path}: this file only describes {COMPANIONS[kind]} of {_number(path, kind)}_tracks.csv. Give that "
                "file: what lies beside it is read with it"
            )
    return tracks


def _described(head: Head, files: ThreeFiles, bad_rows: BadRows) -> Described:
    """Returns one recording; its table has the vehicles' columns too, and `kind` for "class".

    Raises:
        FormatError: a file is missing or not as these say, or a vehicle is not described or of no known class
            and such are not to be skipped.
    """
    rows = read_rows(head, files.tracks, bad_rows=bad_rows)
    recording = read_rows(_beside(head.path, "recordingMeta", files), files.recording, bad_rows=bad_rows)
    if recording.table.height != 1:
        raise FormatError(f"{recording.file}: expected one row, that of the recording, found {recording.table.height}")
    vehicles = read_rows(_beside(head.path, "tracksMeta", files), files.vehicles, bad_rows=bad_rows)
    unknown, known = _with_kinds(vehicles, bad_rows)
    rows = without_vehicles(rows, rows.table["id"].is_in(unknown["id"].implode()), _reason(unknown), bad_rows)
    rows = _with_vehicles(rows, known, bad_rows)
    return Described(rows.table, recording.table.row(0, named=True), rows.report(f"{files.name} tracks"))


def _check_one_location(heads: Sequence[Head], recordings: Sequence[Mapping[str, Any]], names: Sequence[str]) -> None:
    """Raises FormatError where recordings of one place differ in values that its recordings share."""
    for head, values in zip(heads, recordings, strict=True):
        for name in names:
            if values[name] != recordings[0][name]:
                raise FormatError(
                    f"{head.path}: its {name} is {values[name]}, that of {heads[0].path.name} is "
                    f"{recordings[0][name]}. Convert recordings of different places by themselves"
                )


def _speed_limit(recording: Mapping[str, Any]) -> float:
    """Returns the speed limit [m/s], NaN where it is not told; the files have -1 where there is none."""
    limit = recording.get("limit")
    return math.nan if limit is None else float(limit) if limit > 0 else UNLIMITED


def _kind(path: Path) -> str:
    return next((kind for kind in COMPANIONS if f"_{kind}" in path.name), TRACKS)


def _number(path: Path, kind: str) -> str:
    return path.name.rpartition(f"_{kind}")[0]


def _beside(path: Path, kind: str, files: ThreeFiles) -> Head:
    number, found, ending = path.name.rpartition(f"_{TRACKS}")
    for name in (f"{number}_{kind}{ending}", f"{number}_{kind}.csv"):
        other = path.with_name(name)
        if found and other.is_file():
            return look(other)
    raise FormatError(
        f"{path}: {files.name}'s {number or 'NN'}_{kind}.csv is not beside it. Expected NN_tracks.csv, "
        "NN_tracksMeta.csv and NN_recordingMeta.csv in one folder, with their original names"
    )


def _with_kinds(vehicles: Rows, bad_rows: BadRows) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Returns the vehicles of a class that is not known, if they are to be skipped; and all others with `kind` for it.

    Both are sorted by id.
    """
    table = vehicles.table.sort("id")
    twice = table.filter(pl.col("id").is_duplicated())
    if twice.height:
        raise FormatError(f"{vehicles.file}: vehicle {twice['id'][0]} is described twice; get the file again")
    kinds = pl.col("class").cast(pl.String).str.to_lowercase()
    unknown, known = table.filter(~kinds.is_in(list(KINDS))), table.filter(kinds.is_in(list(KINDS)))
    if unknown.height and bad_rows is BadRows.RAISE:
        raise FormatError(
            f"{vehicles.file}: vehicle {unknown['id'][0]} {_reason(unknown)}. Rows of such vehicles are skipped with "
            "--skip-bad-rows"
        )
    kind = kinds.replace_strict(KINDS, return_dtype=PLANE_SCHEMA[c.KIND]).alias(c.KIND)
    return unknown, known.select(pl.exclude("class"), kind)


def _reason(unknown: pl.DataFrame) -> str:
    """Returns what is wrong with vehicles of a class that is not known."""
    names = ", ".join(f"'{name[:SHOWN]}'" for name in unknown["class"].unique().sort().head(MOST_NAMES))
    return f"is of class {names}; expected one of {', '.join(KINDS)}"


def _with_vehicles(rows: Rows, vehicles: pl.DataFrame, bad_rows: BadRows) -> Rows:
    """Returns the rows with what is known of their vehicles, which are sorted by id."""
    reason = "it is not in the tracksMeta file beside this one. Get both files again"
    rows = without_vehicles(rows, ~rows.table["id"].is_in(vehicles["id"].implode()), reason, bad_rows)
    index = np.searchsorted(vehicles["id"].to_numpy(), rows.table["id"].to_numpy())
    return replace(rows, table=rows.table.hstack(vehicles.drop("id")[index]))
