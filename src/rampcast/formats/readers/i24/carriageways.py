"""Recordings of I-24 MOTION's two carriageways from its json files: in memory, or written part by part.

Both ways make the same rows; the second never holds more than a few hundred thousand of them.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import polars as pl

from rampcast.errors import FormatError
from rampcast.files import naming_faults, work_folder, write_whole
from rampcast.formats.format import Door
from rampcast.formats.readers.i24.stream import Batch, kept_ids
from rampcast.formats.readers.i24.tracks import EAST, ROADS, WEST
from rampcast.formats.steps.units import FOOT, MILE
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.recording.breach import Breach, over_parts
from rampcast.recording.cutting import cut_tracks
from rampcast.recording.invariants import breaches_of
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
    parts: dict[str, dict[str, pl.DataFrame]] = {road: {} for road in roads}

    def keep(road: str, place: str, recording: Recording) -> None:
        parts[road][place] = recording.tracks

    found = _each(batches, source, roads, keep=keep)
    recordings = [
        Recording(
            pl.concat([those[place] for place in sorted(those)]).with_columns(found.ids[road]),
            roads[road],
            found.step,
            source,
        )
        for road, those in parts.items()
        if those
    ]
    return tuple(recordings), found.report


def convert_tracks(
    batches: Iterable[Batch], out: Path, source: str, sites: dict[str, Site], site: Site | None, door: Door
) -> tuple[tuple[Path, ...], ReadReport]:
    """Writes the recordings of vehicles as parquet files, one a road, and returns these and what reading found.

    Memory stays bounded however many batches there are; the other arguments are those of `read_tracks`.

    Args:
        out: the file to write; of several roads one each, named as `write_recordings` does.
        door: is given what is wrong with the recordings, and may refuse it.
    """
    roads = _roads(sites, site)
    checked: dict[str, list[tuple[int, tuple[Breach, ...]]]] = {road: [] for road in roads}
    with naming_faults(out), work_folder(out.parent) as parts:

        def keep(road: str, place: str, recording: Recording) -> None:
            (parts / road).mkdir(exist_ok=True)
            recording.tracks.write_parquet(parts / road / f"{place}.parquet", compression="lz4")
            checked[road].append((recording.tracks.height, breaches_of(recording)))

        found = _each(batches, source, roads, keep=keep)
        there = [road for road in roads if (parts / road).is_dir()]
        breaches = tuple(breach for road in there for breach in over_parts(checked[road]))
        door(breaches)
        written = tuple(road_files([roads[road] for road in there], out))
        for road, path in zip(there, written, strict=True):
            metadata = file_metadata(roads[road], time_step=found.step, source=source)
            _join(parts / road, path, found.ids[road], metadata)
    return written, replace(found.report, breaches=breaches)


@dataclass(frozen=True)
class _Found:
    """What all batches together tell: what reading found, the vehicles' ids on each road, the time step [s]."""

    report: ReadReport
    ids: dict[str, pl.Expr]
    step: float


@dataclass
class _Road:
    """What is counted of a road while its batches come: the largest number of a vehicle, cuts, and its days."""

    largest: int = 0
    cuts: int = 0
    days: list[str] = field(default_factory=list)


def _each(
    batches: Iterable[Batch], source: str, roads: dict[str, Site], *, keep: Callable[[str, str, Recording], None]
) -> _Found:
    """Returns what all batches tell; the rows on each road are given to `keep`, with where they come in it by name.

    Tracks are cut where no vehicle can have driven on. What follows a cut comes behind the vehicles of its day, and is
    numbered -1, -2 and so on until all vehicles are known.
    """
    reports: list[ReadReport] = []
    names: list[str] = []
    counts = {road: _Road() for road in roads}
    step = 0.0
    for number, batch in enumerate(batches):
        recordings, report = _on_roads(batch, source, roads)
        reports.append(report)
        names.extend(batch.names)
        step = batch.time_step
        for road, recording in recordings.items():
            for is_new, part in enumerate(_whole_and_new(recording, counts[road])):
                if not part.tracks.is_empty():
                    day = counts[road].days.index(part.tracks[c.RECORDING][0])
                    keep(road, f"{day:04}-{is_new}-{number:08}", part)
    cuts = sum(one.cuts for one in counts.values())
    kept = kept_ids(names, room=cuts)
    report = replace(_joined(reports, len(names) if kept is None else 0, roads), tracks_cut=cuts)
    return _Found(report, {road: _ids(kept, one.largest) for road, one in counts.items()}, step)


def _whole_and_new(recording: Recording, counted: _Road) -> tuple[Recording, Recording]:
    """Returns the rows of the vehicles up to where their tracks are cut, and what follows, numbered below 0."""
    vehicle, tracks = pl.col(c.VEHICLE), recording.tracks
    if (day := tracks[c.RECORDING][0]) not in counted.days:
        counted.days.append(day)
    largest = int(tracks[c.VEHICLE].to_numpy().max())
    cut, cuts = cut_tracks(recording)
    new = cut.tracks.filter(vehicle > largest).with_columns((largest - vehicle - counted.cuts).alias(c.VEHICLE))
    counted.largest = max(counted.largest, largest)
    counted.cuts += cuts
    return replace(cut, tracks=cut.tracks.filter(vehicle <= largest)), replace(cut, tracks=new)


def _join(parts: Path, path: Path, ids: pl.Expr, metadata: dict[str, str]) -> None:
    """Writes the rows of all files in a folder, in the order of their names, as one."""
    with write_whole(path) as partial:
        rows = pl.scan_parquet(sorted(parts.iterdir())).with_columns(ids)
        rows.sink_parquet(
            partial, compression="zstd", compression_level=LEVEL, row_group_size=ROW_GROUP, metadata=metadata
        )


def _roads(sites: dict[str, Site], site: Site | None) -> dict[str, Site]:
    return {ALL: site} if site is not None else sites


def _on_roads(batch: Batch, source: str, roads: dict[str, Site]) -> tuple[dict[str, Recording], ReadReport]:
    """Returns the rows of a batch on each road, where there are any, and what was found with what that left out."""
    recordings, counts = {}, [batch.report]
    for road, site in roads.items():
        rows = batch.rows if road == ALL else batch.rows.filter(pl.col(ROAD) == road)
        if rows.is_empty():
            continue
        plane = Plane(source, site.title, source, rows, batch.time_step)
        recording, found = on_road(plane, site, beside=BESIDE)
        counts.append(replace(found, rows=recording.tracks.height))
        if not recording.tracks.is_empty():
            recordings[road] = recording
    report = join_reports(counts)
    return recordings, replace(report, rows_off_road=batch.rows.height - report.rows)


def _joined(reports: Sequence[ReadReport], renumbered: int, roads: dict[str, Site]) -> ReadReport:
    report = join_reports(reports)
    if not report.rows:
        other = "Are positions in the unit of the format (docs/formats), and is direction -1 where x falls?"
        given = "Was the site made from this source? Leave it out to have both carriageways"
        raise FormatError(
            f"{', '.join(report.files)}: none of its {report.rows_read:,} rows lies on the road of site "
            f"{', '.join(site.name for site in roads.values())}. {given if ALL in roads else other}"
        )
    return replace(report, vehicles_renumbered=renumbered)


def _ids(kept: Sequence[int] | None, largest: int) -> pl.Expr:
    """Returns the expression of a road's vehicles' ids, from their numbers in order of appearance.

    Args:
        kept: the ids in the source, in that order; None numbers from 1.
        largest: number of a vehicle; what follows cuts, numbered below 0, has ids above its id.
    """
    vehicle, kind = pl.col(c.VEHICLE), c.SCHEMA[c.VEHICLE]
    if kept is None or not largest:
        return pl.when(vehicle > 0).then(vehicle).otherwise(largest - vehicle).cast(kind).alias(c.VEHICLE)
    named = vehicle.replace_strict(range(1, len(kept) + 1), kept, default=0, return_dtype=kind)
    return pl.when(vehicle > 0).then(named).otherwise(kept[largest - 1] - vehicle).cast(kind).alias(c.VEHICLE)
