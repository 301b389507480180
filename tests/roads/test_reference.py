"""Positions along a road: there and back, beyond the ends, smooth beside a bend, the same wherever the plane lies."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from rampcast.errors import SiteError
from rampcast.roads.reference import BLOCK, along_road, in_plane, reference_line

RADIUS = 120.0  # [m] the tightest bend of the lines below

bends = st.lists(
    st.tuples(st.floats(20.0, 200.0), st.floats(-1 / RADIUS, 1 / RADIUS)), min_size=1, max_size=5
)  # pieces of a road: length [m] and curvature [1/m]


def road(pieces, step: float = 4.0) -> np.ndarray:
    """Returns points every 4 m of a road made of arcs."""
    places, heading, here = [np.zeros(2)], 0.0, np.zeros(2)
    for length, curvature in pieces:
        for _ in range(max(round(length / step), 1)):
            heading += curvature * step / 2
            here = here + step * np.array([np.cos(heading), np.sin(heading)])
            heading += curvature * step / 2
            places.append(here)
    return np.array(places)


def turned(points: np.ndarray, angle: float, shift: tuple[float, float]) -> np.ndarray:
    cos, sin = np.cos(angle), np.sin(angle)
    return points @ np.array([[cos, sin], [-sin, cos]]) + np.array(shift)


@given(pieces=bends, seed=st.integers(0, 1000))
@settings(max_examples=40, deadline=None)
def test_there_and_back_is_where_it_was_below_the_radius_of_the_bends(pieces, seed):
    line = reference_line(road(pieces))
    rng = np.random.default_rng(seed)
    x = rng.uniform(-50.0, line.length + 50.0, 200)
    y = rng.uniform(-15.0, 15.0, 200)
    px, py = in_plane(line, x, y)
    longer = np.arange(-100.0, line.length + 100.0, 2.0)  # the line goes on straight beyond its ends
    whole = cKDTree(np.stack(in_plane(line, longer, np.zeros(len(longer))), axis=1))
    distance = whole.query(np.stack([px, py], axis=1))[0]
    unique = distance > np.abs(y) - 0.1  # no other part of a road that comes back to itself is nearer
    again, beside = along_road(line, px[unique], py[unique])
    near = distance[unique] < 20.0
    np.testing.assert_allclose(again[near], x[unique][near], atol=1e-5)
    np.testing.assert_allclose(beside[near], y[unique][near], atol=1e-5)


@given(pieces=bends, angle=st.floats(0.0, 6.3), shift=st.tuples(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4)))
@settings(max_examples=30, deadline=None)
def test_turning_and_shifting_the_plane_changes_nothing(pieces, angle, shift):
    points = road(pieces)
    line = reference_line(points)
    rng = np.random.default_rng(1)
    px, py = in_plane(line, rng.uniform(0, line.length, 50), rng.uniform(-10, 10, 50))
    moved = turned(np.stack([px, py], axis=1), angle, shift)
    ours = along_road(line, px, py)
    theirs = along_road(reference_line(turned(points, angle, shift)), moved[:, 0].copy(), moved[:, 1].copy())
    np.testing.assert_allclose(theirs, ours, atol=1e-5)


@given(pieces=bends, y=st.floats(-20.0, 20.0))
@settings(max_examples=30, deadline=None)
def test_x_does_not_jump_along_a_smooth_path_beside_a_bend(pieces, y):
    """Places 0.5 m apart along the road, at one lateral position, are found 0.5 m apart."""
    line = reference_line(road(pieces))
    places = np.arange(0.0, line.length, 0.5)
    px, py = in_plane(line, places, np.full(len(places), y))
    if cKDTree(line.points).query(np.stack([px, py], axis=1))[0].min() < abs(y) - 0.1:
        return  # the road comes back to itself: another part of it is nearer
    x, beside = along_road(line, px, py)
    np.testing.assert_allclose(np.diff(x), 0.5, atol=1e-5)
    np.testing.assert_allclose(beside, y, atol=1e-5)


def test_y_grows_to_the_left_of_travel():
    east = reference_line(np.array([[0.0, 0.0], [10.0, 0.0]]))
    north = reference_line(np.array([[0.0, 0.0], [0.0, 10.0]]))
    assert along_road(east, np.array([3.0]), np.array([2.0])) == (3.0, 2.0)
    x, y = along_road(north, np.array([-2.0]), np.array([3.0]))
    assert (x[0], y[0]) == pytest.approx((3.0, 2.0))


def test_the_road_goes_on_straight_before_and_beyond_a_quarter_circle():
    """It begins at (0, 0) to the east and ends at (100, 100) to the north: 157.08 m of 100 m radius to the left."""
    angles = np.linspace(0.0, np.pi / 2, 80)
    line = reference_line(np.stack([100 * np.sin(angles), 100 * (1 - np.cos(angles))], axis=1))
    x, y = along_road(line, np.array([-30.0, 95.0]), np.array([2.0, 140.0]))
    assert x == pytest.approx([-30.0, 157.08 + 40.0], abs=0.5)
    assert y == pytest.approx([2.0, 5.0], abs=0.5)


def test_a_circle_is_measured_as_one():
    """A point 7 m inside a circle of 200 m radius, 1 rad on: x = 200 m, y = 7 m to the left."""
    angles = np.arange(0.0, 1.6, 0.01)
    line = reference_line(np.stack([200 * np.sin(angles), 200 * (1 - np.cos(angles))], axis=1))
    x, y = along_road(line, np.array([193 * np.sin(1.0)]), np.array([200 - 193 * np.cos(1.0)]))
    assert x[0] == pytest.approx(200.0, abs=0.01)
    assert y[0] == pytest.approx(7.0, abs=0.01)


@pytest.mark.parametrize("away", [0.0, 5_000.0, 1e7])
def test_a_point_alone_is_where_it_is_among_many_and_a_stray_one_disturbs_none(away):
    line = reference_line(road([(300.0, 1 / RADIUS)]))
    rng = np.random.default_rng(0)
    size = 3 * BLOCK + 5
    px, py = in_plane(line, rng.uniform(-20, 320, size), rng.uniform(-12, 12, size))
    px[7] += away
    x, y = along_road(line, px, py)
    for i in (0, BLOCK, size - 1):
        alone = along_road(line, px[i : i + 1], py[i : i + 1])
        assert (x[i], y[i]) == pytest.approx((alone[0][0], alone[1][0]), abs=1e-5)


def test_a_straight_line_of_many_points_is_the_line_of_its_ends():
    places = np.linspace(0.0, 500.0, 101)
    many = reference_line(np.stack([0.8 * places, 0.6 * places], axis=1))
    ends = reference_line(np.array([[0.0, 0.0], [400.0, 300.0]]))
    px, py = np.random.default_rng(0).uniform(-100, 500, (2, 1000))
    np.testing.assert_allclose(along_road(many, px, py), along_road(ends, px, py), atol=1e-9)


def test_a_road_of_fifty_kilometres_is_looked_up_as_well():
    line = reference_line(road([(25_000.0, 1 / 20_000), (25_000.0, -1 / 20_000)], step=50.0))
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, line.length, 1000), rng.uniform(-20, 20, 1000)
    np.testing.assert_allclose(along_road(line, *in_plane(line, x, y)), (x, y), atol=1e-5)


def test_no_points_are_no_positions():
    line = reference_line(road([(100.0, 0.005)]))
    assert [len(values) for values in along_road(line, np.empty(0), np.empty(0))] == [0, 0]


def test_one_point_is_no_line():
    with pytest.raises(SiteError, match="two different points"):
        reference_line(np.array([[1.0, 2.0], [1.0, 2.0]]))
