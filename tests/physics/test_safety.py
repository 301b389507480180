"""Measures of safety: numbers by hand, limits, and signs."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rampcast.physics.safety import (
    LEAST_POST_ENCROACHMENT,
    LEAST_TIME_TO_COLLISION,
    MOST_DECELERATION,
    deceleration_to_avoid_crash,
    post_encroachment_time,
    time_to_collision,
)

pytestmark = pytest.mark.usefixtures("double_precision")

GAPS = st.floats(0.1, 200.0)
SPEEDS = st.floats(0.0, 40.0)
few = settings(deadline=None, max_examples=60)


def ttc(gap: float, speed: float, leader_speed: float) -> float:
    return float(time_to_collision(gap, speed=speed, leader_speed=leader_speed))


def drac(gap: float, speed: float, leader_speed: float) -> float:
    return float(deceleration_to_avoid_crash(gap, speed=speed, leader_speed=leader_speed))


def test_the_time_to_collision_is_the_gap_over_the_closing_speed():
    # 30 m at 20 - 14 = 6 m/s
    assert ttc(30.0, 20.0, 14.0) == pytest.approx(5.0)


def test_the_deceleration_to_avoid_a_crash_is_the_square_of_the_closing_speed_over_twice_the_gap():
    # 6^2 / (2 * 30)
    assert drac(30.0, 20.0, 14.0) == pytest.approx(0.6)


def test_the_post_encroachment_time_counts_from_the_rear_that_left_to_the_front_that_enters():
    assert float(post_encroachment_time(7.5, 9.0)) == pytest.approx(1.5)
    assert float(post_encroachment_time(9.0, 7.5)) == pytest.approx(-1.5)
    assert float(post_encroachment_time(7.5, math.inf)) == math.inf


def test_the_thresholds_are_those_of_sumo():
    assert (LEAST_TIME_TO_COLLISION, MOST_DECELERATION, LEAST_POST_ENCROACHMENT) == (3.0, 3.0, 2.0)


@few
@given(GAPS, SPEEDS, st.floats(0.0, 20.0))
def test_behind_a_leader_that_is_not_slower_there_is_no_conflict(gap, speed, more):
    assert ttc(gap, speed, speed + more) == math.inf
    assert drac(gap, speed, speed + more) == 0.0


@pytest.mark.parametrize("gap", [0.0, -2.0])
def test_vehicles_that_touch_have_no_time_left_if_they_close_in(gap):
    assert ttc(gap, 10.0, 5.0) == 0.0
    assert ttc(gap, 5.0, 10.0) == math.inf
    assert drac(gap, 10.0, 5.0) == math.inf
    assert drac(gap, 5.0, 10.0) == 0.0


@few
@given(GAPS, SPEEDS, st.floats(0.1, 20.0))
def test_braking_by_drac_takes_twice_the_time_to_collision_and_ends_at_the_leaders_bumper(gap, leader_speed, closing):
    """With relative braking b the closing speed vanishes after c / b, in which c^2 / (2 b) of the gap are used up."""
    needed, time = drac(gap, leader_speed + closing, leader_speed), ttc(gap, leader_speed + closing, leader_speed)
    assert closing / needed == pytest.approx(2.0 * time, rel=1e-6)
    assert closing**2 / (2.0 * needed) == pytest.approx(gap, rel=1e-6)


@few
@given(GAPS, st.floats(0.1, 100.0), SPEEDS, st.floats(0.1, 20.0))
def test_a_wider_gap_is_safer(gap, more, leader_speed, closing):
    speed = leader_speed + closing
    assert ttc(gap + more, speed, leader_speed) > ttc(gap, speed, leader_speed)
    assert drac(gap + more, speed, leader_speed) < drac(gap, speed, leader_speed)


@few
@given(GAPS, SPEEDS, st.floats(0.1, 20.0), st.floats(0.1, 20.0))
def test_closing_in_faster_is_less_safe(gap, leader_speed, closing, more):
    slower, faster = leader_speed + closing, leader_speed + closing + more
    assert ttc(gap, faster, leader_speed) < ttc(gap, slower, leader_speed)
    assert drac(gap, faster, leader_speed) > drac(gap, slower, leader_speed)


def test_many_vehicles_and_steps_are_computed_at_once():
    gap, speed = np.array([[10.0], [20.0]]), np.array([5.0, 10.0, 15.0])
    together = time_to_collision(gap, speed=speed, leader_speed=5.0)
    np.testing.assert_allclose(together, [[np.inf, 2.0, 1.0], [np.inf, 4.0, 2.0]])
