"""What became of a merging vehicle: when it crossed the lane line, and into which gap."""

import numpy as np
from jaxtyping import Bool, Float, Int

from rampcast.benchmark.cases import frames_left
from rampcast.traffic.merge_scenes import BEHIND
from rampcast.traffic.platoons import Tracks


def crossing_times(
    tracks: Tracks, beyond: Bool[np.ndarray, "row"], rows: Int[np.ndarray, "case"]
) -> Float[np.ndarray, "case"]:
    """Returns the time [s] from each row to the crossing of the lane line: from there on the vehicle stays beyond it.

    The crossing may lie before the row: then the time is zero or less. NaN where none was seen.

    Args:
        tracks: see `Tracks`.
        beyond: whether the vehicle is beyond the line in each row of the tracks.
        rows: the vehicle and the moment t = 0 of each case.
    """
    starts, _ = tracks.runs()
    first = starts[np.searchsorted(starts, rows, side="right") - 1]
    last = rows + frames_left(tracks)[rows]
    short = np.flatnonzero(~beyond)
    before = np.searchsorted(short, last, side="right") - 1
    last_short = np.where(before >= 0, short[np.maximum(before, 0)], -1) if len(short) else np.full_like(rows, -1)
    crossing = np.maximum(last_short + 1, first)
    return np.where(crossing <= last, (crossing - rows) * tracks.time_step, np.nan)


def gap_entered(
    tracks: Tracks,
    rows: Int[np.ndarray, "case"],
    change_time: Float[np.ndarray, "case"],
    *,
    places: Int[np.ndarray, "case place"],
    there: Bool[np.ndarray, "case place"],
) -> Float[np.ndarray, "case"]:
    """Returns the index of the gap that each vehicle merged into, by the vehicles that it passed or that passed it.

    It is the number of vehicles of the target lane that were ahead at t = 0 and are behind at the lane change, less
    those that were behind and are ahead. A vehicle that is no longer seen then is where it was seen last. NaN where no
    lane change was seen after t = 0.

    Args:
        tracks: see `Tracks`.
        rows: the vehicle and the moment t = 0 of each case.
        change_time: from t = 0 to the lane change [s].
        places: row at t = 0 of each vehicle of the target lane, in the order of `MergeScenes.target`.
        there: whether there is one.
    """
    merges = np.nan_to_num(change_time) > 0.0
    frames = np.where(merges, np.rint(np.nan_to_num(change_time) / tracks.time_step), 0.0).astype(np.int64)
    steps = np.minimum(frames[:, None], frames_left(tracks)[places])
    ahead = np.arange(places.shape[1]) >= BEHIND
    ahead_then = tracks.x[places + steps] >= tracks.x[rows[:, None] + steps]
    passed = (there & ahead & ~ahead_then).sum(axis=1) - (there & ~ahead & ahead_then).sum(axis=1)
    return np.where(merges, passed, np.nan)
