"""Metrics of the lane-change classifiers."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn import metrics

from rampcast.paper.lane_change.forests import ForestSpec, LaneChangeForests, fit, predict
from rampcast.paper.lane_change.scores import METRICS, binary_metrics, lane_change_table
from rampcast.paper.lane_change.sets import Anchors, Reading
from tests.factories import random_anchors


@pytest.fixture(scope="module")
def forests() -> LaneChangeForests:
    return fit(random_anchors(np.random.default_rng(0), 1000), spec=ForestSpec(n_trees=5), seed=0)


@pytest.fixture(scope="module")
def test_anchors() -> Anchors:
    return random_anchors(np.random.default_rng(1), 600)


@pytest.fixture(scope="module")
def table(forests: LaneChangeForests, test_anchors: Anchors) -> pl.DataFrame:
    return lane_change_table(forests, test_anchors, seed=0)


def test_metrics_by_hand() -> None:
    probability = np.array([0.9, 0.6, 0.5, 0.2, 0.8])
    positive = np.array([True, True, True, False, False])
    got = binary_metrics(probability, positive)
    assert got == pytest.approx(
        {
            "accuracy": 3 / 5,  # a tie of 0.5 is "no lane change"
            "tpr": 2 / 3,
            "tnr": 1 / 2,
            "ppv": 2 / 3,
            "npv": 1 / 2,
            "base_rate": 3 / 5,
            "brier": (0.01 + 0.16 + 0.25 + 0.04 + 0.64) / 5,
            "best_accuracy": 4 / 5,  # between 0.2 and 0.5: the one at 0.8 is wrong
            "brier_skill": 1 - (1.10 / 5) / (3 / 5 * 2 / 5),
        }
    )


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(st.floats(0.0, 1.0), st.booleans()), min_size=1, max_size=30))
def test_metrics_equal_those_of_scikit_learn(samples: list[tuple[float, bool]]) -> None:
    probability, positive = np.array([p for p, _ in samples]), np.array([y for _, y in samples])
    got, said = binary_metrics(probability, positive), probability > 0.5
    tn, fp, fn, tp = metrics.confusion_matrix(positive, said, labels=[False, True]).ravel()
    for name, right, of in (("tpr", tp, tp + fn), ("tnr", tn, tn + fp), ("ppv", tp, tp + fp), ("npv", tn, tn + fn)):
        assert got[name] == (pytest.approx(right / of) if of else None)
    assert got["accuracy"] == pytest.approx(metrics.accuracy_score(positive, said))
    assert got["brier"] == pytest.approx(metrics.mean_squared_error(positive, probability))
    thresholds = [-1.0, *probability]
    best = max(metrics.accuracy_score(positive, probability > threshold) for threshold in thresholds)
    assert got["best_accuracy"] == pytest.approx(best)


def test_metrics_of_nothing_and_of_no_answer_are_none() -> None:
    assert set(binary_metrics(np.zeros(0), np.zeros(0, bool)).values()) == {None}
    assert set(binary_metrics(np.array([np.nan]), np.array([True])).values()) == {None}


def test_the_table_has_a_row_for_each_sampling_kind_and_t(table: pl.DataFrame) -> None:
    names = [
        "mode",
        "model",
        "reading",
        "sampling",
        "kind",
        "t",
        "n",
        "positives",
        "accuracy",
        "tpr",
        "tnr",
        "ppv",
        "npv",
    ]
    assert table.columns == [
        *names,
        "base_rate",
        "brier",
        "best_accuracy",
        "brier_skill",
        "censored",
        "changed_already",
    ]
    assert table.select("sampling", "kind", "t").is_duplicated().sum() == 0
    assert len(table) == 2 * 2 * 16
    assert set(table["mode"]) == {"paper"}
    assert set(table["model"]) == {"forests"}
    assert set(table["reading"]) == {"label"}
    assert table["n"].min() > 0


def test_a_natural_row_equals_a_plain_calculation(
    table: pl.DataFrame, forests: LaneChangeForests, test_anchors: Anchors
) -> None:
    probability = predict(forests, test_anchors.features)[0][:, 7]
    known = ~np.isnan(test_anchors.change_time) | (test_anchors.seen_for > 7.1)
    positive = (np.nan_to_num(test_anchors.change_time, nan=99.0) < 7.1)[known]
    row = table.row(
        by_predicate=(pl.col("sampling") == "natural") & (pl.col("kind") == "within") & (pl.col("t") == 7.0), named=True
    )
    assert (row["n"], row["positives"], row["censored"]) == (known.sum(), positive.sum(), (~known).sum())
    expected = binary_metrics(probability[known], positive)
    assert {name: row[name] for name in METRICS} == pytest.approx(expected)


def test_balanced_sets_are_even_and_natural_sets_have_the_base_rate(table: pl.DataFrame) -> None:
    at_8 = table.filter((pl.col("kind") == "at") & (pl.col("t") == 8.0))
    rate = dict(at_8.select("sampling", "base_rate").iter_rows())
    assert rate["natural"] < 0.05
    assert rate["balanced"] > 0.2


def test_the_seed_fixes_the_table(forests: LaneChangeForests, test_anchors: Anchors, table: pl.DataFrame) -> None:
    assert lane_change_table(forests, test_anchors, seed=0).equals(table)
    assert not lane_change_table(forests, test_anchors, seed=1).equals(table)


def test_certain_and_right_is_all_the_skill_there_is() -> None:
    right = binary_metrics(np.array([1.0, 0.0, 0.0]), np.array([True, False, False]))
    assert (right["brier_skill"], right["best_accuracy"]) == (1.0, 1.0)
    of_one_kind = binary_metrics(np.array([0.2, 0.1]), np.array([False, False]))
    assert of_one_kind["brier_skill"] is None
    assert of_one_kind["best_accuracy"] == 1.0


def test_an_undefined_metric_is_null(forests: LaneChangeForests, test_anchors: Anchors) -> None:
    late = replace(test_anchors, change_time=np.full(600, 30.0), reading=Reading.CROSSING)
    got = lane_change_table(forests, late, seed=0)
    assert got["tpr"].null_count() == len(got)
    assert got["tnr"].null_count() == 0
    assert set(got["reading"]) == {"crossing"}
