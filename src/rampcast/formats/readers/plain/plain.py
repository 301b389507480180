"""A plain table of trajectories: rampcast's own documented columns, or any others by a mapping file.

The own form is in SI units: x along the road, y to its left, both of the front centre; see docs/formats/plain.md.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from rampcast.errors import FormatError
from rampcast.file_values import close_column
from rampcast.formats.files.head import Head, find_header, plain
from rampcast.formats.format import Format, Needs, Recordings
from rampcast.formats.readers.plain.frames import with_frames
from rampcast.formats.readers.plain.ids import with_ids, without_zeros
from rampcast.formats.readers.plain.lanes import check_lanes, tells_lanes
from rampcast.formats.readers.plain.mapping import NO_VEHICLE, REFERENCES, TEXTS, Entry, TableMapping
from rampcast.formats.readers.plain.places import with_places
from rampcast.formats.readers.plain.times import with_times
from rampcast.formats.steps.believed import FARTHEST_UTM, FASTEST, HARDEST, LONGEST, WIDEST
from rampcast.formats.steps.earth import in_metres, nearest_meridian
from rampcast.formats.steps.headings import check_headings
from rampcast.formats.steps.motion import directions
from rampcast.formats.steps.places import different_names
from rampcast.formats.steps.vehicles import whole_ids, with_sizes
from rampcast.formats.tables.columns import MOST_NAMES, SHOWN, Column
from rampcast.formats.tables.rows import read_rows
from rampcast.recording import columns as c
from rampcast.recording.reading import BadRows, ReadReport, join_reports
from rampcast.recording.recording import METADATA_KEY
from rampcast.recording.translation import as_words, translated
from rampcast.roads.draft_points import without_strays
from rampcast.roads.plane import PLANE_SCHEMA, PX, PY, SOURCE_LANE, Plane, Road, plane_rows
from rampcast.roads.project import on_roads
from rampcast.sites import Lane, Site
from rampcast.sites.site import LANE_WIDTH, NO_LANE

NAME = "plain"
REQUIRED = ("vehicle", "time", "x", "y", "lane")
OPTIONAL = ("recording", "frame", "length", "width", "kind", "speed", "acceleration")
MAY_BE_BLANK = ("lane", "length", "width", "kind", "speed", "acceleration", "heading")
HEADINGS = "Say so in the mapping (unit of heading), or leave heading out: vehicles head where they move then"
# Type of each value, and the least and the largest that is believed, in SI.
TYPES: dict[str, tuple[Any, float, float]] = {
    "recording": (pl.Categorical(), 0, 0),
    "vehicle": (pl.Categorical(), 0, 0),
    "kind": (pl.Categorical(), 0, 0),
    "frame": (pl.Int64(), -(2.0**31), 2.0**31 - 1),
    "time": (pl.Float64(), -1e10, 1e10),  # seconds since 1970 are 2e9 in the year 2033
    "x": (pl.Float64(), -FARTHEST_UTM, FARTHEST_UTM),
    "y": (pl.Float64(), -FARTHEST_UTM, FARTHEST_UTM),
    "latitude": (pl.Float64(), -84, 84),
    "longitude": (pl.Float64(), -180, 180),
    "heading": (pl.Float32(), -100, 100),
    "lane": (pl.Int16(), 0, 1000),
    "length": (pl.Float32(), 0, LONGEST),
    "width": (pl.Float32(), 0, WIDEST),
    "speed": (pl.Float32(), -FASTEST, FASTEST),
    "acceleration": (pl.Float32(), -HARDEST, HARDEST),
}


def misses_plain(head: Head) -> str | None:
    """Returns the first thing a file lacks to be a table in rampcast's own columns; None if nothing."""
    if METADATA_KEY in head.metadata:
        return f"metadata '{METADATA_KEY}': a recording that rampcast wrote"
    if not head.names:
        return "no header that names columns"
    found = {plain(name) for name in head.names}
    return next((f"no column '{name}'" for name in REQUIRED if name not in found), None)


def read_plain(heads: Sequence[Head], site: Site | None, bad_rows: BadRows) -> tuple[Recordings, ReadReport]:
    """Returns the recording in tables with rampcast's own columns, and what reading found.

    Each file is a part of its own unless a column `recording` says otherwise. The lane numbers are those of the site;
    without one it is drafted from them.
    """
    known = {plain(name) for head in heads for name in head.names}
    entries = {name: Entry(column=name) for name in (*REQUIRED, *OPTIONAL) if name in known}
    for name in REQUIRED:
        advice = "; a table of frames alone needs a mapping that says how long one is" if name == "time" else ""
        if name not in known:
            raise FormatError(
                f"{', '.join(head.name for head in heads)}: no column '{name}'{advice} (docs/formats/plain.md)"
            )
    return read_mapped(heads, TableMapping(path="", vehicles=(entries,), name=NAME, title="Table"), site, bad_rows)


def read_mapped(
    heads: Sequence[Head], mapping: TableMapping, site: Site | None, bad_rows: BadRows
) -> tuple[Recordings, ReadReport]:
    """Returns the recordings in tables whose columns a mapping describes, and what reading found.

    Args:
        heads: of csv or parquet files of one place.
        mapping: what their columns are.
        site: the road; None takes the mapping's, or drafts it.
        bad_rows: what to do with a row that is not as it should be.
    """
    parts, report = _read(heads, mapping, bad_rows)
    parts = _in_plane(parts, mapping.meridian) if mapping.on_earth else parts
    site = site or mapping.site
    table, time_step, slips = with_frames(
        _parts(parts, site.name if site else mapping.name), mapping.time_step, files=report.files
    )
    table, filled = _with_sizes(table)
    ids, renumbered = whole_ids(table[c.VEHICLE])
    table = _with_y(table.with_columns(ids.alias(c.VEHICLE)), site)
    if site is None and not mapping.plane and all(tells_lanes(entries) for entries in mapping.vehicles):
        check_lanes(table, report.files)
    plane = Plane(
        name=mapping.name,
        title=mapping.title,
        source=NAME,
        rows=_front(_with_heading(table, mapping, time_step, report.files), mapping.reference),
        time_step=time_step,
        simulated=mapping.simulated,
        roads=() if mapping.plane else _roads(table, time_step),
    )
    report = replace(report, sizes_filled=filled, vehicles_renumbered=renumbered, clock_slips=slips)
    recordings, report = on_roads(plane, _with_sources(site), report)
    return tuple(replace(one, site=site or one.site) for one in recordings), report


def _read(heads: Sequence[Head], mapping: TableMapping, bad_rows: BadRows) -> tuple[list[pl.DataFrame], ReadReport]:
    """Returns the vehicles of each file in SI, one table for each vehicle of a row, and what reading found."""
    _check_names([head.path for head in heads], mapping)
    parts: list[pl.DataFrame] = []
    reports: list[ReadReport] = []
    for head in (_as_described(head, mapping) for head in heads):
        _check_columns(head, mapping)
        rows = with_ids(read_rows(head, _columns(mapping), bad_rows=bad_rows), mapping, bad_rows)
        rows = with_places(with_times(rows, mapping, bad_rows), mapping, bad_rows)
        found = [_vehicle(rows.table, entries, mapping, head.path) for entries in mapping.vehicles]
        report = rows.report(f"table by {mapping.path}" if mapping.path else "plain table")
        reports.append(replace(report, rows_not_vehicles=sum(left_out for _, left_out in found)))
        parts.extend(table for table, _ in found)
    return parts, join_reports(reports)


def _check_names(paths: Sequence[Path], mapping: TableMapping) -> None:
    """Raises if parts that are named for their files would have the same name: their vehicles would be mixed up."""
    if all("recording" in entries for entries in mapping.vehicles):
        return
    different_names(
        paths, [_part_of(path) for path in paths], others="say in a column 'recording' which part a row is of"
    )


def _part_of(path: Path) -> str:
    """Returns the name of the part that a file is."""
    return path.name.partition(".")[0]


def _check_columns(head: Head, mapping: TableMapping) -> None:
    """Raises if the file lacks a column that the mapping names."""
    if not head.names:
        raise FormatError(f"{head.name}: expected a csv whose first line names its columns, or a parquet file")
    found = {plain(name) for name in head.names}
    for column, name in mapping.columns.items():
        if plain(column) in found:
            continue
        if not mapping.path:
            raise FormatError(
                f"{head.name}: no column '{column}', which another of the files has. Give all of them the same "
                "columns, or convert each by itself"
            )
        names = ", ".join(name[:SHOWN] for name in head.names[:MOST_NAMES])
        close = close_column(column, head.names, needed=mapping.columns)
        hint = f"; is '{close[:SHOWN]}' meant?" if close else f"; its columns are {names}. Mend either"
        raise FormatError(f"{head.name}: no column '{column[:SHOWN]}', which {mapping.path} names for {name}{hint}")


def _columns(mapping: TableMapping) -> tuple[Column, ...]:
    """Returns the columns to read, in the file's units; one that is used twice is believed what both uses believe."""
    found: dict[str, Column] = {}
    for entries in mapping.vehicles:
        for name, entry in entries.items():
            if not entry.column:
                continue
            one = _column(name, entry, is_alone=len(mapping.vehicles) == 1)
            other = found.setdefault(entry.column, one)
            if one.is_text != other.is_text:
                what = f"column '{entry.column}' is read as text and as a number; leave out one"
                raise FormatError(f"{mapping.path}: {what}")
            found[entry.column] = replace(
                one,
                type=one.type if one.type == other.type else pl.Float64(),
                low=min(one.low, other.low),
                high=max(one.high, other.high),
                may_be_blank=one.may_be_blank or other.may_be_blank,
            )
    return tuple(found.values())


def _column(name: str, entry: Entry, *, is_alone: bool) -> Column:
    """Returns a column to read; where a row holds several vehicles, some of them may be absent."""
    kind, low, high = TYPES[name]
    kind = pl.Categorical() if entry.values else pl.String() if entry.written else kind
    ends = sorted((end - entry.plus * abs(entry.factor)) / entry.factor for end in (low, high))
    may_be_blank = name in MAY_BE_BLANK or not (is_alone or name in ("frame", "time"))
    return Column(entry.column, (entry.column,), kind, ends[0], ends[1], may_be_blank=may_be_blank)


def _vehicle(
    table: pl.DataFrame, entries: Mapping[str, Entry], mapping: TableMapping, path: Path
) -> tuple[pl.DataFrame, int]:
    """Returns one vehicle of each row in SI, without the rows in which it is absent, and how many are of no vehicle."""
    rows_before = table.height
    table = _of_vehicles(table, entries)
    left_out = rows_before - table.height
    values = {name: _values(table, name, entry, mapping, path) for name, entry in entries.items()}
    if "recording" not in values:
        values["recording"] = pl.lit(_part_of(path), pl.Categorical())
    rows = table.select(values[name].alias(name) if name in values else _nothing(name) for name in TYPES)
    place = "latitude" if mapping.on_earth else "x"
    if len(mapping.vehicles) > 1:
        rows = rows.filter(pl.col("vehicle").is_not_null() & pl.col(place).is_not_null())
    if mapping.absent:
        known = rows.height
        rows = rows.filter(~pl.col("vehicle").cast(pl.String).is_in(mapping.absent))
        left_out += known - rows.height if len(mapping.vehicles) == 1 else 0
    return rows.with_columns(_told_by_kind(name, one) for name, one in entries.items() if one.by_kind), left_out


def _of_vehicles(table: pl.DataFrame, entries: Mapping[str, Entry]) -> pl.DataFrame:
    """Returns the rows that are of vehicles, and not of a kind that the mapping says is none."""
    kind = entries.get("kind")
    gone = [word for word, meant in kind.values.items() if meant == NO_VEHICLE] if kind else []
    if kind is None or not gone:
        return table
    return table.filter(~without_zeros(pl.col(kind.column).cast(pl.String)).is_in(gone).fill_null(False))


def _told_by_kind(name: str, entry: Entry) -> pl.Expr:
    told = pl.col("kind").cast(pl.String).fill_null("car").replace_strict(dict(entry.by_kind), default=None)
    return pl.col(name).fill_null(told.cast(TYPES[name][0]))


def _as_described(head: Head, mapping: TableMapping) -> Head:
    """Returns a file with the header that the separator of the mapping parts, and the decimal sign that it names."""
    if not head.is_text or not (mapping.separator or mapping.decimal):
        return head
    header = find_header(head.text, (mapping.separator,)) if mapping.separator else head.header
    return replace(head, header=replace(header, decimal=mapping.decimal) if header else None)


def _in_plane(parts: Sequence[pl.DataFrame], meridian: float | None) -> list[pl.DataFrame]:
    """Returns the parts with x to the east and y to the north [m] for their degrees, in one plane."""
    first = next((part for part in parts if part.height), parts[0])
    meridian = nearest_meridian(first["longitude"].to_numpy()) if meridian is None else meridian
    places = [in_metres(part["latitude"].to_numpy(), part["longitude"].to_numpy(), meridian) for part in parts]
    return [part.with_columns(pl.Series(c.X, x), pl.Series(c.Y, y)) for part, (x, y) in zip(parts, places, strict=True)]


def _parts(tables: Sequence[pl.DataFrame], site: str) -> pl.DataFrame:
    """Returns the tables as one, and the parts of a recording without the site's name, which all recordings have."""
    table = pl.concat(tables)
    words = table[c.RECORDING].unique().drop_nulls()
    names = words.cast(pl.String).str.strip_prefix(f"{site}-")
    if names.equals(words.cast(pl.String)):
        return table
    return table.with_columns(pl.col(c.RECORDING).replace_strict(words, names, return_dtype=pl.Categorical()))


def _nothing(name: str) -> pl.Expr:
    return pl.lit(None, PLANE_SCHEMA[c.KIND] if name == "kind" else TYPES[name][0]).alias(name)


def _values(table: pl.DataFrame, name: str, entry: Entry, mapping: TableMapping, path: Path) -> pl.Expr:
    kind = PLANE_SCHEMA[c.KIND] if name == "kind" else TYPES[name][0]
    if entry.constant is not None:
        _, low, high = TYPES[name]
        if isinstance(entry.constant, int | float) and not low <= entry.constant <= high:
            what = f"{name} is {entry.constant:,.6g} in every row, expected {low:,g} to {high:,g}"
            raise FormatError(f"{mapping.path}: {what}. A constant is in SI units: mend it")
        return pl.lit(entry.constant).cast(kind)
    if not entry.column:
        return _nothing(name)
    if name in TEXTS or entry.values:
        return pl.lit(_words(table[entry.column], name, entry, kind, f"{path}: {entry.column}"))
    cell = pl.col(entry.column)
    cell = cell.fill_nan(None) if table.schema[entry.column].is_float() else cell
    if entry.factor != 1 or entry.plus:
        cell = cell.cast(pl.Float64) * entry.factor + entry.plus * abs(entry.factor)
    return cell.round().cast(kind) if name == "frame" and table.schema[entry.column].is_float() else cell.cast(kind)


def _words(words: pl.Series, name: str, entry: Entry, kind: Any, place: str) -> pl.Series:
    """Returns texts without the ".0" of whole numbers that were floats, as the mapping translates them, of a kind."""
    unique = words.unique().drop_nulls()
    plainly = unique.to_frame("word").select(without_zeros(pl.col("word").cast(pl.String))).to_series()
    known = dict(entry.values) or ({kind: kind for kind in c.KINDS} if name == "kind" else {})
    asked = plainly.str.to_lowercase() if name == "kind" and not entry.values else plainly
    unknown = sorted(plainly.filter(~asked.is_in(list(known)))) if known else []
    if unknown:
        where = "are listed under its values" if entry.values else "rampcast knows"
        raise FormatError(
            f"{place} holds '{unknown[0][:SHOWN]}', which is no {name}; {', '.join(one[:SHOWN] for one in known)} "
            f"{where}. Say in a mapping what it means: values = {{ {unknown[0][:SHOWN]!r} = ... }}"
        )
    new = asked.replace_strict(known) if known else plainly
    if not known and new.equals(unique.cast(pl.String)):
        return words.cast(kind)
    return translated(words, unique, new.cast(kind))


def _with_sizes(table: pl.DataFrame) -> tuple[pl.DataFrame, int]:
    """Returns the rows with the sizes that the vehicle has in other rows, else typical ones, and how many were typical.

    A vehicle of no kind is a car.
    """
    table = table.with_columns(pl.col(c.KIND).fill_null("car"))
    own = (
        pl.col(name).fill_null(pl.col(name).drop_nulls().first().over(c.RECORDING, c.VEHICLE))
        for name in (c.LENGTH, c.WIDTH)
        if 0 < table[name].null_count() < table.height
    )
    return with_sizes(table.with_columns(own))


def _with_y(table: pl.DataFrame, site: Site | None) -> pl.DataFrame:
    """Returns the rows with the y of their lane's centre where they have none.

    One of no lane is put a lane's width beside the leftmost, where it is in no lane.
    """
    if not table[c.Y].has_nulls():
        return table
    lanes = site.lanes if site else [Lane(n, "main", (0.5 - n) * LANE_WIDTH) for n in table[c.LANE].unique() if n]
    centres = {lane.number: lane.centre for lane in lanes}
    beside = max(centres.values(), default=0.0) + LANE_WIDTH
    known = pl.col(c.LANE).replace_strict(centres, default=beside, return_dtype=pl.Float64)
    return table.with_columns(pl.col(c.Y).fill_null(known))


def _with_heading(table: pl.DataFrame, mapping: TableMapping, time_step: float, files: Sequence[str]) -> pl.DataFrame:
    """Returns the rows with a heading [rad] where they have none: along the road; in a plane, as the vehicle moves."""
    if mapping.reference == "front":
        return table
    key = [c.RECORDING, c.VEHICLE]
    headings = table.select(*key, c.FRAME, c.X, c.Y, "heading")
    check_headings(", ".join(files), headings, key, time_step=time_step, advice=HEADINGS)
    if not table["heading"].has_nulls():
        return table
    if not mapping.plane:
        return table.with_columns(pl.col("heading").fill_null(0.0))
    table = table.sort(c.RECORDING, c.VEHICLE, c.FRAME)
    track = table.select(pl.struct(c.RECORDING, c.VEHICLE).rle_id().cast(pl.Int64)).to_series().to_numpy()
    ux, uy = directions(track, table[c.X].to_numpy(), table[c.Y].to_numpy(), time_step=time_step)
    return table.with_columns(pl.col("heading").fill_null(pl.Series(np.arctan2(uy, ux))))


def _front(table: pl.DataFrame, reference: str) -> pl.DataFrame:
    """Returns the rows of a plane: positions moved to the front centre."""
    ahead, left = REFERENCES[reference]
    px, py = pl.col(c.X), pl.col(c.Y)
    if reference != "front":
        heading = pl.col("heading").cast(pl.Float64)
        along, across = ahead * pl.col(c.LENGTH).cast(pl.Float64), left * pl.col(c.WIDTH).cast(pl.Float64)
        px = px + along * heading.cos() - across * heading.sin()
        py = py + along * heading.sin() + across * heading.cos()
    return plane_rows(
        table,
        {
            PX: px,
            PY: py,
            SOURCE_LANE: pl.when(pl.col(c.LANE) > NO_LANE).then(as_words(table[c.LANE])),
            c.RECORDED_V: pl.col("speed"),
            c.RECORDED_A: pl.col("acceleration"),
        },
    )


def _roads(table: pl.DataFrame, time_step: float) -> tuple[Road, ...]:
    """Returns the road of a table along the road: x as it is, and the lanes by their numbers, centred on their rows."""
    places = table.select(c.RECORDING, c.VEHICLE, c.FRAME, pl.col(c.X).alias(PX), pl.col(c.Y).alias(PY))
    x = without_strays(Plane("", "", NAME, places, time_step)).rows[PX].to_numpy()
    start = min(float(np.floor(x.min())), 0.0)  # a road begins at x = 0: one that began before is moved
    end = max(float(np.ceil(x.max())), start + 1.0)
    centres = table.filter(pl.col(c.LANE) > NO_LANE).group_by(c.LANE).agg(pl.col(c.Y).median()).sort(c.LANE)
    lanes = tuple(Lane(number, "main", round(centre, 3), (str(number),)) for number, centre in centres.iter_rows())
    return (Road("", ((start, 0.0), (end, 0.0)), lanes),)


def _with_sources(site: Site | None) -> Site | None:
    """Returns the site with its lane numbers as the names of its lanes, where it names none itself."""
    if site is None or any(lane.sources for lane in site.lanes):
        return site
    return replace(site, lanes=tuple(replace(lane, sources=(str(lane.number),)) for lane in site.lanes))


PLAIN = Format(NAME, "plain table, rampcast's own columns", ".csv, .parquet", read_plain, Needs(misses_plain, REQUIRED))
