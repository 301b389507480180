"""The 32 lane-change forests: equal to scikit-learn, honest about what they were trained on."""

import io
from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.ensemble import RandomForestClassifier

from rampcast.errors import ModelError
from rampcast.models.forest_arrays import TREES_TOGETHER, leaf, pack
from rampcast.paper.lane_change.forests import (
    SPECS,
    Cumulative,
    ForestSpec,
    LaneChangeForests,
    Training,
    fit,
    importance_table,
    predict,
    training_table,
)
from rampcast.paper.lane_change.sets import KINDS, TIMES, Anchors, Reading, Sampling
from rampcast.paper.laws.mode import Mode
from tests.factories import random_anchors

SMALL = ForestSpec(n_trees=3)


@pytest.fixture(scope="module")
def anchors() -> Anchors:
    return random_anchors(np.random.default_rng(0), 4000)


@pytest.fixture(scope="module")
def forests(anchors: Anchors) -> LaneChangeForests:
    return fit(anchors, spec=SMALL, seed=1)


def sklearn_forests(n: int, *, n_trees: int, features: np.ndarray, seed: int) -> list[RandomForestClassifier]:
    rng = np.random.default_rng(seed)
    noisy = features[:, 0] + features[:, 0].std() * rng.normal(size=len(features))
    targets = [noisy > np.quantile(noisy, (i + 1) / (n + 1)) for i in range(n)]
    return [
        RandomForestClassifier(n_trees, random_state=seed + i, max_depth=[None, 3][i % 2]).fit(features, target)
        for i, target in enumerate(targets)
    ]


@pytest.mark.parametrize("scenes", [0, 1, 5, 20, max(TREES_TOGETHER) + 3])
@pytest.mark.parametrize("n_trees", [1, 7, 40])
def test_probabilities_equal_those_of_scikit_learn(scenes: int, n_trees: int) -> None:
    rng = np.random.default_rng(n_trees)
    train = np.round(rng.normal(size=(300, 5)), 1)  # rounded: many ties, impure leaves
    slow = sklearn_forests(4, n_trees=n_trees, features=train, seed=n_trees)
    fast = pack([[tree.tree_ for tree in forest.estimators_] for forest in slow])
    new = np.round(rng.normal(size=(scenes, 5)), 1)
    expected = [forest.predict_proba(new)[:, 1] if scenes else np.zeros(0) for forest in slow]
    np.testing.assert_allclose(fast.positive_share(new), np.stack(expected, axis=1), rtol=0, atol=1e-12)


def test_a_feature_on_a_threshold_goes_the_way_scikit_learn_sends_it() -> None:
    rng = np.random.default_rng(3)
    train = rng.normal(size=(200, 2)) * 1e3 + 1e6  # float32 is coarse here: thresholds fall between its numbers
    slow = sklearn_forests(1, n_trees=5, features=train, seed=3)
    fast = pack([[tree.tree_ for tree in slow[0].estimators_]])
    edges = np.unique(np.concatenate([tree.tree_.threshold for tree in slow[0].estimators_]))
    for value in (edges, np.nextafter(edges, np.inf), np.nextafter(edges.astype(np.float32), np.float32(np.inf))):
        new = np.stack([value, value], axis=1)
        expected = slow[0].predict_proba(new)[:, 1]
        np.testing.assert_allclose(fast.positive_share(new)[:, 0], expected, rtol=0, atol=1e-12)


def test_the_answer_for_a_scene_does_not_depend_on_the_others(forests: LaneChangeForests) -> None:
    features = random_anchors(np.random.default_rng(4), 40).features
    together = np.stack(predict(forests, features))
    one_by_one = np.concatenate([np.stack(predict(forests, row[None])) for row in features], axis=1)
    assert np.array_equal(together, one_by_one)


def test_the_seed_fixes_everything(anchors: Anchors, forests: LaneChangeForests) -> None:
    again, other = (fit(anchors, spec=SMALL, seed=seed).to_arrays() for seed in (1, 2))
    for name, array in forests.to_arrays().items():
        assert np.array_equal(array, again[name], equal_nan=array.dtype.kind == "f"), name
    assert len(other["left"]) != len(again["left"]) or not np.array_equal(other["threshold"], again["threshold"])


def test_forests_learn(forests: LaneChangeForests) -> None:
    test = random_anchors(np.random.default_rng(9), 1200)
    within, at = predict(forests, test.features)
    assert within[test.change_time < 7.0, 8].mean() > within[test.change_time > 9.0, 8].mean() + 0.2
    near = np.abs(test.change_time - 3.0) < 0.5
    assert at[near, 3].mean() > at[test.change_time > 6.0, 3].mean() + 0.2


def test_saved_arrays_give_the_same_forests_without_pickle(forests: LaneChangeForests, anchors: Anchors) -> None:
    file = io.BytesIO()
    np.savez_compressed(file, **forests.to_arrays())
    file.seek(0)
    with np.load(file, allow_pickle=False) as arrays:
        loaded = LaneChangeForests.from_arrays(arrays)
    assert loaded.spec == forests.spec
    assert loaded.reading is forests.reading
    for mine, theirs in zip(predict(forests, anchors.features), predict(loaded, anchors.features), strict=True):
        assert np.array_equal(mine, theirs)
    assert importance_table(loaded).equals(importance_table(forests))
    assert training_table(loaded).equals(training_table(forests))


@pytest.mark.parametrize("name", ["left", "root", "spec", "counts", "sampling"])
def test_a_missing_array_is_named(forests: LaneChangeForests, name: str) -> None:
    arrays = forests.to_arrays()
    name = "mode" if name == "spec" else name
    del arrays[name]
    with pytest.raises(ModelError, match=name):
        LaneChangeForests.from_arrays(arrays)


@pytest.mark.parametrize(("name", "value"), [("left", 10**6), ("left", -1), ("feature", 42), ("root", 10**6)])
def test_a_node_that_points_nowhere_is_refused(forests: LaneChangeForests, name: str, value: int) -> None:
    arrays = forests.to_arrays() | {name: forests.to_arrays()[name].copy()}
    arrays[name].flat[0] = value
    with pytest.raises(ModelError, match="outside"):
        LaneChangeForests.from_arrays(arrays)


def test_arrays_of_the_wrong_shape_are_refused(forests: LaneChangeForests) -> None:
    arrays = forests.to_arrays()
    with pytest.raises(ModelError, match="32 forests of 3 trees"):
        LaneChangeForests.from_arrays(arrays | {"root": arrays["root"][:5]})
    with pytest.raises(ModelError, match="one length"):
        LaneChangeForests.from_arrays(arrays | {"share": arrays["share"][:5]})


def test_importances_of_every_grouping_sum_to_one(forests: LaneChangeForests) -> None:
    table = importance_table(forests)
    assert table.columns == ["mode", "kind", "t", "grouping", "group", "importance"]
    assert set(table.filter(pl.col("grouping") == "feature")["group"]) == set("xyvuae")
    assert set(table.filter(pl.col("grouping") == "vehicle")["group"]) == {"central", "ramp", "target"}
    trained = table.filter(pl.col("importance").is_not_null())
    sums = trained.group_by("kind", "t", "grouping").agg(pl.col("importance").sum())
    assert len(sums) > 2 * 2 * 14
    assert np.allclose(sums["importance"], 1.0)


def test_the_features_that_matter_are_found_important(forests: LaneChangeForests) -> None:
    table = importance_table(forests).filter((pl.col("kind") == "within") & (pl.col("t") == 8.0))
    share = dict(table.select("group", "importance").iter_rows())
    assert max("xyvuae", key=lambda kind: share[kind]) in "xy"  # the first two features are the leader's x and y
    assert share["ramp"] > share["central"]


def test_a_set_of_one_class_gives_a_constant_classifier_that_says_so() -> None:
    anchors = random_anchors(np.random.default_rng(5), 200)
    early = replace(anchors, change_time=np.full(200, 1.6), seen_for=np.full(200, 5.0))
    fitted = fit(early, spec=SMALL, seed=0)
    within, at = predict(fitted, early.features)
    table = training_table(fitted)
    outcome = {(kind, t): name for kind, t, name in table.select("kind", "t", "outcome").iter_rows()}
    assert outcome["within", 5.0] == "one_class"
    assert np.all(within[:, 5] == 1.0)
    assert outcome["within", 0.0] == "one_class"
    assert np.all(within[:, 0] == 0.0)
    assert outcome["at", 5.0] == "no_samples"
    assert np.isnan(at[:, 5]).all()
    assert importance_table(fitted)["importance"].null_count() == len(importance_table(fitted))


def test_censored_anchors_are_counted(anchors: Anchors, forests: LaneChangeForests) -> None:
    table = training_table(forests)
    assert table.columns[-4:] == ["n", "positives", "censored", "changed_already"]
    never = np.isnan(anchors.change_time)
    for kind in KINDS:
        censored = table.filter(pl.col("kind") == kind)["censored"].to_list()
        assert censored == [int((never & (np.rint(anchors.seen_for / 0.2) <= 5 * t)).sum()) for t in TIMES]
        assert censored[-1] > 0


def test_corrected_mode_never_falls_with_t_and_paper_mode_is_left_alone(anchors: Anchors) -> None:
    corrected = fit(anchors, spec=replace(SPECS[Mode.CORRECTED], n_trees=3), seed=0)
    raw = replace(corrected, spec=replace(corrected.spec, cumulative=Cumulative.AS_TRAINED))
    within, at = predict(corrected, anchors.features)
    untouched, same_at = predict(raw, anchors.features)
    assert np.all(np.diff(within, axis=1) >= 0)
    assert np.any(np.diff(untouched, axis=1) < 0)
    assert np.array_equal(within, np.maximum.accumulate(untouched, axis=1))
    assert np.array_equal(at, same_at)
    assert SPECS[Mode.PAPER].cumulative is Cumulative.AS_TRAINED


def test_natural_training_gives_the_natural_base_rate() -> None:
    train, test = (random_anchors(np.random.default_rng(seed), 3000) for seed in (6, 7))
    rate = np.mean(test.change_time[~np.isnan(test.change_time)] < 5.0)
    mean = {}
    for sampling in Sampling:
        within, _ = predict(fit(train, spec=ForestSpec(n_trees=10, sampling=sampling), seed=0), test.features)
        mean[sampling] = within[:, 5].mean()
    assert abs(mean[Sampling.NATURAL] - rate) < 0.03
    assert mean[Sampling.BALANCED] > rate + 0.05


def test_progress_is_reported(anchors: Anchors) -> None:
    calls: list[tuple[int, int]] = []
    fit(anchors, spec=ForestSpec(n_trees=1), seed=0, progress=lambda done, of: calls.append((done, of)))
    assert calls == [(i, 32) for i in range(1, 33)]


def test_a_feature_that_is_no_number_is_named(anchors: Anchors) -> None:
    features = anchors.features.copy()
    features[3, 0] = np.nan
    with pytest.raises(ModelError, match=r"leader\.x.*scene 3"):
        fit(replace(anchors, features=features), spec=SMALL, seed=0)
    with pytest.raises(ModelError, match="at least one scene"):
        fit(Anchors(np.zeros((0, 42)), np.zeros(0), np.zeros(0), np.zeros(0, int), Reading.LABEL), spec=SMALL, seed=0)


@settings(max_examples=20, deadline=None)
@given(share=st.floats(0.0, 1.0))
def test_a_forest_of_leaves_gives_its_share(share: float) -> None:
    packed = pack([[leaf(share)] * 3, [leaf(1.0 - share)] * 3])
    assert packed.positive_share(np.zeros((1, 42))) == pytest.approx(np.array([[share, 1.0 - share]]), abs=1e-12)


def test_the_codes_of_a_saved_training_stay_what_they_are() -> None:
    assert {member.name: member.value for member in Training} == {"TRAINED": 0, "ONE_CLASS": 1, "NO_SAMPLES": 2}
