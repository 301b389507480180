"""The two laws of Gazis-Herman-Rothery type: GHR, and what the paper prints as Gipps'."""

import math
from types import ModuleType

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rampcast.physics import ghr, ghr_no_speed, separable
from rampcast.physics.floors import MINIMUM_GAP, MINIMUM_SPEED, MINIMUM_SPEED_DIFFERENCE

BOTH = (ghr, ghr_no_speed)
exponents = st.floats(-5.0, 5.0)


def acceleration(
    law: ModuleType, parameters: tuple[float, ...], speed: float, leader_speed: float, gap: float
) -> float:
    return float(law.acceleration(law.Parameters(*parameters), speed=speed, leader_speed=leader_speed, gap=gap))


def test_ghr_equals_a_number_computed_by_hand() -> None:
    assert acceleration(ghr, (2.0, 1.0, 2.0), 10.0, 12.0, 10.0) == pytest.approx(2 * 10 * 2 / 10**2)


def test_the_papers_gipps_equals_a_number_computed_by_hand() -> None:
    assert acceleration(ghr_no_speed, (2.0, 2.0, 1.0), 10.0, 7.0, 6.0) == pytest.approx(-2 * 3**2 / 6)


@pytest.mark.parametrize("law", BOTH)
@given(st.tuples(st.floats(-10.0, 10.0), exponents, exponents), st.floats(0.0, 30.0), st.floats(-5.0, 500.0))
def test_acceleration_is_zero_at_equal_speeds(
    law: ModuleType, parameters: tuple[float, ...], speed: float, gap: float
) -> None:
    assert acceleration(law, parameters, speed, speed, gap) == 0.0


@pytest.mark.parametrize("law", BOTH)
@given(st.tuples(st.floats(0.01, 10.0), exponents, exponents), st.floats(1.0, 20.0), st.floats(0.2, 5.0))
def test_a_faster_leader_pulls_and_a_slower_one_brakes(
    law: ModuleType, parameters: tuple[float, ...], speed: float, difference: float
) -> None:
    assert acceleration(law, parameters, speed, speed + difference, 20.0) > 0.0
    assert acceleration(law, parameters, speed, speed - difference, 20.0) < 0.0


@pytest.mark.parametrize("law", BOTH)
def test_without_a_leader_the_speed_is_kept(law: ModuleType) -> None:
    assert acceleration(law, (5.0, 1.0, -5.0), 10.0, math.nan, math.inf) == 0.0


@pytest.mark.parametrize("law", BOTH)
def test_what_the_data_do_not_resolve_counts_as_the_floor(law: ModuleType) -> None:
    parameters = (1.0, -5.0, 5.0)
    assert acceleration(law, parameters, 5.0, 6.0, -4.0) == acceleration(law, parameters, 5.0, 6.0, MINIMUM_GAP)
    assert acceleration(ghr, parameters, 0.0, 1.0, 5.0) == pytest.approx(MINIMUM_SPEED**-5 * 1.0 / 5.0**5)
    small = acceleration(ghr_no_speed, parameters, 5.0, 5.0 - 1e-3, 5.0)
    assert small == pytest.approx(-(MINIMUM_SPEED_DIFFERENCE**-5) / 5.0**5)


def test_the_limits_of_a_roll_out_are_those_of_the_recordings() -> None:
    lowest, highest = separable.limits(ghr.Parameters(np.zeros(2), np.zeros(2), np.zeros(2)))
    assert np.array_equal(lowest, [-3.41, -3.41])
    assert np.array_equal(highest, [3.41, 3.41])
