"""Positions along a road: from the source's plane to x along the reference line and y to its left, and back.

The reference line is where y = 0. Its direction is interpolated between its points, so that x and y of a smooth path
are smooth even where the line has corners; before its first and beyond its last point it goes on straight.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from rampcast.errors import SiteError

SPACING = 2.0  # [m] between the points that the line is resampled to; a road of 50 m radius leaves its chord by 1 cm
REFINEMENTS = 4  # each brings the foot of the perpendicular closer by the factor y / radius

Points = Float[np.ndarray, "point 2"]


@dataclass(frozen=True)
class ReferenceLine:
    """A line resampled at equal spacing: its points, the unit vectors along it, and the spacing [m]."""

    points: Float[np.ndarray, "point 2"]
    directions: Float[np.ndarray, "point 2"]
    spacing: float

    @property
    def length(self) -> float:
        """Returns the length of the line [m]."""
        return self.spacing * (len(self.points) - 1)


def reference_line(points: Points) -> ReferenceLine:
    """Returns the line through the points [m], in the order of travel.

    Raises:
        SiteError: there are fewer than two different points.
    """
    points = points[np.r_[True, np.any(np.diff(points, axis=0) != 0, axis=1)]]
    if len(points) < 2:
        raise SiteError("a reference line needs two different points or more")
    lengths = np.hypot(*np.diff(points, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    pieces = 1 if len(points) == 2 else max(round(along[-1] / SPACING), 1)
    places = np.linspace(0.0, along[-1], pieces + 1)
    resampled = np.stack([np.interp(places, along, points[:, axis]) for axis in (0, 1)], axis=1)
    steps = np.diff(resampled, axis=0)
    directions = np.concatenate([steps[:1], steps[:-1] + steps[1:], steps[-1:]])
    directions /= np.hypot(*directions.T)[:, None]
    return ReferenceLine(resampled, directions, float(along[-1] / pieces))


def along_road(
    line: ReferenceLine, px: Float[np.ndarray, "row"], py: Float[np.ndarray, "row"]
) -> tuple[Float[np.ndarray, "row"], Float[np.ndarray, "row"]]:
    """Returns x along the line and y to its left [m] of points in the plane [m]."""
    points = np.stack([px, py], axis=1)
    s = _nearest(line, points)
    for _ in range(REFINEMENTS if len(line.points) > 2 else 1):
        place, direction = _at(line, s)
        s = s + np.sum((points - place) * direction, axis=1)
    place, direction = _at(line, s)
    off = points - place
    return s, direction[:, 0] * off[:, 1] - direction[:, 1] * off[:, 0]


def in_plane(
    line: ReferenceLine, x: Float[np.ndarray, "row"], y: Float[np.ndarray, "row"]
) -> tuple[Float[np.ndarray, "row"], Float[np.ndarray, "row"]]:
    """Returns the points in the plane [m] that lie at x along the line and y to its left [m]."""
    place, direction = _at(line, x)
    return place[:, 0] - y * direction[:, 1], place[:, 1] + y * direction[:, 0]


def _nearest(line: ReferenceLine, points: Points) -> Float[np.ndarray, "row"]:
    """Returns where along the line [m] the nearest of its points lies."""
    if len(line.points) == 2:
        return np.zeros(len(points))
    return np.asarray(cKDTree(line.points).query(points, workers=-1)[1] * line.spacing, float)


def _at(line: ReferenceLine, s: Float[np.ndarray, "row"]) -> tuple[Points, Points]:
    """Returns place and direction of the line at s [m]; straight on where s is beyond its ends."""
    inside = np.clip(s, 0.0, line.length)
    index = np.minimum((inside / line.spacing).astype(np.int64), len(line.points) - 2)
    share = (inside / line.spacing - index)[:, None]
    direction = (1 - share) * line.directions[index] + share * line.directions[index + 1]
    direction /= np.hypot(*direction.T)[:, None]
    place = (1 - share) * line.points[index] + share * line.points[index + 1]
    return place + (s - inside)[:, None] * direction, direction
