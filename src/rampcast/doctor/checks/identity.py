"""Checks of who a vehicle is: holes in its track, ids and sizes that change hands, rows out of order, fragments."""

import numpy as np
import polars as pl

from rampcast.doctor.finding import Faults
from rampcast.doctor.places import moments
from rampcast.doctor.subject import Subject
from rampcast.recording import columns as c
from rampcast.recording.smoothing import SHORTEST_TRACK

RESIZED = 0.5  # [m] more than the noise of a length that is measured in every frame
SHORTEST, LONGEST = 1.0, 30.0  # [m] a moped is 1.7 m; the longest road trains allowed in Europe are 25.25 m


def gaps(subject: Subject) -> Faults:
    """Returns the rows that follow a hole of up to 5 s in their vehicle's track; the value is its length [s]."""
    rows = np.flatnonzero(subject.is_after_hole)
    missing = subject.step[rows] - 1
    return Faults(
        subject.places(rows, missing * subject.time_step),
        of=len(subject.step),
        detail=f"{int(missing.sum()):,} frames are missing in these holes" if len(rows) else "",
    )


def reused_ids(subject: Subject) -> Faults:
    """Returns the rows where an id comes back after more than 5 s; the value is how long it was away [s]."""
    rows = np.flatnonzero(subject.comes_back)
    return Faults(subject.places(rows, (subject.step[rows] - 1) * subject.time_step), of=len(subject.starts))


def changing_sizes(subject: Subject) -> Faults:
    """Returns the rows at which a vehicle's length changes by more than 0.5 m; the value is by how much [m]."""
    length = subject.tracks[c.LENGTH].to_numpy().astype(np.float64)
    change = np.where(subject.step > 0, np.diff(length, prepend=np.nan), 0.0)
    rows = np.flatnonzero(np.abs(change) > RESIZED)
    return Faults(subject.places(rows, change[rows]), of=len(subject.starts))


def impossible_sizes(subject: Subject) -> Faults:
    """Returns the rows whose vehicle is shorter than 1 m, longer than 30 m, or of no length; the value is it [m]."""
    length = subject.tracks[c.LENGTH].to_numpy().astype(np.float64)
    rows = np.flatnonzero(~((length >= SHORTEST) & (length <= LONGEST)))
    return Faults(subject.places(rows, length[rows]), of=len(length))


def time_backwards(subject: Subject) -> Faults:
    """Returns the rows whose frame is before that of the row above, of the same vehicle; the value is how far [s]."""
    tracks, same = subject.recording.tracks, [c.RECORDING, c.VEHICLE]
    back = pl.when(pl.all_horizontal(pl.col(name) == pl.col(name).shift(1) for name in same)).then(
        pl.col(c.FRAME).shift(1) - pl.col(c.FRAME)
    )
    found = tracks.with_columns(value=back * subject.time_step).filter(pl.col("value") > 0)
    names = [c.RECORDING, c.VEHICLE, c.FRAME, c.X, c.LANE, "value"]
    return Faults(moments(found.select(names).to_dict()), of=tracks.height)


def fragments(subject: Subject) -> Faults:
    """Returns the tracks that are too short to smooth; the value is their length [frames].

    A track is a vehicle's rows without a hole of more than 5 s.
    """
    begins = np.flatnonzero((subject.step == 0) | subject.comes_back)
    rows = np.diff(np.append(begins, len(subject.step)))
    short = rows < SHORTEST_TRACK
    return Faults(subject.places(begins[short], rows[short]), of=len(begins))
