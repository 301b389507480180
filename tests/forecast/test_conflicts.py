"""Leaders, gaps and conflicts in the samples of a forecast: by hand, and against plain loops."""

from dataclasses import replace

import numpy as np
import pytest

from rampcast.forecast.conflicts import SLOW
from rampcast.forecast.leaders import NOBODY, leaders
from rampcast.horizon import FUTURE, STEP
from rampcast.physics.safety import deceleration_to_avoid_crash, post_encroachment_time, time_to_collision
from rampcast.sites.site import NO_LANE
from tests.forecast.forecasts_made_up import RAMP, TARGET, TIME, driving, random_forecast


def plain_leader(forecast, one, sample, step):
    x, lane = forecast.samples[:, sample, step], forecast.lane[:, sample, step]
    ahead = [other for other in range(len(x)) if lane[other] == lane[one] != NO_LANE and x[other] > x[one]]
    return min(ahead, key=lambda other: x[other], default=NOBODY)


def plain_follower(forecast, one, sample, step):
    led = [other for other in range(len(forecast)) if plain_leader(forecast, other, sample, step) == one]
    return led[0] if led else NOBODY


def test_the_leader_is_the_next_one_ahead_in_the_lane_then():
    forecast = random_forecast(3, vehicles=9, samples=6)
    forecast.lane[2] = NO_LANE
    found = leaders(forecast.samples, forecast.lane)
    plain = [plain_leader(forecast, *at) for at in np.ndindex(found.shape)]
    np.testing.assert_array_equal(found, np.reshape(plain, found.shape))
    assert (found[2] == NOBODY).all()
    assert not (found == 2).any()
    assert (found[[0, 1, 3]] != NOBODY).any()


def test_nobody_has_a_leader_where_nobody_is():
    assert leaders(np.zeros((0, 3, 4), dtype=np.float32), np.zeros((0, 3, 4), dtype=np.int16)).shape == (0, 3, 4)


def test_a_merge_goes_into_the_gap_between_those_who_are_there_then():
    """One from 0 m at 20 m/s merges after 5 s at 100 m: it has passed one of 60 m at 2 m/s."""
    forecast = driving(
        start=[0.0, 60.0, 150.0, -100.0], lane=[RAMP, TARGET, TARGET, TARGET], speed=[20.0, 2.0, 2.0, 30.0],
        merge=[5.0, None, None, None],
    )  # fmt: skip
    assert forecast.gap.rows() == [(101, 1, 103, 102, 1.0)]
    faster = replace(forecast, samples=forecast.samples.copy())
    faster.samples[3] += 60.0  # at 110 m when the other is at 100 m
    assert faster.gap.rows() == [(101, 0, 104, 102, 1.0)]  # one passed, and was passed by another
    assert forecast[101].gap.rows() == [(1, 103, 102, 1.0)]


def test_at_an_end_of_the_traffic_a_gap_has_one_side():
    forecast = driving(start=[0.0, 30.0], lane=[RAMP, TARGET], speed=[10.0, 10.0], merge=[1.0, None])
    assert forecast.gap.rows() == [(101, 0, 102, None, 1.0)]


def test_gaps_are_those_that_a_plain_loop_counts():
    forecast = random_forecast(5, vehicles=9, samples=7)
    ahead, behind, _ = forecast.gap_sides
    merges = 0
    for one, sample in np.ndindex(ahead.shape):
        step = forecast.merge_step[one, sample]
        if step < FUTURE:
            merges += 1
            assert ahead[one, sample] == plain_leader(forecast, one, sample, step)
            assert behind[one, sample] == plain_follower(forecast, one, sample, step)
        else:
            assert ahead[one, sample] == behind[one, sample] == NOBODY
    assert merges > 5


def test_the_probabilities_of_the_gaps_add_up_to_that_of_a_merge():
    forecast = random_forecast(6)
    merging = {one: forecast[one].gap["p"].sum() for one in forecast.vehicle.tolist()}
    np.testing.assert_allclose(list(merging.values()), forecast.p_merged[:, -1])
    assert 0.2 < max(merging.values())


def test_time_to_collision_counts_from_the_step_in_which_it_falls_below_3_s():
    """At 10 m/s behind a rear 21.05 m ahead at 5 m/s: 4.2 s at first, so below 3 s after 1.2 s."""
    forecast = driving(start=[0.0, 26.05], lane=[TARGET, TARGET], speed=[10.0, 5.0], merge=[None, None])
    np.testing.assert_array_equal(forecast.conflicts.time_to_collision, [TIME > 1.21, np.zeros(FUTURE)])


def test_deceleration_counts_from_the_step_in_which_it_rises_above_3():
    """Closing in at 10 m/s needs more than 3 m/s^2 below a gap of 100 / 6 = 16.7 m: from 28.7 m on after 1.2 s."""
    forecast = driving(start=[0.0, 33.7], lane=[TARGET, TARGET], speed=[15.0, 5.0], merge=[None, None])
    np.testing.assert_array_equal(forecast.conflicts.deceleration, [TIME > 1.21, np.zeros(FUTURE)])


def test_a_conflict_that_has_passed_has_still_been():
    forecast = driving(start=[0.0, 11.0], lane=[TARGET, TARGET], speed=[10.0, 5.0], merge=[None, None])
    forecast.lane[1, 0, 5:] = 5  # the leader leaves the lane after 1 s
    np.testing.assert_array_equal(forecast.conflicts.time_to_collision[0], np.ones(FUTURE))


def test_after_the_merge_the_vehicle_behind_counts_too():
    """It merges at 1 s; behind it one comes at 15 m/s, 20.1 m behind at first: 20.1 - 5 t below 15 m from 1.02 s on."""
    forecast = driving(start=[0.0, -25.1], lane=[RAMP, TARGET], speed=[10.0, 15.0], merge=[1.0, None])
    np.testing.assert_array_equal(forecast.conflicts.time_to_collision, np.tile(TIME > 1.01, (2, 1)))
    stays = driving(start=[0.0, -25.1], lane=[TARGET, TARGET], speed=[10.0, 15.0], merge=[None, None])
    assert not stays.conflicts.time_to_collision[0].any()  # it is the other's conflict, who can brake


@pytest.mark.parametrize(("gap", "expected"), [(19.0, 1.0), (21.0, 0.0)])
def test_encroachment_ahead_is_the_time_since_the_leader_was_there(gap, expected):
    """At 10 m/s its rear was at the place of the merge gap / 10 ago."""
    merging = driving(start=[0.0, gap + 5.0], lane=[RAMP, TARGET], speed=[10.0, 10.0], merge=[1.0, None])
    assert merging.conflicts.encroachment.tolist() == [expected, 0.0]
    assert not replace(merging, lane=np.full_like(merging.lane, RAMP)).conflicts.encroachment.any()


@pytest.mark.parametrize(("gap", "expected"), [(19.0, 1.0), (21.0, 0.0)])
@pytest.mark.parametrize("merge", [1.0, 15.0])
def test_encroachment_behind_is_the_time_until_the_follower_is_there(gap, expected, merge):
    """Its front is gap + 5 m (the length) behind; also where it would be there after the last step only."""
    merging = driving(start=[0.0, -gap - 5.0], lane=[RAMP, TARGET], speed=[10.0, 10.0], merge=[merge, None])
    assert merging.conflicts.encroachment.tolist() == [expected, 0.0]


@pytest.mark.usefixtures("double_precision")
def test_conflicts_are_those_that_a_plain_loop_finds_with_the_laws():
    forecast = random_forecast(7, vehicles=8, samples=4)
    x, v, length = (values.astype(float) for values in (forecast.samples, forecast.speeds, forecast.length))
    close, hard = np.zeros((2, 8, 4, FUTURE), dtype=bool)
    for one, sample, step in np.ndindex(x.shape):
        ahead = plain_leader(forecast, one, sample, step)
        if ahead == NOBODY:
            continue
        gap = x[ahead, sample, step] - length[ahead] - x[one, sample, step]
        speeds = {"speed": v[one, sample, step], "leader_speed": v[ahead, sample, step]}
        for found, beyond in ((close, time_to_collision(gap, **speeds) < 3.0),
                              (hard, deceleration_to_avoid_crash(gap, **speeds) > 3.0)):  # fmt: skip
            found[one, sample, step] |= bool(beyond)
            found[ahead, sample, step] |= bool(beyond) and step >= forecast.merge_step[ahead, sample]
    for found, plain in ((forecast.conflicts.time_to_collision, close), (forecast.conflicts.deceleration, hard)):
        np.testing.assert_allclose(found, np.logical_or.accumulate(plain, axis=2).mean(axis=1))
        assert 0.0 < plain.mean() < 1.0


def test_encroachments_are_those_that_a_plain_loop_finds():
    forecast = random_forecast(8, vehicles=8, samples=30)
    x, v, found = forecast.samples.astype(float), forecast.speeds.astype(float), np.zeros((8, 30), dtype=bool)
    far = x[:, :, -1:] + v[:, :, -1:] * TIME  # those who go on at their speed
    x_on, v_on = np.concatenate([x, far], axis=2), np.concatenate([v, np.repeat(v[:, :, -1:], FUTURE, axis=2)], axis=2)
    for one, sample in np.argwhere(forecast.merge_step < FUTURE):
        step = forecast.merge_step[one, sample]
        ahead, behind = plain_leader(forecast, one, sample, step), plain_follower(forecast, one, sample, step)
        if ahead != NOBODY:
            gap = x[ahead, sample, step] - forecast.length[ahead] - x[one, sample, step]
            found[one, sample] |= gap / max(v[ahead, sample, step], SLOW) < 2.0
        if behind != NOBODY:
            place = x[one, sample, step] - forecast.length[one]
            later = step + int(np.argmax(x_on[behind, sample, step:] >= place))
            over = (x_on[behind, sample, later] - place) / max(v_on[behind, sample, later], SLOW)
            found[one, sample] |= float(post_encroachment_time(step * STEP, later * STEP - over)) < 2.0
    np.testing.assert_allclose(forecast.conflicts.encroachment, found.mean(axis=1))
    assert 0.0 < found.mean() < 1.0
