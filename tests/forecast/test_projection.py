"""Samples moved to where they are calibrated: to the wanted quantiles, in order, and to a possible future."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rampcast.forecast.projection import ANCHORS, NEAR, OVER_TIME, SAME, TOGETHER, project, shifts
from rampcast.forecast.roll_out import begin, drive
from rampcast.horizon import FUTURE
from rampcast.models.correction import KNOTS, LEVELS
from rampcast.traffic.situation import situation_of_traffic
from tests.forecast.test_roll_out import six
from tests.forecast.traffics_made_up import assert_possible, model, traffics

SAMPLES = 6


def moved(x, counts, wanted):
    out = np.empty(x.shape)
    shifts(x, counts, wanted, out)
    return x + out


@given(st.integers(0, 10**6), st.booleans())
@settings(max_examples=30, deadline=None)
def test_the_quantiles_of_moved_samples_are_the_wanted_ones_and_their_order_stays(seed, some):
    rng = np.random.default_rng(seed)
    x = rng.normal(100.0, 20.0, (3, 200, 2))
    counts = rng.random(x.shape) < 0.6 if some else np.ones(x.shape, dtype=bool)
    wanted = np.sort(rng.normal(120.0, 30.0, (3, 2, len(ANCHORS))), axis=2)
    found = moved(x, counts, wanted)
    for row, knot in np.ndindex(3, 2):
        here = found[row, counts[row, :, knot], knot]
        got = np.quantile(here, LEVELS[ANCHORS], method="weibull")
        spacing = np.diff(np.sort(here)).max()  # between two samples the map has a corner
        np.testing.assert_allclose(got, wanted[row, knot], atol=0.05 + spacing)
        order = np.argsort(x[row, :, knot] + SAME * (np.arange(200) + 0.5) / 200)
        assert (np.diff(found[row, order, knot]) >= -1e-9).all()


def test_samples_that_have_the_wanted_quantiles_stay_where_they_are():
    x = np.random.default_rng(1).normal(100.0, 20.0, (1, 400, 1))
    wanted = np.quantile(x[0, :, 0], LEVELS[ANCHORS], method="weibull")[None, None]
    np.testing.assert_allclose(moved(x, np.ones(x.shape, dtype=bool), wanted), x, atol=0.03)


def test_samples_that_lie_in_one_place_are_drawn_apart():
    x = np.full((1, 100, 1), 50.0)
    wanted = np.array([[[48.0, 49.0, 50.0, 51.0, 52.0]]])
    found = moved(x, np.ones(x.shape, dtype=bool), wanted)[0, :, 0]
    got = np.quantile(found, LEVELS[ANCHORS], method="weibull")
    np.testing.assert_allclose(got, wanted[0, 0], atol=0.05)


def test_moves_are_straight_between_knots_and_nothing_at_t_0():
    np.testing.assert_allclose(OVER_TIME.sum(axis=1)[KNOTS[0] + 2 :], 1.0)
    np.testing.assert_allclose(OVER_TIME @ (KNOTS + 1.0), np.clip(np.arange(1, FUTURE + 1), None, 75.0), atol=1.0)


def projected(traffic, shift, *, seed=1):
    made, situation = model(hazard=-1.0), situation_of_traffic(traffic)
    beginning = begin(made, situation)
    driven = drive(made, beginning, samples=SAMPLES, seed=seed)
    x, lane = driven.x.copy(), driven.lane.copy()
    fastest = np.maximum(made.limit, beginning.start.v)
    moves = np.broadcast_to(shift, (len(x), SAMPLES, len(KNOTS))).astype(np.float32)
    project(beginning.start, fastest, moves, OVER_TIME, NEAR, (0, 1), (0, SAMPLES), x, lane)
    return situation, driven, x, lane


@given(traffics(), st.sampled_from((-40.0, -5.0, 5.0, 60.0)))
@settings(max_examples=40, deadline=None)
def test_moved_samples_of_any_traffic_are_possible(traffic, size):
    """All vehicles are moved by different lengths, some back and some on."""
    count = len(situation_of_traffic(traffic).lane)
    shift = size * np.random.default_rng(1).normal(0.5, 1.0, (count, SAMPLES, 1)) * np.linspace(0.1, 1.0, len(KNOTS))
    situation, _, x, lane = projected(traffic, shift)
    start = situation.x[:, -1]
    assert_possible(x, lane, start=start, length=situation.length, end=situation.end[0])
    speed = np.diff(x, axis=2, prepend=np.broadcast_to(start[:, None, None], (count, SAMPLES, 1))) / 0.2
    assert (speed <= np.maximum(situation.v[:, -1], 30.0)[:, None, None] + 0.01).all()


@pytest.mark.parametrize("seed", range(4))
def test_without_moves_nearly_all_stays_as_it_was_driven(seed):
    """Roll-outs accelerate and brake within what projection allows, so they are possible for it too."""
    _, driven, x, lane = projected(six(seed), 0.0)
    np.testing.assert_array_equal(lane, driven.lane)
    np.testing.assert_allclose(x, driven.x, atol=1e-3)


def test_a_vehicle_with_room_goes_where_it_is_moved():
    """The first of its lane is moved on by a metre; a merge in front of it may hold it up for a moment."""
    situation, driven, _, _ = projected(six(2), 0.0)
    first = int(np.argmax(np.where(situation.lane == situation.lane[3], situation.x[:, -1], -np.inf)))
    shift = np.zeros((6, SAMPLES, len(KNOTS)))
    shift[first] = 1.0
    _, _, x, _ = projected(six(2), shift)
    off = x[first, :, KNOTS[1] :] - driven.x[first, :, KNOTS[1] :] - 1.0
    assert np.quantile(np.abs(off), 0.99) < 0.02


def test_all_of_a_move_at_a_knot_is_made_there():
    weight = np.zeros(OVER_TIME.shape)
    for step, first in enumerate(NEAR.tolist()):
        weight[step, first : first + TOGETHER] = OVER_TIME[step, first : first + TOGETHER]
    np.testing.assert_array_equal(weight, OVER_TIME)
    np.testing.assert_allclose(weight[KNOTS[1] :].sum(axis=1), 1.0)
