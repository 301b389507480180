"""What is seen of a merge scene at t = 0, by hand."""

from dataclasses import replace

import numpy as np
import pytest

from rampcast.models.merge_features import merge_columns, platoon_table, target_gaps, time_with_room
from rampcast.traffic.merge_scenes import BEHIND
from tests.forecast.merges_made_up import LENGTH, merges
from tests.models.platoons_made_up import drive


@pytest.fixture(scope="module")
def scenes():
    return merges(40, seed=3).scenes


def test_gaps_count_from_the_own_rear_and_the_own_front(scenes):
    ahead = scenes.target.x[:, :, -1] - scenes.own.x[:, :1, -1]
    found = target_gaps(scenes)[:, :, -1]
    np.testing.assert_allclose(found[:, BEHIND:], ahead[:, BEHIND:] - LENGTH)
    np.testing.assert_allclose(found[:, :BEHIND], -ahead[:, :BEHIND] - LENGTH)


def test_time_with_room_by_hand(scenes):
    """At 10 m/s beside 12 m/s, a rear 1.1 m ahead of the own front was abreast until 0.55 s ago: two steps."""
    one = scenes.select(np.array([0]))
    own = replace(one.own, x=one.own.x.copy())
    target = replace(one.target, x=one.target.x.copy(), valid=one.target.valid.copy())
    back = np.arange(-20, 1) * 0.2
    own.x[0, 0] = 10.0 * back
    target.x[0] = np.nan
    target.x[0, BEHIND] = LENGTH + 1.1 + 12.0 * back
    assert time_with_room(replace(one, own=own, target=target)) == pytest.approx(0.4)
    target.x[0, BEHIND] = np.nan  # nobody is there
    assert time_with_room(replace(one, own=own, target=target)) == pytest.approx(3.0)


def test_places_count_from_the_vehicle_itself(scenes):
    own, target = (replace(part, x=part.x + 1000.0) for part in (scenes.own, scenes.target))
    moved = replace(scenes, own=own, target=target)
    np.testing.assert_allclose(platoon_table(moved.own), platoon_table(scenes.own), atol=1e-6)
    np.testing.assert_allclose(merge_columns(moved), merge_columns(scenes), atol=1e-6)


def test_an_empty_lane_has_no_gaps_and_infinite_ends_are_missing(scenes):
    empty = replace(scenes.target, valid=np.zeros_like(scenes.target.valid), x=np.full_like(scenes.target.x, np.nan))
    found = merge_columns(replace(scenes, target=empty, to_end=np.full(len(scenes), np.inf)))
    assert np.isnan(found).any()
    assert not np.isinf(found).any()


def test_the_traffic_around_is_told_by_how_much_faster_it_is_and_where_nothing_is_known_nothing_is_told():
    platoons = drive(4, seed=1).platoons
    unknown = platoon_table(platoons)
    speeds = np.array([[3.0, np.nan, 9.0, 1.0, 2.0, 4.0, 5.0], [8.0, 7.0, 6.0, 5.0, 4.0, 3.0, 2.0]])
    told = platoon_table(replace(platoons, traffic=np.broadcast_to(speeds, (4, *speeds.shape))))
    count = speeds.size
    assert np.isnan(unknown[:, -count:]).all()
    np.testing.assert_array_equal(told[:, :-count], unknown[:, :-count])
    np.testing.assert_allclose(told[:, -count:], speeds.ravel() - platoons.v[:, :1, -1])


def test_which_of_several_standing_vehicles_is_the_slowest_hangs_on_no_rounding_error():
    platoons = drive(50, seed=1).platoons
    standing = replace(platoons, v=np.where(np.isnan(platoons.v), np.nan, 0.0))
    noise = 1e-12 * np.random.default_rng(1).standard_normal(platoons.v.shape)
    np.testing.assert_allclose(
        platoon_table(replace(standing, v=standing.v + noise)), platoon_table(standing), atol=1e-10
    )
