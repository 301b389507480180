"""The filter of states from the past alone, against a plain Kalman filter and smoother, and its properties."""

import numpy as np
import pytest
from scipy.linalg import expm

from rampcast.traffic.past_filter import (
    ACCELERATION_BEFORE,
    FADING,
    JERK,
    POSITION_NOISE,
    SPEED_BEFORE,
    states_from_past,
)

GRID = np.arange(-20, 1) * 0.2


def _of_one(time, x, y=None):
    first = np.array([0, len(time)])
    states, valid = states_from_past(time, x, np.full(len(x), np.nan) if y is None else y, first, grid=GRID)
    return states[0], valid[0]


def _plain(time, x, speed, axis):
    """The textbook filter and smoother, with the noise from a matrix exponential (Van Loan 1978)."""
    moments = np.unique(np.concatenate([np.round(time, 9), np.round(GRID[GRID >= time[0] - 1e-6], 9)]))
    seen = dict(zip(np.round(time, 9), x, strict=True))
    drift = np.array([[0, 1, 0], [0, 0, 1], [0, 0, -FADING]])
    means, covs, afters, cov_afters, steps = [], [], [], [], []
    for number, now in enumerate(moments):
        if number == 0:
            step, mean = np.eye(3), np.array([x[0], speed, 0.0])
            cov = np.diag([1e4 * POSITION_NOISE**2, SPEED_BEFORE[axis] ** 2, ACCELERATION_BEFORE[axis] ** 2])
        else:
            block = np.zeros((6, 6))
            block[:3, :3], block[:3, 3:], block[3:, 3:] = -drift, np.diag([0, 0, JERK[axis] ** 2]), drift.T
            whole = expm(block * (now - moments[number - 1]))
            step = whole[3:, 3:].T
            mean, cov = step @ afters[-1], step @ cov_afters[-1] @ step.T + step @ whole[:3, 3:]
        means.append(mean), covs.append(cov), steps.append(step)
        if now in seen:
            gain = cov[:, 0] / (cov[0, 0] + POSITION_NOISE**2)
            mean, cov = mean + gain * (seen[now] - mean[0]), cov - np.outer(gain, cov[0])
        afters.append(mean), cov_afters.append(cov)
    smooth = [afters[-1]]
    for number in range(len(moments) - 2, -1, -1):
        gain = cov_afters[number] @ steps[number + 1].T @ np.linalg.inv(covs[number + 1])
        smooth.insert(0, afters[number] + gain @ (smooth[0] - means[number + 1]))
    found = dict(zip(moments, smooth, strict=True))
    return np.array([found[np.round(now, 9)] for now in GRID if np.round(now, 9) in found])


@pytest.mark.parametrize("rate", [5.0, 10.0, 12.5, 25.0, 30.0])
def test_it_is_the_textbook_filter_and_smoother_at_any_rate(rate):
    time = np.sort(-np.arange(0, int(4 * rate) + 1) / rate)
    x = 20 * time + 0.4 * time**2 + 0.1 * np.random.default_rng(1).normal(size=len(time))
    states, valid = _of_one(time, x)
    speed = (x[-1] - x[0]) / (time[-1] - time[0])
    np.testing.assert_allclose(states[[0, 2, 4]].T[valid], _plain(time, x, speed, 0), rtol=1e-6, atol=1e-6)
    assert valid.all()


def test_late_starts_holes_and_odd_moments_are_the_textbook_s_too():
    time = np.array([-1.93, -1.81, -1.74, -1.1, -1.0, -0.87, -0.31, -0.05])
    x = 9 * time + np.sin(time)
    states, valid = _of_one(time, x)
    speed = (x[-1] - x[0]) / (time[-1] - time[0])
    # between moments that lie near each other the noise is a series, good to a hundredth
    np.testing.assert_allclose(states[[0, 2, 4]].T[valid], _plain(time, x, speed, 0), rtol=1e-3, atol=1e-3)
    assert valid.sum() == 10
    assert not valid[:11].any()


def test_a_steady_speed_is_found_exactly_and_an_acceleration_nearly():
    time = np.arange(-40, 1) / 10
    states, _ = _of_one(time, 12.0 * time)
    np.testing.assert_allclose(states[2], 12.0, atol=1e-9)
    np.testing.assert_allclose(states[4], 0.0, atol=1e-9)
    states, _ = _of_one(time, 12.0 * time + 0.5 * 1.2 * time**2)
    assert abs(states[2, -1] - 12.0) < 0.15
    assert abs(states[4, -1] - 1.2) < 0.3


def test_moving_a_vehicle_moves_its_places_alone():
    time = np.arange(-40, 1) / 10
    x = 5 * time + np.cos(time)
    there, _ = _of_one(time, x)
    moved, _ = _of_one(time, x + 1000.0)
    np.testing.assert_allclose(moved[0] - there[0], 1000.0, atol=1e-7)
    np.testing.assert_allclose(moved[[2, 4]], there[[2, 4]], atol=1e-7)


def test_a_hair_of_noise_moves_states_by_a_hair():
    time = np.arange(-40, 1) / 10
    x = 15 * time + np.sin(time)
    there, _ = _of_one(time, x)
    noisy, _ = _of_one(time, x + 1e-9 * np.random.default_rng(1).normal(size=len(x)))
    assert np.abs(noisy - there)[[0, 2, 4]].max() < 1e-7


def test_an_id_that_comes_back_elsewhere_or_after_a_long_hole_is_a_new_vehicle():
    time = np.arange(-40, 1) / 10
    x = 10.0 * time
    jumped = np.where(time < -1.05, x + 200.0, x)
    states, valid = _of_one(time, jumped)
    assert valid.sum() == 6
    assert valid[-6:].all()
    np.testing.assert_allclose(states[2, -1], 10.0, atol=0.1)
    seen = (time < -2.95) | (time > -1.45)
    _, valid = _of_one(time[seen], x[seen])
    assert valid.sum() == 8


def test_a_lost_vehicle_is_taken_on_and_one_seen_once_has_the_traffic_s_speed():
    time = np.arange(-40, -4) / 10  # last seen at -0.5 s
    states, valid = _of_one(time, 10.0 * time)
    assert valid.all()
    np.testing.assert_allclose([states[0, -1], states[2, -1]], [0.0, 10.0], atol=1e-6)
    both = np.concatenate([np.arange(-10, 1) / 10, [0.0]])
    x = np.concatenate([8.0 * np.arange(-10, 1) / 10, [50.0]])
    states, _ = states_from_past(both, x, np.full(12, np.nan), np.array([0, 11, 12]), grid=GRID)
    assert states[1, 2, -1] == pytest.approx(8.0)


def test_without_a_lateral_position_there_is_no_lateral_motion():
    time = np.arange(-40, 1) / 10
    states, _ = _of_one(time, 3.0 * time)
    assert np.isnan(states[[1, 3, 5]]).all()
    states, _ = _of_one(time, 3.0 * time, 1.0 + 0.5 * time)
    np.testing.assert_allclose(states[3, -1], 0.5, atol=1e-3)


def test_nobody_is_no_error():
    states, valid = states_from_past(np.zeros(0), np.zeros(0), np.zeros(0), np.array([0]), grid=GRID)
    assert states.shape == (0, 6, 21)
    assert valid.shape == (0, 21)
