"""The tables that the doctor's page draws: tracks around the worst faults, lateral positions, faults in time."""

from collections.abc import Sequence

import numpy as np
import polars as pl

from rampcast.doctor.finding import Finding
from rampcast.doctor.places import FINDING, PLACE_SCHEMA
from rampcast.doctor.severity import Severity
from rampcast.doctor.subject import Subject
from rampcast.recording import columns as c

SHOWN_TIME = 60.0  # [s] of the space-time picture: single vehicles can be told apart
MOST_FINDINGS = 6  # as many as the palette has colours
WEIGHTS = {Severity.SPOILS: 9.0, Severity.WARNING: 3.0, Severity.NOTE: 1.0}
LATERAL_BAR = 0.1  # [m]
TIMELINE_BARS = 150
MOST_TIMELINES = 3  # windows: those with most places
# Findings whose places are everywhere or tell of the end of a track: they would hide all others in the pictures.
NOT_SHOWN = (
    *("hard_accelerations", "raw_accelerations", "cut_tracks"),
    *("unseen_merges", "short_stays", "virtual_neighbours"),
)


def picture_tables(subject: Subject, findings: Sequence[Finding]) -> dict[str, pl.DataFrame]:
    """Returns the tables: `tracks`, `marks`, `lateral`, `timeline`, and the limits of the lanes in `lanes`."""
    shown = [one for one in findings if one.places.height and one.check.name not in NOT_SHOWN]
    places = _placed(subject, shown)
    tracks, marks = _stretch(subject, places)
    return {
        "tracks": tracks,
        "marks": marks,
        "lateral": _lateral(subject),
        "lanes": _lanes(subject),
        "timeline": _timeline(subject, places),
    }


def _placed(subject: Subject, findings: Sequence[Finding]) -> pl.DataFrame:
    """Returns the places that have a frame, each with its finding's title, its weight, and its time [s]."""
    schema = pl.Schema(PLACE_SCHEMA | {FINDING: pl.String(), "weight": pl.Float64()})
    tables = [
        one.places.with_columns(pl.lit(one.check.title).alias(FINDING), pl.lit(weight).alias("weight"))
        for one in findings
        for weight in [WEIGHTS[one.severity] / max(one.places.height, 1)]
    ]
    found = pl.concat([pl.DataFrame(schema=schema), *tables])
    return found.filter(pl.col(c.FRAME).is_not_null()).with_columns(t=pl.col(c.FRAME) * subject.time_step)


def _stretch(subject: Subject, places: pl.DataFrame) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Returns the tracks and the marked places of the window, lane and minute in which most findings show."""
    rows = subject.tracks.with_columns(t=pl.col(c.FRAME) * subject.time_step)
    names = [c.RECORDING, c.VEHICLE, c.LANE, "t", c.X]
    if not rows.height:
        return rows.select(names), places
    window, lane, start = _worst(rows, places)
    inside = (
        (pl.col(c.RECORDING) == window) & (pl.col(c.LANE) == lane) & pl.col("t").is_between(start, start + SHOWN_TIME)
    )
    shown = rows.with_columns(pl.col(c.RECORDING).cast(pl.String)).filter(inside).select(names)
    marks = places.filter(inside)
    order = marks.group_by(FINDING).agg(pl.col("weight").max(), pl.len()).sort("weight", descending=True)
    return shown, marks.filter(pl.col(FINDING).is_in(order[FINDING].head(MOST_FINDINGS).to_list()))


def _worst(rows: pl.DataFrame, places: pl.DataFrame) -> tuple[str, int, float]:
    """Returns the window, the lane and the first second of the minute to show; the busiest if there are no places."""
    where = places.drop_nulls([c.LANE]) if places.height else places
    if not where.height:
        where = rows.with_columns(pl.col(c.RECORDING).cast(pl.String), weight=pl.lit(1.0), finding=pl.lit(""))
    begin = rows.select(pl.col("t").min()).item()
    minutes = where.with_columns(minute=((pl.col("t") - begin) / SHOWN_TIME).floor())
    each = minutes.group_by(c.RECORDING, c.LANE, "minute").agg(pl.col("weight").sum())
    order = each.sort("weight", c.RECORDING, "minute", c.LANE, descending=[True, False, False, False])
    best = order.row(0, named=True)
    return str(best[c.RECORDING]), int(best[c.LANE]), float(begin + best["minute"] * SHOWN_TIME)


def _lateral(subject: Subject) -> pl.DataFrame:
    """Returns the share of each lane's rows in bars of lateral position: columns lane, y [m] and share."""
    bar = (pl.col(c.Y) / LATERAL_BAR).round() * LATERAL_BAR
    counts = subject.tracks.group_by(c.LANE, bar.alias(c.Y)).len()
    share = pl.col("len") / pl.col("len").sum().over(c.LANE)
    return counts.select(c.LANE, c.Y, share=share).sort(c.LANE, c.Y)


def _lanes(subject: Subject) -> pl.DataFrame:
    lanes = [(lane.number, lane.role, lane.centre) for lane in subject.recording.site.lanes]
    return pl.DataFrame(lanes, {c.LANE: pl.Int16(), "role": pl.String(), "centre": pl.Float64()}, orient="row")


def _timeline(subject: Subject, places: pl.DataFrame) -> pl.DataFrame:
    """Returns vehicles seen and places of each finding in equal parts of the time of the windows with most places.

    Columns: recording, t [s] (the middle of the part), finding ("" for vehicles seen in a frame, on average), count.
    """
    faulty = places.group_by(c.RECORDING, maintain_order=True).len().sort("len", descending=True, maintain_order=True)
    names = faulty[c.RECORDING].head(MOST_TIMELINES).to_list() or subject.recording.names[:1]
    schema = pl.Schema({c.RECORDING: pl.String(), "t": pl.Float64(), FINDING: pl.String(), "count": pl.Float64()})
    parts = [pl.DataFrame(schema=schema)]
    for name in names:
        time = subject.tracks.filter(pl.col(c.RECORDING) == name)[c.FRAME].to_numpy() * subject.time_step
        bars = min(TIMELINE_BARS, round(np.ptp(time) / subject.time_step) + 1)
        edges = np.linspace(time.min(), time.max() + subject.time_step, bars + 1) - subject.time_step / 2
        frames = (edges[1] - edges[0]) / subject.time_step
        series = {"": np.histogram(time, edges)[0] / frames}
        for (title,), own in places.filter(pl.col(c.RECORDING) == name).group_by(FINDING, maintain_order=True):
            series[str(title)] = np.histogram(own["t"].to_numpy(), edges)[0].astype(np.float64)
        middle = (edges[1:] + edges[:-1]) / 2
        for title, counts in series.items():
            part = {c.RECORDING: [name] * bars, "t": middle, FINDING: [title] * bars, "count": counts}
            parts.append(pl.DataFrame(part, schema=schema))
    return pl.concat(parts)
