"""The metrics against plain loops and closed forms, and the tables made of them."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from scipy.stats import norm

from rampcast.benchmark.metrics import coverage, crps_of_quantiles, gap_closed, pit_histogram
from rampcast.benchmark.models import LEVELS, Forecasts
from rampcast.benchmark.place_tables import case_table, score_table, time_blocks

RNG = np.random.default_rng(3)


def test_the_crps_of_a_single_number_is_its_absolute_error():
    truth = np.array([3.0, -1.0])
    np.testing.assert_allclose(crps_of_quantiles(np.full((2, 5), [[5.0], [-2.0]]), truth), [2.0, 1.0])


def test_the_crps_of_five_normal_quantiles_is_within_a_tenth_of_the_closed_form():
    truth = RNG.normal(size=4000)
    quantiles = np.tile(norm.ppf(LEVELS), (4000, 1))
    assert crps_of_quantiles(quantiles, truth).mean() == pytest.approx(1 / np.sqrt(np.pi), rel=0.1)


def test_calibrated_quantiles_have_a_flat_pit_and_cover_what_they_say():
    truth = norm.ppf((np.arange(1000) + 0.5) / 1000)
    quantiles = np.tile(norm.ppf(LEVELS), (1000, 1))
    np.testing.assert_allclose(pit_histogram(quantiles, truth), [0.05, 0.2, 0.25, 0.25, 0.2, 0.05], atol=1e-9)
    assert coverage(quantiles[:, 0], quantiles[:, -1], truth) == pytest.approx(0.9)
    assert coverage(quantiles[:, 1], quantiles[:, -2], truth) == pytest.approx(0.5)


def test_the_reference_closes_nothing_of_the_gap_and_the_oracle_all_of_it():
    error, reference = np.array([18.0, 4.0, 11.0, 11.0]), np.array([18.0, 18.0, 18.0, 4.0])
    np.testing.assert_array_equal(gap_closed(error, reference, np.full(4, 4.0)), [0.0, 1.0, 0.5, np.nan])


@pytest.fixture
def forecasts(cases):
    """Returns a reference that is 4 m off, an oracle that is 1 m off and blind at 2 s, and one with quantiles."""
    truth = cases.truth
    oracle = truth - 1.0
    oracle[::2, 9] = np.nan
    spread = truth[..., None] + np.array([-4.0, -1.0, 0.5, 2.0, 5.0])
    return {
        "chain_1": Forecasts(truth + 4.0),
        "other": Forecasts(truth + 2.5, spread),
        "oracle": Forecasts(oracle),
    }


def test_the_table_of_scores_has_what_a_loop_finds(cases, forecasts):
    table = score_table(cases, forecasts)
    row = table.row(
        by_predicate=(pl.col("model") == "other") & (pl.col("depth") == 3) & (pl.col("horizon") == 2.0), named=True
    )
    deep = [k for k in range(len(cases)) if cases.platoons.depth[k] >= 3]
    assert row["n"] == len(deep)
    assert row["groups"] == len({cases.group[k] for k in deep})
    assert (row["mean_error"], row["rmse"], row["bias"]) == pytest.approx((2.5, 2.5, 2.5))
    assert (row["within_5"], row["within_10"], row["error_low"], row["error_high"]) == pytest.approx((1, 1, 2.5, 2.5))
    assert (row["coverage_50"], row["coverage_90"], row["width_50"], row["width_90"]) == pytest.approx((1, 1, 3, 9))
    assert row["pit_25_50"] == 1.0
    assert (row["gap_closed"], row["gap_closed_low"], row["gap_closed_high"]) == pytest.approx((0.5, 0.5, 0.5))
    crps = 2 * sum(
        width * max(level * -offset, (level - 1) * -offset)
        for level, width, offset in zip(
            LEVELS, (0.15, 0.225, 0.25, 0.225, 0.15), (-4.0, -1.0, 0.5, 2.0, 5.0), strict=True
        )
    )
    assert row["crps"] == pytest.approx(crps)
    assert sorted(table["depth"].unique()) == [0, 1, 2, 3, 4]
    assert sorted(table["horizon"].unique()) == list(range(1, 16))


def test_an_oracle_that_another_beats_is_no_floor(cases, forecasts):
    better = score_table(cases, forecasts | {"best": Forecasts(cases.truth + 0.5)})
    assert better["gap_closed"].is_null().all()


def test_who_is_nearer_than_constant_velocity_in_every_draw_is_better_until_he_is_not(cases):
    """At 1 to 7 s 1 m off instead of 2 m, from 8 s on 3 m."""
    error = np.where(np.arange(75) < 37, 1.0, 3.0)
    table = score_table(
        cases, {"constant_velocity": Forecasts(cases.truth + 2.0), "other": Forecasts(cases.truth + error)}
    ).filter((pl.col("model") == "other") & (pl.col("depth") == 0))
    assert table["better"].to_list() == table["better_until"].to_list() == [1.0] * 7 + [0.0] * 8
    late = score_table(
        cases, {"constant_velocity": Forecasts(cases.truth + 2.0), "other": Forecasts(cases.truth + error[::-1])}
    ).filter((pl.col("model") == "other") & (pl.col("depth") == 0))
    assert late["better"].to_list() == [0.0] * 7 + [1.0] * 8
    assert late["better_until"].to_list() == [0.0] * 15


def test_samples_are_scored_together_and_so_are_their_gaps_to_the_leader(cases):
    """Two samples 1 m short of the truth and 1 m beyond: CRPS 1 - 1 = 0, and so at all seconds together."""
    truth = cases.truth[:, 4::5]
    samples = np.stack([truth - 1.0, truth + 1.0], axis=1)
    gap = cases.leader_truth[:, 4::5] - truth - 4.8
    gaps = np.stack([gap - 2.0, gap - 1.0], axis=1)
    found = score_table(cases, {"other": Forecasts(cases.truth, samples=samples, gaps=gaps)}).filter(
        pl.col("depth") == 0
    )
    np.testing.assert_allclose(found["energy"], 0.0, atol=1e-9)
    np.testing.assert_allclose(found["gap_crps"], 1.5 - 0.5, atol=1e-9)  # E|X - y| = 1.5, E|X - X'| = 1
    assert found["gap_coverage_90"].to_list() == [0.0] * 15
    assert found["gap_pit_deviation"].to_list() == pytest.approx([0.9] * 15)
    assert found["gap_n"].to_list() == [len(cases)] * 15
    point = score_table(cases, {"other": Forecasts(cases.truth + 3.0)})
    np.testing.assert_allclose(point["energy"], 3.0)


def test_blocks_of_time_are_half_a_minute_of_a_window(cases):
    """The two queues of each of three windows begin at 0 and 100 s; cases are 4 to 14 s later."""
    assert len(np.unique(time_blocks(cases))) == 6
    assert len(np.unique(time_blocks(replace(cases, t0=np.full(len(cases), np.nan))))) == 1


def test_what_is_not_known_is_null_in_the_table(cases, forecasts):
    table = score_table(cases, forecasts)
    assert table.filter(pl.col("model") == "chain_1")["crps"].is_null().all()
    blind = table.filter((pl.col("model") == "oracle") & (pl.col("depth") == 0))
    counts = dict(zip(blind["horizon"], blind["n"], strict=True))
    assert counts[2.0] == len(cases) / 2
    assert counts[3.0] == len(cases)


def test_every_single_forecast_is_written_in_the_columns_that_are_promised(cases, forecasts):
    table = case_table(cases, forecasts)
    assert table.columns == [
        *("data_set", "case", "depth", "horizon", "model", "x"),
        *("x_q05", "x_q25", "x_q50", "x_q75", "x_q95", "x_true"),
    ]
    assert table.height == len(cases) * 15 * 3
    of_other = table.filter(pl.col("model") == "other")
    np.testing.assert_allclose(of_other["x"] - of_other["x_true"], 2.5)
    np.testing.assert_allclose(of_other["x_q95"] - of_other["x_true"], 5.0)
    assert table.filter(pl.col("model") == "chain_1")["x_q50"].is_null().all()
    first = table.row(
        by_predicate=(pl.col("case") == "1-3-65") & (pl.col("horizon") == 7.0) & (pl.col("model") == "other"),
        named=True,
    )
    assert first["x_true"] == cases.truth[cases.case.tolist().index("1-3-65"), 34]
    assert first["depth"] == 2
