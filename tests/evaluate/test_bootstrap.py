"""Intervals against standard errors and plain loops."""

import numpy as np
import pytest

from rampcast.evaluate.bootstrap import resampling, ways_to_draw, widest

RNG = np.random.default_rng(3)


def test_a_draw_by_group_is_wider_than_one_by_case_when_the_cases_of_a_vehicle_are_alike():
    group = np.repeat(np.arange(20), 30)
    values = np.repeat(RNG.normal(size=20), 30)
    low, high = widest([resampling(group).means(values)])
    narrow_low, narrow_high = widest([resampling(np.arange(600)).means(values)])
    assert low < values.mean() < high
    assert high - low > 4.0 * (narrow_high - narrow_low)
    standard_error = values.reshape(20, 30)[:, 0].std() / np.sqrt(20)
    assert high - low == pytest.approx(2 * 1.96 * standard_error, rel=0.15)


def test_means_of_draws_are_what_a_loop_finds():
    group, values = np.array(["b", "a", "b", "c"]), np.array([[1.0], [2.0], [5.0], [np.nan]])
    one = resampling(group)
    means = one.means(values)
    for draw in range(30):
        drawn = [values[k, 0] for name, times in zip("abc", one.draws[draw], strict=True) for _ in range(times)
                 for k in np.flatnonzero(group == name)]  # fmt: skip
        known = [value for value in drawn if np.isfinite(value)]
        np.testing.assert_allclose(means[draw, 0], np.mean(known) if known else np.nan)


def test_ratios_compare_the_same_cases_and_know_nothing_where_there_are_none():
    values, others = np.array([1.0, 3.0, np.nan, 8.0]), np.array([2.0, 6.0, 100.0, np.nan])
    ratios = resampling(np.arange(4)).ratios(values, others)
    assert np.nanmin(ratios) == np.nanmax(ratios) == 0.5
    assert np.isnan(ratios).any()  # neither of the first two was drawn


def test_the_widest_interval_is_shown_and_few_blocks_of_time_give_none():
    vehicle, block = np.arange(40), np.repeat(np.arange(5), 8)
    values = np.repeat(RNG.normal(size=5), 8)
    by_vehicle, by_time = ways_to_draw(vehicle, block)
    np.testing.assert_array_equal(
        widest([one.means(values) for one in (by_vehicle, by_time)]), widest([by_time.means(values)])
    )
    assert len(ways_to_draw(vehicle, np.repeat(np.arange(4), 10))) == 1
