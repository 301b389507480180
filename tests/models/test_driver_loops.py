"""The compiled laws: equal to those of `physics`, and safe."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rampcast.horizon import STEP
from rampcast.models.driver_loops import (
    FINE,
    HARDEST,
    NARROWEST,
    WIDEST,
    able_to_stop,
    free,
    free_table,
    freely,
    law,
    own_gap,
    stopping,
)
from rampcast.physics import idm

pytestmark = pytest.mark.usefixtures("double_precision")

DRIVERS = st.tuples(*(st.floats(bound.low, bound.high) for bound in idm.NET_BOUNDS))
SPEEDS = st.floats(0.0, 40.0)


@given(DRIVERS, SPEEDS, SPEEDS, st.floats(-5.0, 300.0))
@settings(deadline=None)
def test_the_compiled_law_is_the_one_of_physics(driver, v, leader_v, gap):
    standing, headway, highest, braking, desired, exponent = driver
    freely = free(highest, desired, exponent, v)
    found = law(standing, headway, highest, 2.0 * np.sqrt(highest * braking), freely, v, leader_v, gap)
    expected = idm.acceleration(idm.Parameters(*driver), speed=v, leader_speed=leader_v, gap=gap)
    np.testing.assert_allclose(found, float(expected), rtol=1e-6, atol=1e-6)


@given(DRIVERS, SPEEDS)
@settings(deadline=None)
def test_behind_nobody_it_is_the_free_term(driver, v):
    _, _, highest, _, desired, exponent = driver
    expected = idm.acceleration(idm.Parameters(*driver), speed=v, leader_speed=v, gap=np.inf)
    np.testing.assert_allclose(free(highest, desired, exponent, v), float(expected), rtol=1e-6, atol=1e-6)


def stopped(x: float, v: float) -> float:
    """Returns where a vehicle stands that brakes as hard as it can, step by step [m]."""
    while v > 0.0:
        v = max(v - HARDEST * STEP, 0.0)
        x += v * STEP
    return x


@given(st.floats(0.0, 200.0), SPEEDS)
@settings(deadline=None)
def test_who_keeps_to_the_stopping_place_can_stop_behind_a_leader_that_brakes_as_hard_as_it_can(room, leader_v):
    """Up to the 4 cm by which a vehicle that brakes in steps comes to a stand later."""
    reached = stopping(0.0, room, leader_v)
    assert 0.0 <= reached <= room
    assert stopped(reached, reached / STEP) <= room + leader_v**2 / (2.0 * HARDEST) + 0.0401


def test_behind_what_is_reached_already_it_stays():
    assert stopping(10.0, 9.0, 20.0) == 10.0
    assert stopped(0.0, 8.0) == pytest.approx(0.2 * (6.4 + 4.8 + 3.2 + 1.6))


@given(DRIVERS, st.floats(1.0, 20.0), st.floats(3.0, 80.0))
@settings(deadline=None)
def test_a_driver_of_full_habit_keeps_speed_in_the_gap_of_now(driver, v, gap):
    standing, headway, highest, braking, desired, exponent = driver
    factor = own_gap(1.0, standing, headway, desired, exponent, v, gap)
    assert own_gap(0.0, standing, headway, desired, exponent, v, gap) == 1.0
    freely = free(highest, desired, exponent, v)
    if NARROWEST < factor < WIDEST and freely > 0.05 * highest:
        softness = 2.0 * np.sqrt(highest * braking)
        assert law(standing * factor, headway * factor, highest, softness, freely, v, v, gap) == pytest.approx(
            0.0, abs=1e-9
        )


def test_behind_nobody_there_is_no_habit():
    assert own_gap(1.0, 2.0, 1.2, 20.0, 4.0, 10.0, np.inf) == 1.0


@given(st.floats(0.3, 3.0), st.floats(15.0, 50.0), st.floats(1.0, 8.0), SPEEDS)
@settings(deadline=None)
def test_free_accelerations_of_the_table_are_those_of_the_law_to_5_mm_per_square_second(highest, desired, exponent, v):
    driver = np.array([[2.0, 1.2, highest, 2.0, desired, exponent, 0.0]])
    close = 0.005 * max(1.0, (max(v, FINE) / desired) ** (exponent - 2.0))  # its second derivative grows so
    assert freely(free_table(driver)[0], v) == pytest.approx(free(highest, desired, exponent, v), abs=close)


@given(SPEEDS, st.floats(-5.0, 400.0), SPEEDS, st.floats(0.0, 9.0))
@settings(deadline=None)
def test_a_place_told_without_the_root_is_that_told_with_it(speed, rear, leader_v, place):
    place = max(place, speed * STEP)
    assert able_to_stop(place, 0.0, rear, leader_v) == pytest.approx(
        min(place, stopping(0.0, rear, leader_v)), abs=1e-9
    )
