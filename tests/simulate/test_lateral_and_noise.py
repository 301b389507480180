"""Lateral paths and position noise."""

import numpy as np
import pytest

from rampcast.recording import Recording, read_recording
from rampcast.recording import columns as c
from rampcast.simulate import add_position_noise, shipped_sample
from rampcast.simulate.lateral import CHANGE_TIME, OFFSET, WANDER, lateral_path

CENTRES = {6: -20.0, 7: -23.7}
STRAY = 4 * OFFSET + 3 * WANDER  # [m] as far as a driver strays from the centre


def path_of_a_merge(x: np.ndarray, *, change: int) -> np.ndarray:
    lane = np.where(np.arange(len(x)) < change, 7, 6)
    centre = np.array([CENTRES[k] for k in lane])
    stream = np.random.default_rng(0)
    return lateral_path(x, centre, lane=lane, lane_centres=CENTRES, time_step=0.1, stream=stream)


def test_a_path_leads_from_the_centre_of_one_lane_to_that_of_the_next() -> None:
    y = path_of_a_merge(np.arange(300) * 1.0, change=150)
    assert abs(y[0] - CENTRES[7]) < STRAY
    assert abs(y[-1] - CENTRES[6]) < STRAY


def test_a_path_has_no_jump_where_the_label_changes() -> None:
    y = path_of_a_merge(np.arange(300) * 1.0, change=150)
    assert np.abs(np.diff(y)).max() < 0.2


def test_a_path_takes_as_long_as_lane_changes_do() -> None:
    y = path_of_a_merge(np.arange(300) * 1.0, change=150)
    moving = np.flatnonzero(np.abs(np.diff(y)) > 0.03)
    assert (moving[-1] - moving[0]) * 0.1 < CHANGE_TIME[1]


def test_a_vehicle_that_stands_does_not_move_sideways() -> None:
    x = np.concatenate([np.arange(150) * 1.0, np.full(100, 149.0), 149.0 + np.arange(100)])
    y = path_of_a_merge(x, change=155)
    assert np.ptp(y[151:250]) < 1e-9
    assert abs(y[-1] - CENTRES[6]) < STRAY


@pytest.fixture(scope="module")
def window() -> Recording:
    return read_recording(shipped_sample()[0])


def test_noise_has_the_asked_for_size_and_half_of_it_across(window: Recording) -> None:
    noisy = add_position_noise(window, standard_deviation=0.2, seed=1)
    for axis, expected in ((c.X, 0.2), (c.Y, 0.1)):
        error = (noisy.tracks[axis] - window.tracks[axis]).to_numpy()
        assert error.std() == pytest.approx(expected, rel=0.03)
        assert abs(error.mean()) < 0.02 * expected


def test_noise_of_neighbouring_frames_is_alike(window: Recording) -> None:
    noisy = add_position_noise(window, standard_deviation=0.2, seed=1)
    error = (noisy.tracks[c.X] - window.tracks[c.X]).to_numpy()
    assert np.corrcoef(error[1:], error[:-1])[0, 1] == pytest.approx(np.exp(-0.1 / 0.3), abs=0.02)


def test_noise_changes_nothing_but_positions(window: Recording) -> None:
    noisy = add_position_noise(window, standard_deviation=0.2, seed=1)
    assert noisy.tracks.drop(c.X, c.Y).equals(window.tracks.drop(c.X, c.Y))


def test_noise_of_the_same_seed_is_the_same(window: Recording) -> None:
    once, again, other = (add_position_noise(window, standard_deviation=0.2, seed=seed) for seed in (1, 1, 2))
    assert once.tracks.equals(again.tracks)
    assert not once.tracks.equals(other.tracks)


def test_no_noise_is_the_recording_itself(window: Recording) -> None:
    assert add_position_noise(window, standard_deviation=0.0, seed=1) is window
