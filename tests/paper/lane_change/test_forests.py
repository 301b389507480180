"""The 32 lane-change forests: equal to scikit-learn, honest about what they were trained on."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from rampcast.errors import ModelError
from rampcast.forecast.tables import TIMES
from rampcast.models.folder import load_model, save_model
from rampcast.models.plain_data import to_record
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
from rampcast.paper.lane_change.sets import KINDS, Anchors, Reading, Sampling
from rampcast.paper.laws.mode import Mode
from rampcast.paper.tags import TAGS
from tests.factories import random_anchors

SMALL = ForestSpec(n_trees=3)


@pytest.fixture(scope="module")
def anchors() -> Anchors:
    return random_anchors(np.random.default_rng(0), 4000)


@pytest.fixture(scope="module")
def forests(anchors: Anchors) -> LaneChangeForests:
    return fit(anchors, spec=SMALL, seed=1)


def test_the_answer_for_a_scene_does_not_depend_on_the_others(forests: LaneChangeForests) -> None:
    features = random_anchors(np.random.default_rng(4), 40).features
    together = np.stack(predict(forests, features))
    one_by_one = np.concatenate([np.stack(predict(forests, row[None])) for row in features], axis=1)
    assert np.array_equal(together, one_by_one)


def test_the_seed_fixes_everything(anchors: Anchors, forests: LaneChangeForests) -> None:
    again, other = (to_record(fit(anchors, spec=SMALL, seed=seed), TAGS).arrays for seed in (1, 2))
    for name, array in to_record(forests, TAGS).arrays.items():
        assert np.array_equal(array, again[name], equal_nan=array.dtype.kind == "f"), name
    assert not np.array_equal(other["packed.trees.left"], again["packed.trees.left"])


def test_forests_learn(forests: LaneChangeForests) -> None:
    test = random_anchors(np.random.default_rng(9), 1200)
    within, at = predict(forests, test.features)
    assert within[test.change_time < 7.0, 8].mean() > within[test.change_time > 9.0, 8].mean() + 0.2
    near = np.abs(test.change_time - 3.0) < 0.5
    assert at[near, 3].mean() > at[test.change_time > 6.0, 3].mean() + 0.2


def test_saved_forests_are_the_same_forests(forests: LaneChangeForests, anchors: Anchors, tmp_path: Path) -> None:
    save_model(forests, tmp_path / "forests", TAGS)
    loaded = load_model(tmp_path / "forests", TAGS, kind="lane_changes")
    assert loaded.spec == forests.spec
    assert loaded.reading is forests.reading
    for mine, theirs in zip(predict(forests, anchors.features), predict(loaded, anchors.features), strict=True):
        assert np.array_equal(mine, theirs)
    assert importance_table(loaded).equals(importance_table(forests))
    assert training_table(loaded).equals(training_table(forests))


def test_forests_of_another_number_are_refused(forests: LaneChangeForests) -> None:
    with pytest.raises(ModelError, match=r"expected 32 forests of 4 trees.*got 96 trees, 3 in a forest"):
        replace(forests, spec=replace(forests.spec, n_trees=4))


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


@pytest.mark.slow
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


def test_the_codes_of_a_saved_training_stay_what_they_are() -> None:
    assert {member.name: member.value for member in Training} == {"TRAINED": 0, "ONE_CLASS": 1, "NO_SAMPLES": 2}
