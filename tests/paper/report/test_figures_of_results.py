"""Each panel that draws results: labels with units, lines and legend entries, missing numbers, and readability."""

import polars as pl
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rampcast.errors import RampcastError
from rampcast.paper.report.figures import classification_figure
from rampcast.paper.report.lane_change import base_rate, feature_importance, lane_change_metrics
from rampcast.paper.report.longitudinal import (
    forecast_accuracy,
    forecast_bias,
    forecast_error,
    forecast_within,
    neighbour_accuracy,
    neighbour_error,
    scenes_per_horizon,
)
from tests.plots import tidy_tables
from tests.plots.looking import assert_readable, legend_labels


@pytest.fixture(scope="module")
def longitudinal() -> pl.DataFrame:
    return tidy_tables.longitudinal().filter(pl.col("mode") == "paper")


@pytest.fixture(scope="module")
def central(longitudinal: pl.DataFrame) -> pl.DataFrame:
    return longitudinal.filter(pl.col("group") == "central")


@pytest.fixture(scope="module")
def three_laws(central: pl.DataFrame) -> pl.DataFrame:
    return central.filter(pl.col("model").is_in(["idm", "gipps_paper", "ghr"]))


@pytest.fixture(scope="module")
def neighbours(longitudinal: pl.DataFrame) -> pl.DataFrame:
    return longitudinal.filter((pl.col("group") != "central") & (pl.col("model") == "lstm"))


@pytest.fixture(scope="module")
def lane_change() -> pl.DataFrame:
    return tidy_tables.lane_change().filter((pl.col("mode") == "paper") & (pl.col("reading") == "label"))


def _one(table: pl.DataFrame, **values: str) -> pl.DataFrame:
    return table.filter(*(pl.col(name) == value for name, value in values.items()))


def _lines(ax: Axes) -> list[tuple[object, ...]]:
    return [
        (line.get_color(), line.get_marker(), line.get_linestyle())
        for line in ax.get_lines()
        if line.get_label()[0] != "_"
    ]


def test_the_accuracy_of_neighbours_has_one_line_per_lane_and_tolerance(neighbours: pl.DataFrame) -> None:
    ax = neighbour_accuracy(neighbours)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("time ahead [s]", "predictions within 5 m or 10 m [%]")
    assert legend_labels(ax) == ["ramp lane, 5 m", "ramp lane, 10 m", "target lane, 5 m", "target lane, 10 m"]
    assert [line.get_linestyle() for line in ax.get_lines()] == ["-", "--", "-", "--"]
    assert_readable(ax)


def test_the_error_of_neighbours_has_one_line_per_lane(neighbours: pl.DataFrame) -> None:
    ax = neighbour_error(neighbours)
    assert ax.get_ylabel() == "mean absolute error [m]"
    assert legend_labels(ax) == ["neighbours on the ramp", "neighbours in the target lane"]
    assert_readable(ax)


def test_the_accuracy_of_forecasts_draws_percentages_of_the_table(three_laws: pl.DataFrame) -> None:
    ax = forecast_accuracy(three_laws)
    assert len(ax.get_lines()) == 6
    idm = _one(three_laws, model="idm").sort("horizon")
    assert ax.get_lines()[0].get_ydata() == pytest.approx(100.0 * idm["within_5"].to_numpy())
    assert "Gipps (paper), 10 m" in legend_labels(ax)
    assert_readable(ax)


def test_the_error_of_forecasts_draws_metres_of_the_table(three_laws: pl.DataFrame) -> None:
    ax = forecast_error(three_laws)
    assert legend_labels(ax) == ["IDM", "Gipps (paper)", "GHR"]
    idm = _one(three_laws, model="idm").sort("horizon")
    assert ax.get_lines()[0].get_ydata() == pytest.approx(idm["mean_error"].to_numpy())
    assert ax.get_ylim()[0] == 0.0
    assert_readable(ax)


def test_every_model_and_baseline_has_a_look_of_its_own() -> None:
    ax = forecast_error(_one(tidy_tables.longitudinal(), mode="corrected", group="central"))
    assert legend_labels(ax)[0] == "rampcast"
    assert len(_lines(ax)) == len(tidy_tables.ERROR_AT_15) == len(set(_lines(ax)))
    assert_readable(ax)


@pytest.mark.parametrize("tolerance", ["within_5", "within_10"])
def test_the_share_within_one_tolerance_names_it_on_the_axis(central: pl.DataFrame, tolerance: str) -> None:
    ax = forecast_within(central, tolerance=tolerance)
    assert ax.get_ylabel() == f"forecasts within {tolerance[7:]} m [%]"
    assert_readable(ax)


def test_the_bias_is_drawn_around_a_line_at_zero(central: pl.DataFrame) -> None:
    ax = forecast_bias(central)
    assert ax.get_ylabel() == "mean of forecast − observed [m]"
    assert any(set(line.get_ydata()) == {0.0} for line in ax.get_lines())
    assert_readable(ax)


def test_the_number_of_scored_forecasts_is_a_count_per_group(longitudinal: pl.DataFrame) -> None:
    ax = scenes_per_horizon(longitudinal)
    assert ax.get_ylabel() == "forecasts scored [count]"
    assert len(legend_labels(ax)) == 3
    assert_readable(ax)


@pytest.mark.parametrize("kind", ["within", "at"])
def test_classification_metrics_are_five_lines_over_t(lane_change: pl.DataFrame, kind: str) -> None:
    ax = lane_change_metrics(_one(lane_change, sampling="balanced", kind=kind))
    assert ax.get_xlabel() == f"t: lane change {kind} t seconds [s]"
    assert ax.get_ylabel() == "classification metric [%]"
    assert len(legend_labels(ax)) == len(set(_lines(ax))) == 5
    assert_readable(ax)


def test_the_base_rate_is_the_share_of_positives(lane_change: pl.DataFrame) -> None:
    ax = base_rate(lane_change)
    natural = next(line for line in ax.get_lines() if line.get_label() == "natural samples, within t")
    assert natural.get_ydata()[10] == pytest.approx(50.0)
    assert len(legend_labels(ax)) == 4
    assert_readable(ax)


@pytest.mark.parametrize(("grouping", "lines"), [("feature", 6), ("vehicle", 3)])
def test_importance_has_one_line_per_group(grouping: str, lines: int) -> None:
    ax = feature_importance(_one(tidy_tables.importance(), mode="paper", kind="at", grouping=grouping))
    assert ax.get_ylabel() == "share of the importance [%]"
    assert len(legend_labels(ax)) == len(set(_lines(ax))) == lines
    assert_readable(ax)


def test_a_panel_draws_into_axes_that_it_is_given(three_laws: pl.DataFrame) -> None:
    given = Figure().add_subplot()
    assert forecast_error(three_laws, ax=given) is given
    assert len(given.get_lines()) == 3


def test_unknown_numbers_are_gaps_and_a_model_without_any_is_left_out(three_laws: pl.DataFrame) -> None:
    late, idm = pl.col("horizon") > 6, pl.col("model") == "idm"
    holes = pl.when(idm).then(None).when(late).then(float("nan")).otherwise(pl.col("mean_error"))
    ax = forecast_error(three_laws.with_columns(mean_error=holes))
    assert legend_labels(ax) == ["Gipps (paper)", "GHR"]
    assert_readable(ax)


def test_a_table_without_rows_is_drawn_as_no_data(three_laws: pl.DataFrame) -> None:
    ax = forecast_error(three_laws.clear())
    assert "no data" in [text.get_text() for text in ax.texts]


def test_short_horizons_are_given_the_room(three_laws: pl.DataFrame) -> None:
    assert forecast_error(three_laws.filter(pl.col("horizon") <= 6)).get_xlim()[1] < 7


def test_a_table_that_lacks_a_column_is_an_error_that_names_it(three_laws: pl.DataFrame) -> None:
    with pytest.raises(RampcastError, match=r"'longitudinal' lacks the columns \['mean_error'\]"):
        forecast_error(three_laws.drop("mean_error"))


def test_a_table_of_two_modes_is_an_error_that_says_so() -> None:
    with pytest.raises(RampcastError, match=r"one panel draws one mode.*\['corrected', 'paper'\]"):
        forecast_error(tidy_tables.longitudinal())


def test_a_model_that_never_says_yes_is_told_in_words_and_not_drawn_as_flat_lines() -> None:
    table = tidy_tables.lane_change()
    silent = (pl.col("mode") == "corrected") & (pl.col("kind") == "at")
    table = table.with_columns(
        tpr=pl.when(silent).then(0.0).otherwise("tpr"), accuracy=pl.when(silent).then(0.5).otherwise("accuracy")
    )
    figure = classification_figure({"lane_change": table})
    drawn = [panel.name for panel in figure.panels]
    assert "10b-paper" in drawn
    assert "10b-corrected" not in drawn
    (why,) = figure.missing
    assert "(b) at t, corrected mode" in why
    assert "accuracy, 50 %" in why
