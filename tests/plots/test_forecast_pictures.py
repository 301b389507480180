"""The pictures of forecasts and of the benchmark, on made-up tables: labels, lines, what is missing, readability."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rampcast.benchmark.figures import band_coverage, error_over_horizon, reliability_of_merges, reliability_of_places
from rampcast.benchmark.metrics import BINS
from rampcast.benchmark.pictures import benchmark_pictures, read_benchmark, write_benchmark_pictures
from rampcast.benchmark.reliability import merge_reliability, shares_below, typical_case, typical_merges, with_merges
from rampcast.errors import RampcastError
from rampcast.plots.forecast_pictures import arriving_wave, forecast_fan, merge_densities
from tests.plots.looking import assert_readable, legend_labels

pytestmark = pytest.mark.slow

SECONDS = np.arange(1.0, 16.0)
SETS = {"i80_car_following_pairs": 491, "hee_merge_pairs": 34, "simulated": 2525, "a_new_one": 5}  # cases
SHARES = dict(zip(BINS, (0.05, 0.20, 0.25, 0.25, 0.20, 0.05), strict=True))  # of a calibrated forecast
BAND = ("x_q05", "x_q25", "x_q50", "x_q75", "x_q95")


def made_up_cases(data_set: str = "simulated", count: int = 3) -> pl.DataFrame:
    """Returns forecasts of vehicles at 10 m/s; case k lies 2 k m short after 15 s."""
    parts = []
    for k in range(count):
        for model, speed in (("rampcast", 9.0), ("constant_velocity", 10.0), ("idm", 8.0)):
            x = speed * SECONDS
            bands = {f"x_q{level:02d}": x + (level - 50) / 100 * SECONDS for level in (5, 25, 50, 75, 95)}
            rows = {"horizon": SECONDS, "x": x, **bands, "x_true": 9.0 * SECONDS - 2.0 * k * SECONDS / 15.0}
            parts.append(
                pl.DataFrame(rows).with_columns(
                    data_set=pl.lit(data_set), case=pl.lit(f"2-{k}-40"), model=pl.lit(model)
                )
            )
    return pl.concat(parts)


def made_up_merges(data_set: str = "simulated", count: int = 120) -> pl.DataFrame:
    """Returns merges after 0.2, 0.4 ... s that rampcast knows to a second, and the base rate not at all."""
    parts = []
    for k in range(count):
        time = 0.2 * (k + 1)
        known = 1.0 / (1.0 + np.exp(-2.0 * (SECONDS - time)))
        for model, p_within in (("rampcast", known), ("forests", known**0.5), ("base_rate", SECONDS / 24.0)):
            rows = pl.DataFrame({"t": SECONDS.astype(np.int64), "p_within": p_within})
            parts.append(rows.with_columns(data_set=pl.lit(data_set), case=pl.lit(f"2-{k}-40"), model=pl.lit(model),
                                           median_time=pl.lit(time), event_time=pl.lit(time)))  # fmt: skip
    return pl.concat(parts)


def made_up_scores() -> pl.DataFrame:
    """Returns scores of a calibrated rampcast and of other models, by data set."""
    parts = []
    for data_set, n in SETS.items():
        for factor, model in enumerate(("rampcast", "idm", "chain_8", "oracle", "constant_velocity"), start=1):
            rows = pl.DataFrame({"horizon": SECONDS, "mean_error": 0.5 * factor * SECONDS})
            shares = {f"pit_{name}": pl.lit(share) for name, share in SHARES.items()}
            parts.append(rows.with_columns(data_set=pl.lit(data_set), model=pl.lit(model), depth=pl.lit(0), n=pl.lit(n),
                                           coverage_90=pl.lit(0.9), **shares))  # fmt: skip
    return pl.concat(parts)


def made_up_wave() -> pl.DataFrame:
    """Returns three vehicles that brake one after the other, 10 m upstream and 4 s later each."""
    time = np.round(np.arange(-4.0, 15.1, 0.2), 1)
    parts = []
    for place in range(3):
        brakes = 4.0 * (2 - place) - 2.0
        x = 100.0 + 50.0 * place + np.where(time < brakes, 10.0 * time, 10.0 * brakes + 2.0 * (time - brakes))
        rows = pl.DataFrame({"t": time, "x": x, "brakes": np.abs(time - brakes) < 0.05}).with_columns(
            place=pl.lit(place)
        )
        parts += [rows.filter(pl.col("t") <= 0.0).with_columns(series=pl.lit("observed")),
                  rows.filter(pl.col("t") >= 0.0).with_columns(series=pl.lit("future"))]  # fmt: skip
    for series, speed in (("rampcast", 6.0), ("constant_velocity", 10.0)):
        x = 100.0 + speed * SECONDS
        bands = {name: x + (k - 2) * SECONDS for k, name in enumerate(BAND)} if series == "rampcast" else {}
        parts.append(pl.DataFrame({"t": SECONDS, "x": x, **bands}).with_columns(
            series=pl.lit(series), place=pl.lit(0), brakes=pl.lit(value=False)))  # fmt: skip
    return pl.concat(parts, how="diagonal_relaxed")


@pytest.fixture(scope="module")
def one_case() -> pl.DataFrame:
    return made_up_cases(count=1).filter(pl.col("model") != "idm")


def _labels(ax: Axes) -> tuple[str, str]:
    return ax.get_xlabel(), ax.get_ylabel()


def _texts(ax: Axes) -> list[str]:
    return [text.get_text() for text in ax.texts]


def test_a_fan_has_both_bands_the_median_the_truth_and_constant_velocity(one_case: pl.DataFrame) -> None:
    ax = forecast_fan(one_case)
    assert _labels(ax) == ("time from now (t = 0) [s]", "displacement [m]")
    assert legend_labels(ax) == ["90 % band", "50 % band", "rampcast, median", "constant velocity", "truth"]
    truth = next(line for line in ax.get_lines() if line.get_label() == "truth")
    assert truth.get_ydata() == pytest.approx(9.0 * np.arange(16.0))
    assert_readable(ax)


def test_a_fan_of_a_merge_marks_it_and_shows_its_probability_below(one_case: pl.DataFrame) -> None:
    merges = made_up_merges(count=40).filter(pl.col("case") == "2-0-40").with_columns(event_time=pl.lit(4.0))
    ax = forecast_fan(with_merges(one_case, merges))
    assert "merge" in legend_labels(ax)
    strip = ax.get_figure(root=True).axes[-1]
    assert _labels(strip) == ("time from now (t = 0) [s]", "merged [%]")
    mark = next(line for line in ax.get_lines() if line.get_label() == "merge")
    assert (mark.get_xdata()[0], mark.get_ydata()[0]) == pytest.approx((4.0, 36.0))
    assert_readable(ax)


def test_a_fan_without_bands_truth_or_merge_draws_what_there_is(one_case: pl.DataFrame) -> None:
    unknown = [pl.lit(None, pl.Float64).alias(name) for name in (*BAND, "x_true", "p_within", "event_time")]
    ax = forecast_fan(one_case.with_columns(unknown))
    assert legend_labels(ax) == ["rampcast, median", "constant velocity"]
    assert_readable(ax)


def test_a_fan_of_a_merge_after_the_last_second_has_no_mark(one_case: pl.DataFrame) -> None:
    ax = forecast_fan(one_case.with_columns(p_within=pl.lit(0.1), event_time=pl.lit(40.0)))
    assert "merge" not in legend_labels(ax)
    assert_readable(ax)


def test_a_wave_is_drawn_through_the_points_where_vehicles_brake_with_its_speed() -> None:
    ax = arriving_wave(made_up_wave())
    assert _labels(ax) == ("time from now (t = 0) [s]", "position along the road [m]")
    wave = next(line for line in ax.get_lines() if line.get_label() == "the wave")
    assert wave.get_xdata() == pytest.approx([-2.0, 2.0, 6.0])
    # each vehicle is 50 m behind, and goes 40 m in the 4 s until the wave reaches it: 10 m upstream in 4 s
    assert "the wave runs upstream at 2.5 m/s" in _texts(ax)
    assert "rampcast, median" in legend_labels(ax)
    assert_readable(ax)


def test_a_picture_without_a_wave_says_nothing_of_one() -> None:
    ax = arriving_wave(made_up_wave().with_columns(brakes=pl.lit(value=False)))
    assert "the wave" not in legend_labels(ax)
    assert not _texts(ax)
    assert_readable(ax)


def test_densities_stand_one_above_the_other_with_the_true_times() -> None:
    ax = merge_densities(typical_merges(made_up_merges()))
    assert _labels(ax) == ("time from now (t = 0) [s]", "true time of each merge [s]")
    # the times up to 15 s are 0.2, 0.4 ... 15.0 s: the 10 % quantile is at place 7 of 0 to 74
    assert [label.get_text() for label in ax.get_yticklabels()] == ["13.6", "10.6", "7.6", "4.6", "1.6"]
    assert "true time" in legend_labels(ax)
    assert_readable(ax)


def test_densities_of_one_case_whose_merge_was_not_seen_have_no_true_time() -> None:
    merges = made_up_merges(count=1).with_columns(event_time=pl.lit(None, pl.Float64))
    ax = merge_densities(merges)
    assert [label.get_text() for label in ax.get_yticklabels()] == ["–"]
    assert "true time" not in legend_labels(ax)
    assert_readable(ax)


def test_no_merges_are_drawn_as_no_data() -> None:
    assert "no data" in _texts(merge_densities(made_up_merges().clear()))
    assert "no data" in _texts(reliability_of_merges(merge_reliability(made_up_merges()).clear()))


def test_the_shares_below_the_quantiles_of_a_calibrated_forecast_are_their_levels() -> None:
    shares = shares_below(made_up_scores())
    assert shares["level"].to_numpy() == pytest.approx(shares["share"].to_numpy())
    assert sorted(set(shares["level"])) == [0.05, 0.25, 0.5, 0.75, 0.95]


def test_reliability_of_places_is_one_line_by_data_set_with_its_cases() -> None:
    shares = shares_below(made_up_scores()).filter(pl.col("model") == "rampcast")
    ax = reliability_of_places(shares, horizon=5.0)
    assert _labels(ax) == ("level of the forecast quantile [%]", "truths below it [%]")
    # fewer than 20 cases are not drawn, fewer than 100 with open markers
    assert legend_labels(ax) == [
        "I-80, car-following pairs (n = 491)", "HEE, merge pairs (n = 34)", "simulated (n = 2,525)",
    ]  # fmt: skip
    faces = [line.get_markerfacecolor() for line in ax.get_lines() if line.get_label()[0] != "_"]
    assert [face == "white" for face in faces] == [False, True, False]
    assert_readable(ax)


def test_the_coverage_is_drawn_beside_its_zone() -> None:
    falling = pl.when(pl.col("data_set") == "hee_merge_pairs").then((60 - 4 * pl.col("horizon")).cast(pl.Int64))
    scores = made_up_scores().filter(pl.col("model") == "rampcast").with_columns(n=falling.otherwise(pl.col("n")))
    ax = band_coverage(scores)
    assert _labels(ax) == ("time ahead [s]", "truths in the band of 90 % [%]")
    assert "HEE, merge pairs (n = 56 to 20)" in legend_labels(ax)
    assert_readable(ax)


def test_merges_are_as_frequent_as_forecast_where_the_forecast_is_right() -> None:
    rng = np.random.default_rng(1)
    p = rng.uniform(size=4000)
    times = np.where(rng.uniform(size=4000) < p, 4.0, 9.0)
    merges = pl.DataFrame({"case": [str(k) for k in range(4000)], "p_within": p, "event_time": times}).with_columns(
        data_set=pl.lit("simulated"), model=pl.lit("rampcast"), t=pl.lit(5)
    )
    bins = merge_reliability(merges)
    assert bins["n"].sum() == 4000
    assert bins["observed"].to_numpy() == pytest.approx(bins["forecast"].to_numpy(), abs=0.06)
    assert_readable(reliability_of_merges(bins))


def test_a_merge_that_was_not_seen_counts_nowhere() -> None:
    merges = made_up_merges().with_columns(
        event_time=pl.when(pl.col("case") == "2-0-40").then(None).otherwise(pl.col("event_time"))
    )
    bins = merge_reliability(merges).filter((pl.col("model") == "rampcast") & (pl.col("t") == 5))
    assert bins["n"].sum() == 119


def test_reliability_of_merges_shows_models_base_rate_and_cases_per_bin() -> None:
    bins = merge_reliability(made_up_merges()).filter(pl.col("t") == 10)
    ax = reliability_of_merges(bins)
    assert legend_labels(ax) == ["rampcast", "base rate", "forests"]
    strip = ax.get_figure(root=True).axes[-1]
    assert _labels(strip) == ("forecast: merged within 10 s [%]", "cases")
    assert_readable(ax)


def test_the_error_over_the_horizon_leaves_out_few_cases_and_missing_numbers() -> None:
    scores = made_up_scores().filter(pl.col("data_set") == "simulated")
    few = pl.when((pl.col("model") == "idm") & (pl.col("horizon") > 9)).then(19).otherwise(pl.col("n"))
    unknown = pl.when(pl.col("model") == "oracle").then(None).otherwise(pl.col("mean_error"))
    ax = error_over_horizon(scores.with_columns(n=few, mean_error=unknown))
    assert _labels(ax) == ("time ahead [s]", "mean absolute error [m]")
    assert legend_labels(ax) == ["rampcast", "constant velocity", "IDM", "chain of 8"]
    assert max(ax.get_lines()[2].get_xdata()) == 9.0
    assert_readable(ax)


def test_a_panel_draws_into_axes_that_it_is_given(one_case: pl.DataFrame) -> None:
    given = Figure().add_subplot()
    assert forecast_fan(one_case, ax=given) is given


def test_a_table_that_lacks_a_column_is_an_error_that_names_it(one_case: pl.DataFrame) -> None:
    with pytest.raises(RampcastError, match=r"'cases' lacks the columns \['x_true'\]"):
        forecast_fan(one_case.drop("x_true"))


def test_the_typical_case_is_the_one_with_the_median_error_at_the_last_horizon() -> None:
    assert typical_case(made_up_cases(count=3))["case"].unique().to_list() == ["2-1-40"]
    assert typical_case(made_up_cases().clear()).is_empty()


def test_the_pictures_of_a_run_are_written_beside_its_tables(tmp_path: Path) -> None:
    made_up_scores().write_parquet(tmp_path / "scores.parquet")
    made_up_cases().write_parquet(tmp_path / "cases.parquet")
    made_up_merges().write_parquet(tmp_path / "merge_cases.parquet")
    written = write_benchmark_pictures(tmp_path)
    names = {path.stem for path in written}
    assert names == {"error_over_horizon", "band_coverage", "reliability_of_places", "typical_forecasts",
                     "reliability_of_merges_simulated", "merge_densities_simulated"}  # fmt: skip
    assert {path.suffix for path in written} == {".png", ".svg"}
    assert all(path.parent == tmp_path and path.stat().st_size > 0 for path in written)


def test_the_pictures_of_a_run_are_readable(tmp_path: Path) -> None:
    tables = {"scores": made_up_scores(), "cases": made_up_cases(), "merge_cases": made_up_merges()}
    for figure in benchmark_pictures(tables).values():
        assert_readable(figure.axes[0])


def test_a_run_without_merges_has_no_pictures_of_them(tmp_path: Path) -> None:
    made_up_scores().write_parquet(tmp_path / "scores.parquet")
    pl.DataFrame().write_parquet(tmp_path / "merge_cases.parquet")
    assert set(benchmark_pictures(read_benchmark(tmp_path))) == {
        "error_over_horizon",
        "band_coverage",
        "reliability_of_places",
    }


def test_a_folder_without_scores_is_an_error_that_says_what_to_give(tmp_path: Path) -> None:
    with pytest.raises(RampcastError, match="give the folder that `rampcast benchmark` wrote"):
        write_benchmark_pictures(tmp_path)


def test_nothing_is_written_when_a_picture_cannot_be_drawn(tmp_path: Path) -> None:
    made_up_scores().write_parquet(tmp_path / "scores.parquet")
    made_up_cases().drop("x_true").write_parquet(tmp_path / "cases.parquet")
    with pytest.raises((RampcastError, pl.exceptions.ColumnNotFoundError)):
        write_benchmark_pictures(tmp_path)
    assert [path.name for path in tmp_path.iterdir() if path.suffix not in (".parquet",)] == []
