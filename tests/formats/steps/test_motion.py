"""The direction of travel is told from positions, and kept while a vehicle stands."""

import numpy as np
import pytest

from rampcast.formats.steps.motion import directions

STEP = 0.1  # [s]


def heading(track, px, py):
    ux, uy = directions(np.array(track), np.array(px, float), np.array(py, float), time_step=STEP)
    return np.degrees(np.arctan2(uy, ux)).round(6), np.hypot(ux, uy)


def test_a_vehicle_on_a_straight_line_heads_along_it():
    # 3-4-5 triangle: 4 m east and 3 m north a step: atan2(3, 4) = 36.869898 degrees
    steps = np.arange(20)
    angle, length = heading(np.zeros(20, int), 4.0 * steps, 3.0 * steps)
    assert angle == pytest.approx(36.869898)
    assert length == pytest.approx(1.0)


def test_on_a_circle_the_direction_is_the_tangent():
    # 20 m/s on a radius of 300 m: 0.4 degrees a step; the chord from 0.5 s before to 0.5 s after is parallel to it
    turned = 20 * STEP * np.arange(100) / 300
    angle, _ = heading(np.zeros(100, int), 300 * np.sin(turned), 300 * (1 - np.cos(turned)))
    assert angle[5:-5] == pytest.approx(np.degrees(turned)[5:-5], abs=1e-6)
    assert angle == pytest.approx(np.degrees(turned), abs=1.0)  # one-sided at the ends: half of 0.5 s


def test_a_standing_vehicle_keeps_its_last_direction_or_has_its_next():
    # stands 10 steps, drives north 20 steps at 10 m/s, stands again with noise of a few centimetres
    rng = np.random.default_rng(0)
    y = np.r_[np.zeros(10), np.arange(1, 21), np.full(30, 20.0)]
    x = np.r_[np.zeros(30), rng.normal(0, 0.03, 30)]
    angle, length = heading(np.zeros(60, int), x, y)
    assert angle == pytest.approx(90.0, abs=2.0)
    assert length == pytest.approx(1.0)


def test_a_vehicle_that_never_moves_has_the_direction_of_whoever_was_near():
    west = -np.arange(20.0)
    track = np.repeat([0, 1, 2], 20)
    px = np.r_[west, np.full(20, -10.0), -west]
    py = np.r_[np.zeros(20), np.full(20, 3.0), np.full(20, 50.0)]
    angle, _ = heading(track, px, py)
    assert angle[20:40] == pytest.approx(180.0)


def test_tracks_do_not_mix_and_nothing_at_all_is_no_error():
    angle, _ = heading([0, 0, 1, 1], [0, 5, 100, 95], [0, 0, 0, 0])
    assert angle.tolist() == [0, 0, 180, 180]
    assert heading([0, 1], [0, 1], [0, 1])[1].tolist() == [0, 0]
    assert len(heading(np.zeros(0, int), [], [])[1]) == 0
