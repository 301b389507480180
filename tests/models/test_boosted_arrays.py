"""Boosted trees as arrays against scikit-learn's own prediction."""

import numpy as np
import pytest
from sklearn.ensemble import HistGradientBoostingRegressor
from threadpoolctl import threadpool_limits

from rampcast.models.boosted_arrays import boosted_trees


@pytest.fixture(autouse=True)
def one_thread():
    """Trees of so few rows gain nothing from more."""
    with threadpool_limits(1, user_api="openmp"):
        yield


def training_table(seed: int, *, rows: int = 600, missing: float = 0.0) -> np.ndarray:
    chance = np.random.default_rng(seed)
    table = chance.normal(size=(rows, 5))
    table[:, 3] = np.round(table[:, 3])  # ties
    table[chance.random(table.shape) < missing] = np.nan
    return table


def fitted(table: np.ndarray, **options: object) -> HistGradientBoostingRegressor:
    wanted = np.nan_to_num(table[:, 0]) * 3 + np.abs(np.nan_to_num(table[:, 1], nan=2.0)) + 10.0
    return HistGradientBoostingRegressor(max_iter=30, random_state=1, early_stopping=False, **options).fit(
        table, wanted
    )


@pytest.mark.parametrize("loss", ["absolute_error", "squared_error"])
@pytest.mark.parametrize("missing", [0.0, 0.3])
def test_the_prediction_is_that_of_scikit_learn(loss, missing):
    model = fitted(training_table(1, missing=missing), loss=loss, max_leaf_nodes=12)
    for rows in (1, 7, 6000):
        table = training_table(2, rows=rows, missing=missing)
        np.testing.assert_allclose(boosted_trees(model).predict(table), model.predict(table), rtol=1e-12, atol=1e-12)


def test_values_that_were_never_missing_in_training_may_be_missing_later():
    model, table = fitted(training_table(3)), training_table(4, missing=0.5)
    np.testing.assert_allclose(boosted_trees(model).predict(table), model.predict(table), rtol=1e-12)


def test_a_value_on_a_threshold_goes_left():
    model = fitted(training_table(5))
    trees = boosted_trees(model)
    inner = np.flatnonzero(np.isfinite(trees.threshold))
    table = np.zeros((len(inner), 5))
    table[np.arange(len(inner)), trees.feature[inner]] = trees.threshold[inner]
    np.testing.assert_allclose(trees.predict(table), model.predict(table), rtol=1e-12)


def test_trees_that_found_nothing_to_split_give_a_constant():
    model = HistGradientBoostingRegressor(max_iter=3).fit(np.zeros((40, 2)), np.full(40, 7.0))
    np.testing.assert_allclose(boosted_trees(model).predict(np.ones((3, 2))), 7.0)


def test_no_rows_are_no_predictions():
    assert boosted_trees(fitted(training_table(6))).predict(np.zeros((0, 5))).shape == (0,)


def test_a_table_of_other_columns_is_refused():
    with pytest.raises(ValueError, match="expected 5 columns, got 4"):
        boosted_trees(fitted(training_table(7))).predict(np.zeros((2, 4)))
