"""When a vehicle changed lane and into which gap, by hand and against the scenes; the features of the forests."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from rampcast.benchmark.forest_features import RAMP_CENTRE, TARGET_CENTRE, forest_features
from rampcast.benchmark.lane_changes import crossing_times, gap_entered
from rampcast.benchmark.merge_sets import simulated
from rampcast.paper.lane_change.features import FEATURE_NAMES, lane_change_features
from rampcast.paper.scenes.build import build_scenes_at
from rampcast.paper.scenes.scenes import SLOTS
from rampcast.recording import clean, read_recording, write_recording
from rampcast.simulate import shipped_sample
from rampcast.traffic import find_anchors
from rampcast.traffic.platoons import tracks_of_table

FRAMES = 1000  # of a simulated window; its first 100 s


@pytest.fixture(scope="module")
def window(tmp_path_factory):
    """Returns the beginning of a simulated window."""
    recording = read_recording(shipped_sample()[0])
    path = tmp_path_factory.mktemp("window") / "simulated-1.parquet"
    write_recording(replace(recording, tracks=recording.tracks.filter(pl.col("frame") < FRAMES)), path)
    return path


@pytest.fixture(scope="module")
def cases(window):
    return simulated([window])


@pytest.fixture(scope="module")
def scenes(window):
    """Returns the scenes of the corrected mode, and their cases by name."""
    smoothed, _ = clean(read_recording(window))
    scenes = build_scenes_at(smoothed, find_anchors(smoothed, every=0.2))
    frame = np.rint(scenes.t0 / 0.1).astype(int)
    return scenes, [f"1-{vehicle}-{k}" for vehicle, k in zip(scenes.vehicle[:, 0], frame, strict=True)]


def track(vehicle: int, x: list[float], *, first: int = 0) -> pl.DataFrame:
    """Returns rows of one vehicle every 0.2 s from a frame on."""
    frame = first + np.arange(len(x))
    nobody = pl.Series([None] * len(x), dtype=pl.Int64)
    return pl.DataFrame({"vehicle": vehicle, "frame": frame, "x": x, "leader": nobody})


def test_a_line_is_crossed_where_the_vehicle_stays_beyond_it():
    """Beyond in rows 2, 4 and 5, and short of it again in row 3: it crosses in row 4. Another never stays beyond."""
    tracks = tracks_of_table(pl.concat([track(1, [0.0] * 6), track(2, [0.0] * 3)]), time_step=0.2)
    beyond = np.array([False, False, True, False, True, True, True, False, False])
    times = crossing_times(tracks, beyond, np.array([0, 3, 4, 5, 6, 8]))
    np.testing.assert_allclose(times, [0.8, 0.2, 0.0, -0.2, np.nan, np.nan])


def test_who_was_beyond_the_line_from_the_first_row_on_crossed_there():
    tracks = tracks_of_table(track(1, [0.0] * 4), time_step=0.2)
    np.testing.assert_allclose(crossing_times(tracks, np.full(4, True), np.array([0, 3])), [0.0, -0.6])


def test_the_gap_counts_who_was_passed_and_who_passed():
    """The vehicle goes from 0 to 50 m. l1 at 20 m stands: passed. l2 at 60 m goes on. f1 at -10 m overtakes in the end.

    f2 is lost sight of at -30 m, behind. In all 1 - 1 = 0; without f1 it is 1.
    """
    parts = [
        track(1, [0.0, 10.0, 30.0, 50.0]),
        track(2, [20.0, 20.0, 20.0, 20.0]),
        track(3, [60.0, 65.0, 70.0, 75.0]),
        track(4, [-10.0, 10.0, 40.0, 55.0]),
        track(5, [-30.0, -30.0]),
    ]
    tracks = tracks_of_table(pl.concat(parts), time_step=0.2)
    places = np.array([[16, 12, 4, 8]])  # f2, f1, l1, l2 at frame 0
    both, one = (np.array([[True, f1, True, True]]) for f1 in (True, False))
    rows, time = np.array([0]), np.array([0.6])
    assert gap_entered(tracks, rows, time, places=places, there=both).tolist() == [0.0]
    assert gap_entered(tracks, rows, time, places=places, there=one).tolist() == [1.0]
    assert gap_entered(tracks, rows, np.array([0.2]), places=places, there=both).tolist() == [-1.0]  # abreast is ahead
    assert np.isnan(gap_entered(tracks, rows, np.array([-0.2]), places=places, there=both)).all()


def test_simulated_lane_changes_are_those_of_the_scenes(cases, scenes):
    """Theirs lie on steps of 0.2 s, the others on 0.1 s, and both are of positions smoothed alike."""
    built, names = scenes
    place = {name: row for row, name in enumerate(names)}
    both = [(row, place[name]) for row, name in enumerate(cases.case.tolist()) if name in place]
    assert len(both) > 20
    mine, theirs = np.array(both).T
    np.testing.assert_array_equal(np.isnan(cases.change_time[mine]), np.isnan(built.change_crossing[theirs]))
    assert np.nanmax(np.abs(cases.change_time[mine] - built.change_crossing[theirs])) < 0.2
    np.testing.assert_allclose(cases.seen_for[mine], built.seen_for[theirs], atol=0.11)


def test_simulated_vehicles_end_where_they_changed_lane(cases):
    """The displacement at the lane change is that of the truth at the time, which is known every 0.2 s."""
    soon = np.flatnonzero((cases.change_time > 0.2) & (cases.change_time < 14.0))
    assert len(soon) > 10
    time = np.append(0.0, 0.2 * np.arange(1, 76))
    for row in soon:
        there = np.interp(cases.change_time[row], time, np.append(0.0, cases.truth[row]))
        assert cases.place[row] == pytest.approx(there, abs=0.05)


def test_time_since_entry_counts_from_the_first_row_on_the_ramp(cases):
    first = [f"{name.rsplit('-', 1)[0]}-" for name in cases.case.tolist()]
    frame = np.array([int(name.rsplit("-", 1)[1]) for name in cases.case.tolist()])
    for group in set(first):
        mine = np.array([name == group for name in first])
        np.testing.assert_allclose(np.diff(cases.since_entry[mine]), 0.1 * np.diff(frame[mine]), atol=1e-9)
    assert cases.since_entry.min() >= 4.0 - 1e-9


def test_the_features_of_the_forests_are_those_of_the_scenes(cases, scenes):
    """Up to what a merge scene does not hold: y counts from the lane line, followers in the own lane are not known."""
    built, names = scenes
    place = {name: row for row, name in enumerate(names)}
    both = [(row, place[name]) for row, name in enumerate(cases.case.tolist()) if name in place]
    mine, theirs = np.array(both).T
    found, expected = forest_features(cases.scenes.select(mine)), lane_change_features(built.select(theirs))
    there = ~built.virtual[theirs]
    for name in ("leader", "target_leader_1", "target_leader_2", "target_follower_1", "target_follower_2"):
        seen = there[:, SLOTS.index(name)]
        for kind, atol in (("x", 0.5), ("v", 0.7)):  # these look 1 s ahead, those do not
            column = FEATURE_NAMES.index(f"{name}.{kind}")
            error = np.abs(found[seen, column] - expected[seen, column])
            assert np.median(error) < atol, (name, kind)


def test_a_lonely_vehicle_stands_among_the_papers_stand_ins(merging):
    """Nobody is there: the leader stands at the end of the lane, the others 500 m from it, all in mid-lane."""
    scenes = merging.scenes
    nobody = replace(scenes.target, valid=np.zeros_like(scenes.target.valid))
    own = replace(scenes.own, valid=scenes.own.valid & (np.arange(9) == 0)[:, None])
    features = dict(zip(FEATURE_NAMES, forest_features(replace(scenes, target=nobody, own=own)).T, strict=True))
    np.testing.assert_allclose(features["leader.x"], scenes.to_end)
    np.testing.assert_allclose(features["target_leader_1.x"], 500.0 + scenes.to_end)
    np.testing.assert_allclose(features["target_follower_2.x"], 500.0 - scenes.to_end)
    np.testing.assert_allclose(features["target_leader_2.y"], TARGET_CENTRE - RAMP_CENTRE)
    np.testing.assert_allclose(features["leader.y"], 0.0)
    np.testing.assert_allclose(features["central.v"], scenes.own.v[:, 0, -1])
    np.testing.assert_allclose(features["central.x"], -scenes.to_end)
    assert not features["follower.v"].any()
