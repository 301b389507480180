"""Cases of the benchmark: platoons at t = 0, and what became of them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from rampcast.recording.smoothing import HALF_WINDOW, SHORTEST_TRACK, smooth_tracks
from rampcast.scenes.platoons import Platoons, Tracks, platoons_of_tracks
from rampcast.scenes.scenes import FUTURE

BEFORE = 4.0  # [s] of history before the first anchor
SPACING = 2.5  # [s] between anchors
WHOLE_TRUTH = 15.0  # [s]


@dataclass(frozen=True)
class Cases:
    """Cases of one data set.

    Attributes:
        data_set: its name.
        case: name of each case.
        group: its vehicle, or the smallest part of the data that must not be on both sides of a split.
        t0: time of t = 0 [s] in the clock of the data set; NaN where it has none.
        platoons: what may be known at t = 0.
        truth: displacement of the central vehicle from its place at t = 0, at 0.2, 0.4 ... 15 s [m]; NaN where not
            seen.
        leader_truth: front of the leader that it has at t = 0, counted from the same place [m]; NaN where not seen.
    """

    data_set: str
    case: Shaped[np.ndarray, "case"]
    group: Shaped[np.ndarray, "case"]
    t0: Float[np.ndarray, "case"]
    platoons: Platoons
    truth: Float[np.ndarray, "case step"]
    leader_truth: Float[np.ndarray, "case step"]

    def __len__(self) -> int:
        return len(self.case)

    def select(self, rows: Shaped[np.ndarray, "row"]) -> "Cases":
        """Returns the cases at those rows (a mask or positions)."""
        return Cases(
            data_set=self.data_set,
            case=self.case[rows],
            group=self.group[rows],
            t0=self.t0[rows],
            platoons=self.platoons.select(rows),
            truth=self.truth[rows],
            leader_truth=self.leader_truth[rows],
        )


def regular_anchors(tracks: Tracks, *, least_truth: float = WHOLE_TRUTH) -> Int[np.ndarray, "case"]:
    """Returns rows of the tracks: in each vehicle's longest gapless run that at 4.0 s after its beginning and then
    every 2.5 s (at 10 Hz index 40, 65, 90 ...) as long as so much truth [s] remains.
    """
    first, spacing, truth = (int(duration / tracks.time_step + 1e-9) for duration in (BEFORE, SPACING, least_truth))
    starts, lengths = tracks.runs()
    order = np.lexsort((starts, -lengths, tracks.vehicle[starts]))
    _, longest = np.unique(tracks.vehicle[starts][order], return_index=True)
    chosen = order[longest]
    anchors = [
        np.arange(start + first, start + length - truth, spacing)
        for start, length in zip(starts[chosen], lengths[chosen], strict=True)
    ]
    return np.concatenate(anchors).astype(np.int64)


def make_cases(
    data_set: str,
    tracks: Tracks,
    rows: Int[np.ndarray, "case"],
    *,
    case: Shaped[np.ndarray, "case"],
    group: Shaped[np.ndarray, "case"],
    t0: Float[np.ndarray, "case"],
) -> Cases:
    """Returns the cases at those rows of the tracks, without those whose vehicle has no speed yet.

    The past is smoothed without the future. The truth is smoothed over whole gapless runs, as a recording is.
    """
    smoothed = smoothed_runs(tracks)
    leader = tracks.leader[rows]
    ahead = np.where(tracks.led[rows][:, None], _future(tracks, smoothed, leader), np.nan)
    cases = Cases(
        data_set=data_set,
        case=case,
        group=group,
        t0=t0,
        platoons=platoons_of_tracks(tracks, rows),
        truth=_future(tracks, smoothed, rows) - smoothed[rows][:, None],
        leader_truth=ahead - smoothed[rows][:, None],
    )
    return cases.select(cases.platoons.present[:, 0])


def smoothed_runs(tracks: Tracks) -> Float[np.ndarray, "row"]:
    """Returns x [m] smoothed over each gapless run; as it is in runs that are too short."""
    _, lengths = tracks.runs()
    long = lengths >= SHORTEST_TRACK
    rows: Bool[np.ndarray, "row"] = np.repeat(long, lengths)
    smoothed = tracks.x.copy()
    if long.any():
        kept = np.concatenate([[0], np.cumsum(lengths[long])[:-1]])
        smoothed[rows] = smooth_tracks(tracks.x[rows], kept, window=2 * round(HALF_WINDOW / tracks.time_step) + 1)
    return smoothed


def _future(
    tracks: Tracks, x: Float[np.ndarray, "row"], rows: Int[np.ndarray, "case"]
) -> Float[np.ndarray, "case step"]:
    """Returns x [m] of the vehicle of each row at 0.2 s steps after it; NaN where it was not seen."""
    ahead = np.arange(1, FUTURE + 1) * tracks.every
    vehicle = np.broadcast_to(tracks.vehicle[rows][:, None], (len(rows), FUTURE))
    found, seen = tracks.find(vehicle, tracks.frame[rows][:, None] + ahead)
    return np.where(seen, x[found], np.nan)
