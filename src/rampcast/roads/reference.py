"""Positions along a road: from the source's plane to x along the reference line and y to its left, and back.

The reference line is where y = 0. Its direction is interpolated between its points, so that x and y of a smooth path
are smooth even where the line has corners; before its first and beyond its last point it goes on straight.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from rampcast.errors import SiteError
from rampcast.threads import in_threads

LONGEST = 200_000.0  # [m] no recorded road is as long; a vehicle whose positions jump makes a longer one
SPACING = 2.0  # [m] between the points that the line is resampled to; a road of 50 m radius leaves its chord by 1 cm
REFINEMENTS = 8  # at most; each squares the error of the foot of the perpendicular, so that three do on a road
CLOSE = 1e-4  # [m] a foot that moves by less is found: the next step would be about its square
STEEPEST = 0.2  # least of 1 - y / radius by which a step is divided: near the centre of a bend there is no foot
BLOCK = 1 << 14  # rows done at once: their dozen of arrays fit the cache of a core
CELL = 4.0  # [m] of the grid in which the first guess is looked up
MOST_CELLS = 4_000_000  # of that grid, 32 MB; longer roads get larger cells
BESIDE = 200.0  # [m] around the line that the grid covers; what lies farther off is searched by itself

Row = Float[np.ndarray, "row"]


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


def reference_line(points: Float[np.ndarray, "point 2"]) -> ReferenceLine:
    """Returns the line through the points [m], in the order of travel.

    Raises:
        SiteError: there are fewer than two different points.
    """
    points = points[np.r_[True, np.any(np.diff(points, axis=0) != 0, axis=1)]]
    if len(points) < 2:
        raise SiteError("a reference line needs two different points or more")
    lengths = np.hypot(*np.diff(points, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    if along[-1] > LONGEST and len(points) > 2:
        raise SiteError(
            f"the reference line is {along[-1] / 1000:,.0f} km long, expected {LONGEST / 1000:g} km at most"
        )
    pieces = 1 if len(points) == 2 else max(round(along[-1] / SPACING), 1)
    places = np.linspace(0.0, along[-1], pieces + 1)
    resampled = np.stack([np.interp(places, along, points[:, axis]) for axis in (0, 1)], axis=1)
    steps = np.diff(resampled, axis=0)
    directions = np.concatenate([steps[:1], steps[:-1] + steps[1:], steps[-1:]])
    directions /= np.hypot(*directions.T)[:, None]
    return ReferenceLine(resampled, directions, float(along[-1] / pieces))


def along_road(line: ReferenceLine, px: Row, py: Row) -> tuple[Row, Row]:
    """Returns x along the line and y to its left [m] of points in the plane [m]."""
    if len(line.points) == 2:
        return _along_straight(line, px, py)
    guess = _first_guess(line, px, py)
    pieces = _pieces(line)
    return _in_blocks(lambda part: _foot(line, pieces, px[part], py[part], guess(part)), len(px))


def in_plane(line: ReferenceLine, x: Row, y: Row) -> tuple[Row, Row]:
    """Returns the points in the plane [m] that lie at x along the line and y to its left [m]."""
    pieces = _pieces(line)

    def placed(part: slice) -> tuple[Row, Row]:
        at = _at(line, pieces, x[part])
        beside = y[part] / at.norm
        return at.px - beside * at.uy, at.py + beside * at.ux

    return _in_blocks(placed, len(x))


def _along_straight(line: ReferenceLine, px: Row, py: Row) -> tuple[Row, Row]:
    (x0, y0), (ux, uy) = line.points[0], line.directions[0]

    def placed(part: slice) -> tuple[Row, Row]:
        ahead, left = px[part] - x0, py[part] - y0
        return ahead * ux + left * uy, left * ux - ahead * uy

    return _in_blocks(placed, len(px))


@dataclass(frozen=True)
class _Place:
    """Places on the line [m], the direction there (not of length 1 to the last digit), and the curvature [1/m]."""

    px: Row
    py: Row
    ux: Row
    uy: Row
    curvature: Row

    @property
    def norm(self) -> Row:
        """Returns the length of the direction."""
        return np.sqrt(self.ux * self.ux + self.uy * self.uy)


def _pieces(line: ReferenceLine) -> Float[np.ndarray, "9 piece"]:
    """Returns of each piece of the line: the start of x, y and direction, what they grow by, and the curvature."""
    values = np.concatenate([line.points, line.directions], axis=1)
    start, growth = values[:-1].T, np.diff(values, axis=0).T
    turn = start[2] * growth[3] - start[3] * growth[2]
    return np.ascontiguousarray(np.concatenate([start, growth, [turn / line.spacing]]))


def _at(line: ReferenceLine, pieces: Float[np.ndarray, "9 piece"], s: Row) -> _Place:
    """Returns the line at s [m]; straight on where s is beyond its ends."""
    inside = np.clip(s, 0.0, line.length)
    scaled = inside * (1.0 / line.spacing)
    index = np.minimum(scaled.astype(np.intp), pieces.shape[1] - 1)
    share = scaled - index
    px, py, ux, uy = (pieces[i].take(index) + share * pieces[i + 4].take(index) for i in range(4))
    curvature = pieces[8].take(index)
    beyond = s - inside
    if beyond.any():
        px, py, curvature = px + beyond * ux, py + beyond * uy, np.where(beyond == 0.0, curvature, 0.0)
    return _Place(px, py, ux, uy, curvature)


def _foot(line: ReferenceLine, pieces: Float[np.ndarray, "9 piece"], px: Row, py: Row, s: Row) -> tuple[Row, Row]:
    """Returns where the perpendicular from a point meets the line, and how far to its left the point is [m].

    Newton's method: a step along the line by ds moves the foot's error by (1 - y / radius) ds.
    """
    for _ in range(REFINEMENTS):
        at = _at(line, pieces, s)
        off_x, off_y = px - at.px, py - at.py
        left = at.ux * off_y - at.uy * off_x
        step = (at.ux * off_x + at.uy * off_y) / np.maximum(1.0 - at.curvature * left, STEEPEST)
        s = s + step
        if np.abs(step).max() < CLOSE:
            break
    return s, left / at.norm


def _first_guess(line: ReferenceLine, px: Row, py: Row) -> Callable[[slice], Row]:
    """Returns a function of rows that tells about where along the line [m] their feet are.

    It looks up the point of the line that is nearest to the middle of the cell of a grid.
    """
    low, high = line.points.min(axis=0) - BESIDE, line.points.max(axis=0) + BESIDE
    cell = max(CELL, float(np.sqrt(np.prod(high - low) / MOST_CELLS)))
    shape = np.ceil((high - low) / cell).astype(int)
    tree = cKDTree(line.points)

    def cells(part: slice) -> Int[np.ndarray, "row"]:
        column, row = (px[part] - low[0]) / cell, (py[part] - low[1]) / cell
        inside = (column >= 0) & (column < shape[0]) & (row >= 0) & (row < shape[1])
        return np.where(inside, column.astype(np.int32) * shape[1] + row.astype(np.int32), -1)

    is_met = np.zeros(shape.prod(), bool)
    for part in _parts(len(px)):
        found = cells(part)
        is_met[found[found >= 0]] = True
    met = np.flatnonzero(is_met)
    middle = low + (np.stack(np.divmod(met, shape[1]), axis=1) + 0.5) * cell
    nearest = np.zeros(shape.prod())
    nearest[met] = tree.query(middle)[1] * line.spacing

    def guess(part: slice) -> Row:
        found = cells(part)
        s = nearest[found]
        far = found < 0
        if far.any():
            s[far] = tree.query(np.stack([px[part][far], py[part][far]], axis=1))[1] * line.spacing
        return s

    return guess


def _parts(size: int) -> list[slice]:
    return [slice(start, min(start + BLOCK, size)) for start in range(0, size, BLOCK)]


def _in_blocks(do: Callable[[slice], tuple[Row, Row]], size: int) -> tuple[Row, Row]:
    """Returns both results of a function of rows, which is called for blocks of them on all cores."""
    first, second = np.empty(size), np.empty(size)

    def fill(part: slice) -> None:
        first[part], second[part] = do(part)

    in_threads(fill, _parts(size))
    return first, second
