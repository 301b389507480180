"""Tracks are cut where no vehicle can have driven: a simulator's teleport, an id that a tracker gave to another one."""

from dataclasses import replace

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int

from rampcast.recording import columns as c
from rampcast.recording.order import is_sorted, track_starts
from rampcast.recording.recording import KEY, Recording
from rampcast.recording.smoothing import IMPOSSIBLE_ACCELERATION, LONGEST_FILLED_GAP, SHORTEST_TRACK

FASTEST = 70.0  # [m/s] 252 km/h: the speed to which makers limit most fast cars is 250 km/h
NOISE = 5.0  # [m] a car's length: a tracker that slips so far still follows the same vehicle
SPEED_NOISE = 3.0  # [m/s] of a speed over half a second, where a place is off by a metre
ASIDE, ASIDE_RATE = 7.5, 3.0  # [m, m/s] aside: two lanes, which simulators cross in a step, and as fast as one swerves
BESIDE = 0.5  # [s] before and after a step that tell how fast the vehicle was
BLOCK = 1 << 15  # rows done at once: their arrays fit the cache of a core

Row = Float[np.ndarray, "row"]


def cut_tracks(recording: Recording) -> tuple[Recording, int]:
    """Returns a raw recording with tracks cut where no vehicle can have driven on, and how often that was.

    What follows a cut is a vehicle of its own, with an id that the window had not. A few rows that lie elsewhere and
    are back again are no cut: the vehicle is the same.
    """
    tracks = recording.tracks
    if recording.is_smoothed or tracks.height < 2 or not is_sorted(tracks):
        return recording, 0
    starts = track_starts(tracks, slice(None))
    cut = _without_short_pieces(_impossible(tracks, starts, recording.time_step), starts)
    if not cut.any():
        return recording, 0
    pieces = np.cumsum(cut)  # counts cuts from the first row on
    first = np.repeat(pieces[starts], np.diff(np.r_[starts, tracks.height]))
    is_new = pieces > first
    vehicle = tracks[c.VEHICLE].to_numpy()
    ids = np.where(is_new, _free_ids(vehicle, int(cut.sum()))[np.maximum(pieces - 1, 0)], vehicle)
    renamed = tracks.with_columns(pl.Series(c.VEHICLE, ids, dtype=c.SCHEMA[c.VEHICLE])).sort(KEY)
    return replace(recording, tracks=renamed), int(cut.sum())


def _free_ids(vehicle: Int[np.ndarray, "row"], count: int) -> Int[np.ndarray, "piece"]:
    """Returns ids that no vehicle has: those above the largest, or the lowest that are free where that is the limit."""
    largest = int(vehicle.max())
    if largest + count <= c.LARGEST:
        return np.arange(largest + 1, largest + count + 1)
    known = np.unique(vehicle)
    return np.setdiff1d(np.arange(1, len(known) + count + 1), known)[:count]


def _impossible(tracks: pl.DataFrame, starts: Int[np.ndarray, "track"], time_step: float) -> Bool[np.ndarray, "row"]:
    """Returns which rows no vehicle can have reached from its row before, after up to 5 s."""
    x, y = (tracks[name].to_numpy().astype(float, copy=False) for name in (c.X, c.Y))
    frame = tracks[c.FRAME].to_numpy().astype(np.int64)
    found = np.zeros(len(x), bool)
    suspects = _suspects(x, y, frame, starts, time_step)
    if not len(suspects):
        return found
    came, aside = x[suspects] - x[suspects - 1], y[suspects] - y[suspects - 1]
    time = (frame[suspects] - frame[suspects - 1]) * time_step
    first = np.repeat(starts, np.diff(np.r_[starts, len(x)]))
    before, after = _speeds(x, frame * time_step, first, suspects)
    slow, fast = np.fmin(before, after), np.fmax(before, after)
    slow, fast = np.nan_to_num(slow, nan=0.0), np.nan_to_num(fast, nan=FASTEST)
    reach = _reach(time)
    # who must be as slow again has half of the time to speed up, and half to brake
    both = (before + after) / 2 * time + IMPOSSIBLE_ACCELERATION * time**2 / 4 + NOISE + SPEED_NOISE * time
    farthest = np.fmin(fast * time + reach, both)
    is_along = (came < slow * time - reach) | (came > farthest)
    found[suspects] = is_along | (np.abs(aside) > ASIDE + ASIDE_RATE * time)
    return found


def _suspects(
    x: Row, y: Row, frame: Int[np.ndarray, "row"], starts: Int[np.ndarray, "track"], time_step: float
) -> Int[np.ndarray, "some"]:
    """Returns the rows that follow their vehicle's row before in an odd way or after a hole, of up to 5 s."""
    is_start = np.zeros(len(x), bool)
    is_start[starts] = True
    found = []
    for first in range(1, len(x), BLOCK):
        part = slice(first - 1, first + BLOCK)
        elapsed = np.diff(frame[part]) * time_step
        came, aside = np.abs(np.diff(x[part])), np.abs(np.diff(y[part]))
        is_odd = (came > _reach(elapsed)) | (aside > ASIDE) | (elapsed > BESIDE)
        known = (elapsed > 0) & (elapsed <= LONGEST_FILLED_GAP) & ~is_start[first : first + BLOCK]
        found.append(np.flatnonzero(known & is_odd) + first)
    return np.concatenate(found)


def _reach(elapsed: Float[np.ndarray, "some"]) -> Float[np.ndarray, "some"]:
    """Returns how far noise and all that grip allows lead off a steady way [m] in a time [s]."""
    return NOISE + IMPOSSIBLE_ACCELERATION * elapsed**2 / 2


def _speeds(
    x: Row, time: Row, first: Int[np.ndarray, "row"], rows: Int[np.ndarray, "some"]
) -> tuple[Float[np.ndarray, "some"], Float[np.ndarray, "some"]]:
    """Returns the speeds [m/s] in the half second before the row before and from these rows on; NaN where unseen."""
    pairs = []
    for start, way in ((rows - 1, -1), (rows, 1)):
        other = start.copy()
        for _ in range(2, 64):
            following = np.clip(other + way, 0, len(x) - 1)
            goes_on = (first[following] == first[start]) & (np.abs(time[following] - time[start]) <= BESIDE)
            if not (goes_on & (following != other)).any():
                break
            other = np.where(goes_on, following, other)
        away = time[other] - time[start]
        known = away != 0
        pairs.append(np.where(known, (x[other] - x[start]) / np.where(known, away, 1.0), np.nan))
    return pairs[0], pairs[1]


def _without_short_pieces(cut: Bool[np.ndarray, "row"], starts: Int[np.ndarray, "track"]) -> Bool[np.ndarray, "row"]:
    """Returns the cuts but for those around a few rows between two of them."""
    edges = cut.copy()
    edges[starts] = True
    begins = np.flatnonzero(edges)
    size = np.diff(np.r_[begins, len(cut)])
    is_last = np.isin(np.r_[begins[1:], len(cut)], np.r_[starts, len(cut)])
    short = np.flatnonzero(cut[begins] & (size < SHORTEST_TRACK) & ~is_last)
    kept = cut.copy()
    kept[begins[short]] = False
    kept[begins[short + 1]] = False
    return kept
