"""Scenes against the recording they were built from."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from rampcast.errors import RecordingError
from rampcast.horizon import FUTURE, PAST, STEP
from rampcast.paper.neighbours.windows import in_influence_area, seen_long, training_windows
from rampcast.paper.scenes import SLOTS, build_scenes
from rampcast.paper.scenes.scenes import CENTRAL, LEADER, TARGET_FOLLOWER_1, TARGET_LEADER_1
from rampcast.recording import clean
from rampcast.traffic import find_anchors
from rampcast.traffic.anchors import FEATURES, X
from rampcast.traffic.around import merge_scenes_of_rows
from rampcast.traffic.merge_scenes import BEHIND
from rampcast.traffic.outcomes import outcomes
from tests.made_up_traffic import SITE, random_traffic


@pytest.fixture(scope="module")
def recording():
    return clean(random_traffic(11, vehicles=60, seconds=60))[0]


@pytest.fixture(scope="module")
def scenes(recording):
    return build_scenes(recording, every=1.0)


@pytest.fixture(scope="module")
def lookup(recording):
    return {(row["vehicle"], row["frame"]): row for row in recording.tracks.rows(named=True)}


def anchor(scenes, scene):
    return round(float(scenes.t0[scene]) / STEP)


def test_the_central_vehicle_is_on_the_ramp_during_the_whole_history(scenes, lookup):
    assert len(scenes) > 50
    for scene in range(len(scenes)):
        frames = anchor(scenes, scene) + np.arange(1 - PAST, 1)
        assert all(lookup[int(scenes.vehicle[scene, CENTRAL]), int(f)]["lane"] == 7 for f in frames)


def test_past_and_future_are_the_rows_of_the_same_vehicles(scenes, lookup):
    for scene in range(0, len(scenes), 3):
        for slot in range(len(SLOTS)):
            if scenes.virtual[scene, slot]:
                continue
            vehicle = int(scenes.vehicle[scene, slot])
            for steps, states, valid in (
                (np.arange(1 - PAST, 1), scenes.past, scenes.past_valid),
                (np.arange(1, FUTURE + 1), scenes.future, scenes.future_valid),
            ):
                rows = [lookup.get((vehicle, anchor(scenes, scene) + int(k))) for k in steps]
                assert [row is not None for row in rows] == valid[scene, slot].tolist()
                expected = [[row[name] for name in FEATURES] for row in rows if row is not None]
                np.testing.assert_allclose(states[scene, slot][valid[scene, slot]], np.reshape(expected, (-1, 6)))


def test_unseen_future_is_nan_and_unseen_past_goes_back_at_constant_velocity(scenes):
    real = ~scenes.virtual
    assert np.isnan(scenes.future[real & ~scenes.virtual][~scenes.future_valid[real]]).all()
    partly = real & ~scenes.past_valid.all(axis=2)
    assert partly.any()
    for scene, slot in np.argwhere(partly)[:20]:
        first = int(np.argmax(scenes.past_valid[scene, slot]))
        x, _, v = scenes.past[scene, slot, :, :3].T
        np.testing.assert_allclose(np.diff(x[: first + 1]), v[first] * STEP, atol=1e-9)


def test_the_traffic_around_begins_with_the_neighbours(recording, scenes):
    around, start = merge_scenes_of_rows(recording, find_anchors(recording, every=1.0))
    assert len(around) == len(scenes)
    assert around.may_merge.all()
    np.testing.assert_array_equal(around.own.x[:, 0, -1], start)
    np.testing.assert_allclose(start, scenes.past[:, CENTRAL, -1, X], atol=0.5)  # smoothed with what comes
    np.testing.assert_allclose(around.to_end, SITE.ramp_end - start)
    for slot, platoons, place in (
        (LEADER, around.own, 1),
        (TARGET_LEADER_1, around.target, BEHIND),
        (TARGET_FOLLOWER_1, around.target, BEHIND - 1),
    ):
        there = ~scenes.virtual[:, slot]
        found = platoons.x[:, place, -1]
        same = np.where(there, np.abs(found - scenes.past[:, slot, -1, X]) < 0.5, np.isnan(found))
        assert same.mean() > 0.9  # but where somebody was lost less than a second before


def test_outcomes_are_what_the_scenes_hold_of_the_future(recording, scenes):
    became = outcomes(recording, find_anchors(recording, every=1.0))
    start = scenes.past[:, CENTRAL, -1, X, None]
    for found, slot in ((became.displacement, CENTRAL), (became.leader_displacement, LEADER)):
        seen = scenes.future_valid[:, slot]
        np.testing.assert_array_equal(np.isfinite(found), seen)
        np.testing.assert_array_equal(found[seen], (scenes.future[:, slot, :, X] - start)[seen])
    for name, field in (("change_time", "change_crossing"), ("seen_for", "seen_for"), ("t0", "t0")):
        np.testing.assert_array_equal(getattr(became, name), getattr(scenes, field))
    assert became.group.tolist() == [f"1-{vehicle}" for vehicle in scenes.vehicle[:, CENTRAL]]


def test_missing_neighbours_stand_where_the_paper_puts_them(scenes):
    assert scenes.virtual[:, LEADER].any()
    assert (scenes.past[scenes.virtual[:, LEADER], LEADER, :, X] == SITE.ramp_end).all()
    assert (scenes.future[scenes.virtual[:, TARGET_LEADER_1], TARGET_LEADER_1, :, X] == 500.0).all()
    assert (scenes.past[scenes.virtual[:, TARGET_FOLLOWER_1], TARGET_FOLLOWER_1, :, X] == -500.0).all()
    assert not scenes.past_valid[scenes.virtual].any()
    assert (scenes.past[scenes.virtual][..., 2:] == 0).all()


@pytest.mark.parametrize(("ramp_end", "stands_at"), [(np.inf, 503.0), (700.0, 700.0)])
def test_the_missing_leader_of_a_lane_that_goes_on_is_beyond_the_section(recording, ramp_end, stands_at):
    """The section is 503 m long, and the paper puts missing leaders at 500 m."""
    site = replace(SITE, ramp_end=ramp_end)
    endless = replace(recording, site=site, raw=replace(recording.raw, site=site))
    scenes = build_scenes(endless, every=5.0)
    assert (scenes.past[scenes.virtual[:, LEADER], LEADER, :, X] == stands_at).all()
    around, start = merge_scenes_of_rows(endless, find_anchors(endless, every=5.0))
    np.testing.assert_array_equal(around.to_end, ramp_end - start)
    assert around.may_merge.all()


def test_the_role_view_shows_who_filled_the_slot_at_each_step(scenes, recording):
    tracks = recording.tracks
    for scene in range(0, len(scenes), 7):
        for step in (0, 9, PAST - 1):
            frame = anchor(scenes, scene) + step - PAST + 1
            me = scenes.past[scene, CENTRAL, step, X]
            there = tracks.filter((pl.col("frame") == frame) & (pl.col("lane") == 6) & (pl.col("x") >= me))["x"].sort()
            assert scenes.role_virtual[scene, TARGET_LEADER_1, step] == there.is_empty()
            if len(there):
                assert scenes.role_past[scene, TARGET_LEADER_1, step, X] == pytest.approx(there[0])


def test_both_lane_change_times_count_from_the_anchor(scenes, recording, lookup):
    seen = 0
    for scene in range(len(scenes)):
        vehicle, t0 = int(scenes.vehicle[scene, CENTRAL]), anchor(scenes, scene)
        rows = [row for (v, f), row in lookup.items() if v == vehicle]
        label = [row["frame"] for row in rows if row["frame"] > t0 and row["lane"] == 6]
        assert np.isnan(scenes.change_label[scene]) == (not label)
        right = [row["frame"] for row in rows if row["y"] < SITE.lane_line_y(np.array([row["x"]]))[0]]
        last = max(row["frame"] for row in rows)
        assert scenes.seen_for[scene] == pytest.approx((last - t0) * STEP)
        if label:
            assert scenes.change_label[scene] == pytest.approx((min(label) - t0) * STEP)
        if max(right) < last:
            assert scenes.change_crossing[scene] == pytest.approx((max(right) + 1 - t0) * STEP)
            seen += 1
        else:
            assert np.isnan(scenes.change_crossing[scene])
    assert seen > 10


def test_anchors_of_a_finer_spacing_contain_those_of_a_coarser_one(recording, scenes):
    fine = build_scenes(recording, every=0.2, future=0)
    assert fine.future.shape[2] == 0
    keys = set(zip(fine.vehicle[:, 0].tolist(), np.round(fine.t0, 3).tolist(), strict=True))
    assert set(zip(scenes.vehicle[:, 0].tolist(), np.round(scenes.t0, 3).tolist(), strict=True)) <= keys
    assert len(fine) > 4 * len(scenes)


def test_the_future_of_the_recording_does_not_reach_the_past_of_a_scene(recording):
    """Smoothed rows after the anchor are thrown away: all that a model may see stays the same.

    That the smoothing itself looks ahead, and how far, is pinned in tests/recording/test_smoothing.py.
    """
    cut = 100
    whole = build_scenes(recording, every=0.2)
    early = replace(recording, tracks=recording.tracks.filter(pl.col("frame") <= cut))
    cut_scenes = build_scenes(early, every=0.2)
    same = whole.select(np.round(whole.t0 / STEP) <= cut)
    for name in (
        "vehicle",
        "t0",
        "virtual",
        "length",
        "past",
        "past_valid",
        "role_past",
        "role_virtual",
        "role_length",
    ):
        np.testing.assert_array_equal(getattr(same, name), getattr(cut_scenes, name))


def test_a_filled_frame_is_no_truth_and_no_anchor(recording):
    """The same recording, of which every fourth row is said to have been filled."""
    filled = recording.tracks["frame"] % 4 == 0
    holed = replace(recording, tracks=recording.tracks.with_columns(observed=~filled))
    found = build_scenes(holed, every=0.2)
    moment = np.round(found.t0 / STEP).astype(int)
    assert (moment % 4 != 0).all()
    of_future = moment[:, None] + np.arange(1, FUTURE + 1)
    assert not found.future_valid[:, CENTRAL][of_future % 4 == 0].any()
    assert found.future_valid[:, CENTRAL][of_future % 4 == 1].any()


def test_a_vehicle_that_was_never_right_of_the_line_has_crossed_it_already(recording):
    left = replace(recording, tracks=recording.tracks.with_columns(y=pl.lit(SITE.lane_centre(6))))
    assert (build_scenes(left, every=1.0).change_crossing <= 0).all()


def test_training_windows_are_gapless_and_stay_in_their_lanes(recording):
    windows = training_windows(recording, [6])
    count = 0
    for _, track in recording.tracks.group_by("vehicle", maintain_order=True):
        inside = (track["lane"] == 6).to_numpy()
        count += sum(inside[k : k + 21].all() for k in range(len(inside) - 20))
    assert windows.shape == (count, 21)
    with pytest.raises(RecordingError, match="cannot be trained"):
        training_windows(recording, [3])


def test_paper_mode_trains_on_vehicles_seen_for_19_seconds_and_on_the_ramp_influence_area(recording):
    """1,500 ft = 457.2 m downstream of the gore at 117.8 m."""
    whole = recording.tracks.group_by("vehicle").agg(seen=(pl.col("frame").max() - pl.col("frame").min()) * STEP)
    long = set(whole.filter(pl.col("seen") >= 19.0 - 1e-9)["vehicle"])
    assert 0 < len(long) < whole.height
    assert set(seen_long(recording).tracks["vehicle"]) == long
    x = in_influence_area(recording).tracks["x"]
    assert (x.min() >= 117.8, x.max() <= 575.0) == (True, True)
    assert len(x) == recording.tracks.filter(pl.col("x").is_between(117.8, 575.0)).height < recording.tracks.height


def test_scenes_ask_for_a_smoothed_recording_and_for_a_vehicle_on_the_ramp(recording):
    with pytest.raises(RecordingError, match="smooth the recording first"):
        build_scenes(random_traffic(1))
    with pytest.raises(RecordingError, match=r"multiple of 0\.2 s"):
        build_scenes(recording, every=0.3)
    with pytest.raises(RecordingError, match="nothing to forecast"):
        build_scenes(replace(recording, tracks=recording.tracks.filter(pl.col("lane") == 6)))
