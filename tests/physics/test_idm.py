"""The intelligent driver model: a number from its source, its limits, and its signs."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rampcast.physics.idm import BOUNDS, FALLBACK, PUBLISHED, Parameters, acceleration, desired_gap, limits
from rampcast.physics.minimums import MINIMUM_GAP, MINIMUM_SPEED

pytestmark = pytest.mark.usefixtures("double_precision")

# Table I of Treiber, Hennecke and Helbing 2000: s_0 = 2 m, T = 1.6 s, a = 0.73, b = 1.67 m/s^2, v_0 = 120 km/h.
TREIBER = Parameters(2.0, 1.6, 0.73, 1.67, 120.0 / 3.6, 4.0)
DRIVERS = st.builds(Parameters, *(st.floats(bound.low, bound.high) for bound in BOUNDS))
SPEEDS = st.floats(0.2, 30.0)
GAPS = st.floats(1.5, 200.0)
few = settings(deadline=None, max_examples=60)


def at(driver: Parameters, speed: float, leader_speed: float, gap: float) -> float:
    return float(acceleration(driver, speed=speed, leader_speed=leader_speed, gap=gap))


def test_the_desired_gap_is_that_computed_by_hand():
    # sqrt(0.73 * 1.67) = 1.10413;  2 + 1.6 * 20 + 20 * (20 - 15) / (2 * 1.10413) = 34 + 45.2846
    assert float(desired_gap(TREIBER, speed=20.0, leader_speed=15.0)) == pytest.approx(79.2846, abs=1e-3)


def test_the_acceleration_is_that_computed_by_hand():
    # (20 / 33.3333)^4 = 0.1296;  (79.2846 / 40)^2 = 3.92878;  0.73 * (1 - 0.1296 - 3.92878) = -2.23262
    assert at(TREIBER, 20.0, 15.0, 40.0) == pytest.approx(-2.23262, abs=1e-4)


@few
@given(DRIVERS, st.floats(0.02, 0.95))
def test_at_its_equilibrium_gap_a_vehicle_keeps_its_speed(driver, share):
    speed = max(share * driver.desired_speed, MINIMUM_SPEED)
    free = 1.0 - (speed / driver.desired_speed) ** driver.exponent
    if free < 1e-6:  # with an exponent near 0 there is no equilibrium: the free road does not attract
        return
    gap = (driver.standing_gap + driver.time_headway * speed) / math.sqrt(free)
    assert at(driver, speed, speed, gap) == pytest.approx(0.0, abs=1e-9)


@few
@given(DRIVERS, SPEEDS, st.floats(0.01, 5.0), st.floats(0.0, 1.0), GAPS)
def test_it_falls_with_the_speed_behind_a_slower_leader(driver, speed, more, share, gap):
    leader_speed = share * speed
    assert at(driver, speed + more, leader_speed, gap) < at(driver, speed, leader_speed, gap)


@few
@given(DRIVERS, SPEEDS, st.floats(0.0, 1.0), GAPS, st.floats(0.1, 100.0))
def test_it_rises_with_the_gap(driver, speed, share, gap, more):
    assert at(driver, speed, share * speed, gap + more) > at(driver, speed, share * speed, gap)


@few
@given(DRIVERS, SPEEDS, st.floats(0.1, 1.0), GAPS)
def test_closing_in_brakes_harder_than_following(driver, speed, share, gap):
    assert at(driver, speed, (1.0 - share) * speed, gap) < at(driver, speed, speed, gap)


@few
@given(DRIVERS, SPEEDS, SPEEDS, GAPS)
def test_it_never_exceeds_its_maximum_acceleration(driver, speed, leader_speed, gap):
    assert at(driver, speed, leader_speed, gap) <= driver.maximum_acceleration
    assert at(driver, speed, leader_speed, math.inf) <= driver.maximum_acceleration


@few
@given(DRIVERS, SPEEDS, st.floats(0.0, 40.0))
def test_without_a_leader_only_the_free_road_counts(driver, speed, leader_speed):
    free = driver.maximum_acceleration * (1.0 - (speed / driver.desired_speed) ** driver.exponent)
    assert at(driver, speed, leader_speed, math.inf) == pytest.approx(free, rel=1e-9, abs=1e-9)


def test_on_a_free_road_it_keeps_the_desired_speed_and_seeks_it_from_both_sides():
    assert at(TREIBER, 120.0 / 3.6, 0.0, math.inf) == pytest.approx(0.0, abs=1e-12)
    assert at(TREIBER, 30.0, 0.0, math.inf) > 0.0 > at(TREIBER, 36.0, 0.0, math.inf)


@pytest.mark.parametrize("gap", [-5.0, 0.0, 0.5])
def test_a_gap_below_the_floor_brakes_as_the_floor_does(gap):
    assert at(TREIBER, 10.0, 5.0, gap) == at(TREIBER, 10.0, 5.0, MINIMUM_GAP)
    assert at(TREIBER, 10.0, 5.0, gap) < -1.0


def test_a_standing_vehicle_with_a_vanishing_exponent_has_a_finite_acceleration():
    driver = TREIBER._replace(exponent=0.0)
    assert at(driver, 0.0, 0.0, 10.0) == pytest.approx(-0.73 * (2.0 / 10.0) ** 2)


def test_many_vehicles_and_steps_are_computed_at_once():
    drivers = Parameters(*(np.linspace(bound.low, bound.high, 5)[:, None] for bound in BOUNDS))
    speed = np.linspace(0.0, 20.0, 4)
    together = acceleration(drivers, speed=speed, leader_speed=8.0, gap=15.0)
    assert together.shape == (5, 4)
    one = Parameters(*(float(values[3, 0]) for values in drivers))
    assert float(together[3, 2]) == pytest.approx(at(one, float(speed[2]), 8.0, 15.0), rel=1e-12)


def test_the_limits_of_a_roll_out_are_minus_b_and_a_so_that_it_can_brake():
    lowest, highest = limits(TREIBER)
    assert (float(lowest), float(highest)) == (-1.67, 0.73)


def test_the_ranges_and_the_spread_are_those_of_the_papers_table():
    assert [(bound.low, bound.high) for bound in BOUNDS] == [(5, 30), (0.5, 6), (0.5, 5), (0.5, 5), (5, 35), (0, 10)]
    assert [spread[1:] for spread in PUBLISHED] == [
        (10.68, 6.92, 8.47),
        (1.79, 0.91, 1.88),
        (3.34, 3.75, 1.64),
        (2.63, 1.63, 2.10),
        (18.19, 7.62, 13.89),
        (5.19, 4.48, 4.04),
        (0.08, 0.02, 0.26),
    ]
    assert tuple(spread.mean for spread in PUBLISHED[:-1]) == FALLBACK
