"""The shipped simulated sample: complete, of the right form, and close enough to real traffic."""

import polars as pl
import pytest

from rampcast.recording import Recording, read_recording
from rampcast.recording import columns as c
from rampcast.simulate import make_sample, realism, shipped_sample
from rampcast.sites import load_site

LARGEST = 8e6  # bytes of all files together
REMADE_MINUTES = 0.5


@pytest.fixture(scope="module", params=["1", "2", "3"])
def window(request: pytest.FixtureRequest) -> Recording:
    return read_recording(shipped_sample()[int(request.param) - 1])


def test_the_sample_has_three_windows_and_is_small() -> None:
    files = shipped_sample()
    assert [file.name for file in files] == [f"simulated-{k}.parquet" for k in "123"]
    assert sum(file.stat().st_size for file in files) < LARGEST


def test_a_window_has_the_columns_and_types_of_a_recording(window: Recording) -> None:
    assert dict(window.tracks.schema) == c.SCHEMA
    assert window.tracks.null_count().sum_horizontal().item() == 0


def test_a_window_says_that_it_is_simulated(window: Recording) -> None:
    assert window.source == "simulated"
    assert window.site == load_site("simulated")
    assert window.site.simulated


def test_a_window_holds_ten_frames_a_second_for_fifteen_minutes_without_gaps(window: Recording) -> None:
    frames = window.tracks[c.FRAME]
    assert (frames.min(), frames.max(), window.time_step) == (0, 8999, 0.1)
    assert window.tracks.select(c.VEHICLE, c.FRAME).is_unique().all()


def test_a_window_holds_the_ramp_and_the_adjacent_lane_only(window: Recording) -> None:
    assert set(window.tracks[c.LANE].unique()) == {6, 7}
    assert window.tracks[c.X].is_between(0, window.site.length).all()


def test_a_window_mixes_all_kinds_of_vehicles(window: Recording) -> None:
    assert set(window.tracks[c.KIND].unique()) == set(c.KINDS)


def test_enough_vehicles_merge_and_are_seen_for_19_seconds(window: Recording) -> None:
    ramp = window.tracks.filter((pl.col(c.LANE) == 7).any().over(c.VEHICLE))
    seen = ramp.group_by(c.VEHICLE).agg((pl.len() * window.time_step).alias("seconds"))
    assert 100 <= len(seen) <= 250
    assert (seen["seconds"] > 19).sum() >= 80


def test_vehicle_numbers_begin_anew_in_each_window(window: Recording) -> None:
    assert window.tracks[c.VEHICLE].min() < 20


def test_a_window_resembles_real_traffic_in_every_measure(window: Recording) -> None:
    failed = realism(window).filter(~pl.col("accepted"))
    assert failed.is_empty(), failed.to_dicts()


def test_y_grows_to_the_left_so_that_merging_raises_it(window: Recording) -> None:
    merging = window.tracks.filter(
        (pl.col(c.LANE) == 7).any().over(c.VEHICLE), (pl.col(c.X) > 300).any().over(c.VEHICLE)
    )
    ends = (
        merging.sort(c.FRAME)
        .group_by(c.VEHICLE)
        .agg(
            pl.col(c.Y).filter(pl.col(c.LANE) == 7).first().alias("ramp"),
            pl.col(c.Y).filter(pl.col(c.X) > 300).first().alias("main"),
        )
    )
    assert (ends["main"] > ends["ramp"]).all()


def test_the_lane_line_is_crossed_at_another_time_than_the_label_changes(window: Recording) -> None:
    right = pl.Series(window.tracks[c.Y].to_numpy() < window.site.lane_line_y(window.tracks[c.X].to_numpy()))
    tracks = window.tracks.with_columns(right.alias("right")).filter((pl.col(c.LANE) == 7).any().over(c.VEHICLE))
    times = (
        tracks.filter(pl.col(c.X) > window.site.gore)
        .group_by(c.VEHICLE)
        .agg(
            pl.col(c.FRAME).filter(pl.col(c.LANE) == 6).min().alias("label"),
            pl.col(c.FRAME).filter(~pl.col("right")).min().alias("crossing"),
        )
        .drop_nulls()
    )
    later = (times["crossing"] - times["label"]) * window.time_step
    assert later.is_between(0.2, 6.0).mean() > 0.7


@pytest.mark.slow
@pytest.mark.sumo
def test_the_committed_command_makes_the_beginning_of_the_sample_again() -> None:
    # The beginning of a longer simulation is the shorter one, so half a minute stands for the whole.
    pytest.importorskip("sumo", reason="needs the extra [sumo]")
    made = make_sample("1", minutes=REMADE_MINUTES).tracks
    shipped = read_recording(shipped_sample()[0]).tracks.filter(pl.col(c.FRAME) < REMADE_MINUTES * 600)
    same = [name for name in c.SCHEMA if name not in (c.X, c.Y)]
    assert made.select(same).equals(shipped.select(same))
    for axis in (c.X, c.Y):
        assert float((made[axis] - shipped[axis]).abs().max()) <= 0.011  # type: ignore[arg-type]  # rounded to 1 cm
