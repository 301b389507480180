"""The metrics of merge times against numbers counted by hand, and against plain loops."""

import numpy as np
import pytest

from rampcast.benchmark.merge_metrics import (
    brier_terms,
    c_index,
    c_index_draws,
    calibration_error,
    concordance,
    crps_of_times,
    exact_outcomes,
    known_outcomes,
    one_per_vehicle,
)
from rampcast.benchmark.merges import TIME, median_time
from rampcast.evaluate.bootstrap import resampling
from rampcast.evaluate.yes_or_no import accuracy, best_threshold

RNG = np.random.default_rng(5)
SEEN = np.array([True])


def curve(*knots: tuple[float, float]) -> np.ndarray:
    """Returns one curve at 0.2 ... 15 s that is linear between (t, p) knots."""
    t, p = zip((0.0, 0.0), *knots, strict=True)
    return np.interp(TIME, t, p)[None, :]


def test_the_crps_of_a_jump_is_its_distance_in_time():
    """A curve that goes from 0 to 1 between 5.0 and 5.2 s, a merge at 8 s: 2.8 s too early, and 0.2/3 of the ramp."""
    jump = curve((5.0, 0.0), (5.2, 1.0), (15.0, 1.0))
    assert crps_of_times(jump, np.array([8.0]), SEEN)[0] == pytest.approx(2.8 + 0.2 / 3)
    assert crps_of_times(jump, np.array([3.0]), SEEN)[0] == pytest.approx(2.0 + 0.2 / 3)


def test_the_crps_of_a_straight_line_is_that_of_a_uniform_forecast():
    """F = t / 15 and a merge at 6 s: integral of (t/15)^2 to 6 s is 6^3/(3*225), of (1-t/15)^2 after it 9^3/(3*225)."""
    line = curve((15.0, 1.0))
    assert crps_of_times(line, np.array([6.0]), SEEN)[0] == pytest.approx((216 + 729) / 675)
    assert crps_of_times(line, np.array([6.1]), SEEN)[0] == pytest.approx((6.1**3 + 8.9**3) / 675)


def test_the_crps_of_a_case_that_was_lost_counts_until_then():
    line = curve((15.0, 1.0))
    lost = np.array([False])
    assert crps_of_times(line, np.array([6.0]), lost)[0] == pytest.approx(216 / 675)
    assert crps_of_times(line, np.array([40.0]), lost)[0] == pytest.approx(5.0)
    assert crps_of_times(line, np.array([40.0]), SEEN)[0] == pytest.approx(5.0)  # no merge within 15 s either


def test_the_crps_is_the_integral_on_a_fine_grid():
    p = np.sort(RNG.uniform(size=(20, 75)), axis=1)
    time, ended = RNG.uniform(0.0, 18.0, 20), RNG.uniform(size=20) < 0.7
    t = (np.arange(150_000) + 0.5) * 1e-4
    for row in range(20):
        f = np.interp(t, np.append(0.0, TIME), np.append(0.0, p[row]))
        there = (time[row] <= t) if ended[row] else np.where(t > time[row], f, 0.0)
        expected = ((f - there) ** 2).sum() * 1e-4
        assert crps_of_times(p, time, ended)[row] == pytest.approx(expected, abs=2e-4)


def test_the_median_time_is_where_the_curve_passes_a_half():
    curves = np.concatenate([curve((15.0, 1.0)), curve((15.0, 0.4)), curve((4.0, 0.0), (4.2, 1.0), (15.0, 1.0))])
    np.testing.assert_allclose(median_time(curves), [7.5, 15.0, 4.1])
    assert median_time(np.full((1, 75), 0.8))[0] == pytest.approx(0.125)  # within the first step


def test_harrells_c_counts_pairs_that_can_be_compared():
    """Times 1, 2, 3 (lost) and 4: pairs (1,2) (1,3) (1,4) (2,3) (2,4); the one lost at 3 cannot be compared with 4.

    Predicted 1, 3, 3, 2: (1,2) (1,3) (1,4) are right, (2,3) is a tie, (2,4) is wrong: 3.5 of 5.
    """
    ended = np.array([True, True, False, True])
    found = concordance(np.array([1.0, 3.0, 3.0, 2.0]), np.array([1.0, 2.0, 3.0, 4.0]), ended, np.arange(4))
    assert found[1].sum() == 5.0
    assert c_index(*found) == pytest.approx(3.5 / 5)


def test_of_two_equal_times_one_must_have_been_lost_to_be_compared():
    predicted, group = np.array([1.0, 2.0]), np.arange(2)
    both = concordance(predicted, np.array([3.0, 3.0]), np.array([True, True]), group)
    assert np.isnan(c_index(*both))
    one = concordance(predicted, np.array([3.0, 3.0]), np.array([True, False]), group)
    assert (one[1].sum(), c_index(*one)) == (1.0, 1.0)


def test_merges_after_15_seconds_are_all_alike():
    """Of 14, 20 and 30 s only the first pairs count."""
    found = concordance(np.array([9.0, 8.0, 7.0]), np.array([14.0, 20.0, 30.0]), np.full(3, True), np.arange(3))
    assert (found[1].sum(), c_index(*found)) == (2.0, 0.0)


def test_harrells_c_is_one_half_for_chance_and_that_of_a_loop():
    count = 700  # more than a block
    time, predicted = RNG.uniform(0.0, 15.0, count).round(1), RNG.uniform(0.0, 9.0, count).round(1)
    ended, group = RNG.uniform(size=count) < 0.8, RNG.integers(0, 40, count)
    right, comparable = concordance(predicted, time, ended, group)
    assert c_index(right, comparable) == pytest.approx(0.5, abs=0.03)
    one, pairs = 0.0, 0
    for i in range(count):
        for j in range(count):
            if ended[i] and (time[i] < time[j] or (time[i] == time[j] and not ended[j])):
                pairs += 1
                one += 1.0 if predicted[i] < predicted[j] else 0.5 if predicted[i] == predicted[j] else 0.0
    assert comparable.sum() == pairs
    assert right.sum() == pytest.approx(one)
    inside = c_index_draws(right, comparable, resampling(np.arange(40)).draws)
    assert np.quantile(inside, 0.025) < c_index(right, comparable) < np.quantile(inside, 0.975)


def test_who_was_lost_is_stood_for_by_those_seen_for_longer():
    """Merges at 1, 3 and 4 s, one lost at 2 s: of three seen until then one was lost, so two weigh 3/2."""
    time, ended = np.array([1.0, 2.0, 3.0, 4.0]), np.array([True, False, True, True])
    changed, weight = known_outcomes(3.5, time, ended)
    assert changed.tolist() == [True, False, True, False]
    np.testing.assert_allclose(weight, [1.0, 0.0, 1.5, 1.5])
    terms = brier_terms(np.array([0.9, 0.5, 0.6, 0.2]), changed, weight)
    assert terms.mean() == pytest.approx((0.01 + 1.5 * 0.16 + 1.5 * 0.04) / 4)


def test_who_merges_when_another_is_lost_was_not_there_to_be_lost():
    """One of four merges at 2 s and one is lost then: of the two others and the lost one a third was lost."""
    time, ended = np.array([2.0, 2.0, 3.0, 4.0]), np.array([True, False, True, True])
    _, weight = known_outcomes(2.5, time, ended)
    np.testing.assert_allclose(weight, [1.0, 0.0, 1.5, 1.5])
    assert weight.mean() == pytest.approx(1.0)


def test_the_brier_score_of_the_share_itself_is_its_variance():
    time = np.arange(1.0, 11.0)
    changed, weight = known_outcomes(3.0, time, np.full(10, True))
    assert changed.sum() == 3
    assert brier_terms(np.full(10, 0.3), changed, weight).mean() == pytest.approx(0.3 * 0.7)


def test_the_calibration_error_is_the_mean_distance_of_bins():
    """Two bins: 0.25 said of four, one merged: 0; 0.95 said of two, one merged: 0.45; in all 0.45 / 3."""
    probability = np.array([0.25, 0.25, 0.25, 0.25, 0.95, 0.95])
    changed = np.array([True, False, False, False, True, False])
    assert calibration_error(probability, changed, np.ones(6)) == pytest.approx(0.45 / 3)
    assert calibration_error(np.array([1.0]), np.array([True]), np.ones(1)) == 0.0


def test_the_best_threshold_is_right_most_often():
    score, positive = np.array([0.1, 0.2, 0.3, 0.8, 0.9]), np.array([False, True, False, True, True])
    threshold = best_threshold(score, positive, np.ones(5))
    assert threshold == pytest.approx(0.55)  # 4 of 5, as below 0.2 would be; of two as good it is the upper
    assert accuracy(score, positive, np.ones(5), threshold=threshold) == pytest.approx(0.8)
    heavy = np.array([1.0, 5.0, 1.0, 1.0, 1.0])
    assert best_threshold(score, positive, heavy) == pytest.approx(0.15)


@pytest.mark.parametrize("said", [True, False])
def test_the_best_threshold_may_say_yes_or_no_to_all(said):
    score = np.array([0.4, 0.4, 0.7])
    threshold = best_threshold(score, np.full(3, said), np.ones(3))
    assert (score > threshold).all() == said
    assert (score > threshold).any() == said


def test_the_best_threshold_is_that_of_a_loop():
    score, positive, weight = RNG.integers(0, 8, 60) / 8, RNG.uniform(size=60) < 0.4, RNG.uniform(size=60)
    best = max(accuracy(score, positive, weight, threshold=t) for t in np.arange(-1, 9) / 8 + 1e-3)
    found = accuracy(score, positive, weight, threshold=best_threshold(score, positive, weight))
    assert found == pytest.approx(best)


def test_a_merge_at_a_second_is_one_in_the_step_that_ends_there():
    """The step of 3 s goes from 2.8, which is not in it, to 3.0 s, which is."""
    time = np.array([2.8, 2.9, 3.0, 3.05, 9.0, 2.9, 9.0])
    ended = np.array([True, True, True, True, True, False, False])
    exact, later = exact_outcomes(3, time, ended)
    assert exact.tolist() == [False, True, True, False, False, False, False]
    assert later.tolist() == [False, False, False, True, True, False, True]


def test_a_vehicle_with_more_cases_weighs_no_more():
    weight = one_per_vehicle(np.array([True, True, True, False]), np.array([0, 0, 1, 2]))
    np.testing.assert_allclose(weight, [0.25, 0.25, 0.5, 0.0])
    assert one_per_vehicle(np.full(2, False), np.array([0, 1])).tolist() == [0.0, 0.0]
