"""Which tracks belong to one road: those that drive the same way where they pass the same place."""

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from rampcast.roads.draft_points import HARDLY, Sample, track_mean

ANGLE = np.radians(60.0)  # to the road's direction; ramps join at less, opposite carriageways differ by 180 degrees
STRETCHES = 16  # of each track whose direction is compared
LONG = 0.5  # [m] a shorter stretch tells no direction: so large may the noise of a position be
SEEDS = 12  # roads that are looked for; no recorded section has as many
SMALL = 0.01  # of all that is driven: less is no road but vehicles that turned, or were lost and found again
NONE = -1


def group_tracks(sample: Sample) -> Int[np.ndarray, "track"]:
    """Returns the number of the road of each track, -1 for those that hardly move or drive like few others.

    The longest track leads; all that drive within 60 degrees of it where they pass it are on its road, and the rest is
    searched again. So a bend does not part a road, and a ramp belongs to the road that it joins.
    """
    track, middle, along = _stretches(sample)
    extent = sample.extent
    free = extent >= min(HARDLY, max(float(extent.max(initial=0.0)) / 2, LONG))  # in a short clip all come not far
    road = np.full(sample.size, NONE)
    for number in range(SEEDS):
        if not free.any():
            break
        seed = int(np.where(free, extent, 0.0).argmax())
        mine = track == seed
        if mine.any():
            _, nearest = cKDTree(middle[mine]).query(middle)
            agreement = track_mean(np.sum(along * along[mine][nearest], axis=1), track, sample.size)
            same = free & (np.nan_to_num(agreement, nan=-1.0) >= np.cos(ANGLE))
        else:
            same = np.zeros(sample.size, bool)
        same[seed] = True
        if number == 0 or extent[same].sum() >= SMALL * extent.sum():
            road[same] = number
        free &= ~same
    _, road[road != NONE] = np.unique(road[road != NONE], return_inverse=True)
    return road


def _stretches(
    sample: Sample,
) -> tuple[Int[np.ndarray, "stretch"], Float[np.ndarray, "stretch 2"], Float[np.ndarray, "stretch 2"]]:
    """Returns the track, the middle [m] and the direction of stretches of the tracks, at most so many of each."""
    points = np.stack([sample.px, sample.py], axis=1)
    index = _spread(sample.track, STRETCHES + 1)
    same = sample.track[index[1:]] == sample.track[index[:-1]]
    step = points[index[1:]] - points[index[:-1]]
    length = np.hypot(*step.T)
    kept = same & (length >= LONG)
    middle = (points[index[1:]] + points[index[:-1]])[kept] / 2
    return sample.track[index[1:]][kept], middle, step[kept] / length[kept, None]


def _spread(track: Int[np.ndarray, "point"], most: int) -> Int[np.ndarray, "kept"]:
    """Returns the indices of at most so many points of each track, spread evenly over it, first and last included."""
    starts = np.flatnonzero(np.r_[True, np.diff(track) > 0])
    counts = np.diff(np.r_[starts, len(track)])
    share = np.linspace(0.0, 1.0, most)
    return np.unique(starts[:, None] + (share * (counts - 1)[:, None]).round().astype(np.int64))


def nearest_road(
    distances: Float[np.ndarray, "road point"], track: Int[np.ndarray, "point"], size: int
) -> Int[np.ndarray, "track"]:
    """Returns the road that each track is nearest to on average, from its points' distances to each road [m]."""
    means = np.stack([track_mean(of_road, track, size) for of_road in distances])
    return np.where(np.isnan(means), np.inf, means).argmin(axis=0)
