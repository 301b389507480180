"""The Kaplan-Meier estimate against numbers counted by hand."""

import numpy as np
import pytest

from rampcast.evaluate.survival import kaplan_meier


def test_those_not_seen_to_the_end_count_as_long_as_they_were_seen():
    """Four cases: ends at 1, 3 and 4 s, one lost at 2 s: 3/4, then 3/4 * 1/2, then 0."""
    curve = kaplan_meier(np.array([1.0, 2.0, 3.0, 4.0]), np.array([True, False, True, True]))
    np.testing.assert_allclose(curve.time, [1.0, 3.0, 4.0])
    np.testing.assert_allclose(curve.at_risk, [4.0, 2.0, 1.0])
    np.testing.assert_allclose(curve.share, [0.75, 0.375, 0.0])
    np.testing.assert_allclose(curve.at(np.array([0.5, 1.0, 2.9, 3.0, 9.0])), [1.0, 0.75, 0.75, 0.375, 0.0])
    np.testing.assert_allclose(curve.before(np.array([1.0, 3.0, 3.1])), [1.0, 0.75, 0.375])


def test_those_who_came_later_are_not_at_risk_before():
    """Ends at 1, 2 and 3 s; the third is watched from 1.5 s on: 1 of 2, then 1 of 2, then 1 of 1."""
    curve = kaplan_meier(np.array([1.0, 2.0, 3.0]), np.full(3, True), entered=np.array([0.0, 0.0, 1.5]))
    np.testing.assert_allclose(curve.at_risk, [2.0, 2.0, 1.0])
    np.testing.assert_allclose(curve.share, [0.5, 0.25, 0.0])


def test_two_that_end_together_are_one_event():
    curve = kaplan_meier(np.array([0.1 + 0.2, 0.3, 0.5]), np.full(3, True))
    np.testing.assert_allclose(curve.share, [1 / 3, 0.0], atol=1e-12)


def test_who_has_waited_is_compared_with_those_that_waited_as_long():
    """Ten ends at 1, 2 ... 10 s: after 4 s six are left, half of whom end within 3 s."""
    curve = kaplan_meier(np.arange(1.0, 11.0), np.full(10, True))
    within = curve.within(np.array([0.0, 4.0]), np.array([3.0, 6.0]))
    np.testing.assert_allclose(within, [[0.3, 0.6], [0.5, 1.0]])


def test_beyond_what_is_known_one_waits_no_longer_than_those_who_are_known():
    """The last end with five at risk is at 6 s: who has waited beyond the one before is taken to have waited 5 s."""
    curve = kaplan_meier(np.arange(1.0, 11.0), np.full(10, True))
    within = curve.within(np.array([5.0, 9.5, 80.0]), np.array([0.5, 1.0]))
    np.testing.assert_allclose(within, [[0.0, 0.2]] * 3)


@pytest.mark.parametrize("count", [0, 3])
def test_where_no_end_was_seen_nothing_ends(count):
    curve = kaplan_meier(np.ones(count), np.full(count, False))
    np.testing.assert_allclose(curve.within(np.array([0.0, 5.0]), np.array([1.0, 15.0])), 0.0)
