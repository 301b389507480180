"""How good a recording is: what is in it, its gaps, overlaps and impossible accelerations, window by window."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

import polars as pl

from rampcast.doctor.checks.motion import CLIPPED_ACCELERATION
from rampcast.doctor.checks.ramp import LONG_ENOUGH
from rampcast.doctor.row_measures import BEFORE, DEPTH, STEP, TRACK, measured
from rampcast.errors import RecordingError
from rampcast.recording import columns as c
from rampcast.recording.recording import Recording
from rampcast.recording.smoothing import IMPOSSIBLE_ACCELERATION, LONGEST_FILLED_GAP, clean
from rampcast.sites.site import Site

ALL = "all"
MOST_COLUMNS = 4  # windows side by side that a terminal has room for


@dataclass(frozen=True)
class PaperCounts:
    """Counts that the paper prints; None where it prints none."""

    on_ramp_vehicles: int | None = None
    on_ramp_seen_19s: int | None = None
    target_lane_vehicles: int | None = None


# By site and window; the paper, section "Data Set".
PAPER_COUNTS: Mapping[str, Mapping[str, PaperCounts]] = {
    "i80": {
        "i80-1": PaperCounts(on_ramp_seen_19s=117),
        "i80-2": PaperCounts(on_ramp_seen_19s=129),
        "i80-3": PaperCounts(on_ramp_seen_19s=139),
        ALL: PaperCounts(on_ramp_vehicles=713, on_ramp_seen_19s=385, target_lane_vehicles=1529),
    }
}


@dataclass(frozen=True)
class LaneQuality:
    """A lane: its number and role, rows and vehicles in it, and where its vehicles drive beside where the site says.

    `median_y` and `centre` are lateral positions [m]; NaN where the site does not know the lane.
    """

    number: int
    role: str
    rows: int
    vehicles: int
    median_y: float
    centre: float


@dataclass(frozen=True)
class WindowQuality:
    """What is in one window, or in all of them together.

    Attributes:
        name: of the window; "all" for the whole recording.
        vehicles: ids.
        rows: rows.
        frames: different frames.
        duration: time of those frames [s].
        duplicates: rows that repeat a (window, vehicle, frame).
        gaps: holes in a track of up to 5 s.
        skipped_frames: frames missing in those holes.
        reused_ids: ids that come back after more than 5 s: another vehicle, most likely.
        impossible_before, impossible_after: rows with |a| > 8 m/s^2 before and after smoothing; None where not known.
        clipped_before, clipped_after: the same for |a| > 3.41 m/s^2.
        accelerations_before, accelerations_after: rows whose acceleration is known.
        overlaps: rows where a vehicle's front is ahead of its leader's rear in the same lane and frame.
        on_ramp_vehicles: vehicles with a row in a ramp lane.
        on_ramp_seen_19s: those of them that are seen for more than 19 s.
        target_lane_vehicles: vehicles with a row in the target lane between gore and ramp end.
        paper: the paper's counts beside them, where it prints some.
        lanes: lane by lane.
    """

    name: str
    vehicles: int
    rows: int
    frames: int
    duration: float
    duplicates: int
    gaps: int
    skipped_frames: int
    reused_ids: int
    impossible_before: int | None
    impossible_after: int | None
    clipped_before: int | None
    clipped_after: int | None
    accelerations_before: int | None
    accelerations_after: int | None
    overlaps: int
    on_ramp_vehicles: int
    on_ramp_seen_19s: int
    target_lane_vehicles: int
    paper: PaperCounts | None
    lanes: tuple[LaneQuality, ...]


@dataclass(frozen=True)
class Quality:
    """The quality of a recording: its site and source, each window, and all together."""

    site: str
    source: str
    simulated: bool
    windows: tuple[WindowQuality, ...]
    total: WindowQuality

    def to_dict(self) -> dict[str, Any]:
        """Returns everything as plain values, for json; NaN as None."""
        return dict(_plain(asdict(self)))


@dataclass(frozen=True)
class QualityTable:
    """A quality as text, for printing: column heads, and rows of a label and its cells."""

    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def quality(recording: Recording, *, cleaned: Recording | None = None) -> Quality:
    """Returns how good a recording is.

    Accelerations before smoothing are second differences of the raw positions, those after are the derived ones. The
    limit of 8 m/s^2 is about the grip of a dry road; 3.41 m/s^2 is where NGSIM clips.

    Args:
        recording: raw or smoothed.
        cleaned: the same recording smoothed, if the caller has it; None smooths a raw one here.
    """
    cleaned = cleaned or _cleaned(recording)
    tracks, repeats = measured(recording)
    duplicates = dict(repeats.group_by(pl.col(c.RECORDING).cast(pl.String)).len().iter_rows())
    windows = []
    for name in recording.names:
        smoothed = None if cleaned is None else cleaned.tracks.filter(pl.col(c.RECORDING) == name)
        window = tracks.filter(pl.col(c.RECORDING) == name)
        windows.append(_describe(name, recording, window, smoothed, duplicates=duplicates.get(name, 0)))
    total = _together(windows, recording.site, _lanes(tracks, recording.site))
    return Quality(recording.site.name, recording.source, recording.site.simulated, tuple(windows), total)


def quality_table(found: Quality) -> QualityTable:
    """Returns the counts of each window, of all together, and the paper's where it prints some, as text.

    Of many windows it is all together; `window_table` has a row for each of them.
    """
    columns = (*found.windows, found.total) if len(found.windows) > 1 else found.windows
    if len(found.windows) > MOST_COLUMNS:
        columns = (found.total,)
    papers = {one.name: one.paper for one in columns if one.paper}
    rows = [(label, *(show(one) for one in columns)) for label, show in _ROWS.items()]
    for label, name in _PAPER_ROWS.items():
        if papers:
            cells = (_number(getattr(papers[one.name], name)) if one.name in papers else "" for one in columns)
            rows.append((f"{label}, the paper", *cells))
    return QualityTable(("", *(one.name for one in columns)), tuple(rows))


def window_table(found: Quality) -> QualityTable | None:
    """Returns a row of counts for each window, as text, where there are too many for columns; None where not."""
    if len(found.windows) <= MOST_COLUMNS:
        return None
    rows = ((one.name, *(_ROWS[label](one) for label in _WINDOW_COLUMNS.values())) for one in found.windows)
    return QualityTable(("window", *_WINDOW_COLUMNS), tuple(rows))


def lane_table(found: Quality) -> QualityTable:
    """Returns rows, vehicles and lateral position of each lane over all windows, as text."""
    heads = ("lane", "role", "rows", "vehicles", "median y [m]", "site's centre [m]")
    rows = (
        (str(one.number), one.role, f"{one.rows:,}", f"{one.vehicles:,}", f"{one.median_y:z.2f}", f"{one.centre:z.2f}")
        for one in found.total.lanes
    )
    return QualityTable(heads, tuple(rows))


def _cleaned(recording: Recording) -> Recording | None:
    if recording.is_smoothed:
        return recording
    try:
        return clean(recording)[0]
    except RecordingError:  # too short to smooth: all else can still be told
        return None


def _describe(
    name: str, recording: Recording, tracks: pl.DataFrame, smoothed: pl.DataFrame | None, *, duplicates: int
) -> WindowQuality:
    site, dt = recording.site, recording.time_step
    longest = round(LONGEST_FILLED_GAP / dt)
    hole = pl.col(STEP).is_between(2, longest)
    counts = tracks.select(
        gaps=hole.sum(),
        skipped_frames=(pl.col(STEP) - 1).filter(hole).sum(),
        reused_ids=(pl.col(STEP) > longest).sum(),
        overlaps=(pl.col(DEPTH) > 0).sum(),
        frames=pl.col(c.FRAME).n_unique(),
    ).row(0, named=True)
    beside = pl.col(c.X).is_between(site.gore, site.ramp_end) & (pl.col(c.LANE) == site.target_lane)
    vehicles = tracks.group_by(c.VEHICLE).agg(
        on_ramp=pl.col(c.LANE).is_in(list(site.ramp_lanes)).any(),
        beside=beside.any(),
        long=(pl.col(c.FRAME).max() - pl.col(c.FRAME).min()) * dt > LONG_ENOUGH,
    )
    before = None if recording.is_smoothed else tracks[BEFORE].drop_nulls()
    after = None if smoothed is None else smoothed[c.A]
    return WindowQuality(
        name=name,
        vehicles=vehicles.height,
        rows=tracks.height + duplicates,
        duplicates=duplicates,
        duration=counts["frames"] * dt,
        impossible_before=_above(before, IMPOSSIBLE_ACCELERATION),
        impossible_after=_above(after, IMPOSSIBLE_ACCELERATION),
        clipped_before=_above(before, CLIPPED_ACCELERATION),
        clipped_after=_above(after, CLIPPED_ACCELERATION),
        accelerations_before=None if before is None else before.len(),
        accelerations_after=None if after is None else after.len(),
        on_ramp_vehicles=int(vehicles["on_ramp"].sum()),
        on_ramp_seen_19s=vehicles.filter("on_ramp", "long").height,
        target_lane_vehicles=int(vehicles["beside"].sum()),
        paper=PAPER_COUNTS.get(site.name, {}).get(name),
        lanes=_lanes(tracks, site),
        **counts,
    )


def _together(windows: Sequence[WindowQuality], site: Site, lanes: tuple[LaneQuality, ...]) -> WindowQuality:
    """Returns the sum of the windows; an id in two windows is two vehicles."""
    numbers = [entry.name for entry in fields(WindowQuality) if entry.name not in ("name", "paper", "lanes")]
    columns = {name: [getattr(window, name) for window in windows] for name in numbers}
    sums: dict[str, Any] = {name: None if None in values else sum(values) for name, values in columns.items()}
    return WindowQuality(name=ALL, paper=PAPER_COUNTS.get(site.name, {}).get(ALL), lanes=lanes, **sums)


def _above(accelerations: pl.Series | None, limit: float) -> int | None:
    return None if accelerations is None else int((accelerations.abs() > limit).sum())


def _lanes(tracks: pl.DataFrame, site: Site) -> tuple[LaneQuality, ...]:
    known = {lane.number: lane for lane in site.lanes}
    vehicles = tracks.select(c.LANE, *TRACK).unique().group_by(c.LANE).agg(pl.len().alias("vehicles"))
    found = tracks.group_by(c.LANE).agg(pl.len().alias("rows"), pl.col(c.Y).median().alias("y")).join(vehicles, c.LANE)
    return tuple(
        LaneQuality(
            number=row[c.LANE],
            role=known[row[c.LANE]].role if row[c.LANE] in known else "unknown",
            rows=row["rows"],
            vehicles=row["vehicles"],
            median_y=row["y"],
            centre=known[row[c.LANE]].centre if row[c.LANE] in known else math.nan,
        )
        for row in found.sort(c.LANE).iter_rows(named=True)
    )


def _number(value: int | None) -> str:
    return "–" if value is None else f"{value:,}"


def _share(count: int | None, of: int | None) -> str:
    return f"{count:,} ({100 * count / of:.2f} %)" if count is not None and of else "–"


_ROWS: Mapping[str, Callable[[WindowQuality], str]] = {
    "vehicles": lambda one: f"{one.vehicles:,}",
    "rows": lambda one: f"{one.rows:,}",
    "frames": lambda one: f"{one.frames:,}",
    "duration [s]": lambda one: f"{one.duration:,.1f}",
    "duplicate rows": lambda one: f"{one.duplicates:,}",
    "gaps up to 5 s": lambda one: f"{one.gaps:,}",
    "frames skipped in them": lambda one: f"{one.skipped_frames:,}",
    "ids that come back after more than 5 s": lambda one: f"{one.reused_ids:,}",
    "|a| > 8 m/s² before smoothing": lambda one: _share(one.impossible_before, one.accelerations_before),
    "|a| > 8 m/s² after smoothing": lambda one: _share(one.impossible_after, one.accelerations_after),
    "|a| > 3.41 m/s² before smoothing": lambda one: _share(one.clipped_before, one.accelerations_before),
    "|a| > 3.41 m/s² after smoothing": lambda one: _share(one.clipped_after, one.accelerations_after),
    "overlaps with the leader [rows]": lambda one: _share(one.overlaps, one.rows),
    "on-ramp vehicles": lambda one: f"{one.on_ramp_vehicles:,}",
    "on-ramp vehicles seen for more than 19 s": lambda one: f"{one.on_ramp_seen_19s:,}",
    "target-lane vehicles beside the ramp lane": lambda one: f"{one.target_lane_vehicles:,}",
}
_WINDOW_COLUMNS = {  # short heads of the rows that a table of many windows shows
    "vehicles": "vehicles",
    "rows": "rows",
    "duration [s]": "duration [s]",
    "gaps": "gaps up to 5 s",
    "|a| > 8 before": "|a| > 8 m/s² before smoothing",
    "after": "|a| > 8 m/s² after smoothing",
    "overlaps": "overlaps with the leader [rows]",
    "on-ramp": "on-ramp vehicles",
}
_PAPER_ROWS = {
    "on-ramp vehicles": "on_ramp_vehicles",
    "on-ramp vehicles seen for more than 19 s": "on_ramp_seen_19s",
    "target-lane vehicles beside the ramp lane": "target_lane_vehicles",
}


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and math.isnan(value) else value
