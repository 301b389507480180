"""The learned correction: it finds what roll-outs get wrong, and its quantiles hold on what it was not trained on."""

from functools import lru_cache

import numpy as np
import pytest

from rampcast.models.correction import KNOTS, LEVELS, CorrectionSpec, Rolled, fit_correction, over_time
from rampcast.models.folds import time_folds

pytestmark = pytest.mark.slow

SPEC = CorrectionSpec(trees=16, learning_rate=0.2, least_for_trees=100)


def made_up(count: int, seed: int, *, wrong: float) -> tuple[Rolled, np.ndarray]:
    """Returns roll-outs that fall short by `wrong` times a feature, and truths that scatter by another feature."""
    rng = np.random.default_rng(seed)
    features = rng.uniform(0.0, 1.0, (count, 3))
    median = np.outer(10.0 + features[:, 2], (KNOTS + 1) * 0.2)
    noise = rng.standard_normal(median.shape) * (0.5 + 2.0 * features[:, [1]])
    rolled = Rolled(
        features=np.column_stack([features, np.full(count, np.nan)]),
        chains=np.repeat(median[:, :, None], 2, axis=2),
        median=median,
        spread=np.full(median.shape, 2.0),
        regime=rng.integers(0, 3, count),
    )
    return rolled, median + wrong * features[:, [0]] + noise


@lru_cache
def fitted(*, wrong: float):
    count = 500
    rolled, truth = made_up(count, 1, wrong=wrong)
    group = np.array([f"1-{row // 5}" for row in range(count)])
    nowhen = np.full(count, np.nan)
    folds = time_folds(group, nowhen, nowhen, count=3)
    return fit_correction(rolled, truth, group=group, folds=folds, seed=1, spec=SPEC)


def test_an_error_that_a_feature_tells_is_taken_back():
    rolled, truth = made_up(300, 2, wrong=8.0)
    median = fitted(wrong=8.0).quantiles(rolled)[:, :, 49]
    assert np.abs(median - truth).mean() < 0.6 * np.abs(rolled.median - truth).mean()


def test_where_nothing_is_to_be_learned_little_is_changed():
    rolled, truth = made_up(300, 2, wrong=0.0)
    median = fitted(wrong=0.0).quantiles(rolled)[:, :, 49]
    assert np.abs(median - truth).mean() < 1.05 * np.abs(rolled.median - truth).mean()


def test_bands_hold_everywhere_and_are_wide_where_the_rest_is_large():
    rolled, truth = made_up(2000, 2, wrong=8.0)
    quantiles = fitted(wrong=8.0).quantiles(rolled)
    inside = (truth >= quantiles[:, :, 4]) & (truth <= quantiles[:, :, 94])
    np.testing.assert_allclose(inside.mean(axis=0), 0.9, atol=0.06)  # 500 residuals at each knot
    assert 0.87 < inside.mean() < 0.94
    width = (quantiles[:, :, 94] - quantiles[:, :, 4]).mean(axis=1)
    small, large = rolled.features[:, 1] < 0.3, rolled.features[:, 1] > 0.7
    assert width[large].mean() > 1.5 * width[small].mean()
    assert inside[large].mean() > 0.8


def test_between_knots_what_is_added_is_interpolated_and_nothing_falls():
    median = np.tile(10.0 * 0.2 * np.arange(1, 76), (2, 1))
    beyond = np.tile(LEVELS - 0.5, (2, len(KNOTS), 1)) * (KNOTS + 1)[None, :, None]
    found = over_time(median[:, KNOTS, None] + beyond, median)
    # at every step the addition is (level - 1/2) (step + 1), as it is at the knots
    expected = median[:, :, None] + (LEVELS - 0.5) * np.arange(1, 76)[None, :, None]
    np.testing.assert_allclose(found, expected, atol=1e-9)
    falling = over_time(np.repeat(median[:, KNOTS, None] - 3.0 * KNOTS[None, :, None], 99, axis=2), median)
    assert falling.min() >= 0.0
    assert np.diff(falling, axis=1).min() >= 0.0


def test_folds_never_train_on_a_vehicle_or_a_time_that_they_test():
    begin = np.arange(60, dtype=float) * 2.0
    group = np.array([f"1-{row // 4}" for row in range(60)])
    for train, test in time_folds(group, begin, begin + 19.0, count=3):
        assert not set(group[train]) & set(group[test])
        later = begin[train] >= begin[test].max() + 19.0
        earlier = begin[train] + 19.0 <= begin[test].min()
        assert (later | earlier).all()
