"""NGSIM trajectories of freeways: the 18-column text, the csv of each site, and the portal's export.

Source: US Department of Transportation, Next Generation Simulation, data set 8ect-6jqj.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

import numpy as np
import polars as pl

from rampcast.errors import FormatError
from rampcast.formats.files.head import BYTE_ORDER_MARK, Head
from rampcast.formats.files.sources import open_source, parse_ahead, read_chunks
from rampcast.formats.format import Format, Needs, Recordings
from rampcast.formats.readers.ngsim import windows as clocks
from rampcast.formats.readers.ngsim.layout import RECORDED, WANTED, Layout, detect_layout, misses_ngsim
from rampcast.formats.readers.ngsim.rows import Parsed, Rules, parse_chunk, parse_lines, rules_of
from rampcast.formats.readers.ngsim.site import guess_ngsim_site
from rampcast.formats.steps.units import FOOT
from rampcast.formats.steps.vehicles import with_sizes
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.recording.order import sorted_unique
from rampcast.recording.reading import MOST_LISTED, BadRow, BadRows, ReadReport
from rampcast.sites import Site

SOURCE = "ngsim"
TIME_STEP = 0.1  # [s]
SHORTEST_CAR = 8.0  # [ft] the shortest car sold is 8.2 ft (2.5 m)


@dataclass(frozen=True)
class _File:
    """The rows of one file, and the counts that go with them."""

    name: str
    layout: Layout
    parts: tuple[pl.DataFrame, ...]
    rows_read: int
    other_locations: dict[str, int]
    faults: tuple[BadRow, ...]
    faults_counted: int
    grouped_numbers: int


def read_ngsim(
    heads: Sequence[Head], site: Site | None = None, bad_rows: BadRows = BadRows.RAISE
) -> tuple[Recordings, ReadReport]:
    """Returns the trajectories of one site in NGSIM's files, and what reading found.

    Rows are told apart into the site's recorded windows by the clock of the recording (see `ngsim_windows`); rows
    outside all of them are kept under the site's name alone.

    Args:
        heads: of files of one site, plain or in a .gz or .zip.
        site: the geometry; its `location` picks the rows of the portal's export. None tells it by the files' content.
        bad_rows: whether a row that is not as it should be is an error or is skipped and counted.

    Raises:
        FormatError: a file is none of the forms, is of another site, or has a bad row and those are not to be skipped.
    """
    site = site or guess_ngsim_site(heads)
    rules = rules_of(site)
    files = [_read_file(head.path, rules, bad_rows) for head in heads]
    for file in files:
        _check_file(file, site)
    report = ReadReport(
        files=tuple(file.name for file in files),
        forms=tuple(file.layout.title for file in files),
        rows_read=sum(file.rows_read for file in files),
        rows_other_location=sum(sum(file.other_locations.values()) for file in files),
        rows_skipped=sum(file.faults_counted for file in files),
        skipped=tuple(fault for file in files for fault in file.faults)[:MOST_LISTED],
        grouped_numbers=sum(file.grouped_numbers for file in files),
    )
    rows, filled = with_sizes(pl.concat([part for file in files for part in file.parts]))
    del files  # the parts are not needed beside the whole
    recording, report = _assemble(rows, site, replace(report, sizes_filled=filled))
    return (recording,), report


def _read_file(path: Path, rules: Rules, bad_rows: BadRows) -> _File:
    with open_source(path) as (name, stream):
        chunks = read_chunks(name, stream)
        first = next(chunks, b"")
        layout = detect_layout(name, first)
        file = _File(name, layout, (), 0, {}, (), 0, 0)
        parts = []
        styles: dict[str, str] = {}
        for parsed in _parse(name, first, chunks, layout, rules, styles):
            if parsed.faults and bad_rows is BadRows.RAISE:
                raise FormatError(_advice(parsed.faults[0]))
            parts.append(parsed.rows)
            file = _count(file, parsed)
    return replace(file, parts=tuple(parts))


def _parse(
    name: str, first: bytes, chunks: Iterator[bytes], layout: Layout, rules: Rules, styles: dict[str, str]
) -> Iterator[Parsed]:
    """Yields the chunks parsed in order, in metres: fast, and line by line where that finds anything wrong."""

    def fast(chunk: bytes) -> Parsed | None:
        return _parse_fast(_without_lines(chunk, layout.header_lines if chunk is first else 0), layout, rules)

    line = 1
    for chunk, found in parse_ahead(chain([first], chunks), fast):
        parsed = found
        header = layout.header_lines if line == 1 else 0
        if parsed is None or any(styles.get(key, style) != style for key, style in parsed.styles.items()):
            body = _without_lines(chunk, header)
            slow = parse_lines(body, layout, rules, file=name, first_line=line + header, styles=styles)
            parsed = replace(slow, rows=_to_metres(slow.rows))
        styles.update(parsed.styles)
        line += parsed.lines + header
        yield parsed


def _parse_fast(chunk: bytes, layout: Layout, rules: Rules) -> Parsed | None:
    parsed = parse_chunk(chunk, layout, rules)
    return parsed and replace(parsed, rows=_to_metres(parsed.rows))


def _without_lines(chunk: bytes, count: int) -> bytes:
    for _ in range(count):
        chunk = chunk.partition(b"\n")[2]
    return chunk.removeprefix(BYTE_ORDER_MARK)


def _count(file: _File, parsed: Parsed) -> _File:
    others = dict(file.other_locations)
    for location, rows in parsed.other_locations.items():
        others[location] = others.get(location, 0) + rows
    return replace(
        file,
        rows_read=file.rows_read + parsed.rows.height + sum(parsed.other_locations.values()) + len(parsed.faults),
        other_locations=others,
        faults=(file.faults + parsed.faults)[:MOST_LISTED],
        faults_counted=file.faults_counted + len(parsed.faults),
        grouped_numbers=file.grouped_numbers + parsed.grouped_numbers,
    )


def _advice(fault: BadRow) -> str:
    return f"{fault}. Mend the file, or skip such rows with --skip-bad-rows (bad_rows=BadRows.SKIP)"


def _to_metres(rows: pl.DataFrame) -> pl.DataFrame:
    """Returns rows in SI: x = Local_Y, and y = -Local_X because NGSIM counts to the right and rampcast to the left."""
    return rows.select(
        pl.col("vehicle_id").cast(pl.Int32).alias(c.VEHICLE),
        pl.col("frame_id").cast(pl.Int32).alias(c.FRAME),
        (pl.col("local_y") * FOOT).alias(c.X),
        (pl.col("local_x") * -FOOT).alias(c.Y),
        pl.col("lane_id").cast(pl.Int16).alias(c.LANE),
        (pl.col("v_length") * FOOT).cast(pl.Float32).alias(c.LENGTH),
        (pl.col("v_width") * FOOT).cast(pl.Float32).alias(c.WIDTH),
        _kind(pl.col("v_class")).alias(c.KIND),
        *(_recorded(rows, name).alias(ours) for name, ours in zip(RECORDED, c.OPTIONAL_SCHEMA, strict=True)),
        (pl.col("global_time").cast(pl.Int64) - clocks.FRAME_MS * pl.col("frame_id").cast(pl.Int64)).alias(
            clocks.CLOCK
        ),
    )


def _recorded(rows: pl.DataFrame, name: str) -> pl.Expr:
    if name not in rows.columns:
        return pl.lit(None, pl.Float32())
    return (pl.col(name) * FOOT).cast(pl.Float32)


def _kind(v_class: pl.Expr) -> pl.Expr:
    """Returns the kind of vehicle; NGSIM's data dictionary: 1 motorcycle, 2 auto, 3 truck."""
    motorcycle, car, truck = (pl.lit(kind, dtype=c.SCHEMA[c.KIND]) for kind in c.KINDS)
    return pl.when(v_class == 1).then(motorcycle).when(v_class == 2).then(car).otherwise(truck)


def _check_file(file: _File, site: Site) -> None:
    rows = sum(part.height for part in file.parts)
    others = ", ".join(f"{location or '(empty)'} ({count:,} rows)" for location, count in file.other_locations.items())
    if not rows and file.other_locations:
        raise FormatError(
            f"{file.name}: no row has the Location '{site.location}' of site {site.name}; found {others}. "
            "Choose the site that fits with --site"
        )
    if not rows and file.faults:
        raise FormatError(f"{file.name}: none of its {file.faults_counted:,} rows can be read. {file.faults[0]}")
    if not rows:
        raise FormatError(f"{file.name}: the file has a header but no rows; get the file again")
    cars = pl.concat([part.filter(pl.col(c.KIND) == "car")[c.LENGTH] for part in file.parts])
    median = float(np.median(cars.to_numpy())) / FOOT if cars.len() else 0.0
    if 0 < median < SHORTEST_CAR:
        raise FormatError(
            f"{file.name}: half of the cars are shorter than {median:.1f} ft ({median * FOOT:.1f} m): the "
            "file seems to be in metres. Expected NGSIM's own feet: convert Local_X, Local_Y, v_Length and v_Width"
        )


def _assemble(rows: pl.DataFrame, site: Site, report: ReadReport) -> tuple[Recording, ReadReport]:
    """Returns the recording: rows told apart into windows, duplicates removed, sorted."""
    table = clocks.clocks_of(rows)
    clocks.check_site(report.files[0], table, site)
    parts, duplicates, conflicts, slips, outside = [], 0, 0, 0, 0
    columns = [*c.SCHEMA, *(name for name in c.OPTIONAL_SCHEMA if _is_known(rows[name]))]
    for window, part in clocks.split_windows(rows, table, site.window_bounds()).items():
        name = f"{site.name}-{window}" if window else site.name
        part, removed, differing = sorted_unique(part.with_columns(pl.lit(name).alias(c.RECORDING)))
        duplicates, conflicts = duplicates + removed, conflicts + differing
        slips += _slips(part)
        outside += part.height if window == clocks.OUTSIDE else 0
        parts.append(part.select(columns))
    total = sum(part.height for part in parts)
    _check_slips(slips, total, report)
    report = replace(
        report,
        duplicates=duplicates,
        conflicting_duplicates=conflicts,
        rows_outside_windows=outside,
        clock_slips=slips,
        rows=total,
    )
    parts.sort(key=lambda part: str(part[c.RECORDING][0]))
    return Recording(tracks=pl.concat(parts), site=site, time_step=TIME_STEP, source=SOURCE), report


def _is_known(recorded: pl.Series) -> bool:
    """Returns whether a file gives speeds or accelerations at all: some are cut from sources without, and say 0."""
    return bool((recorded != 0).any())


def _slips(rows: pl.DataFrame) -> int:
    same = pl.col(c.VEHICLE) == pl.col(c.VEHICLE).shift(1)
    return int(rows.select((same & (pl.col(clocks.CLOCK) != pl.col(clocks.CLOCK).shift(1))).sum()).item())


def _check_slips(slips: int, rows: int, report: ReadReport) -> None:
    if slips > clocks.MOST_SLIPS * rows:
        raise FormatError(
            f"{', '.join(report.files)}: Frame_ID and Global_Time do not advance together in {slips:,} of {rows:,} "
            "rows. Expected 100 ms a frame. A spreadsheet program may have rounded Global_Time, or the file was "
            "resampled: use the original"
        )


NGSIM = Format(
    "ngsim", "NGSIM freeway trajectories", ".txt, .csv, in .gz or .zip", read_ngsim, Needs(misses_ngsim, WANTED)
)
