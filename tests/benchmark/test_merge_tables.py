"""The tidy tables of merges against what can be counted."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from rampcast.benchmark import MergeForecasts, Training, run_benchmark
from rampcast.benchmark.merge_tables import (
    SECOND_COLUMNS,
    TIME_COLUMNS,
    merge_case_table,
    merge_score_table,
    outcomes,
    thresholds,
)
from rampcast.benchmark.merges import TIME
from rampcast.cli import show as terminal
from rampcast.forecasters import merges, places
from rampcast.paper.lane_change import forests
from tests.benchmark import made_up_merges

CHEAP = {name: merges()[name] for name in ("base_rate", "kaplan_meier")}


def knowing(cases, *, late: float = 0.0) -> MergeForecasts:
    """Returns the forecasts of one who knows the truth, that much later [s]."""
    time = cases.change_time + late
    p_within = (TIME >= time[:, None] - 1e-9).astype(float)
    p_at = np.diff(p_within, axis=1, prepend=0.0)
    return MergeForecasts(p_within, p_at, np.minimum(time, 15.0), gap=cases.gap, place=cases.place + 3.0)


@pytest.fixture(scope="module")
def forecasts(merging):
    training = Training(merging)
    found = {name: fit(training)(merging.scenes, merging.since_entry) for name, fit in CHEAP.items()}
    return found | {"knowing": knowing(merging), "late": knowing(merging, late=2.0)}


@pytest.fixture(scope="module")
def scores(merging, forecasts):
    limits = {name: thresholds(outcomes(merging), forecast) for name, forecast in forecasts.items()}
    return merge_score_table(merging, forecasts, limits)


def test_there_is_a_row_for_times_and_one_for_every_second(scores, forecasts):
    assert scores.columns == ["data_set", "horizon", "model", "n", "groups", *TIME_COLUMNS, *SECOND_COLUMNS]
    assert scores.height == len(forecasts) * (1 + 15)
    assert scores["horizon"].null_count() == len(forecasts)
    of_times, of_seconds = scores.filter(pl.col("horizon").is_null()), scores.filter(pl.col("horizon").is_not_null())
    assert all(of_times[name].null_count() == len(forecasts) for name in SECOND_COLUMNS)
    assert all(of_seconds[name].null_count() == of_seconds.height for name in TIME_COLUMNS)


def test_who_knows_the_truth_is_never_wrong(scores, merging):
    row = scores.filter(pl.col("horizon").is_null() & (pl.col("model") == "knowing")).row(0, named=True)
    assert row["n"] == len(merging)
    assert (row["time_error"], row["time_error_ratio"], row["c_index"]) == (0.0, 0.0, 1.0)
    assert (row["gap_accuracy"], row["place_error"]) == (1.0, pytest.approx(3.0))
    assert row["crps"] < 0.1  # the curve is linear within a step
    of_seconds = scores.filter(pl.col("horizon").is_not_null() & (pl.col("model") == "knowing"))
    for name in ("accuracy", "best_accuracy", "exact_accuracy", "exact_accuracy_natural"):
        assert set(of_seconds[name].drop_nulls().to_list()) <= {1.0}, name
    assert of_seconds["brier"].max() == of_seconds["calibration_error"].max() == 0.0


def test_who_is_two_seconds_late_is_off_by_two_seconds(scores, forecasts):
    row = scores.filter(pl.col("horizon").is_null() & (pl.col("model") == "late")).row(0, named=True)
    assert row["time_error"] == pytest.approx(2.0)
    assert (row["time_error_low"], row["time_error_high"]) == pytest.approx((2.0, 2.0))
    assert row["c_index"] == 1.0
    assert row["crps"] == pytest.approx(2.0, abs=0.1)
    assert "late" in forecasts


def test_the_base_rate_has_no_skill_and_orders_nothing(scores):
    base = scores.filter(pl.col("model") == "base_rate")
    assert base["brier_skill"].drop_nulls().abs().max() == 0.0
    assert base["c_index"].drop_nulls().to_list() == [0.5]
    share = base.filter(pl.col("horizon") == 3.0).row(0, named=True)
    assert share["brier"] == pytest.approx(share["merged"] * (1.0 - share["merged"]))


def test_cases_are_written_at_every_whole_second(merging, forecasts):
    table = merge_case_table(merging, forecasts)
    assert table.columns == ["data_set", "case", "model", "median_time", "t", "p_within", "event_time"]
    assert table.height == len(merging) * len(forecasts) * 15
    mine = table.filter((pl.col("model") == "knowing") & (pl.col("t") == 3))
    np.testing.assert_array_equal(mine["p_within"] == 1.0, merging.change_time <= 3.0 + 1e-9)
    np.testing.assert_array_equal(mine["event_time"], merging.change_time)
    lost = merge_case_table(replace(merging, change_time=np.full(len(merging), np.nan)), forecasts)
    assert lost["event_time"].null_count() == lost.height


def test_merges_that_no_one_saw_are_scored_as_far_as_they_were_watched(merging, forecasts):
    """Nobody is seen to merge: no errors of times, and every probability is too large."""
    lost = replace(merging, change_time=np.full(len(merging), np.nan), gap=np.full(len(merging), np.nan))
    limits = {name: thresholds(outcomes(lost), forecast) for name, forecast in forecasts.items()}
    table = merge_score_table(lost, forecasts, limits)
    of_times = table.filter(pl.col("horizon").is_null())
    assert of_times["n"].to_list() == [0] * len(forecasts)
    assert of_times["time_error"].null_count() == of_times["c_index"].null_count() == len(forecasts)
    assert table.filter(pl.col("horizon") == 1.0)["merged"].to_list() == [0.0] * len(forecasts)


def test_a_run_with_merges_has_their_tables(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(forests, "SPECS", {mode: replace(spec, n_trees=5) for mode, spec in forests.SPECS.items()})
    sides = [tmp_path / name for name in ("train", "test")]
    for seed, folder in enumerate(sides):
        folder.mkdir()
        made_up_merges.cases(folder, made_up_merges.merges(9, seed=seed))
    found = run_benchmark(
        *sides,
        models={name: places()[name] for name in ("constant_velocity", "chain_1")},
        merge_models=CHEAP | {"forests": merges()["forests"]},
    )
    assert found.merge_scores["model"].unique(maintain_order=True).to_list() == [*CHEAP, "forests"]
    about = found.record["data_sets"]["us101_ramp_merges"]
    assert about["test_merges"] == about["test"] == found.merge_cases["case"].n_unique()
    assert about["test"] > found.cases["case"].n_unique()  # those with less than a second to go ask for the merge alone
    terminal.print_benchmark(found)
    assert f"us101_ramp_merges, time to the merge (n = {about['test']} within 15 s)" in capsys.readouterr().out
