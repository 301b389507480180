"""The summary of a recording, window by window: what is in it, lane by lane, and how often what is wrong with it.

Every number is a sum of what the doctor's checks look at, so that both say the same.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Shaped

from rampcast.arguments import expected
from rampcast.doctor.checks.motion import CLIPPED_ACCELERATION
from rampcast.doctor.checks.ramp import seen_long
from rampcast.doctor.row_measures import TRACK
from rampcast.doctor.subject import READ_FIRST, Subject, subject_of
from rampcast.notebook import html_table
from rampcast.recording import columns as c
from rampcast.recording.recording import Recording
from rampcast.recording.smoothing import IMPOSSIBLE_ACCELERATION
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
class LaneCounts:
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
class Counts:
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
        on_ramp_vehicles: vehicles whose first row lies in a ramp lane.
        on_ramp_seen_19s: those of them that are seen for 19 s or more.
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
    lanes: tuple[LaneCounts, ...]


NUMBERS = tuple(one.name for one in fields(Counts) if one.name not in ("name", "paper", "lanes"))


@dataclass(frozen=True, repr=False)
class Summary:
    """What is in a recording: its site and source, the counts of each window, and of all together."""

    site: str
    source: str
    simulated: bool
    windows: tuple[Counts, ...]
    total: Counts

    def to_dict(self) -> dict[str, Any]:
        """Returns everything as plain values, for json; NaN as None."""
        return dict(_plain(asdict(self)))

    def to_polars(self) -> pl.DataFrame:
        """Returns the counts as a table: a row for each window, and one for all together."""
        each = (*self.windows, self.total)
        return pl.DataFrame([{name: getattr(one, name) for name in ("name", *NUMBERS)} for one in each])

    def __repr__(self) -> str:
        total, count = self.total, len(self.windows)
        windows = f"{count} window{'s' if count != 1 else ''}"
        return f"<Summary of {self.site}: {total.vehicles:,} vehicles, {total.rows:,} rows in {windows}>"

    def _repr_html_(self) -> str:
        return html_table(repr(self)[1:-1], {label: show(self.total) for label, show in _ROWS.items()})


@dataclass(frozen=True)
class TextTable:
    """Counts as text, for printing: column heads, and rows of a label and its cells."""

    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def inspect(recording: Recording) -> Summary:
    """Returns what is in a recording, and how often what is wrong with it.

    Accelerations before smoothing are second differences of the raw positions, those after are the derived ones. The
    limit of 8 m/s^2 is about the grip of a dry road; 3.41 m/s^2 is where NGSIM clips.

    Args:
        recording: raw or smoothed.

    Raises:
        RampcastError: it is something else.
    """
    expected(Recording, recording, name="recording", advice=READ_FIRST)
    site, subject = recording.site, subject_of(recording, None)
    paper = PAPER_COUNTS.get(site.name, {})
    found = []
    for row in _numbers(subject).iter_rows(named=True):
        name = str(row.pop(c.RECORDING))
        tracks = subject.tracks if name == ALL else subject.tracks.filter(pl.col(c.RECORDING) == name)
        found.append(Counts(name=name, paper=paper.get(name), lanes=_lanes(tracks, site), **row))
    return Summary(site.name, recording.source, site.simulated, tuple(found[:-1]), found[-1])


def counts_table(found: Summary) -> TextTable:
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
    return TextTable(("", *(one.name for one in columns)), tuple(rows))


def window_table(found: Summary) -> TextTable | None:
    """Returns a row of counts for each window, as text, where there are too many for columns; None where not."""
    if len(found.windows) <= MOST_COLUMNS:
        return None
    rows = ((one.name, *(_ROWS[label](one) for label in _WINDOW_COLUMNS.values())) for one in found.windows)
    return TextTable(("window", *_WINDOW_COLUMNS), tuple(rows))


def lane_table(found: Summary) -> TextTable:
    """Returns rows, vehicles and lateral position of each lane over all windows, as text."""
    heads = ("lane", "role", "rows", "vehicles", "median y [m]", "site's centre [m]")
    rows = (
        (str(one.number), one.role, f"{one.rows:,}", f"{one.vehicles:,}", f"{one.median_y:z.2f}", f"{one.centre:z.2f}")
        for one in found.total.lanes
    )
    return TextTable(heads, tuple(rows))


def _numbers(subject: Subject) -> pl.DataFrame:
    """Returns the `NUMBERS` of each window, and last those of all together; an id in two windows is two vehicles."""
    parts = [_of_rows(subject), _of_vehicles(subject)]
    again = np.ones(subject.repeats.height, dtype=bool)
    parts.append(_summed(subject.repeats, {"rows": again, "duplicates": again}))
    if subject.cleaned is not None:
        smoothed = subject.cleaned.tracks
        parts.append(_summed(smoothed, _accelerations("after", smoothed[c.A].to_numpy())))
    nothing = pl.DataFrame(schema={c.RECORDING: pl.String(), **dict.fromkeys(NUMBERS, pl.Int64())})
    found = pl.concat([nothing, *parts], how="diagonal").group_by(c.RECORDING).sum().sort(c.RECORDING)
    found = pl.concat([found, found.select(pl.lit(ALL).alias(c.RECORDING), pl.exclude(c.RECORDING).sum())])
    known = {"before": not subject.recording.is_smoothed, "after": subject.cleaned is not None}
    unknown = [name for name in NUMBERS if not known.get(name.rpartition("_")[2], True)]
    seconds = pl.col("frames") * subject.time_step
    return found.with_columns(pl.lit(None).alias(name) for name in unknown).with_columns(duration=seconds)


def _of_rows(subject: Subject) -> pl.DataFrame:
    tracks = subject.tracks
    counted = {
        "rows": np.ones(tracks.height, dtype=bool),
        "frames": tracks.select(pl.struct(c.RECORDING, c.FRAME).is_first_distinct()).to_series().to_numpy(),
        "gaps": subject.is_after_hole,
        "skipped_frames": np.where(subject.is_after_hole, subject.step - 1, 0),
        "reused_ids": subject.comes_back,
        "overlaps": subject.overlap > 0,
    }
    return _summed(tracks, counted | _accelerations("before", subject.raw_acceleration))


def _of_vehicles(subject: Subject) -> pl.DataFrame:
    counted = {
        "vehicles": np.ones(len(subject.starts), dtype=bool),
        "on_ramp_vehicles": subject.on_ramp,
        "on_ramp_seen_19s": subject.on_ramp & seen_long(subject),
        "target_lane_vehicles": _drive_beside_ramp(subject),
    }
    return _summed(subject.tracks[subject.starts], counted)


def _summed(rows: pl.DataFrame, counted: Mapping[str, Shaped[np.ndarray, "row"]]) -> pl.DataFrame:
    """Returns the sums over the rows of each window."""
    table = pl.DataFrame({c.RECORDING: rows[c.RECORDING].cast(pl.String), **counted})
    return table.group_by(c.RECORDING).agg(pl.all().sum().cast(pl.Int64))


def _accelerations(stage: str, values: Float[np.ndarray, "row"]) -> dict[str, Bool[np.ndarray, "row"]]:
    size = np.abs(values)  # NaN is not above
    return {
        f"impossible_{stage}": size > IMPOSSIBLE_ACCELERATION,
        f"clipped_{stage}": size > CLIPPED_ACCELERATION,
        f"accelerations_{stage}": np.isfinite(size),
    }


def _drive_beside_ramp(subject: Subject) -> Bool[np.ndarray, "vehicle"]:
    """Returns which vehicles have a row in the target lane between gore and ramp end."""
    site = subject.recording.site
    beside = (subject.x >= site.gore) & (subject.x <= site.ramp_end) & (subject.lane == site.target_lane)
    before = np.concatenate([[0], np.cumsum(beside)])
    return before[subject.ends + 1] > before[subject.starts]


def _lanes(tracks: pl.DataFrame, site: Site) -> tuple[LaneCounts, ...]:
    known = {lane.number: (lane.role, lane.centre) for lane in site.lanes}
    vehicles = tracks.select(c.LANE, *TRACK).unique().group_by(c.LANE).agg(vehicles=pl.len())
    found = tracks.group_by(c.LANE).agg(rows=pl.len(), median_y=pl.col(c.Y).median()).join(vehicles, on=c.LANE)
    lanes = []
    for row in found.sort(c.LANE).iter_rows(named=True):
        number = row.pop(c.LANE)
        role, centre = known.get(number, ("unknown", math.nan))
        lanes.append(LaneCounts(number=number, role=role, centre=centre, **row))
    return tuple(lanes)


def _number(value: int | None) -> str:
    return "–" if value is None else f"{value:,}"


def _share(count: int | None, of: int | None) -> str:
    return f"{count:,} ({100 * count / of:.2f} %)" if count is not None and of else "–"


_ROWS: Mapping[str, Callable[[Counts], str]] = {
    "vehicles": lambda one: f"{one.vehicles:,}",
    "rows": lambda one: f"{one.rows:,}",
    "frames": lambda one: f"{one.frames:,}",
    "duration [s]": lambda one: f"{one.duration:,.1f}",
    "duplicate rows left": lambda one: f"{one.duplicates:,}",
    "gaps up to 5 s": lambda one: f"{one.gaps:,}",
    "frames skipped in them": lambda one: f"{one.skipped_frames:,}",
    "ids that come back after more than 5 s": lambda one: f"{one.reused_ids:,}",
    "|a| > 8 m/s² before smoothing": lambda one: _share(one.impossible_before, one.accelerations_before),
    "|a| > 8 m/s² after smoothing": lambda one: _share(one.impossible_after, one.accelerations_after),
    "|a| > 3.41 m/s² before smoothing": lambda one: _share(one.clipped_before, one.accelerations_before),
    "|a| > 3.41 m/s² after smoothing": lambda one: _share(one.clipped_after, one.accelerations_after),
    "overlaps with the leader [rows]": lambda one: _share(one.overlaps, one.rows - one.duplicates),
    "on-ramp vehicles": lambda one: f"{one.on_ramp_vehicles:,}",
    "on-ramp vehicles seen for 19 s or more": lambda one: f"{one.on_ramp_seen_19s:,}",
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
    "on-ramp vehicles seen for 19 s or more": "on_ramp_seen_19s",
    "target-lane vehicles beside the ramp lane": "target_lane_vehicles",
}


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and math.isnan(value) else value
