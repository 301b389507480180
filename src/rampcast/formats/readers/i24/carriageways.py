"""Recordings of I-24 MOTION's two carriageways from its json files: in memory, or written part by part.

Both ways make the same rows; the second never holds more than a few hundred thousand of them.
"""

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import polars as pl

from rampcast.errors import FormatError
from rampcast.files import naming_faults, work_folder, write_whole
from rampcast.formats.readers.i24.stream import Batch, kept_ids
from rampcast.formats.readers.i24.tracks import EAST, ROADS, WEST
from rampcast.formats.steps.units import FOOT, MILE
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.recording.reading import ReadReport, join_reports
from rampcast.recording.recording import LEVEL, file_metadata, road_files
from rampcast.roads.plane import ROAD, Plane
from rampcast.roads.project import BESIDE, on_road
from rampcast.sites import Lane, Note, Site

ENDS = (58.5 * MILE, 63.5 * MILE)  # [m] the instrument spans miles 58.7 to 62.9
US_LANE_WIDTH = 12 * FOOT  # [m] as docs/formats/i24.md has it
LANES = 5  # the fifth is the lane of entrances and exits where there is one
SPEED_LIMIT = 70 * MILE / 3600  # [m/s]
ALL = "all"  # stands for the road where a site is given: every row may be on it
ROW_GROUP = 100_000  # [rows] of a file written part by part


def i24_sites(*, origin: float = 0.0) -> dict[str, Site]:
    """Returns the sites of both carriageways by the names of their roads; `origin` is x = 0 of the plane [m]."""
    west_end, east_end = (end - origin for end in ENDS)
    lines = {
        ROADS[WEST]: ((east_end, 0.0), (west_end, 0.0)),
        ROADS[EAST]: ((west_end, 0.0), (east_end, 0.0)),
    }
    centres = {number: -round((number + 0.5) * US_LANE_WIDTH, 4) for number in range(1, LANES + 1)}
    lanes = tuple(Lane(number, "main", centre, (str(number),)) for number, centre in centres.items())
    notes = (
        Note("Lane k lies from 12 k to 12 (k + 1) feet right of y = 0.", "docs/formats/i24.md"),
        Note("The posted limit; signs lower it in congestion.", "docs/formats/i24.md"),
    )
    return {
        road: Site(
            name=f"i24-{road}",
            title=f"I-24 MOTION, {road}bound",
            simulated=False,
            length=round(ENDS[1] - ENDS[0], 1),
            speed_limit=round(SPEED_LIMIT, 2),
            lanes=lanes,
            timezone="America/Chicago",
            reference=line,
            notes=notes,
        )
        for road, line in lines.items()
    }


def read_tracks(
    batches: Iterable[Batch], source: str, sites: dict[str, Site], site: Site | None
) -> tuple[tuple[Recording, ...], ReadReport]:
    """Returns the recordings of vehicles, one a road, and what reading found.

    Args:
        batches: of vehicles.
        source: the format's name.
        sites: the roads, where no site is given.
        site: the one road to read; None reads all `sites`.

    Raises:
        FormatError: as whatever gives the batches, or no row lies on the road.
    """
    roads = _roads(sites, site)
    parts: dict[str, list[pl.DataFrame]] = {road: [] for road in roads}
    report, ids, step = _each(batches, source, roads, keep=lambda road, rows: parts[road].append(rows))
    recordings = [
        Recording(pl.concat(parts[road]).with_columns(ids), one, step, source)
        for road, one in roads.items()
        if parts[road]
    ]
    return tuple(recordings), report


def convert_tracks(
    batches: Iterable[Batch], out: Path, source: str, sites: dict[str, Site], site: Site | None
) -> tuple[tuple[Path, ...], ReadReport]:
    """Writes the recordings of vehicles as parquet files, one a road, and returns these and what reading found.

    Memory stays bounded however many batches there are; the other arguments are those of `read_tracks`.

    Args:
        out: the file to write; of several roads one each, named as `write_recordings` does.
    """
    roads, numbers = _roads(sites, site), itertools.count()
    with naming_faults(out), work_folder(out.parent) as parts:

        def keep(road: str, rows: pl.DataFrame) -> None:
            (parts / road).mkdir(exist_ok=True)
            rows.write_parquet(parts / road / f"{next(numbers):08}.parquet", compression="lz4")

        report, ids, step = _each(batches, source, roads, keep=keep)
        there = [road for road in roads if (parts / road).is_dir()]
        written = tuple(road_files([roads[road] for road in there], out))
        for road, path in zip(there, written, strict=True):
            metadata = file_metadata(roads[road], time_step=step, source=source)
            _join(parts / road, path, ids, metadata)
    return written, report


def _each(
    batches: Iterable[Batch], source: str, roads: dict[str, Site], *, keep: Callable[[str, pl.DataFrame], None]
) -> tuple[ReadReport, pl.Expr, float]:
    """Returns what reading found, the vehicles' ids and the time step [s]; rows on a road are given to `keep`."""
    reports: list[ReadReport] = []
    names: list[str] = []
    step = 0.0
    for batch in batches:
        tracks, report = _on_roads(batch, source, roads)
        reports.append(report)
        names.extend(batch.names)
        step = batch.time_step
        for road, rows in tracks.items():
            keep(road, rows)
    return _joined(reports, names, roads), _ids(names), step


def _join(parts: Path, path: Path, ids: pl.Expr, metadata: dict[str, str]) -> None:
    """Writes the rows of all files in a folder, in the order of their names, as one."""
    with write_whole(path) as partial:
        rows = pl.scan_parquet(sorted(parts.iterdir())).with_columns(ids)
        rows.sink_parquet(
            partial, compression="zstd", compression_level=LEVEL, row_group_size=ROW_GROUP, metadata=metadata
        )


def _roads(sites: dict[str, Site], site: Site | None) -> dict[str, Site]:
    return {ALL: site} if site is not None else sites


def _on_roads(batch: Batch, source: str, roads: dict[str, Site]) -> tuple[dict[str, pl.DataFrame], ReadReport]:
    """Returns the rows of a batch on each road, where there are any, and what was found with what that left out."""
    tracks, counts = {}, [batch.report]
    for road, site in roads.items():
        rows = batch.rows if road == ALL else batch.rows.filter(pl.col(ROAD) == road)
        if rows.is_empty():
            continue
        plane = Plane(source, site.title, source, rows, batch.time_step)
        recording, found = on_road(plane, site, beside=BESIDE)
        counts.append(replace(found, rows=recording.tracks.height))
        if not recording.tracks.is_empty():
            tracks[road] = recording.tracks
    report = join_reports(counts)
    return tracks, replace(report, rows_off_road=batch.rows.height - report.rows)


def _joined(reports: Sequence[ReadReport], names: Sequence[str], roads: dict[str, Site]) -> ReadReport:
    report = join_reports(reports)
    if not report.rows:
        raise FormatError(
            f"{', '.join(report.files)}: none of its {report.rows_read:,} rows lies on the road of site "
            f"{', '.join(site.name for site in roads.values())}. Was the site made from this source? Leave it out to "
            "have both carriageways"
        )
    return replace(report, vehicles_renumbered=0 if kept_ids(names) else len(names))


def _ids(names: Sequence[str]) -> pl.Expr:
    """Returns the expression of the vehicles' ids, from their numbers in order of appearance."""
    ids = kept_ids(names)
    vehicle = pl.col(c.VEHICLE)
    return vehicle.replace_strict(range(1, len(ids) + 1), ids, return_dtype=c.SCHEMA[c.VEHICLE]) if ids else vehicle
