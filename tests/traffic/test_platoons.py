"""Platoons: who is in them, what is known of each, and that nothing of the future is."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from rampcast.errors import RecordingError
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.traffic.moments import GRID, traffic
from rampcast.traffic.past_filter import states_from_past
from rampcast.traffic.platoons import (
    HISTORY,
    PLACES,
    Tracks,
    lateral_now,
    platoons_of_tracks,
    tracks_of_recording,
    tracks_of_table,
    traffic_around,
)
from tests.factories import TEST_SITE

FRAMES = 100


def table_of(x_by_vehicle: dict[int, np.ndarray], leaders: dict[int, int]) -> pl.DataFrame:
    """Returns a table with a row for each vehicle and frame at which x is not NaN."""
    parts = [
        pl.DataFrame({"vehicle": vehicle, "frame": np.arange(len(x)), "x": x, "length": 4.0 + vehicle}).with_columns(
            leader=pl.lit(leaders.get(vehicle), pl.Int64)
        )
        for vehicle, x in x_by_vehicle.items()
    ]
    return pl.concat(parts).filter(pl.col("x").is_not_nan())


def row_of(tracks: Tracks, vehicle: int, frame: int) -> np.ndarray:
    """Returns the row of a vehicle at a frame, as an array of one."""
    return np.flatnonzero((tracks.vehicle == vehicle) & (tracks.frame == frame))


def noisy(seed: int, *, start: float = 0.0, speed: float = 10.0) -> np.ndarray:
    """Returns the places of a vehicle at 10 Hz that wavers, with noise of a decimetre."""
    time = 0.1 * np.arange(FRAMES)
    noise = np.random.default_rng(seed).normal(0.0, 0.1, FRAMES)
    result: np.ndarray = start + speed * time + 3.0 * np.sin(0.4 * time + seed) + noise
    return result


@pytest.fixture
def three() -> Tracks:
    """Three vehicles, 1 behind 2 behind 3."""
    places = {k: noisy(k, start=30.0 * k) for k in (1, 2, 3)}
    return tracks_of_table(table_of(places, {1: 2, 2: 3}), time_step=0.1)


def test_the_places_hold_the_leader_and_the_leaders_leader(three):
    platoons = platoons_of_tracks(three, row_of(three, 1, 60))
    assert platoons.depth.tolist() == [2]
    assert platoons.present[0].tolist() == [True] * 3 + [False] * (PLACES - 3)
    np.testing.assert_array_equal(platoons.length[0, :4], [5.0, 6.0, 7.0, np.nan])
    assert np.isnan(platoons.x[0, 3:]).all()
    assert platoons.x.shape == (1, PLACES, HISTORY)


def test_a_straight_drive_has_its_places_its_speed_and_no_acceleration():
    """x = 5 + 12 t, t = 0.1 frame: at frame 50 x = 65, 4 s earlier 17, speed 12 throughout."""
    tracks = tracks_of_table(table_of({1: 5.0 + 1.2 * np.arange(FRAMES)}, {}), time_step=0.1)
    platoons = platoons_of_tracks(tracks, row_of(tracks, 1, 50))
    np.testing.assert_allclose(platoons.x[0, 0], np.linspace(17.0, 65.0, HISTORY), atol=1e-9)
    np.testing.assert_allclose(platoons.v[0, 0], 12.0, atol=1e-9)
    np.testing.assert_allclose(platoons.a[0, 0], 0.0, atol=1e-7)


def test_a_history_is_what_the_filter_makes_of_the_frames_until_then(three):
    at = 60
    seen = [three.vehicle == vehicle for vehicle in (1, 2, 3)]
    raw = np.concatenate([three.x[mine][at - 40 : at + 1] for mine in seen])
    states, _ = states_from_past(
        np.tile(0.1 * np.arange(-40, 1), 3), raw, np.full(len(raw), np.nan), np.array([0, 41, 82, 123]), grid=GRID
    )
    platoons = platoons_of_tracks(three, row_of(three, 1, at))
    for name, order in (("x", 0), ("v", 2), ("a", 4)):
        np.testing.assert_array_equal(getattr(platoons, name)[0, :3], states[:, order])


def test_frames_after_the_anchor_change_nothing(three):
    rows = np.concatenate([row_of(three, vehicle, 60) for vehicle in (1, 2, 3)])
    later = three.frame > 60
    changed = replace(three, x=np.where(later, three.x + 40.0, three.x), led=np.where(later, False, three.led))
    one, other = platoons_of_tracks(three, rows), platoons_of_tracks(changed, rows)
    for name in ("x", "v", "a", "valid", "length", "kind"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_a_platoon_does_not_depend_on_the_others(three):
    rows = np.concatenate([row_of(three, vehicle, frame) for vehicle in (1, 2, 3) for frame in (45, 61, 99)])
    together = platoons_of_tracks(three, rows)
    for k, row in enumerate(rows):
        alone = platoons_of_tracks(three, np.array([row]))
        np.testing.assert_allclose(alone.x[0], together.x[k], atol=1e-9)
        np.testing.assert_allclose(alone.a[0], together.a[k], atol=1e-7)


def test_a_short_hole_is_bridged_and_after_a_long_one_a_track_begins_anew():
    short, long = noisy(1), noisy(2, start=40.0)
    short[30:36] = np.nan  # 0.6 s
    long[25:40] = np.nan  # 1.5 s
    tracks = tracks_of_table(table_of({1: short, 2: long}, {1: 2}), time_step=0.1)
    platoons = platoons_of_tracks(tracks, row_of(tracks, 1, 60))
    assert platoons.valid[0, 0].all()
    known = 20 + 2 * np.flatnonzero(platoons.valid[0, 1])  # frames
    np.testing.assert_array_equal(known, np.arange(40, 61, 2))
    assert np.isnan(platoons.v[0, 1, :10]).all()


def test_a_leader_that_is_seen_for_the_first_time_is_as_fast_as_the_others():
    """Two at 10 and 12 m/s, so 11 m/s."""
    time = 0.1 * np.arange(FRAMES)
    late = 60.0 + 9.0 * time
    late[:60] = np.nan
    tracks = tracks_of_table(table_of({1: 10.0 * time, 2: late, 3: 200.0 + 12.0 * time}, {1: 2, 2: 3}), time_step=0.1)
    platoons = platoons_of_tracks(tracks, row_of(tracks, 1, 60))
    assert platoons.depth.tolist() == [2]
    assert platoons.valid[0, 1].sum() == 1
    assert platoons.v[0, 1, -1] == pytest.approx(11.0)


def test_lateral_places_and_speeds_are_those_of_the_past_alone(three):
    y = 1.0 + 0.3 * 0.1 * three.frame + np.where(three.frame > 60, 7.0, 0.0)
    place, speed = lateral_now(three, y, row_of(three, 2, 60))
    np.testing.assert_allclose([place[0], speed[0]], [1.0 + 0.3 * 6.0, 0.3], atol=1e-3)
    unknown, _ = lateral_now(three, np.full(len(y), np.nan), row_of(three, 2, 60))
    assert np.isnan(unknown).all()


def test_a_leader_that_is_not_ahead_or_has_no_row_counts_as_none():
    tracks = tracks_of_table(table_of({1: noisy(1), 2: noisy(2, start=-40.0)}, {1: 2, 2: 7}), time_step=0.1)
    assert not tracks.led.any()


def test_five_frames_a_second_do_as_well():
    time = 0.2 * np.arange(40)
    tracks = tracks_of_table(table_of({1: 8.0 * time + 0.5 * time**2}, {}), time_step=0.2)
    platoons = platoons_of_tracks(tracks, row_of(tracks, 1, 30))
    assert platoons.valid[0, 0].all()
    np.testing.assert_allclose(platoons.v[0, 0, -1], 8.0 + time[30], atol=0.05)
    np.testing.assert_allclose(platoons.a[0, 0, -1], 1.0, atol=0.3)  # the filter takes an acceleration to fade


def test_a_time_step_that_does_not_divide_two_tenths_is_refused():
    with pytest.raises(RecordingError, match=r"every 0.2 s or a whole fraction of it, got every 0.12 s"):
        tracks_of_table(table_of({1: noisy(1)}, {}), time_step=0.12)


def recording(x_by_vehicle: dict[int, np.ndarray], lanes: dict[int, int]) -> Recording:
    """Returns a raw recording of vehicles that keep their lanes."""
    parts = [
        pl.DataFrame({c.VEHICLE: vehicle, c.FRAME: np.arange(len(x)), c.X: x, c.LANE: lanes[vehicle]})
        for vehicle, x in x_by_vehicle.items()
    ]
    tracks = pl.concat(parts).with_columns(
        pl.lit("one").alias(c.RECORDING),
        pl.lit(-20.0).alias(c.Y),
        pl.lit(4.5).alias(c.LENGTH),
        pl.lit(1.8).alias(c.WIDTH),
        pl.lit("truck").alias(c.KIND),
    )
    tracks = tracks.select(c.SCHEMA.keys()).cast(pl.Schema(c.SCHEMA)).sort(c.RECORDING, c.VEHICLE, c.FRAME)
    return Recording(tracks=tracks, site=TEST_SITE, time_step=0.1, source="test")


def test_the_leaders_of_a_recording_are_the_next_ahead_in_the_lane():
    x = {vehicle: noisy(vehicle, start=20.0 * vehicle) for vehicle in range(1, 13)}
    raw = recording(x, {vehicle: 6 + vehicle % 2 for vehicle in x})  # odd vehicles in lane 7
    anchors = np.flatnonzero((raw.tracks[c.VEHICLE] == 1).to_numpy() & (raw.tracks[c.FRAME] == 70).to_numpy())
    platoons = platoons_of_tracks(tracks_of_recording(raw), anchors)
    assert platoons.depth.tolist() == [5]
    ahead = platoons.x[0, 1:6, -1]
    np.testing.assert_allclose(ahead, [x[vehicle][70] for vehicle in (3, 5, 7, 9, 11)], atol=0.5)
    assert set(platoons.kind[0, :6].tolist()) == {c.KINDS.index("truck")}


def test_states_are_those_of_the_traffic_of_that_moment():
    x = {vehicle: noisy(vehicle, start=20.0 * vehicle) for vehicle in range(1, 9)}
    raw = recording(x, dict.fromkeys(x, 6))
    anchors = np.flatnonzero((raw.tracks[c.FRAME] == 70).to_numpy())
    platoons, now = platoons_of_tracks(tracks_of_recording(raw), anchors), traffic(raw, at=7.0)
    np.testing.assert_array_equal(now.vehicle, raw.tracks[c.VEHICLE].to_numpy()[anchors])
    for name in ("x", "v", "a"):  # both begin at the speed of their vehicles, which hardly counts at t = 0
        np.testing.assert_allclose(getattr(platoons, name)[:, 0, -1], getattr(now, name)[:, -1], atol=1e-6)


def test_the_traffic_around_is_the_mean_speed_of_each_stretch_now_and_3_s_before():
    """At frame 60 vehicle 1 is at 60 m (10 m/s), 2 at 112 m (2 m/s) and 3 at 130 m (5 m/s), 52 and 70 m ahead of it;
    4 is at 30 m (4 m/s), 30 m behind. At frame 30 they are at 30, 106, 115 and 18 m: -30, 46, 55 and -42 m from 60 m.
    """
    time = 0.1 * np.arange(FRAMES)
    places = {1: 10.0 * time, 2: 100.0 + 2.0 * time, 3: 100.0 + 5.0 * time, 4: 6.0 + 4.0 * time}
    table = table_of(places, {}).with_columns(road=3)
    tracks = tracks_of_table(table, time_step=0.1)
    found = platoons_of_tracks(tracks, row_of(tracks, 1, 60)).traffic[0]
    nobody = [np.nan] * 4
    np.testing.assert_allclose(found[0], [4.0, 10.0, 3.5, *nobody])
    np.testing.assert_allclose(found[1], [7.0, np.nan, 3.5, *nobody])


def test_traffic_of_another_road_or_of_no_known_road_does_not_count():
    time = 0.1 * np.arange(FRAMES)
    table = table_of({1: 10.0 * time, 2: 50.0 + 2.0 * time}, {})
    apart = tracks_of_table(table.with_columns(road=pl.col("vehicle")), time_step=0.1)
    found = traffic_around(apart, row_of(apart, 1, 60))
    np.testing.assert_allclose(found[0], [[np.nan, 10.0, *[np.nan] * 5], [10.0, *[np.nan] * 6]])
    unknown = tracks_of_table(table, time_step=0.1)
    assert np.isnan(traffic_around(unknown, row_of(unknown, 1, 60))).all()


def test_traffic_is_not_known_before_it_has_been_seen_for_a_second():
    time = 0.1 * np.arange(FRAMES)
    table = table_of({1: 10.0 * time}, {}).with_columns(road=1)
    tracks = tracks_of_table(table, time_step=0.1)
    at = np.concatenate([row_of(tracks, 1, frame) for frame in (9, 10, 39, 40)])
    own, before = traffic_around(tracks, at)[:, 0, 1], traffic_around(tracks, at)[:, 1, 0]
    np.testing.assert_allclose(own, [np.nan, 10.0, 10.0, 10.0])
    np.testing.assert_allclose(before, [np.nan, np.nan, np.nan, 10.0])
