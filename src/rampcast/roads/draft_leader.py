"""Which track leads when a road's reference line is drafted: the longest, unless that one comes from a ramp.

A ramp may be seen for longer than the road that it joins, may turn in a loop, and may cross the road on a bridge. What
tells it from the road is that its vehicles merge, where those of the road go straight on beside them.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from rampcast.sites.site import LANE_WIDTH

Points = Float[np.ndarray, "point 2"]

CANDIDATES = 60  # tracks that are compared
SHORTEST = 0.3  # of the longest track's extent: shorter ones lead nobody
LAG = 20.0  # [m] between headings that are compared: over it the noise of positions turns a path by a milliradian
BESIDE = 5 * LANE_WIDTH  # [m] from each other up to which two tracks may be on one carriageway
SAME_WAY = np.cos(np.radians(20.0))  # to which both must drive: a ramp that nears the road at more is not beside it
ELSEWHERE = 0.1  # of a track that is not beside another, from which on it tells of another way
PARTS = LANE_WIDTH / 2  # [m] by which the distance of two tracks changes where one of them changes lane
SMOOTHER = 0.7  # times as rough as another: no chance of noise


@dataclass(frozen=True)
class Way:
    """A smoothed path: its points at equal steps [m] and its heading at each [rad]."""

    points: Points
    step: float

    @property
    def heading(self) -> Float[np.ndarray, "point"]:
        """Returns the direction at each point [rad]."""
        dx, dy = np.gradient(self.points, axis=0).T if len(self.points) > 1 else np.zeros((2, len(self.points)))
        return np.unwrap(np.arctan2(dy, dx))

    def roughness(self, part: slice = slice(None)) -> float:
        """Returns how much the curvature varies on average [rad]: the change of what the heading changes over 20 m."""
        points, lag = self.points[part], max(round(LAG / self.step), 1)
        if len(points) <= 3 * lag:
            lag = max((len(points) - 1) // 3, 1)
        chords = points[lag:] - points[:-lag]
        heading = np.unwrap(np.arctan2(chords[:, 1], chords[:, 0]))
        bends = heading[lag:] - heading[:-lag]
        return float(np.abs(bends[lag:] - bends[:-lag]).mean()) if len(bends) > lag else 0.0


def leader_of(ways: list[Way]) -> int:
    """Returns the index of the way that leads; the ways are in order of falling length."""
    leader = 0
    for index in range(1, len(ways)):
        if _is_rather_the_road(ways[index], ways[leader]):
            leader = index
    return leader


def spread_candidates(extent: Float[np.ndarray, "track"]) -> Int[np.ndarray, "some"]:
    """Returns tracks that may lead, the longest first: of many some of each length."""
    order = np.argsort(-extent, kind="stable")
    order = order[extent[order] >= SHORTEST * extent[order[0]]]
    return order[np.unique(np.linspace(0, len(order) - 1, min(len(order), CANDIDATES)).round().astype(int))]


def _is_rather_the_road(way: Way, leader: Way) -> bool:
    """Returns whether a shorter way is that of the road, and the leader's that of a ramp which joins or leaves it."""
    distance, nearest = cKDTree(leader.points).query(way.points)
    direction = np.cos(way.heading - leader.heading[nearest])
    beside = (distance <= BESIDE) & (direction >= SAME_WAY)
    if beside.mean() <= 1.0 - ELSEWHERE and way.roughness() < SMOOTHER * leader.roughness():
        return True
    if not beside.any() or not _parts(way, leader, nearest, beside):
        return False
    mine, its = np.flatnonzero(beside), nearest[beside]
    there = slice(int(its.min()), int(its.max()) + 1)
    return way.roughness(slice(int(mine[0]), int(mine[-1]) + 1)) < SMOOTHER * leader.roughness(there)


def _parts(way: Way, leader: Way, nearest: Int[np.ndarray, "point"], beside: Bool[np.ndarray, "point"]) -> bool:
    """Returns whether two ways come nearer to each other, or part, where they are beside each other."""
    off, heading = way.points - leader.points[nearest], leader.heading[nearest]
    lateral = (np.cos(heading) * off[:, 1] - np.sin(heading) * off[:, 0])[beside]
    low, high = np.quantile(lateral, (0.05, 0.95))
    return bool(high - low >= PARTS)
