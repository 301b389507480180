"""The safe-speed law of Gipps 1981: numbers by hand, steady following, and its two speeds."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rampcast.paper.laws.gipps import (
    BOUNDS,
    FALLBACK,
    PUBLISHED,
    Parameters,
    acceleration,
    free_speed,
    limits,
    safe_speed,
)
from rampcast.physics.minimums import MINIMUM_GAP

pytestmark = pytest.mark.usefixtures("double_precision")

# Means of Gipps 1981, section 4; s_n = 6.5 m less a car of 4.5 m.
GIPPS = Parameters(1.7, 3.4, 20.0, 2.0 / 3.0, 3.2, 2.0)
DRIVERS = st.builds(Parameters, *(st.floats(bound.low, bound.high) for bound in BOUNDS))
SPEEDS = st.floats(0.0, 30.0)
GAPS = st.floats(-5.0, 200.0)
few = settings(deadline=None, max_examples=60)


def at(driver: Parameters, speed: float, leader_speed: float, gap: float) -> float:
    return float(acceleration(driver, speed=speed, leader_speed=leader_speed, gap=gap))


def test_the_free_speed_is_that_computed_by_hand():
    # 10 + 2.5 * 1.7 * 2/3 * (1 - 0.5) * sqrt(0.025 + 0.5) = 10 + 2.83333 * 0.5 * 0.724569
    assert float(free_speed(GIPPS, speed=10.0)) == pytest.approx(11.026472, abs=1e-5)
    assert at(GIPPS, 10.0, 0.0, math.inf) == pytest.approx(1.026472 * 1.5, abs=1e-5)


def test_the_safe_speed_is_that_computed_by_hand():
    # B tau = 2.266667;  2 (12 - 2) - 10 * 2/3 + 8^2 / 3.2 = 33.33333;  sqrt(5.137778 + 3.4 * 33.33333) = 10.884444
    # 10.884444 - 2.266667 = 8.617777;  (8.617777 - 10) / (2/3) = -2.073334
    assert float(safe_speed(GIPPS, speed=10.0, leader_speed=8.0, gap=12.0)) == pytest.approx(8.617777, abs=1e-5)
    assert at(GIPPS, 10.0, 8.0, 12.0) == pytest.approx(-2.073334, abs=1e-5)


@few
@given(DRIVERS, st.floats(0.0, 0.9))
def test_who_expects_its_own_braking_follows_steadily_at_one_and_a_half_reaction_times(driver, share):
    """With B = B hat the safe speed is v at s = s_0 + 1.5 v tau; Gipps 1981 adds tau / 2 as a margin of safety."""
    driver, speed = driver._replace(leader_braking=driver.braking), share * driver.desired_speed
    gap = driver.standing_gap + 1.5 * speed * driver.reaction_time
    found = safe_speed(driver, speed=speed, leader_speed=speed, gap=gap)
    assert float(found) == pytest.approx(speed, abs=1e-6)


@few
@given(DRIVERS, SPEEDS, SPEEDS, st.floats(MINIMUM_GAP, 200.0))
def test_it_reaches_the_smaller_of_free_and_safe_speed_after_one_reaction_time(driver, speed, leader_speed, gap):
    reached = speed + at(driver, speed, leader_speed, gap) * driver.reaction_time
    free = float(free_speed(driver, speed=speed))
    safe = float(safe_speed(driver, speed=speed, leader_speed=leader_speed, gap=gap))
    assert reached == pytest.approx(min(free, safe), abs=1e-9)


@few
@given(DRIVERS, st.floats(0.0, 1.0), SPEEDS, GAPS)
def test_it_never_exceeds_its_desired_speed_in_steps_of_a_roll_out(driver, share, leader_speed, gap):
    speed = share * driver.desired_speed
    assert speed + 0.2 * at(driver, speed, leader_speed, gap) <= driver.desired_speed + 1e-9
    assert speed + 0.2 * at(driver, speed, leader_speed, math.inf) <= driver.desired_speed + 1e-9


@few
@given(DRIVERS)
def test_on_a_free_road_it_keeps_the_desired_speed_and_seeks_it_from_both_sides(driver):
    wished = driver.desired_speed
    assert at(driver, wished, 0.0, math.inf) == pytest.approx(0.0, abs=1e-12)
    assert at(driver, 0.9 * wished, 0.0, math.inf) > 0.0 > at(driver, 1.1 * wished, 0.0, math.inf)


@few
@given(DRIVERS, SPEEDS, SPEEDS, GAPS, st.floats(0.1, 50.0))
def test_it_never_falls_as_the_gap_or_the_leaders_speed_grows(driver, speed, leader_speed, gap, more):
    here = at(driver, speed, leader_speed, gap)
    assert at(driver, speed, leader_speed, gap + more) >= here
    assert at(driver, speed, leader_speed + more, gap) >= here
    assert at(driver, speed, leader_speed, math.inf) >= here


def test_closing_in_brakes():
    assert at(GIPPS, 15.0, 5.0, 15.0) < 0.0 < at(GIPPS, 10.0, 12.0, 30.0)


@few
@given(DRIVERS, SPEEDS, SPEEDS, GAPS)
def test_no_driver_wishes_to_drive_backwards(driver, speed, leader_speed, gap):
    reached = speed + at(driver, speed, leader_speed, gap) * driver.reaction_time
    assert reached >= min(0.0, float(free_speed(driver, speed=speed))) - 1e-9


def test_where_no_speed_is_safe_it_stops():
    assert float(safe_speed(GIPPS, speed=30.0, leader_speed=0.0, gap=1.0)) == 0.0
    assert at(GIPPS, 30.0, 0.0, -20.0) == at(GIPPS, 30.0, 0.0, MINIMUM_GAP) == pytest.approx(-45.0)


def test_the_limits_of_a_roll_out_are_minus_b_and_a():
    lowest, highest = limits(GIPPS)
    assert (float(lowest), float(highest)) == (-3.4, 1.7)


def test_the_published_values_are_gipps_own_and_lie_within_the_ranges():
    assert tuple(spread.mean for spread in PUBLISHED) == FALLBACK
    assert all(bound.low <= value <= bound.high for bound, value in zip(BOUNDS, FALLBACK, strict=True))
    by_name = {spread.name: spread for spread in PUBLISHED}
    assert by_name["maximum_acceleration"][1:] == (1.7, 1.7, 0.3)
    assert by_name["braking"][1:] == (3.4, 3.4, 0.6)
    assert by_name["desired_speed"][1:] == (20.0, 20.0, 3.2)
