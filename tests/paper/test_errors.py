"""Position errors against numbers worked out by hand."""

import numpy as np
import pytest

from rampcast.evaluate.positions import position_errors
from rampcast.horizon import FUTURE
from rampcast.paper.errors import central_errors, neighbour_errors
from rampcast.paper.neighbours.predict import NeighbourForecast, continue_at_constant_speed
from rampcast.paper.scenes.scenes import CENTRAL, FOLLOWER, LEADER
from rampcast.traffic.anchors import X
from tests.factories import random_scenes


def test_errors_of_three_forecasts_worked_out_by_hand():
    observed = np.zeros((3, 10))
    predicted = np.tile([[4.0], [-6.0], [11.0]], (1, 10))
    valid = np.ones((3, 10), dtype=bool)
    valid[2, 5:] = False
    table = position_errors(predicted, observed, valid)
    assert table["horizon"].to_list() == [1.0, 2.0]
    assert table["n"].to_list() == [3, 2]
    assert table["within_5"].to_list() == [pytest.approx(1 / 3), 0.5]
    assert table["within_10"].to_list() == [pytest.approx(2 / 3), 1.0]
    assert table["mean_error"].to_list() == [7.0, 5.0]
    assert table["bias"].to_list() == [3.0, -1.0]


def test_a_second_that_nobody_was_seen_for_has_no_error_but_a_count_of_zero():
    table = position_errors(np.zeros((2, 5)), np.zeros((2, 5)), np.zeros((2, 5), dtype=bool))
    assert table.row(0) == (1.0, 0, None, None, None, None)


def test_the_truth_itself_has_no_error_and_every_scene_that_was_seen_counts():
    scenes = random_scenes(np.random.default_rng(4), 40)
    table = central_errors(scenes, {"truth": np.nan_to_num(scenes.future[:, CENTRAL, :, X])})
    assert table["mean_error"].drop_nulls().max() == 0.0
    assert table["n"].to_list() == scenes.future_valid[:, CENTRAL, 4::5].sum(axis=0).tolist()


def test_neighbour_errors_count_each_seen_neighbour_against_its_own_truth():
    scenes = random_scenes(np.random.default_rng(5), 40)
    truth = continue_at_constant_speed(scenes, steps=FUTURE).x
    truth[:, :, 1:] = np.where(scenes.future_valid, scenes.future[..., X], 1e6)
    table = neighbour_errors(scenes, NeighbourForecast(x=truth + 3.0, v=truth))
    ramp = table.filter(table["group"] == "ramp_neighbour")
    assert ramp["n"].to_list() == scenes.future_valid[:, [LEADER, FOLLOWER], 4::5].sum(axis=(0, 1)).tolist()
    assert table["mean_error"].to_numpy() == pytest.approx(3.0)
    assert table["bias"].to_numpy() == pytest.approx(3.0)
