"""Pictures of single scenes and of whole lanes."""

import numpy as np
import polars as pl
import pytest

from rampcast.errors import RampcastError
from rampcast.plots.tracks import plot_forecast, scene_tracks, space_time
from tests.plots import tidy_tables
from tests.plots.looking import assert_readable, legend_labels


@pytest.fixture(scope="module")
def example() -> pl.DataFrame:
    return tidy_tables.examples().filter((pl.col("mode") == "paper") & (pl.col("example") == "shock_1"))


@pytest.fixture(scope="module")
def probabilities() -> pl.DataFrame:
    return pl.DataFrame({"t": np.arange(16.0), "p_within": np.arange(16) / 15.0, "p_at": np.full(16, 0.1)})


def test_a_scene_shows_the_central_vehicle_its_forecasts_and_six_named_neighbours(example: pl.DataFrame) -> None:
    ax = scene_tracks(example, ramp_end=230.0)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("time from now (t = 0) [s]", "position x along the road [m]")
    entries = legend_labels(ax)
    assert {"central, observed", "central, GHR", "central, IDM", "central, LSTM alone"} <= set(entries)
    assert {"l", "f", "l1", "l2", "f1", "f2", "ramp ends "} == {text.get_text() for text in ax.texts}
    assert_readable(ax)


def test_a_forecast_with_samples_is_the_first_and_has_its_band() -> None:
    corrected = tidy_tables.examples().filter((pl.col("mode") == "corrected") & (pl.col("example") == "good_1"))
    ax = scene_tracks(corrected, ramp_end=230.0)
    assert legend_labels(ax)[4:7] == ["central, observed", "rampcast, 90 % band", "central, rampcast"]
    (band,) = ax.collections
    low, high = (corrected.filter(pl.col("series") == f"central {name} quantile")["x"] for name in ("5 %", "95 %"))
    edges = band.get_paths()[0].get_extents()
    assert (edges.y0, edges.y1) == (pytest.approx(low.min()), pytest.approx(high.max()))
    assert_readable(ax)


def test_a_virtual_vehicle_far_away_does_not_squeeze_the_scene(example: pl.DataFrame) -> None:
    far = example.with_columns(x=pl.when(pl.col("slot") == "target_leader_2").then(500.0).otherwise(pl.col("x")))
    assert scene_tracks(far).get_ylim()[1] < 350.0


def test_a_forecast_to_where_nobody_was_does_not_press_the_others_flat(example: pl.DataFrame) -> None:
    away = pl.col("series").str.contains("GHR") & (pl.col("t") > 0)
    far = example.with_columns(x=pl.when(away).then(2000.0).otherwise(pl.col("x")))
    assert scene_tracks(far).get_ylim()[1] < 500.0


def test_the_names_of_neighbours_stand_beside_each_other(example: pl.DataFrame) -> None:
    same = example.with_columns(x=pl.when(pl.col("slot") == "central").then(pl.col("x")).otherwise(150.0))
    places = sorted(text.get_position()[0] for text in scene_tracks(same).texts)
    assert np.diff(places).min() > 0.5


def test_a_line_breaks_where_samples_are_missing(example: pl.DataFrame) -> None:
    seen = example.filter(~((pl.col("slot") == "central") & pl.col("t").is_between(3.0, 6.0)))
    widest = max(scene_tracks(seen).get_lines(), key=lambda line: line.get_linewidth())
    assert np.isnan(widest.get_xdata()).sum() == 1


def test_the_picture_of_a_forecast_has_the_probability_below(
    example: pl.DataFrame, probabilities: pl.DataFrame
) -> None:
    figure = plot_forecast(example, lane_change=probabilities, ramp_end=230.0)
    above, below = figure.axes
    assert above.get_title(loc="left") == "vehicle 100 of i80-2, t0 = 40.0 s"
    assert below.get_ylabel() == "probability [%]"
    assert legend_labels(below) == ["changes lane within t", "changes lane at t"]
    assert_readable(above)


def test_both_models_of_lane_changes_are_drawn_under_their_names(
    example: pl.DataFrame, probabilities: pl.DataFrame
) -> None:
    both = pl.concat([probabilities.with_columns(model=pl.lit(name)) for name in ("rampcast", "forests")])
    below = plot_forecast(example, lane_change=both, ramp_end=230.0).axes[1]
    assert legend_labels(below) == [
        "changes lane within t, rampcast",
        "changes lane within t, forests",
        "changes lane at t, forests",
    ]


def test_the_picture_of_a_forecast_works_without_lane_change(example: pl.DataFrame) -> None:
    figure = plot_forecast(example, title="a title")
    assert len(figure.axes) == 1
    assert_readable(figure.axes[0])


def test_an_example_without_the_central_vehicle_is_still_drawn(example: pl.DataFrame) -> None:
    assert "central, observed" not in legend_labels(scene_tracks(example.filter(pl.col("slot") != "central")))


def test_two_scenes_at_once_are_an_error() -> None:
    with pytest.raises(RampcastError, match="one panel draws one mode"):
        scene_tracks(tidy_tables.examples())


def test_a_space_time_picture_colours_each_step_by_its_speed() -> None:
    tracks = tidy_tables.tracks()
    ax = space_time(tracks, lane=6)
    lines = ax.collections[0]
    assert len(lines.get_segments()) == tracks.height - tracks["vehicle"].n_unique()
    assert lines.get_array().min() == 2.5
    assert lines.get_array().max() == 11.0
    assert ax.get_figure().axes[1].get_ylabel() == "speed [m/s]"
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("time [s]", "position x along the road [m]")
    assert_readable(ax)


def test_a_space_time_picture_does_not_join_vehicles_windows_or_gaps() -> None:
    rows = [("w", 1, 0), ("w", 1, 1), ("w", 1, 5), ("w", 1, 6), ("w", 2, 7), ("w", 2, 8), ("x", 2, 9), ("x", 2, 10)]
    tracks = pl.DataFrame(rows, schema=["recording", "vehicle", "frame"], orient="row")
    tracks = tracks.with_columns(lane=pl.lit(6), x=pl.col("frame") * 1.0, v=pl.lit(10.0))
    assert len(space_time(tracks, lane=[6]).collections[0].get_segments()) == 4


def test_a_lane_without_vehicles_is_an_empty_picture() -> None:
    assert len(space_time(tidy_tables.tracks(), lane=1).collections[0].get_segments()) == 0
