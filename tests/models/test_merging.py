"""The hazard of merging: its features by hand, who counts when, and that a known hazard is found again."""

import numpy as np
import pytest

from rampcast.models.merge_loops import merge_features
from rampcast.models.merging import (
    FEATURES,
    LANE_GOES_ON,
    LEAST_EVENTS,
    MARGIN,
    RARE,
    UNKNOWN_OFFSET,
    fit_merge_hazard,
    merge_periods,
    merge_zone,
    person_periods,
)

STEPS = 75


def features_of(**changes):
    """Returns the features of 10 m/s between vehicles 10 m ahead at 8 m/s and 20 m behind at 12 m/s."""
    state = {"v": 10.0, "lead_gap": 10.0, "lead_v": 8.0, "lag_gap": 20.0, "lag_v": 12.0, "ready": 1.0, "into": 15.0}
    state |= {"left": 60.0, "offset": UNKNOWN_OFFSET, "approach": 0.0, "time": 0.0} | changes
    found = np.full(FEATURES, np.nan)
    merge_features(found, *state.values())
    return found


def test_features_by_hand():
    """The gap ahead closes at 2 m/s: 4 / 20 = 0.2 m/s^2; that behind at 2 m/s: 4 / 40 = 0.1; in 1.5 s 7 and 17 m."""
    expected = [0, np.log(2), 0, 0, 0.4, 0, 0.4, 0, 0.1, 0.05, 0.7, 0.5, 1.0, np.exp(-1), 0.6, np.exp(-1), 0, 0, 0]
    np.testing.assert_allclose(features_of(), expected, atol=1e-6)
    assert len(expected) == FEATURES


def test_a_vehicle_abreast_leaves_no_room():
    found = features_of(lead_gap=-3.0, lag_gap=-1.0)
    assert found[2] == found[3] == 1.0
    assert found[10] == pytest.approx(-0.6)  # the lead recedes by -3 - 3 = -6 m


def test_nobody_in_the_lane_is_a_wide_gap_at_the_own_speed():
    found = features_of(lead_gap=np.inf, lead_v=10.0, lag_gap=np.inf, lag_v=10.0)
    assert np.isfinite(found).all()
    np.testing.assert_array_equal(found[4:10], 0.0)


def test_lateral_motion_tells_when_the_line_is_crossed():
    """0.5 m from the line at 0.5 m/s: it is crossed after 1 s."""
    about_now = [features_of(offset=0.5, approach=0.5, time=time)[17] for time in (0.0, 1.0, 2.0)]
    by_now = [features_of(offset=0.5, approach=0.5, time=time)[18] for time in (0.9, 1.1)]
    assert about_now[1] == pytest.approx(1.0)
    assert about_now[0] == pytest.approx(about_now[2])
    assert by_now[0] == 0.0 < by_now[1]
    assert features_of(offset=0.5, approach=0.1)[17] == 0.0  # noise


def test_who_is_at_risk_when_and_who_merges_when():
    """0.5 s lies in the third step; 0.6 s seen without a merge are three steps; merged before, nobody is at risk."""
    at_risk, event = person_periods(np.array([0.5, np.nan, -0.2]), np.array([15.0, 0.6, 15.0]), steps=5)
    assert at_risk.tolist() == [[True] * 3 + [False] * 2, [True] * 3 + [False] * 2, [False] * 5]
    assert event.tolist() == [[False, False, True, False, False], [False] * 5, [False] * 5]


def test_vehicles_merge_between_the_first_and_the_last_merge():
    """Merges 100 - 10 = 90 m and 70 m before the end; one was not seen, one is farther than the truth goes."""
    truth = np.cumsum(np.full((4, STEPS), 2.0), axis=1)
    first, last = merge_zone(np.array([100.0, 80.0, 500.0, 300.0]), truth, np.array([1.0, 1.0, np.nan, 20.0]))
    assert (first, last) == (90.0 + MARGIN, 70.0 - MARGIN)
    endless = merge_zone(np.full(4, np.inf), truth, np.full(4, 1.0))
    assert endless == (LANE_GOES_ON, 0.0)


def test_a_known_hazard_is_found_again():
    """2,000 vehicles with one feature that counts: logit -3 + 2 times it; half are lost sight of after 5 s."""
    rng = np.random.default_rng(1)
    features = rng.normal(0.0, 1.0, (2000, 1, STEPS, FEATURES))
    p = 1.0 / (1.0 + np.exp(3.0 - 2.0 * features[:, 0, :, 0]))
    merges = rng.random(p.shape) < p
    change = np.where(merges.any(axis=1), (merges.argmax(axis=1) + 1) * 0.2, np.nan)
    seen_for = np.where(rng.random(2000) < 0.5, 5.0, 15.0)
    change[change > seen_for] = np.nan
    found = fit_merge_hazard(merge_periods(features, change, seen_for), change, seen_for)
    assert found.constant == pytest.approx(-3.0, abs=0.15)
    assert found.weights[0] == pytest.approx(2.0, abs=0.1)
    assert np.abs(found.weights[1:]).max() < 0.15


def test_steps_in_which_nobody_can_merge_do_not_count():
    rng = np.random.default_rng(2)
    features = rng.normal(0.0, 1.0, (1500, 1, STEPS, FEATURES))
    can = rng.random((1500, 1, STEPS)) < 0.5
    merges = can[:, 0] & (rng.random((1500, STEPS)) < 0.1)
    change = np.where(merges.any(axis=1), (merges.argmax(axis=1) + 1) * 0.2, np.nan)
    seen_for = np.full(1500, 15.0)
    found = fit_merge_hazard(merge_periods(features, change, seen_for, may=can), change, seen_for)
    assert 1.0 / (1.0 + np.exp(-found.constant)) == pytest.approx(0.1, abs=0.01)


def test_of_a_few_merges_it_is_learned_how_often_they_are():
    """9 vehicles merge in their 15th step of 0.2 s, 41 are seen for 75 steps without: 9 in 3,210 steps."""
    change = np.full(50, np.nan)
    change[: LEAST_EVENTS - 1] = 3.0
    seen_for = np.full(50, 15.0)
    features = np.ones((50, 1, STEPS, FEATURES))
    periods = merge_periods(features, change, seen_for)
    found = fit_merge_hazard(periods, change, seen_for, zone=(200.0, 10.0))
    assert (found.first, found.last) == (200.0, 10.0)
    assert 1.0 / (1.0 + np.exp(-found.constant)) == pytest.approx(9 / 3210)
    never = np.full(50, np.nan)
    nobody = fit_merge_hazard(merge_periods(features, never, seen_for), never, seen_for)
    assert nobody.constant == RARE
    np.testing.assert_array_equal(found.weights, 0.0)
