"""The recording that is examined, as every check needs it: sorted rows as arrays, jumps, and the smoothed recording."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int, Num

from rampcast.doctor.jumps import jumps
from rampcast.doctor.places import places_of
from rampcast.doctor.row_measures import BEFORE, DEPTH, STEP, TRACK, as_row_before, measured
from rampcast.errors import RecordingError
from rampcast.horizon import STEP as SMOOTHED_STEP
from rampcast.recording import CleaningReport, Recording, clean
from rampcast.recording import columns as c
from rampcast.recording.reading import ReadReport
from rampcast.recording.smoothing import LONGEST_FILLED_GAP
from rampcast.traffic import find_anchors, find_neighbours, on_ramp_vehicles
from rampcast.traffic.neighbours import NONE

ANCHOR_SPACING = 1.0  # [s] between the moments at which neighbours are counted


@dataclass(frozen=True)
class Subject:
    """A recording under examination.

    Attributes:
        recording: raw or smoothed.
        report: what reading found; None if nothing was read from files.
        tracks: its rows sorted by (recording, vehicle, frame), each key once, with the columns of `row_measures`.
        repeats: rows whose key came before.
        cleaned: it smoothed; None if that is impossible.
        changes: what smoothing changed; None if it was smoothed already, or cannot be.
        why_not: why it cannot be smoothed.
    """

    recording: Recording
    report: ReadReport | None
    tracks: pl.DataFrame
    repeats: pl.DataFrame
    cleaned: Recording | None
    changes: CleaningReport | None
    why_not: str

    @property
    def time_step(self) -> float:
        """Returns the time between two frames [s]."""
        return self.recording.time_step

    @property
    def longest(self) -> int:
        """Returns the longest hole that is taken for a lost vehicle and not for a reused id [frames]."""
        return round(LONGEST_FILLED_GAP / self.time_step)

    @cached_property
    def step(self) -> Int[np.ndarray, "row"]:
        """Returns the frames since the vehicle's row before; 0 at its first."""
        return self.tracks[STEP].fill_null(0).to_numpy().astype(np.int64)

    @cached_property
    def starts(self) -> Int[np.ndarray, "vehicle"]:
        """Returns the row at which each vehicle begins."""
        return np.flatnonzero(self.step == 0)

    @cached_property
    def ends(self) -> Int[np.ndarray, "vehicle"]:
        """Returns the last row of each vehicle."""
        return np.append(self.starts[1:], len(self.step))[: len(self.starts)] - 1

    @cached_property
    def is_after_hole(self) -> Bool[np.ndarray, "row"]:
        """Returns which rows follow a hole in their vehicle's track that a lost vehicle leaves."""
        return (self.step > 1) & (self.step <= self.longest)

    @cached_property
    def comes_back(self) -> Bool[np.ndarray, "row"]:
        """Returns at which rows an id comes back after so long that it is another vehicle."""
        return self.step > self.longest

    @cached_property
    def overlap(self) -> Float[np.ndarray, "row"]:
        """Returns how far each row's front is ahead of the rear of the next vehicle in its lane [m]; 0 if it is not."""
        return np.fmax(self.tracks[DEPTH].to_numpy(), 0.0)  # NaN where there is no leader

    @cached_property
    def raw_acceleration(self) -> Float[np.ndarray, "row"]:
        """Returns the acceleration before smoothing [m/s^2]; NaN where that, or a row beside it, is not there."""
        known = self.tracks[BEFORE].to_numpy()
        return np.full(len(known), np.nan) if self.recording.is_smoothed else known

    @cached_property
    def seen(self) -> Float[np.ndarray, "vehicle"]:
        """Returns for how long each vehicle is seen [s]."""
        return (self.frame[self.ends] - self.frame[self.starts]) * self.time_step

    @cached_property
    def on_ramp(self) -> Bool[np.ndarray, "vehicle"]:
        """Returns which vehicles are on-ramp vehicles."""
        known = on_ramp_vehicles(replace(self.recording, tracks=self.tracks)).with_columns(on_ramp=pl.lit(True))
        found = self.tracks[self.starts].join(known, on=TRACK, how="left", maintain_order="left")
        return found["on_ramp"].fill_null(False).to_numpy()

    @cached_property
    def track(self) -> Int[np.ndarray, "row"]:
        """Returns the number of the vehicle of each row, counted over all windows."""
        return np.cumsum(self.step == 0) - 1

    @cached_property
    def frame(self) -> Int[np.ndarray, "row"]:
        """Returns the frame of each row."""
        return self.tracks[c.FRAME].to_numpy().astype(np.int64)

    @cached_property
    def lane(self) -> Int[np.ndarray, "row"]:
        """Returns the lane of each row."""
        return self.tracks[c.LANE].to_numpy().astype(np.int64)

    @cached_property
    def x(self) -> Float[np.ndarray, "row"]:
        """Returns the longitudinal position of each row [m]."""
        return self.tracks[c.X].to_numpy().astype(np.float64)

    @cached_property
    def y(self) -> Float[np.ndarray, "row"]:
        """Returns the lateral position of each row [m]."""
        return self.tracks[c.Y].to_numpy().astype(np.float64)

    @cached_property
    def has_lateral(self) -> bool:
        """Returns whether lateral positions were measured: they are more than one value for each lane."""
        values = self.tracks.group_by(c.LANE).agg(pl.col(c.Y).min().alias("low"), pl.col(c.Y).max().alias("high"))
        return bool((values["low"] < values["high"]).any())

    @cached_property
    def speed(self) -> Float[np.ndarray, "row"]:
        """Returns the mean speed since the vehicle's row before [m/s]; NaN at its first and after long holes."""
        return _rates(self.x, self.step, longest=self.longest, time_step=self.time_step)

    @cached_property
    def jump(self) -> Float[np.ndarray, "row"]:
        """Returns how far each row lies from where its vehicle was going [m], if that is a jump; else 0."""
        along = jumps(self.x, self.step, longest=self.longest, time_step=self.time_step)
        if not self.has_lateral:  # a change of label moves a vehicle from lane to lane at once
            return along
        aside = jumps(self.y, self.step, longest=self.longest, time_step=self.time_step)
        return np.where(np.abs(along) >= np.abs(aside), along, aside)

    @cached_property
    def jerk(self) -> Float[np.ndarray, "after"]:
        """Returns the jerk at each row of the smoothed recording [m/s^3]; NaN where the row before is missing."""
        assert self.cleaned is not None
        rows = self.cleaned.tracks
        continues = rows.select(as_row_before(*TRACK) & (pl.col(c.FRAME).diff() == 1)).to_series().fill_null(False)
        rate = np.diff(rows[c.A].to_numpy(), prepend=np.nan) / SMOOTHED_STEP
        return np.where(continues.to_numpy(), rate, np.nan)

    @cached_property
    def anchors(self) -> Int[np.ndarray, "scene"]:
        """Returns the rows of the smoothed recording at which a forecast can begin, one a second of each vehicle."""
        if self.cleaned is None:
            return np.empty(0, dtype=np.int64)
        try:
            return find_anchors(self.cleaned, every=ANCHOR_SPACING)
        except RecordingError:  # there is no ramp, or nobody is on it for 4 s
            return np.empty(0, dtype=np.int64)

    @cached_property
    def missing(self) -> Bool[np.ndarray, "scene 6"]:
        """Returns which of the six neighbours no vehicle fills at each anchor."""
        assert self.cleaned is not None
        return find_neighbours(self.cleaned, self.anchors) == NONE

    def along(self, frames: int) -> Int[np.ndarray, "found"]:
        """Returns the rows of vehicles that have every row from so many frames before to so many after them."""
        rows = np.arange(frames, len(self.step) - frames)
        before, after = rows - frames, rows + frames
        whole = (self.track[before] == self.track[after]) & (self.frame[after] - self.frame[before] == 2 * frames)
        return rows[whole]

    def places(
        self, rows: Int[np.ndarray, "found"] | Bool[np.ndarray, "row"], values: Num[np.ndarray, "found"]
    ) -> pl.DataFrame:
        """Returns the places of those rows, with a value for each."""
        return places_of(self.tracks[_numbers(rows)], values)

    def smoothed_places(
        self, rows: Int[np.ndarray, "found"] | Bool[np.ndarray, "after"], values: Num[np.ndarray, "found"]
    ) -> pl.DataFrame:
        """Returns the places of those rows of the smoothed recording, with frames counted as in the raw one."""
        assert self.cleaned is not None
        every = round(SMOOTHED_STEP / self.time_step)
        found = self.cleaned.tracks[_numbers(rows)]
        return places_of(found.with_columns(pl.col(c.FRAME) * every), values)


def subject_of(recording: Recording, report: ReadReport | None) -> Subject:
    """Returns a recording ready to be examined."""
    tracks, repeats = measured(recording)
    cleaned, changes, why_not = _cleaned(recording)
    return Subject(recording, report, tracks, repeats, cleaned, changes, why_not)


def _numbers(rows: Num[np.ndarray, "found"] | Bool[np.ndarray, "row"]) -> Int[np.ndarray, "found"]:
    return np.flatnonzero(rows) if rows.dtype == np.bool_ else rows.astype(np.int64)


def _cleaned(recording: Recording) -> tuple[Recording | None, CleaningReport | None, str]:
    if recording.is_smoothed:
        return recording, None, ""
    try:
        cleaned, changes = clean(recording)
    except RecordingError as error:
        return None, None, str(error)
    return cleaned, changes, ""


def _rates(
    values: Float[np.ndarray, "row"], step: Int[np.ndarray, "row"], *, longest: int, time_step: float
) -> Float[np.ndarray, "row"]:
    known = (step > 0) & (step <= longest)
    return np.where(known, np.diff(values, prepend=np.nan) / (np.where(known, step, 1) * time_step), np.nan)
