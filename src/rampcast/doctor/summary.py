"""The summary of a recording, window by window: what is in it, lane by lane, and how often what is wrong with it.

Every number is a sum of what the doctor's checks look at, so that both say the same.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Shaped

from rampcast.arguments import expected
from rampcast.doctor.checks.ramp import seen_long
from rampcast.doctor.subject import Subject, subject_of
from rampcast.notebook import html_table
from rampcast.physics.minimums import RECORDED_LIMIT
from rampcast.recording import columns as c
from rampcast.recording.breach import Breach
from rampcast.recording.invariants import breaches_of
from rampcast.recording.recording import READ_FIRST, Recording
from rampcast.recording.smoothing import IMPOSSIBLE_ACCELERATION

NAME = "name"  # of a window
ALL = "all"  # stands for the name of all of them together
MOST_COLUMNS = 4  # windows side by side that a terminal has room for
COUNTS: Mapping[str, str] = {  # what is counted, as the command line calls it; accelerations are null where not known
    "vehicles": "vehicles",  # an id in two windows is two vehicles
    "rows": "rows",
    "frames": "frames",  # different ones
    "duration": "duration [s]",  # of those frames
    "duplicates": "duplicate rows left",  # they repeat a window, vehicle and frame
    "gaps": "gaps up to 5 s",  # holes in a track
    "skipped_frames": "frames skipped in them",
    "reused_ids": "ids that come back after more than 5 s",  # another vehicle, most likely
    "impossible_before": "|a| > 8 m/s² before smoothing",
    "impossible_after": "|a| > 8 m/s² after smoothing",
    "clipped_before": "|a| > 3.41 m/s² before smoothing",
    "clipped_after": "|a| > 3.41 m/s² after smoothing",
    "overlaps": "overlaps with the leader [rows]",  # a front ahead of the leader's rear, in the same lane and frame
    "on_ramp_vehicles": "on-ramp vehicles",  # a row of theirs lies in a ramp lane
    "on_ramp_seen_19s": "on-ramp vehicles seen for 19 s or more",
    "target_lane_vehicles": "target-lane vehicles beside the ramp lane",  # with a row there between gore and ramp end
}
OF_ALL = ("accelerations_before", "accelerations_after")  # rows whose acceleration is known: they are compared with it
IN_WINDOWS = {  # short heads of what a table of many windows shows
    "vehicles": "vehicles", "rows": "rows", "duration": "duration [s]", "gaps": "gaps",
    "impossible_before": "|a| > 8 before", "impossible_after": "after", "overlaps": "overlaps",
    "on_ramp_vehicles": "on-ramp",
}  # fmt: skip
# What the paper prints of a site and window; its section "Data Set".
PAPER_COUNTS: Mapping[str, Mapping[str, Mapping[str, int]]] = {
    "i80": {
        "i80-1": {"on_ramp_seen_19s": 117},
        "i80-2": {"on_ramp_seen_19s": 129},
        "i80-3": {"on_ramp_seen_19s": 139},
        ALL: {"on_ramp_vehicles": 713, "on_ramp_seen_19s": 385, "target_lane_vehicles": 1529},
    }
}
IN_PAPER = tuple(PAPER_COUNTS["i80"][ALL])


@dataclass(frozen=True, repr=False)
class Summary:
    """What is in a recording, and how often what is wrong with it.

    Attributes:
        site, source, simulated: of the recording.
        windows: a row for each window: its name and the numbers of `COUNTS`.
        total: the same numbers of all windows together.
        lanes: a row for each window and lane, and for each lane of all: rows, vehicles, role, and where the vehicles
            drive beside where the site says, `median_y` and `centre` [m, NaN where the site does not know the lane].
        breaches: what of the recording no road or vehicle has, the doctor's and the doors' invariants.
    """

    site: str
    source: str
    simulated: bool
    windows: pl.DataFrame
    total: Mapping[str, Any]
    lanes: pl.DataFrame
    breaches: tuple[Breach, ...] = ()

    def paper(self, name: str) -> Mapping[str, int]:
        """Returns what the paper prints of a window, or of "all"; nothing of most."""
        return PAPER_COUNTS.get(self.site, {}).get(name, {})

    def to_polars(self) -> pl.DataFrame:
        """Returns the numbers of each window, and last those of all together."""
        return pl.concat([self.windows, pl.DataFrame([self.total], schema=self.windows.schema)])

    def to_dict(self) -> dict[str, Any]:
        """Returns everything as plain values, for json."""
        each = [
            row
            | {"paper": {count: found.get(count) for count in IN_PAPER} if found else None}
            | {"lanes": self.lanes.filter(name=row[NAME]).drop(NAME).fill_nan(None).to_dicts()}
            for row in self.to_polars().to_dicts()
            for found in [self.paper(row[NAME])]
        ]
        of_recording = {"site": self.site, "source": self.source, "simulated": self.simulated}
        doubtful = [str(one) for one in self.breaches]
        return {**of_recording, "windows": each[:-1], "total": each[-1], "doubtful": doubtful}

    def __repr__(self) -> str:
        count = self.windows.height
        what = f"{self.total['vehicles']:,} vehicles, {self.total['rows']:,} rows"
        return f"<Summary of {self.site}: {what} in {count} window{'s' if count != 1 else ''}>"

    def __str__(self) -> str:
        """Returns the numbers of all windows together, line by line."""
        lines = [f"{label}: {_cell(self.total, name)}" for name, label in COUNTS.items()]
        return "\n".join([repr(self)[1:-1], *(f"  {line}" for line in lines), *map(str, self.breaches)])

    def _repr_html_(self) -> str:
        return html_table(repr(self)[1:-1], {label: _cell(self.total, name) for name, label in COUNTS.items()})


class TextTable(NamedTuple):
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
    subject, site = subject_of(recording, None), recording.site
    found = _numbers(subject)
    return Summary(
        site.name,
        recording.source,
        site.simulated,
        found[:-1],
        found.row(-1, named=True),
        _lanes(subject),
        breaches_of(recording),
    )


def counts_table(found: Summary) -> TextTable:
    """Returns the counts of each window, of all together, and the paper's where it prints some, as text.

    Of many windows it is all together; `window_table` has a row for each of them.
    """
    several = 1 < found.windows.height <= MOST_COLUMNS
    columns = found.to_polars().to_dicts() if several else [found.total]
    if found.windows.height == 1:
        columns = found.windows.to_dicts()
    rows = [(label, *(_cell(one, name) for one in columns)) for name, label in COUNTS.items()]
    papers = [found.paper(one[NAME]) for one in columns]
    for name in IN_PAPER if any(papers) else ():
        cells = (_cell({name: paper.get(name)}, name) if paper else "" for paper in papers)
        rows.append((f"{COUNTS[name]}, the paper", *cells))
    return TextTable(("", *(one[NAME] for one in columns)), tuple(rows))


def window_table(found: Summary) -> TextTable | None:
    """Returns a row of counts for each window, as text, where there are too many for columns; None where not."""
    if found.windows.height <= MOST_COLUMNS:
        return None
    rows = ((one[NAME], *(_cell(one, name) for name in IN_WINDOWS)) for one in found.windows.to_dicts())
    return TextTable(("window", *IN_WINDOWS.values()), tuple(rows))


def lane_table(found: Summary) -> TextTable:
    """Returns rows, vehicles and lateral position of each lane over all windows, as text."""
    heads = ("lane", "role", "rows", "vehicles", "median y [m]", "site's centre [m]")
    lanes = found.lanes.filter(name=ALL).select("number", "role", "rows", "vehicles", "median_y", "centre")
    rows = (
        (str(number), role, f"{rows:,}", f"{vehicles:,}", f"{y:z.2f}", f"{centre:z.2f}")
        for number, role, rows, vehicles, y, centre in lanes.iter_rows()
    )
    return TextTable(heads, tuple(rows))


def _cell(counts: Mapping[str, Any], name: str) -> str:
    """Returns a count as text, with its share where it is one of accelerations or rows."""
    value, kind = counts[name], name.partition("_")
    if kind[0] in ("impossible", "clipped", "overlaps"):
        of = counts[f"accelerations_{kind[2]}"] if kind[2] else counts["rows"] - counts["duplicates"]
        return f"{value:,} ({100 * value / of:.2f} %)" if of else "–"
    return "–" if value is None else f"{value:,.1f}" if name == "duration" else f"{value:,}"


def _numbers(subject: Subject) -> pl.DataFrame:
    """Returns the name and the numbers of each window, and last those of all together."""
    again = np.ones(subject.repeats.height, dtype=bool)
    parts = [_of_rows(subject), _of_vehicles(subject), _summed(subject.repeats, {"rows": again, "duplicates": again})]
    if subject.cleaned is not None:
        smoothed = subject.cleaned.tracks
        parts.append(_summed(smoothed, _accelerations("after", smoothed[c.A].to_numpy())))
    names = (*COUNTS, *OF_ALL)
    nothing = pl.DataFrame(schema={NAME: pl.String(), **dict.fromkeys(names, pl.Int64())})
    found = pl.concat([nothing, *parts], how="diagonal").group_by(NAME).sum().sort(NAME)
    found = pl.concat([found, found.select(pl.lit(ALL).alias(NAME), pl.exclude(NAME).sum())])
    known = {"before": not subject.recording.is_smoothed, "after": subject.cleaned is not None}
    unknown = [name for name in names if not known.get(name.rpartition("_")[2], True)]
    seconds = pl.col("frames") * subject.time_step
    return found.with_columns(pl.lit(None, pl.Int64).alias(name) for name in unknown).with_columns(duration=seconds)


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
    site = subject.recording.site
    beside = (subject.x >= site.gore) & (subject.x <= site.ramp_end) & (subject.lane == site.target_lane)
    before = np.concatenate([[0], np.cumsum(beside)])
    counted = {
        "vehicles": np.ones(len(subject.starts), dtype=bool),
        "on_ramp_vehicles": subject.on_ramp,
        "on_ramp_seen_19s": subject.on_ramp & seen_long(subject),
        "target_lane_vehicles": before[subject.ends + 1] > before[subject.starts],
    }
    return _summed(subject.tracks[subject.starts], counted)


def _summed(rows: pl.DataFrame, counted: Mapping[str, Shaped[np.ndarray, "row"]]) -> pl.DataFrame:
    """Returns the sums over the rows of each window."""
    table = pl.DataFrame({NAME: rows[c.RECORDING].cast(pl.String), **counted})
    return table.group_by(NAME).agg(pl.all().sum().cast(pl.Int64))


def _accelerations(stage: str, values: Float[np.ndarray, "row"]) -> dict[str, Bool[np.ndarray, "row"]]:
    size = np.abs(values)  # NaN is not above
    return {
        f"impossible_{stage}": size > IMPOSSIBLE_ACCELERATION,
        f"clipped_{stage}": size > RECORDED_LIMIT,
        f"accelerations_{stage}": np.isfinite(size),
    }


def _lanes(subject: Subject) -> pl.DataFrame:
    """Returns the lanes of each window, and last those of all together."""
    known = {lane.number: lane for lane in subject.recording.site.lanes}
    rows = subject.tracks.select(pl.col(c.RECORDING).cast(pl.String).alias(NAME), pl.col(c.LANE).alias("number"), c.Y)
    rows = rows.with_columns(track=pl.Series(subject.track))
    counted = (
        pl.len().alias("rows"),
        pl.col("track").n_unique().alias("vehicles"),
        pl.col(c.Y).median().alias("median_y"),
    )
    found = pl.concat(
        [
            rows.group_by(NAME, "number").agg(counted).sort(NAME, "number"),
            rows.group_by("number").agg(counted).sort("number").select(pl.lit(ALL).alias(NAME), pl.all()),
        ]
    )
    roles = {number: lane.role for number, lane in known.items()}
    centres = {number: lane.centre for number, lane in known.items()}
    return found.with_columns(
        pl.col("number").replace_strict(roles, default="unknown", return_dtype=pl.String).alias("role"),
        pl.col("number").replace_strict(centres, default=math.nan, return_dtype=pl.Float64).alias("centre"),
    )
