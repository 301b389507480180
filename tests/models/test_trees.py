"""Trees as arrays against scikit-learn's own prediction."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.ensemble import HistGradientBoostingRegressor, RandomForestClassifier
from threadpoolctl import threadpool_limits

from rampcast.errors import ModelError
from rampcast.models.trees import (
    TREES_TOGETHER,
    Forests,
    Tree,
    Trees,
    boosted_trees,
    classification_tree,
    joined,
    leaf,
    softness,
)


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
    inner = np.flatnonzero(np.isfinite(trees.trees.threshold))
    table = np.zeros((len(inner), 5))
    table[np.arange(len(inner)), trees.trees.feature[inner]] = trees.trees.threshold[inner]
    np.testing.assert_allclose(trees.predict(table), model.predict(table), rtol=1e-12)


def test_trees_that_found_nothing_to_split_give_a_constant():
    model = HistGradientBoostingRegressor(max_iter=3).fit(np.zeros((40, 2)), np.full(40, 7.0))
    np.testing.assert_allclose(boosted_trees(model).predict(np.ones((3, 2))), 7.0)


def test_no_rows_are_no_predictions():
    assert boosted_trees(fitted(training_table(6))).predict(np.zeros((0, 5))).shape == (0,)


def test_a_table_of_other_columns_is_refused():
    with pytest.raises(ValueError, match="expected 5 columns, got 4"):
        boosted_trees(fitted(training_table(7))).predict(np.zeros((2, 4)))


def sklearn_forests(n: int, *, n_trees: int, features: np.ndarray, seed: int) -> list[RandomForestClassifier]:
    rng = np.random.default_rng(seed)
    noisy = features[:, 0] + features[:, 0].std() * rng.normal(size=len(features))
    targets = [noisy > np.quantile(noisy, (i + 1) / (n + 1)) for i in range(n)]
    return [
        RandomForestClassifier(n_trees, random_state=seed + i, max_depth=[None, 3][i % 2]).fit(features, target)
        for i, target in enumerate(targets)
    ]


def as_forests(slow: list[RandomForestClassifier]) -> Forests:
    trees = [classification_tree(tree.tree_) for forest in slow for tree in forest.estimators_]
    return Forests(joined(trees, columns=slow[0].n_features_in_), each=len(slow[0].estimators_))


@pytest.mark.parametrize("scenes", [0, 1, 5, 20, max(TREES_TOGETHER) + 3])
@pytest.mark.parametrize("n_trees", [1, 7, 40])
def test_probabilities_equal_those_of_scikit_learn(scenes: int, n_trees: int) -> None:
    rng = np.random.default_rng(n_trees)
    train = np.round(rng.normal(size=(300, 5)), 1)  # rounded: many ties, impure leaves
    slow = sklearn_forests(4, n_trees=n_trees, features=train, seed=n_trees)
    fast = as_forests(slow)
    new = np.round(rng.normal(size=(scenes, 5)), 1)
    expected = [forest.predict_proba(new)[:, 1] if scenes else np.zeros(0) for forest in slow]
    np.testing.assert_allclose(fast.positive_share(new), np.stack(expected, axis=1), rtol=0, atol=1e-12)


def test_a_feature_on_a_threshold_goes_the_way_scikit_learn_sends_it() -> None:
    rng = np.random.default_rng(3)
    train = rng.normal(size=(200, 2)) * 1e3 + 1e6  # float32 is coarse here: thresholds fall between its numbers
    slow = sklearn_forests(1, n_trees=5, features=train, seed=3)
    fast = as_forests(slow)
    edges = np.unique(np.concatenate([tree.tree_.threshold for tree in slow[0].estimators_]))
    for value in (edges, np.nextafter(edges, np.inf), np.nextafter(edges.astype(np.float32), np.float32(np.inf))):
        new = np.stack([value, value], axis=1)
        expected = slow[0].predict_proba(new)[:, 1]
        np.testing.assert_allclose(fast.positive_share(new)[:, 0], expected, rtol=0, atol=1e-12)


@settings(max_examples=20, deadline=None)
@given(share=st.floats(0.0, 1.0))
def test_a_forest_of_leaves_gives_its_share(share: float) -> None:
    packed = Forests(joined([leaf(share)] * 3 + [leaf(1.0 - share)] * 3, columns=42), each=3)
    assert packed.positive_share(np.zeros((1, 42))) == pytest.approx(np.array([[share, 1.0 - share]]), abs=1e-12)


def test_soft_trees_are_steady_where_hard_ones_jump_and_the_same_far_from_thresholds():
    table = training_table(10)
    model = fitted(table)
    hard, soft = boosted_trees(model), boosted_trees(model, width=softness(table))
    line = np.zeros((20001, 5))
    line[:, 0] = np.linspace(-2.0, 2.0, len(line))
    step = np.diff(line[:, 0]).mean()
    jumps, slopes = (np.abs(np.diff(trees.predict(line))).max() for trees in (hard, soft))
    assert jumps > 0.05
    assert slopes < 0.05 * jumps
    assert slopes / step < 30.0
    everywhere = training_table(11)
    assert np.abs(soft.predict(everywhere) - hard.predict(everywhere)).mean() < 0.5
    beyond = np.full((1, 5), 50.0)
    np.testing.assert_allclose(soft.predict(beyond), hard.predict(beyond))


def test_halfway_through_a_soft_split_is_the_mean_of_both_sides():
    sides = Tree(*(np.array(one) for one in ([1, -1, -1], [2, -1, -1], [0, 0, 0])), np.array([1.0, 0.0, 0.0]),
                 np.array([False, True, True]), np.array([[0.0], [2.0], [6.0]]))  # fmt: skip
    trees = joined([sides], columns=1, width=np.array([0.5]))
    at = np.array([[0.5], [0.75], [1.0], [1.25], [1.5], [np.nan]])
    np.testing.assert_allclose(trees.sums(at)[:, 0], [2.0, 3.0, 4.0, 5.0, 6.0, 6.0])


def test_the_width_of_a_soft_split_is_a_quarter_of_a_columns_spread_whatever_lies_in_its_tails():
    column = np.random.default_rng(1).normal(scale=3.0, size=(4000, 1))
    column[:40] = 1e6
    with_missing = np.concatenate([column, np.full((100, 1), np.nan)])
    np.testing.assert_allclose(softness(with_missing), 0.25 * 3.0, rtol=0.1)
    assert softness(np.full((5, 1), np.nan)) == 0.0


@pytest.mark.parametrize("width", [-1.0, np.nan, np.inf])
def test_a_width_that_is_no_length_is_refused(width: float) -> None:
    trees = boosted_trees(fitted(training_table(12))).trees
    with pytest.raises(ModelError, match="width"):
        replace(trees, width=np.full(5, width))


@pytest.mark.parametrize(
    ("name", "value"),
    [("left", 10**6), ("left", 2**31 - 1), ("left", -1), ("feature", 5), ("feature", -1), ("root", 10**6)],
)
def test_a_node_that_points_nowhere_is_refused(name: str, value: int) -> None:
    trees = boosted_trees(fitted(training_table(8))).trees
    wrong = getattr(trees, name).copy()
    wrong[0] = value
    with pytest.raises(ModelError, match="outside"):
        replace(trees, **{name: wrong})


@pytest.mark.parametrize(("name", "value"), [("threshold", 1.0), ("missing_left", False)])
def test_a_leaf_that_sends_rows_on_is_refused(name: str, value: float) -> None:
    trees = boosted_trees(fitted(training_table(9))).trees
    wrong = getattr(trees, name).copy()
    wrong[-1] = value
    with pytest.raises(ModelError, match="outside"):
        replace(trees, **{name: wrong})


def chain(depth: int) -> dict[str, object]:
    """Returns the arrays of a tree in which each level has one more leaf."""
    nodes = 2 * depth + 1
    left = np.arange(nodes, dtype=np.int32)
    inner = np.array([0, *range(2, 2 * depth, 2)])
    left[inner] = inner + 1
    is_leaf = left == np.arange(nodes)
    return {
        "columns": 1,
        "feature": np.zeros(nodes, np.int32),
        "threshold": np.where(is_leaf, np.inf, 0.5),
        "missing_left": np.ones(nodes, bool),
        "left": left,
        "value": np.zeros((nodes, 1)),
        "root": np.zeros(1, np.int32),
    }


def test_a_tree_of_any_sane_depth_is_taken_and_a_deeper_one_refused():
    assert Trees(**chain(60)).depths.tolist() == [60]
    with pytest.raises(ModelError, match="levels deep"):
        Trees(**chain(1001))


def test_nodes_that_share_children_are_refused_before_they_fill_the_memory():
    """Each level of such a graph has twice the ways of the one above: 60 nodes have 2**60."""
    nodes = 62
    left = np.minimum(np.arange(nodes) + 1, 60).astype(np.int32)
    left[60:] = [60, 61]
    threshold = np.where(left == np.arange(nodes), np.inf, 0.0)
    with pytest.raises(ModelError, match="below two others"):
        Trees(**(chain(1) | {
            "feature": np.zeros(nodes, np.int32), "threshold": threshold, "missing_left": np.ones(nodes, bool),
            "left": left, "value": np.zeros((nodes, 1)),
        }))  # fmt: skip


@pytest.mark.parametrize(
    ("name", "place", "value", "message"),
    [
        ("threshold", 0, np.nan, "no number"),
        ("threshold", 0, -np.inf, "no number"),
        ("left", 0, -1, "outside"),
        ("left", 0, 5, "outside"),
        ("feature", 0, -1, "outside"),
        ("feature", 0, 1, "outside"),
        ("root", 0, -1, "outside"),
        ("root", 0, 1, "below two others, or below none"),
    ],
)
def test_arrays_that_are_no_tree_are_refused(name, place, value, message):
    arrays = chain(2)
    arrays[name][place] = value
    with pytest.raises(ModelError, match=message):
        Trees(**arrays)
