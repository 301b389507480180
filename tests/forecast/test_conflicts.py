"""Probabilities of conflicts, by hand: one scene, two or four samples, steps of 0.2 s."""

import numpy as np
import pytest

from rampcast.forecast.conflicts import conflicts

STEPS = 20
TIME = 0.2 * np.arange(1, STEPS + 1)
NEVER = STEPS


def at_speed(*speeds: float, start: float = 0.0) -> np.ndarray:
    """Returns samples [1 sample step] at constant speeds [m/s]."""
    return start + np.array(speeds)[None, :, None] * TIME


def found(x, *, rear=None, front=None, merge_step=None, length=5.0):
    count = x.shape[1]
    return conflicts(
        x,
        leader_rear=np.full_like(x, np.nan) if rear is None else rear,
        follower_front=np.full_like(x, np.nan) if front is None else front,
        length=np.array([length]),
        merge_step=np.full((1, count), NEVER) if merge_step is None else np.array([merge_step]),
    )


def test_alone_on_the_road_there_is_no_conflict():
    alone = found(at_speed(10.0, 20.0))
    assert not alone.time_to_collision.any()
    assert not alone.deceleration.any()
    assert not alone.encroachment.any()


def test_time_to_collision_counts_from_the_step_in_which_it_falls_below_3_s():
    """At 10 m/s behind a rear 41 m ahead at 5 m/s: 8.2 s at first, so 3 s after 5.2 s; 21 m ahead: after 1.2 s."""
    x = at_speed(10.0, 10.0)
    rear = np.concatenate([at_speed(5.0, start=41.0), at_speed(5.0, start=21.05)], axis=1)
    below = found(x, rear=rear).time_to_collision[0]
    np.testing.assert_array_equal(below, np.where(TIME > 1.21, 0.5, 0.0))


def test_deceleration_counts_from_the_step_in_which_it_rises_above_3():
    """Closing in at 10 m/s needs more than 3 m/s^2 below a gap of 100 / 6 = 16.7 m: from 28.7 m on after 1.2 s."""
    hard = found(at_speed(15.0), rear=at_speed(5.0, start=28.7)).deceleration[0]
    np.testing.assert_array_equal(hard, TIME > 1.21)


def test_a_conflict_that_has_passed_has_still_been():
    x = at_speed(10.0)
    rear = at_speed(5.0, start=11.0)
    rear[0, 0, 5:] = np.nan  # the leader leaves the lane after 1 s
    np.testing.assert_array_equal(found(x, rear=rear).time_to_collision[0], np.ones(STEPS))


def test_another_leader_that_merges_in_front_is_no_leader_that_drives_backwards():
    """From 1 s on somebody else is 12 m ahead, as fast as the vehicle itself."""
    x = at_speed(10.0)
    rear = at_speed(10.0, start=40.0)
    rear[0, 0, 5:] = x[0, 0, 5:] + 12.0
    assert not found(x, rear=rear).time_to_collision.any()


def test_a_new_leader_at_the_merge_has_its_own_speed():
    """At the merge the leader jumps from 12 m to 13 m ahead, which is not 15 m/s."""
    x = at_speed(10.0)
    rear = at_speed(10.0, start=12.0)
    rear[0, 0, 5:] += at_speed(-2.0, start=3.0)[0, 0, 5:]
    merged = found(x, rear=rear, merge_step=[5])
    # 15 - 2 t ahead, closing in at 2 m/s: below 6 m after 4.5 s, which is not reached
    assert not merged.time_to_collision.any()


def test_after_the_merge_the_vehicle_behind_counts_too():
    """It merges at 1 s; behind it one comes at 15 m/s, 20.1 m behind at first: 20.1 - 5 t below 15 m from 1.02 s on."""
    x, front = at_speed(10.0), at_speed(15.0, start=-25.1)
    behind = found(x, front=np.where(TIME > 0.9, front, np.nan), merge_step=[4])
    np.testing.assert_array_equal(behind.time_to_collision[0], TIME > 1.01)


@pytest.mark.parametrize(("gap", "expected"), [(19.0, 1.0), (21.0, 0.0)])
def test_encroachment_ahead_is_the_time_since_the_leader_was_there(gap, expected):
    """At 10 m/s its rear was at the place of the merge gap / 10 ago."""
    x = at_speed(10.0)
    assert found(x, rear=at_speed(10.0, start=gap), merge_step=[3]).encroachment[0] == expected
    assert found(x, rear=at_speed(10.0, start=gap)).encroachment[0] == 0.0  # it never merges


@pytest.mark.parametrize(("gap", "expected"), [(19.0, 1.0), (21.0, 0.0)])
@pytest.mark.parametrize("step", [3, STEPS - 1])
def test_encroachment_behind_is_the_time_until_the_follower_is_there(gap, expected, step):
    """Its front is gap + 5 m (the length) behind; also where it would be there after the last step only."""
    x, front = at_speed(10.0), at_speed(10.0, start=-5.0 - gap)
    front[0, 0, :step] = np.nan
    assert found(x, front=front, merge_step=[step]).encroachment[0] == expected


def test_probabilities_are_shares_of_the_samples_and_never_fall():
    chance = np.random.default_rng(1)
    speed = chance.uniform(0, 20, (70, 30, STEPS))
    x = np.cumsum(speed, axis=2) * 0.2
    rear = 20.0 + np.cumsum(chance.uniform(0, 20, speed.shape), axis=2) * 0.2
    some = conflicts(
        x,
        leader_rear=np.maximum(rear, x),
        follower_front=np.full_like(x, np.nan),
        length=np.full(70, 4.5),
        merge_step=chance.integers(0, STEPS + 1, (70, 30)),
    )
    for shares in (some.time_to_collision, some.deceleration):
        assert shares.shape == (70, STEPS)
        assert (np.diff(shares, axis=1) >= 0).all()
        np.testing.assert_allclose(shares * 30, np.round(shares * 30), atol=1e-4)
    assert ((some.encroachment >= 0) & (some.encroachment <= 1)).all()
    assert 0 < some.time_to_collision[:, -1].mean() <= 1
