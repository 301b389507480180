"""Situations: lanes, leaders and ends as a plain look finds them; parts and joins lose nothing."""

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rampcast.traffic.situation import (
    NOBODY,
    ROWS_OF_DRAWS,
    Situation,
    joined_situations,
    rows_of_draws,
    situation_of_traffic,
)
from tests.forecast.traffics_made_up import RAMP, SITE, traffic_of, traffics


def assert_same(one: Situation, other: Situation) -> None:
    for field in fields(Situation):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name), err_msg=field.name)


@given(traffics())
@settings(max_examples=40, deadline=None)
def test_leaders_are_the_next_ahead_in_the_lane_and_nobody_overlaps(traffic):
    found = situation_of_traffic(traffic)
    x = found.x[:, -1]
    assert not (x > found.end[0, found.lane]).any()
    for one in range(len(x)):
        ahead = [n for n in range(len(x)) if found.lane[n] == found.lane[one] and x[n] > x[one]]
        nearest = min(ahead, key=lambda n: x[n], default=NOBODY)
        assert found.leader[one] == nearest or x[found.leader[one]] == x[one]
        if ahead:
            assert x[nearest] - found.length[nearest] >= x[one] - 1e-9
            assert found.gap[one] >= -1e-9
        elif found.leader[one] == NOBODY:
            assert found.gap[one] == np.inf
    assert (found.length >= 0.0).all()


@given(traffics(), traffics(), traffics())
@settings(max_examples=20, deadline=None)
def test_what_is_joined_comes_apart_as_it_was(first, second, third):
    parts = [situation_of_traffic(one) for one in (first, second, third)]
    together = joined_situations(parts)
    assert len(together) == 3
    count = together.end.shape[1]
    for number, part in enumerate(parts):
        alone = together.select(np.array([number]))
        for field in fields(Situation):
            mine, its = getattr(alone, field.name), getattr(part, field.name)
            of_lanes = its.ndim == 2 and its.shape[0] == 1 and field.name not in ("x", "v", "a", "valid")
            np.testing.assert_array_equal(mine[:, : its.shape[1]] if of_lanes else mine, its, err_msg=field.name)
    assert_same(together.select(np.arange(3)), together)
    swapped = together.select(np.array([2, 0, 1]))
    assert swapped.end.shape[1] == count
    assert_same(swapped.select(np.array([1, 2, 0])), together)


def test_a_vehicle_beyond_the_end_of_its_lane_is_in_the_lane_that_it_goes_into():
    x = np.array([SITE.ramp_end - 10.0, SITE.ramp_end + 10.0])
    found = situation_of_traffic(
        traffic_of(x, np.full(2, 10.0), np.full(2, RAMP), seen=np.full(2, 40), vehicle=np.arange(2))
    )
    assert found.merging.tolist() == [True, False]
    assert found.lane[1] == found.target[0, found.lane[0]]


def test_vehicles_of_unknown_lanes_lead_nobody():
    lane = np.array([0, 0, 6])
    found = situation_of_traffic(
        traffic_of(np.array([50.0, 80.0, 110.0]), np.full(3, 9.0), lane, seen=np.full(3, 40), vehicle=np.arange(3))
    )
    assert len(set(found.lane.tolist())) == 3
    assert (found.leader == NOBODY).all()


def test_room_beside_counts_from_the_moment_on_from_which_there_is_some():
    """3 m/s slower than the one in the target lane, whose rear passed its front 1 s ago."""
    lane, v = np.array([RAMP, 6]), np.array([9.0, 12.0])
    x = np.array([100.0, 100.0 + 3.0 + 0.1 + 6.0])  # 3.1 m ahead of its front is the rear of 6 m of the other
    found = situation_of_traffic(traffic_of(x, v, lane, seen=np.full(2, 40), vehicle=np.arange(2)))
    assert found.ready[0] == pytest.approx(1.0)
    assert found.ready[1] == 0.0


@given(st.lists(st.integers(0, 10**9), unique=True, max_size=400), st.booleans())
@settings(max_examples=30, deadline=None)
def test_no_two_vehicles_share_random_numbers_while_there_are_rows(numbers, named):
    ids = np.array([f"car {one}" for one in numbers], dtype=np.str_) if named else np.array(numbers, dtype=np.int64)
    rows = rows_of_draws(ids)
    assert len(set(rows.tolist())) == len(numbers)
    assert ((rows >= 0) & (rows < ROWS_OF_DRAWS)).all()
    if len(ids):
        assert rows_of_draws(ids[:1])[0] == rows[0]


def test_of_more_vehicles_than_rows_some_share():
    rows = rows_of_draws(np.arange(ROWS_OF_DRAWS + 88))
    assert len(set(rows.tolist())) == ROWS_OF_DRAWS
