"""The two laws of Gazis-Herman-Rothery type: numbers by hand, zero at equal speeds, signs, floors."""

import math
import sys
from types import ModuleType

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from rampcast.paper.laws import ghr, ghr_no_speed
from rampcast.paper.laws.separable import Parameters, evaluate
from rampcast.physics.minimums import MINIMUM_GAP, MINIMUM_SPEED, MINIMUM_SPEED_DIFFERENCE, RECORDED_LIMIT

pytestmark = pytest.mark.usefixtures("double_precision")

BOTH = pytest.mark.parametrize("law", [ghr, ghr_no_speed], ids=["ghr", "gipps_paper"])
EXPONENTS = st.floats(-5.0, 5.0)
DRIVERS = st.builds(Parameters, st.floats(0.01, 10.0), EXPONENTS, EXPONENTS)
SPEEDS = st.floats(0.0, 30.0)
GAPS = st.floats(-5.0, 200.0)
few = settings(deadline=None, max_examples=60)


def at(law: ModuleType, driver: Parameters, speed: float, leader_speed: float, gap: float) -> float:
    return float(law.acceleration(driver, speed=speed, leader_speed=leader_speed, gap=gap))


def test_ghr_at_the_papers_medians_is_that_computed_by_hand():
    # alpha = 2.14, beta = -0.16, gamma = 0.9:  10^-0.16 = 0.691831;  20^0.9 = 14.8227;
    # 2.14 * 0.691831 * (12 - 10) / 14.8227 = 0.199764
    assert at(ghr, Parameters(2.14, -0.16, 0.9), 10.0, 12.0, 20.0) == pytest.approx(0.199764, abs=1e-5)


def test_the_papers_gipps_is_that_computed_by_hand():
    # alpha = 2, beta = 2, gamma = 1:  2 * (-1) * |7 - 10|^2 / 10 = -1.8
    assert at(ghr_no_speed, Parameters(2.0, 2.0, 1.0), 10.0, 7.0, 10.0) == pytest.approx(-1.8, rel=1e-12)


def test_the_papers_gipps_at_real_exponents_is_that_computed_by_hand():
    # alpha = 2.26, beta = 0.76 (the paper's means), gamma = 1:  2^0.76 = 1.693491;  2.26 * 1.693491 / 20 = 0.191364
    assert at(ghr_no_speed, Parameters(2.26, 0.76, 1.0), 10.0, 12.0, 20.0) == pytest.approx(0.191364, abs=1e-5)


def test_what_is_printed_for_the_papers_gipps_is_undefined():
    """Erratum 2: x_i - x_m is negative whenever there is a leader, and so is its real power."""
    assert isinstance((-20.0) ** 0.9, complex)


@BOTH
@few
@given(driver=DRIVERS, speed=SPEEDS, gap=GAPS)
def test_at_equal_speeds_it_keeps_its_speed(law, driver, speed, gap):
    assert at(law, driver, speed, speed, gap) == 0.0


@BOTH
@few
@given(driver=DRIVERS, speed=SPEEDS, leader_speed=SPEEDS, gap=GAPS)
@example(driver=Parameters(1.0, 1.0, 1.0), speed=2.2e-311, leader_speed=0.0, gap=20.0)
def test_it_brakes_where_it_closes_in_and_speeds_up_where_it_falls_behind(law, driver, speed, leader_speed, gap):
    difference, found = leader_speed - speed, at(law, driver, speed, leader_speed, gap)
    # XLA counts numbers below the smallest normal one, 2.2e-308, as 0: such a difference may be none.
    too_small = abs(difference) < sys.float_info.min and found == 0.0
    assert too_small or math.copysign(1.0, difference) == math.copysign(1.0, found)


@BOTH
@few
@given(driver=DRIVERS, speed=SPEEDS, leader_speed=SPEEDS)
def test_without_a_leader_it_keeps_its_speed(law, driver, speed, leader_speed):
    assert at(law, driver, speed, leader_speed, math.inf) == 0.0


@BOTH
@few
@given(driver=DRIVERS, speed=SPEEDS, leader_speed=SPEEDS, gap=GAPS)
def test_it_is_finite_and_linear_in_alpha(law, driver, speed, leader_speed, gap):
    once = at(law, driver, speed, leader_speed, gap)
    assert math.isfinite(once)
    assert at(law, driver._replace(alpha=-3.0 * driver.alpha), speed, leader_speed, gap) == pytest.approx(-3.0 * once)


@BOTH
def test_with_a_positive_gamma_a_nearer_leader_counts_more(law):
    driver = Parameters(1.0, 1.0, 2.0)
    near, far = (at(law, driver, 10.0, 8.0, gap) for gap in (10.0, 20.0))
    assert near == pytest.approx(4.0 * far)
    assert near < far < 0.0


def test_own_speed_counts_in_ghr_alone():
    driver = Parameters(1.0, 2.0, 1.0)
    assert at(ghr, driver, 20.0, 22.0, 10.0) == pytest.approx(4.0 * at(ghr, driver, 10.0, 12.0, 10.0))
    assert at(ghr_no_speed, driver, 20.0, 22.0, 10.0) == pytest.approx(at(ghr_no_speed, driver, 10.0, 12.0, 10.0))


@BOTH
@pytest.mark.parametrize("gap", [-5.0, 0.0, 0.5])
def test_a_gap_below_the_floor_counts_as_the_floor(law, gap):
    driver = Parameters(1.0, 1.0, 2.0)
    assert at(law, driver, 10.0, 8.0, gap) == at(law, driver, 10.0, 8.0, MINIMUM_GAP)


def test_the_speed_of_a_standing_vehicle_counts_as_the_floor_in_a_power():
    driver = Parameters(1.0, -2.0, 1.0)
    assert at(ghr, driver, 0.0, 1.0, 10.0) == pytest.approx(MINIMUM_SPEED**-2.0 / 10.0)


def test_a_speed_difference_below_the_floor_counts_as_the_floor_with_its_sign():
    driver = Parameters(1.0, -2.0, 1.0)
    size = MINIMUM_SPEED_DIFFERENCE**-2.0 / 10.0
    assert at(ghr_no_speed, driver, 10.0, 10.001, 10.0) == pytest.approx(size)
    assert at(ghr_no_speed, driver, 10.0, 9.999, 10.0) == pytest.approx(-size)


@BOTH
def test_the_law_is_made_of_its_factors(law):
    rng = np.random.default_rng(0)
    states = {"speed": rng.uniform(0, 20, 30), "leader_speed": rng.uniform(0, 20, 30), "gap": rng.uniform(0, 50, 30)}
    driver = Parameters(1.3, 0.4, -0.7)
    np.testing.assert_array_equal(evaluate(driver, law.factors(**states)), law.acceleration(driver, **states))


@BOTH
def test_the_limits_are_those_of_the_recordings_for_every_driver(law):
    lowest, highest = law.limits(Parameters(np.array([1.0, -2.0]), np.zeros(2), np.zeros(2)))
    np.testing.assert_array_equal(highest, [RECORDED_LIMIT, RECORDED_LIMIT])
    np.testing.assert_array_equal(lowest, [-RECORDED_LIMIT, -RECORDED_LIMIT])
    assert pytest.approx(11.2 * 0.3048, abs=0.005) == RECORDED_LIMIT  # 11.2 ft/s^2


@BOTH
def test_the_ranges_are_those_of_the_papers_tables(law):
    assert [(bound.low, bound.high) for bound in law.BOUNDS] == [(-10, 10), (-5, 5), (-5, 5)]


def test_the_spreads_are_those_of_the_papers_tables():
    assert [spread[1:] for spread in ghr_no_speed.PUBLISHED] == [
        (2.26, 0.00, 5.62),
        (0.76, 0.70, 2.42),
        (-1.42, -0.95, 3.09),
        (0.18, 0.06, 0.29),
    ]
    assert [spread[1:] for spread in ghr.PUBLISHED] == [
        (2.84, 2.14, 4.77),
        (0.06, -0.16, 3.89),
        (0.96, 0.9, 1.62),
        (0.12, 0.06, 0.22),
    ]
    for law in (ghr, ghr_no_speed):
        assert tuple(spread.median for spread in law.PUBLISHED[:-1]) == law.FALLBACK
