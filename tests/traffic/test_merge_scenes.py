"""Merge scenes: who is in the target lane, where the own lane ends, and where the line is, by hand."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from rampcast.errors import RecordingError
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.traffic.around import merge_scenes_at
from rampcast.traffic.merge_scenes import BEHIND, TARGET_PLACES, build_merge_scenes, without_target
from rampcast.traffic.moments import traffic
from rampcast.traffic.platoons import HISTORY, PLACES
from tests.factories import TEST_SITE

FRAMES = 60
AT = 50  # frame of t = 0: 5 s
RAMP, MAIN = 7, 6
# vehicle: lane, place at t = 0 [m], speed [m/s]. On the ramp 2 follows 3; on the main road 11 to 16 from upstream on
VEHICLES = {
    2: (RAMP, 130.0, 10.0),
    3: (RAMP, 150.0, 10.0),
    11: (MAIN, 60.0, 12.0),
    12: (MAIN, 90.0, 12.0),
    13: (MAIN, 120.0, 12.0),
    14: (MAIN, 140.0, 12.0),
    15: (MAIN, 170.0, 12.0),
    16: (MAIN, 200.0, 12.0),
}
DRIFT = 0.4  # [m/s] by which vehicle 2 goes to the left, from 1.1 m right of the line at t = 0


@pytest.fixture(scope="module")
def recording() -> Recording:
    time = 0.1 * (np.arange(FRAMES) - AT)
    parts = []
    for vehicle, (lane, x, v) in VEHICLES.items():
        y = np.full(FRAMES, TEST_SITE.lane_centre(lane)) if vehicle != 2 else -22.0 - 1.1 + DRIFT * time
        parts.append(
            pl.DataFrame(
                {
                    c.VEHICLE: np.full(FRAMES, vehicle),
                    c.FRAME: np.arange(FRAMES),
                    c.X: x + v * time,
                    c.Y: y,
                    c.LANE: np.full(FRAMES, lane),
                    c.LENGTH: np.full(FRAMES, 4.0 + 0.1 * vehicle),
                    c.WIDTH: np.full(FRAMES, 1.9),
                    c.KIND: ["car"] * FRAMES,
                }
            )
        )
    tracks = pl.concat(parts).with_columns(pl.lit("test-1").alias(c.RECORDING))
    tracks = tracks.select(c.SCHEMA.keys()).cast(dict(c.SCHEMA)).sort(c.RECORDING, c.VEHICLE, c.FRAME)
    return Recording(tracks=tracks, site=TEST_SITE, time_step=0.1, source="made up for a test")


def anchors(recording, *vehicles):
    rows = recording.tracks.with_row_index("row").filter(pl.col(c.FRAME) == AT)
    found = [rows.filter(pl.col(c.VEHICLE) == one)["row"].item() for one in vehicles]
    return np.array(found, dtype=np.int64)


@pytest.fixture(scope="module")
def scenes(recording):
    return build_merge_scenes(recording, anchors(recording, 2, 14))


def test_the_target_lane_is_sorted_from_upstream_to_downstream(scenes):
    """Vehicle 2 at 130 m is between 13 at 120 m (f1) and 14 at 140 m (l1); f2 is 12; 11 is too far behind."""
    expected = [90.0, 120.0, 140.0, 170.0, 200.0]
    np.testing.assert_allclose(scenes.target.x[0, :5, -1], expected, atol=1e-6)
    assert scenes.target.present[0].tolist() == [True] * 5 + [False] * (TARGET_PLACES - 5)
    np.testing.assert_allclose(scenes.target.length[0, :5], [5.2, 5.3, 5.4, 5.5, 5.6], atol=1e-6)
    np.testing.assert_allclose(scenes.target.v[0, BEHIND, -1], 12.0, atol=1e-6)
    assert scenes.target.x.shape == (2, TARGET_PLACES, HISTORY)


def test_the_own_lane_is_the_platoon(scenes):
    np.testing.assert_allclose(scenes.own.x[0, :2, -1], [130.0, 150.0], atol=1e-6)
    assert scenes.own.depth[0] == 1
    assert scenes.own.x.shape[1] == PLACES


def test_the_lane_ends_and_the_line_is_where_the_site_says(scenes):
    """The ramp ends at 230 m, 100 m ahead; the line lies at y = -22 m, 1.1 m to the left, and is approached."""
    np.testing.assert_allclose(scenes.to_end[0], 100.0, atol=1e-6)
    np.testing.assert_allclose(scenes.offset[0], 1.1, atol=1e-4)
    np.testing.assert_allclose(scenes.approach[0], DRIFT, atol=1e-3)


def test_a_vehicle_that_is_not_on_the_ramp_has_no_lane_to_merge_into(scenes):
    assert scenes.may_merge.tolist() == [True, False]
    assert not scenes.target.present[1].any()
    assert np.isnan([scenes.to_end[1], scenes.offset[1], scenes.approach[1]]).all()
    np.testing.assert_allclose(scenes.own.x[1, :3, -1], [140.0, 170.0, 200.0], atol=1e-6)


def test_nobody_behind_and_nobody_ahead_leave_their_places_empty(recording):
    rows = recording.tracks[c.VEHICLE].is_in([2, 14, 15]).to_numpy()
    some = Recording(
        tracks=recording.tracks.filter(pl.Series(rows)), site=TEST_SITE, time_step=0.1, source="made up for a test"
    )
    found = build_merge_scenes(some, anchors(some, 2))
    assert found.target.present[0, : BEHIND + 3].tolist() == [False, False, True, True, False]


def test_chosen_scenes_keep_all_that_belongs_to_them(scenes):
    one = scenes.select(np.array([1]))
    assert len(one) == 1
    assert not one.may_merge[0]
    np.testing.assert_array_equal(one.own.x, scenes.own.x[1:])


def test_platoons_alone_have_nobody_in_a_target_lane(scenes):
    found = without_target(scenes.own)
    assert not found.may_merge.any()
    assert not found.target.present.any()
    assert np.isnan(found.offset).all()


def test_a_vehicle_that_was_lost_too_long_ago_has_no_scene(recording):
    now = traffic(recording, at=0.1 * AT)
    lost = replace(now, age=np.where(now.vehicle == 3, 1.5, now.age))
    others = np.flatnonzero(now.vehicle != 3)
    assert len(merge_scenes_at(lost, others).to_end) == len(VEHICLES) - 1
    with pytest.raises(RecordingError, match="seen within 1 s before t0, vehicle 3 was not"):
        merge_scenes_at(lost, np.arange(len(now.vehicle)))
