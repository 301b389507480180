"""Cases of the benchmark: scenes at t = 0, and what became of them."""

from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from rampcast.horizon import FUTURE, SAME_STEP, STEP
from rampcast.recording.smoothing import HALF_WINDOW, SHORTEST_TRACK, smooth_tracks
from rampcast.traffic.merge_scenes import MergeScenes, without_target
from rampcast.traffic.platoons import Platoons, Tracks, platoons_of_tracks

BEFORE = 4.0  # [s] of history before the first anchor
SPACING = 2.5  # [s] between anchors
WHOLE_TRUTH = 15.0  # [s]
LEAST_TRUTH = 1.0  # [s] where tracks are short: the first horizon that is scored
TIME = np.arange(1, FUTURE + 1) * STEP  # [s] of the truth


@dataclass(frozen=True)
class Cases:
    """Cases of one data set.

    Attributes:
        data_set: its name.
        case: name of each case.
        group: its vehicle, or the smallest part of the data that must not be on both sides of a split.
        t0: time of t = 0 [s] in the clock of the data set; NaN where it has none.
        scenes: what may be known at t = 0.
        since_entry: time from the vehicle's entry into the lane that it merges from to t = 0 [s]; NaN where there is no
            merge. It may be known at t = 0 too.
        truth: displacement of the central vehicle from its place at t = 0, at 0.2, 0.4 ... 15 s [m]; NaN where not
            seen, and everywhere in a case that asks for the merge alone.
        leader_truth: front of the leader that it has at t = 0, counted from the same place [m]; NaN where not seen.
        seen_for: time from t = 0 to the vehicle's last row [s].
        change_time: time from t = 0 to the lane change [s], zero or less where it lies before; NaN where none was seen.
        gap: index of the gap merged into: 0 between the nearest vehicles ahead and behind of t = 0, 1 in front of the
            nearest ahead, -1 behind the nearest behind, and so on; NaN where no merge was seen.
        place: displacement at the lane change [m]; NaN where none was seen.
    """

    data_set: str
    case: Shaped[np.ndarray, "case"]
    group: Shaped[np.ndarray, "case"]
    t0: Float[np.ndarray, "case"]
    scenes: MergeScenes
    since_entry: Float[np.ndarray, "case"]
    truth: Float[np.ndarray, "case step"]
    leader_truth: Float[np.ndarray, "case step"]
    seen_for: Float[np.ndarray, "case"]
    change_time: Float[np.ndarray, "case"]
    gap: Float[np.ndarray, "case"]
    place: Float[np.ndarray, "case"]

    def __len__(self) -> int:
        return len(self.case)

    @property
    def platoons(self) -> Platoons:
        """Returns the central vehicles and the vehicles ahead of them in their lanes."""
        return self.scenes.own

    @property
    def longitudinal(self) -> Bool[np.ndarray, "case"]:
        """Returns which cases ask where the vehicle will be."""
        return np.isfinite(self.truth).any(axis=1)

    @property
    def merging(self) -> Bool[np.ndarray, "case"]:
        """Returns which cases ask when the vehicle will merge: it has a lane to merge into, and is not there yet."""
        return self.scenes.may_merge & ~(self.change_time <= 0.0)

    def select(self, rows: Shaped[np.ndarray, "row"]) -> "Cases":
        """Returns the cases at those rows (a mask or positions)."""
        arrays = {name: getattr(self, name)[rows] for name in _ARRAYS}
        return replace(self, scenes=self.scenes.select(rows), **arrays)

    def until(self, border: float) -> "Cases":
        """Returns the cases as if nothing had been seen after a time [s], without those that ask for nothing then."""
        left = border - self.t0
        unseen = TIME > left[:, None] + SAME_STEP
        late = self.change_time > left
        known = replace(
            self,
            truth=np.where(unseen, np.nan, self.truth),
            leader_truth=np.where(unseen, np.nan, self.leader_truth),
            seen_for=np.minimum(self.seen_for, left),
            change_time=np.where(late, np.nan, self.change_time),
            gap=np.where(late, np.nan, self.gap),
            place=np.where(late, np.nan, self.place),
        )
        return known.select(left > LEAST_TRUTH - SAME_STEP)


_ARRAYS = tuple(field.name for field in fields(Cases) if field.name not in ("data_set", "scenes"))


@dataclass(frozen=True)
class Merges:
    """What a data set knows of lane changes, a row for each case; see `Cases`."""

    scenes: MergeScenes
    since_entry: Float[np.ndarray, "case"]
    change_time: Float[np.ndarray, "case"]
    gap: Float[np.ndarray, "case"]


def regular_anchors(
    tracks: Tracks, *, spacing: float = SPACING, least_truth: float = WHOLE_TRUTH
) -> Int[np.ndarray, "case"]:
    """Returns rows of the tracks: in each vehicle's longest gapless run that at 4.0 s after its beginning and then
    every so many seconds (at 10 Hz index 40, 65, 90 ...) as long as so much truth [s] remains.
    """
    first, every, truth = (int(duration / tracks.time_step + 1e-9) for duration in (BEFORE, spacing, least_truth))
    starts, lengths = tracks.runs()
    order = np.lexsort((starts, -lengths, tracks.vehicle[starts]))
    _, longest = np.unique(tracks.vehicle[starts][order], return_index=True)
    chosen = order[longest]
    anchors = [
        np.arange(start + first, start + length - truth, every)
        for start, length in zip(starts[chosen], lengths[chosen], strict=True)
    ]
    return np.concatenate(anchors).astype(np.int64)


def led(tracks: Tracks, rows: Int[np.ndarray, "row"]) -> Int[np.ndarray, "case"]:
    """Returns those of the rows whose vehicle has a leader."""
    return rows[tracks.led[rows]]


def make_cases(
    data_set: str,
    tracks: Tracks,
    rows: Int[np.ndarray, "case"],
    *,
    case: Shaped[np.ndarray, "case"],
    group: Shaped[np.ndarray, "case"],
    t0: Float[np.ndarray, "case"],
    merges: Merges | None = None,
) -> Cases:
    """Returns the cases at those rows of the tracks.

    States are made from the past alone. The truth is smoothed over whole gapless runs, as a recording is. Where less
    than `LEAST_TRUTH` was seen, only the merge is asked for.
    """
    smoothed = smoothed_runs(tracks)
    left = frames_left(tracks)[rows]
    asked = (left >= round(LEAST_TRUTH / tracks.time_step))[:, None]
    ahead = np.where(tracks.led[rows][:, None], _future(tracks, smoothed, tracks.leader[rows]), np.nan)
    merges = merges or _no_merges(platoons_of_tracks(tracks, rows))
    seen = np.isfinite(merges.change_time)
    change = rows + np.where(seen, np.rint(merges.change_time / tracks.time_step), 0.0).astype(np.int64)
    return Cases(
        data_set=data_set,
        case=case,
        group=group,
        t0=t0,
        scenes=merges.scenes,
        since_entry=merges.since_entry,
        truth=np.where(asked, _future(tracks, smoothed, rows) - smoothed[rows][:, None], np.nan),
        leader_truth=np.where(asked, ahead - smoothed[rows][:, None], np.nan),
        seen_for=left * tracks.time_step,
        change_time=merges.change_time,
        gap=merges.gap,
        place=np.where(seen, smoothed[change] - smoothed[rows], np.nan),
    )


def frames_left(tracks: Tracks) -> Int[np.ndarray, "row"]:
    """Returns how many frames of the same gapless run come after each row."""
    starts, lengths = tracks.runs()
    return np.repeat(starts + lengths, lengths) - 1 - np.arange(len(tracks.frame))


def names(*parts: Shaped[np.ndarray, "case"]) -> Shaped[np.ndarray, "case"]:
    """Returns the parts of each name, joined by hyphens."""
    return np.array(["-".join(map(str, row)) for row in zip(*parts, strict=True)], dtype=np.str_)


def _no_merges(platoons: Platoons) -> Merges:
    unknown = np.full(len(platoons), np.nan)
    return Merges(without_target(platoons), since_entry=unknown, change_time=unknown, gap=unknown)


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
