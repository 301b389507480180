"""Derivatives in time are of second order at the ends too; distances have the sign that their docstrings give."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rampcast.physics.kinematics import acceleration, front_gap, net_gap, time_to_collision, velocity

T = 0.2
COEFFICIENT = st.floats(-10.0, 10.0)


def cubic(coefficients: tuple[float, ...], steps: int = 12) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns a polynomial of the time and its first two derivatives."""
    line = np.polynomial.Polynomial(coefficients)
    time = np.arange(steps) * T
    return line(time), line.deriv(1)(time), line.deriv(2)(time)


def test_velocity_is_that_computed_by_hand():
    # (-3*0 + 4*1 - 4) / 0.4 = 0;  (4 - 0) / 0.4 = 10;  (3*4 - 4*1 + 0) / 0.4 = 20
    np.testing.assert_allclose(velocity(np.array([0.0, 1.0, 4.0]), time_step=T), [0.0, 10.0, 20.0], atol=1e-12)


def test_acceleration_is_that_computed_by_hand():
    # x = 0, 1, 4, 8:  (0 - 5 + 16 - 8) / 0.04 = 75;  (4 - 2 + 0) / 0.04 = 50;  (8 - 8 + 1) / 0.04 = 25;
    # (16 - 20 + 4 - 0) / 0.04 = 0
    found = acceleration(np.array([0.0, 1.0, 4.0, 8.0]), time_step=T)
    np.testing.assert_allclose(found, [75.0, 50.0, 25.0, 0.0], atol=1e-10)


@settings(deadline=None, max_examples=30)
@given(st.tuples(COEFFICIENT, COEFFICIENT, COEFFICIENT))
def test_velocity_is_exact_for_a_parabola_even_at_its_ends(coefficients):
    x, v, _ = cubic(coefficients)
    np.testing.assert_allclose(velocity(x, time_step=T), v, atol=1e-9)


@settings(deadline=None, max_examples=30)
@given(st.tuples(COEFFICIENT, COEFFICIENT, COEFFICIENT, COEFFICIENT))
def test_acceleration_is_exact_for_a_cubic_even_at_its_ends(coefficients):
    x, _, a = cubic(coefficients)
    np.testing.assert_allclose(acceleration(x, time_step=T), a, atol=1e-8)


def test_halving_the_step_quarters_the_error_of_the_velocity_everywhere():
    def largest_error(step: float) -> float:
        time = np.arange(round(4.0 / step) + 1) * step
        return float(np.abs(np.asarray(velocity(np.sin(time), time_step=step)) - np.cos(time)).max())

    assert largest_error(0.2) / largest_error(0.1) == pytest.approx(4.0, rel=0.1)


def test_every_row_of_a_table_is_differentiated_on_its_own():
    rows = np.random.default_rng(0).normal(size=(2, 3, 8))
    for derivative in (velocity, acceleration):
        together = derivative(rows, time_step=T)
        np.testing.assert_array_equal(together[1, 2], derivative(rows[1, 2], time_step=T))


def test_the_front_gap_is_positive_while_the_leader_is_ahead():
    assert float(front_gap(100.0, 112.0)) == 12.0
    assert float(front_gap(112.0, 100.0)) == -12.0


def test_the_net_gap_ends_at_the_leaders_rear_bumper():
    assert float(net_gap(100.0, 112.0, 5.0)) == 7.0
    assert float(net_gap(100.0, 104.0, 5.0)) == -1.0  # they overlap


def test_time_to_collision_is_the_gap_over_the_closing_speed():
    assert float(time_to_collision(20.0, 15.0, 10.0)) == 4.0


@pytest.mark.parametrize("leader_speed", [10.0, 12.0])
def test_a_vehicle_that_does_not_close_in_never_collides(leader_speed):
    assert float(time_to_collision(20.0, 10.0, leader_speed)) == np.inf
