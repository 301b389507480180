"""The metrics against plain loops and closed forms, and the tables made of them."""

import numpy as np
import polars as pl
import pytest
from scipy.stats import norm

from rampcast.benchmark.metrics import (
    bootstrap_mean,
    case_table,
    coverage,
    crps_of_quantiles,
    gap_closed,
    group_draws,
    pit_histogram,
    score_table,
)
from rampcast.benchmark.models import LEVELS, Forecasts

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
    assert gap_closed(18.0, reference=18.0, oracle=4.0) == 0.0
    assert gap_closed(4.0, reference=18.0, oracle=4.0) == 1.0
    assert gap_closed(11.0, reference=18.0, oracle=4.0) == 0.5
    assert np.isnan(gap_closed(11.0, reference=4.0, oracle=4.0))


def test_a_bootstrap_by_group_is_wider_than_one_by_case_when_the_cases_of_a_vehicle_are_alike():
    group = np.repeat(np.arange(20), 30)
    values = np.repeat(RNG.normal(size=20), 30)
    low, high = bootstrap_mean(values, group, group_draws(20))
    narrow_low, narrow_high = bootstrap_mean(values, np.arange(600), group_draws(600))
    assert low < values.mean() < high
    assert high - low > 4.0 * (narrow_high - narrow_low)
    standard_error = values.reshape(20, 30)[:, 0].std() / np.sqrt(20)
    assert high - low == pytest.approx(2 * 1.96 * standard_error, rel=0.15)


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
    assert row["gap_closed"] == pytest.approx(0.5)
    crps = 2 * sum(
        width * max(level * -offset, (level - 1) * -offset)
        for level, width, offset in zip(
            LEVELS, (0.15, 0.225, 0.25, 0.225, 0.15), (-4.0, -1.0, 0.5, 2.0, 5.0), strict=True
        )
    )
    assert row["crps"] == pytest.approx(crps)
    assert sorted(table["depth"].unique()) == [0, 1, 2, 3, 4]
    assert sorted(table["horizon"].unique()) == list(range(1, 16))


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
