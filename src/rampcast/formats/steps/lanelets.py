"""Lanelets: stretches of a lane between a left and a right bound, and which of them a point lies in."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

NOWHERE = -1  # in place of the index of a lanelet


@dataclass(frozen=True)
class Lanelet:
    """A lanelet: its name in the source, and the points of its outline [m], once around."""

    name: str
    outline: Float[np.ndarray, "point 2"]


def lanelet_at(
    lanelets: Sequence[Lanelet], px: Float[np.ndarray, "row"], py: Float[np.ndarray, "row"]
) -> Int[np.ndarray, "row"]:
    """Returns the index of the first lanelet that each point [m] lies in; -1 where it lies in none."""
    found = np.full(len(px), NOWHERE)
    for index, lanelet in enumerate(lanelets):
        low, high = lanelet.outline.min(axis=0), lanelet.outline.max(axis=0)
        is_near = (px >= low[0]) & (px <= high[0]) & (py >= low[1]) & (py <= high[1])
        near = np.flatnonzero(is_near & (found == NOWHERE))
        found[near[_is_inside(lanelet.outline, px[near], py[near])]] = index
    return found


def _is_inside(
    outline: Float[np.ndarray, "point 2"], px: Float[np.ndarray, "row"], py: Float[np.ndarray, "row"]
) -> Bool[np.ndarray, "row"]:
    """Returns whether a ray from the point to the right crosses the outline an odd number of times."""
    inside = np.zeros(len(px), bool)
    for (x0, y0), (x1, y1) in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        if y0 != y1:
            crosses = (y0 > py) != (y1 > py)
            inside ^= crosses & (px < x0 + (x1 - x0) * (py - y0) / (y1 - y0))
    return inside
