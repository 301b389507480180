"""The forest of merge times: what it learns, that its curves never fall, and what becomes of roll-outs with it."""

import numpy as np
import pytest

from rampcast.horizon import FUTURE
from rampcast.models.merge_forest import (
    MOMENTS,
    _as_arrays,
    _filled,
    _forest,
    _merged_by,
    _out_of_fold,
    _predict,
    fit_merge_forest,
    rate_of,
)

TIME = 0.2 * np.arange(1, FUTURE + 1)


def curves(hazard: np.ndarray) -> np.ndarray:
    """Returns the probability to have merged, of constant hazards [1/s]."""
    return 1.0 - np.exp(-hazard[:, None] * TIME)


@pytest.fixture(scope="module")
def made():
    """300 vehicles that merge at 0.5 or at 0.05 a second; the roll-outs think 0.15 of all."""
    rng = np.random.default_rng(1)
    fast = np.arange(300) % 2
    table = np.column_stack([np.where(fast, 1.0, np.nan), rng.normal(0.0, 1.0, 300)])
    time = rng.exponential(1.0 / np.where(fast, 0.5, 0.05))
    change = np.where(time <= 15.0, time, np.nan)
    group = np.array([f"1-{row}" for row in range(300)])
    rows = np.arange(300)
    folds = [(rows[rows % 3 != one], rows[rows % 3 == one]) for one in range(3)]
    rolled = curves(np.full(300, 0.15))
    forest = fit_merge_forest(table, rolled, change_time=change, seen_for=np.full(300, 15.0), group=group, folds=folds)
    return table, rolled, forest, fast.astype(bool)


def test_it_learns_who_merges_soon(made):
    table, rolled, forest, fast = made
    found = forest.curves(table, rolled)
    true = curves(np.array([0.5, 0.05]))
    assert np.abs(found[fast].mean(axis=0) - true[0])[[4, 24, 49]].max() < 0.12
    assert np.abs(found[~fast].mean(axis=0) - true[1])[[4, 24, 49]].max() < 0.12
    assert (forest.share[5:] > 0.0).all()


def test_curves_never_fall_and_are_probabilities(made):
    table, rolled, forest, _ = made
    found = forest.curves(table, rolled)
    assert (np.diff(found, axis=1) >= -1e-9).all()
    assert found.min() >= 0.0
    assert found.max() <= 1.0


def test_arrays_predict_as_scikit_learn_does(made):
    table, *_ = made
    rng = np.random.default_rng(2)
    merged = np.maximum.accumulate(rng.random((300, len(MOMENTS))) < 0.1, axis=1).astype(float)
    fitted = _forest(5, 1).fit(_filled(table), merged)
    np.testing.assert_allclose(
        _predict(_as_arrays(fitted, np.zeros(table.shape[1])), table), fitted.predict(_filled(table)), atol=1e-6
    )


def test_what_is_seen_of_a_fold_under_test_moves_no_forecast_of_another_row(made):
    """Neither its outcomes nor its features, from which the width of soft splits is taken."""
    table, *_ = made
    rng = np.random.default_rng(3)
    merged = np.maximum.accumulate(rng.random((300, len(MOMENTS))) < 0.1, axis=1).astype(float)
    train, test = np.arange(100, 300), np.arange(100)
    wide = table.copy()
    wide[test[1:]] *= 50.0
    same = [_out_of_fold(one, merged, np.ones(300), [(train, test)], 1)[0] for one in (table, wide)]
    np.testing.assert_array_equal(*same)


def test_who_leaves_before_counts_as_the_roll_outs_say():
    """Seen for 1 s without a merge: by 2 s the roll-outs give (0.4 - 0.2) / 0.8 = 0.25."""
    rolled = np.linspace(0.04, 3.0, FUTURE)[None].clip(max=1.0)
    found = _merged_by(rolled, np.array([np.nan]), np.array([1.0]))[0]
    assert found[MOMENTS == 4] == 0.0
    assert found[MOMENTS == 8].item() == pytest.approx((rolled[0, 8] - rolled[0, 4]) / (1 - rolled[0, 4]))


def test_of_few_vehicles_the_roll_outs_stay_as_they_are():
    rolled = curves(np.linspace(0.1, 0.5, 20))
    rows = np.arange(20)
    forest = fit_merge_forest(
        np.ones((20, 2)), rolled, change_time=np.ones(20), seen_for=np.full(20, 15.0), group=rows, folds=[(rows, rows)]
    )
    np.testing.assert_array_equal(forest.curves(np.ones((20, 2)), rolled), rolled)


def test_a_rate_is_the_quotient_of_the_hazards():
    half, same = rate_of(curves(np.full(2, 0.05)), curves(np.full(2, 0.1))), rate_of(*[curves(np.full(2, 0.1))] * 2)
    np.testing.assert_allclose(half, 0.5, atol=0.05)
    np.testing.assert_allclose(same, 1.0)
