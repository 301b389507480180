"""Courses of vehicles across a road: who drives over or under it, and where a projection onto its line is senseless."""

from collections.abc import Sequence

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int

from rampcast.recording.order import in_order, is_sorted, track_starts
from rampcast.sites.site import LANE_WIDTH

AROUND = 0.5  # [s] before and after a moment between which its course is taken: a lane change takes 3 s and more
MOVED = 2.0  # [m] in that time at which a course is known: noise of a decimetre turns it by several degrees only
STEEPEST = 0.5  # of the way that must lead along the road: a ramp joins at less than 60 degrees
ASLANT = 0.14  # of the way, from beside the road over all its lanes: who weaves through goes at less than 8 degrees
STRETCHED = 2.0  # times the way that may lead along it: beyond, the foot of the perpendicular jumps
CROSSED = 1.5 * LANE_WIDTH  # [m] aside that no change of lane is, even one that a simulator makes in a step
BACKWARDS = 20.0  # [m] upstream between first and last row; a driver who reverses on a ramp goes less
ALWAYS_BACK = 5.0  # [m] likewise, of who never drives the other way
ASIDE, ALONG, BACK = 0, 1, -1
BLOCK = 1 << 15  # rows done at once: their arrays fit the cache of a core

Row = Float[np.ndarray, "row"]
Course = Int[np.ndarray, "row"]


def courses(
    rows: pl.DataFrame, place: tuple[Row, Row], x: Row, y: Row, *, time_step: float, edges: tuple[float, float]
) -> Course:
    """Returns of each row whether its vehicle drives along the road, back along it, or aside: across it, or beyond it.

    Args:
        rows: recording, vehicle and frame, in any order.
        place: positions in the plane [m].
        x: positions along the road [m].
        y: to the left of its line [m].
        time_step: time between two frames [s].
        edges: centres of the lanes furthest to the right and to the left [m].
    """
    if rows.is_empty():
        return np.zeros(0, np.int64)
    order = slice(None) if is_sorted(rows) else in_order(rows)
    starts = track_starts(rows, order)
    points = tuple(one[order] for one in (*place, x, y))
    course, is_aslant = _ways(points, starts, max(round(AROUND / time_step), 1))
    course = _only_crossings(course, points[3], starts)
    course[_passes(is_aslant, points[3], starts, edges)] = ASIDE
    back = np.empty_like(course)
    back[order] = course
    return back


def _ways(
    points: Sequence[Row], starts: Int[np.ndarray, "track"], around: int
) -> tuple[Course, Bool[np.ndarray, "row"]]:
    """Returns the course of each row, and whether it leads aslant over the road.

    Args:
        points: in the plane, along the road and to the left of its line [m], by vehicle and time.
        starts: the first row of each track.
        around: rows before and after a row between which its course is taken.
    """
    size = len(points[0])
    ends = np.r_[starts[1:], size] - 1
    dx, _, moved = _way(points, starts, ends)
    whole = np.where(moved < MOVED, ALONG, _course(dx, moved))  # who stands may stand in a queue
    track = np.repeat(np.arange(len(starts), dtype=np.int32), ends + 1 - starts)
    course, is_aslant = np.empty(size, whole.dtype), np.empty(size, bool)
    for start in range(0, size, BLOCK):
        part = slice(start, start + BLOCK)
        of = track[part]
        at = np.arange(start, start + len(of))
        dx, dy, moved = _way(points, np.maximum(at - around, starts[of]), np.minimum(at + around, ends[of]))
        is_known = moved >= MOVED
        course[part] = np.where(is_known, _course(dx, moved), whole[of])
        is_aslant[part] = is_known & (np.abs(dy) > ASLANT * moved)
    return course, is_aslant


def upstream(rows: pl.DataFrame, x: Row) -> Bool[np.ndarray, "row"]:
    """Returns whether a row's vehicle drives upstream: it is on the opposite carriageway, maybe right beside this.

    Args:
        rows: recording, vehicle and frame, in any order.
        x: positions along the road [m].
    """
    if rows.is_empty():
        return np.zeros(0, bool)
    order = in_order(rows)
    starts = track_starts(rows, order)
    ends, place = np.r_[starts[1:], len(order)], x[order]
    came = place[ends - 1] - place[starts]
    forward = np.maximum.reduceat(place, starts) - place[starts]
    is_against = (came < -BACKWARDS) | ((came < -ALWAYS_BACK) & (forward < MOVED / 2))
    found = np.empty(len(order), bool)
    found[order] = np.repeat(is_against, ends - starts)
    return found


def _way(
    points: Sequence[Row], behind: Int[np.ndarray, "some"], ahead: Int[np.ndarray, "some"]
) -> tuple[Float[np.ndarray, "some"], Float[np.ndarray, "some"], Float[np.ndarray, "some"]]:
    """Returns how far vehicles come along the road, to its left, and in the plane [m]."""
    px, py, x, y = (one[ahead] - one[behind] for one in points)
    return x, y, np.hypot(px, py)


def _course(dx: Row, moved: Row) -> Course:
    is_straight = (np.abs(dx) >= STEEPEST * moved) & (np.abs(dx) <= STRETCHED * moved)
    return np.where(is_straight, np.where(dx > 0, ALONG, BACK), ASIDE)


def _runs(values: Course | Bool[np.ndarray, "row"], starts: Int[np.ndarray, "track"]) -> Int[np.ndarray, "run"]:
    """Returns where runs of alike values of one vehicle begin."""
    begins = np.r_[True, values[1:] != values[:-1]]
    begins[starts] = True
    return np.flatnonzero(begins)


def _passes(
    is_aslant: Bool[np.ndarray, "row"], y: Row, starts: Int[np.ndarray, "track"], edges: tuple[float, float]
) -> Bool[np.ndarray, "row"]:
    """Returns whether a row is of a way aslant from beside the road to its other side, over or under it."""
    runs = _runs(is_aslant, starts)
    is_left = np.maximum.reduceat(y, runs) > edges[1] + CROSSED
    is_right = np.minimum.reduceat(y, runs) < edges[0] - CROSSED
    return np.repeat(is_aslant[runs] & is_left & is_right, np.diff(np.r_[runs, len(y)]))


def _only_crossings(course: Course, y: Row, starts: Int[np.ndarray, "track"]) -> Course:
    """Returns the courses but for short ones aside: a simulator changes lanes in a step, a tracker trembles."""
    runs = _runs(course, starts)
    aside = np.maximum.reduceat(y, runs) - np.minimum.reduceat(y, runs)
    keeps = (course[runs] != ASIDE) | (aside > CROSSED)
    return np.where(np.repeat(keeps, np.diff(np.r_[runs, len(course)])), course, ALONG)
