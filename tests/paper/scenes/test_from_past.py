"""Scenes of corrected mode against plain loops over the traffic of each moment, and against the rows that come."""

from dataclasses import fields, replace

import numpy as np
import polars as pl
import pytest

from rampcast.errors import RecordingError
from rampcast.horizon import PAST, STEP
from rampcast.paper.neighbours.windows import training_windows, training_windows_from_past
from rampcast.paper.scenes import build_scenes_at, scenes_from_past
from rampcast.paper.scenes.scenes import CENTRAL, SLOTS, TARGET_SLOTS
from rampcast.recording import clean
from rampcast.recording import columns as c
from rampcast.traffic import find_anchors
from rampcast.traffic.anchors import FEATURES, X
from rampcast.traffic.moments import traffic
from tests.made_up_traffic import SITE, random_traffic

OF_THE_FUTURE = ("future", "future_valid", "change_label", "change_crossing", "seen_for")


@pytest.fixture(scope="module")
def recording():
    return clean(random_traffic(11, vehicles=60, seconds=60))[0]


@pytest.fixture(scope="module")
def anchors(recording):
    return find_anchors(recording, every=1.0)


@pytest.fixture(scope="module")
def scenes(recording, anchors):
    return scenes_from_past(recording, anchors)


def seen_lately(raw, time):
    """Returns the lane of every vehicle with a row in the second up to a time [s], by its last row."""
    rows = raw.tracks.filter((pl.col(c.FRAME) * raw.time_step).is_between(time - 1.0 - 1e-6, time + 1e-6))
    last = rows.sort(c.FRAME).group_by(c.VEHICLE).last()
    return dict(last.select(c.VEHICLE, c.LANE).iter_rows())


def neighbours(moment, lanes, vehicle, step):
    """Returns who fills the six slots about a vehicle at a step before the moment, by a plain search."""
    x = {other: float(moment.x[place, step]) for place, other in enumerate(moment.vehicle.tolist()) if other in lanes}
    x = {other: place for other, place in x.items() if np.isfinite(place)}
    me = x.pop(vehicle)
    own = {other: place for other, place in x.items() if lanes[other] == lanes[vehicle]}
    target = {other: place for other, place in x.items() if lanes[other] == SITE.target_lane}

    def ordered(some, is_ahead):
        chosen = [other for other, place in some.items() if is_ahead(place - me)]
        return [*sorted(chosen, key=lambda other: abs(some[other] - me)), None, None]

    ahead, behind = ordered(target, lambda away: away >= 0), ordered(target, lambda away: away < 0)
    return [ordered(own, lambda away: away > 0)[0], ordered(own, lambda away: away < 0)[0], *ahead[:2], *behind[:2]]


def test_slots_are_filled_and_states_taken_as_by_a_plain_loop(recording, scenes):
    raw = recording.raw
    for scene in range(0, len(scenes), 25):
        t0, vehicle = float(scenes.t0[scene]), int(scenes.vehicle[scene, CENTRAL])
        moment = traffic(raw, at=t0)
        state = np.stack([getattr(moment, name) for name in FEATURES], axis=-1)
        place = {other: number for number, other in enumerate(moment.vehicle.tolist())}
        for back in (0, 7, PAST - 1):
            lanes = seen_lately(raw, t0 - back * STEP)
            found = neighbours(moment, lanes, vehicle, -1 - back)
            for slot, other in enumerate(found, start=1):
                virtual = scenes.role_virtual[scene, slot, -1 - back]
                assert virtual == (other is None), (scene, SLOTS[slot], back)
                if not virtual:
                    np.testing.assert_array_equal(
                        scenes.role_past[scene, slot, -1 - back], state[place[other], -1 - back]
                    )
                if back == 0:
                    assert int(scenes.vehicle[scene, slot]) == (other or 0)
        known = scenes.past_valid[scene, CENTRAL]
        np.testing.assert_array_equal(scenes.past[scene, CENTRAL][known], state[place[vehicle], 1:][known])
        assert known[-1]


def test_they_are_close_to_those_that_look_ahead(recording, anchors, scenes):
    ahead = build_scenes_at(recording, anchors)
    same = scenes.vehicle == ahead.vehicle
    assert same.mean() > 0.9  # but where somebody was lost less than a second before
    both = same & ~ahead.virtual
    assert 0 < np.abs(scenes.past[both][:, -1, X] - ahead.past[both][:, -1, X]).max() < 0.5


def test_what_became_of_the_vehicles_is_what_the_smoothed_recording_says(recording, anchors, scenes):
    ahead = build_scenes_at(recording, anchors)
    for name in ("change_label", "change_crossing", "seen_for", "t0", "lane", "recording"):
        np.testing.assert_array_equal(getattr(scenes, name), getattr(ahead, name), err_msg=name)
    both = scenes.future_valid & ahead.future_valid & (scenes.vehicle == ahead.vehicle)[..., None]
    assert both[:, CENTRAL].sum() == ahead.future_valid[:, CENTRAL].sum()
    np.testing.assert_array_equal(scenes.future[both], ahead.future[both])


def test_the_raw_future_is_in_none_of_it_but_in_what_became_of_them(recording, anchors, scenes):
    frame = int(np.median(scenes.t0) / STEP)
    now = anchors[recording.tracks[c.FRAME].to_numpy()[anchors] <= frame]
    raw = recording.raw
    future = pl.col(c.FRAME) * raw.time_step > frame * STEP + 1e-9
    wild = pl.when(future).then(700.0 - 0.3 * pl.col(c.X)).otherwise(pl.col(c.X)).alias(c.X)
    other = replace(recording, raw=replace(raw, tracks=raw.tracks.with_columns(wild)))
    before, after = scenes_from_past(recording, now), scenes_from_past(other, now)
    assert len(now) > 50
    for name in (field.name for field in fields(before) if field.name not in (*OF_THE_FUTURE, "site")):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name), err_msg=name)


def test_the_twenty_steps_in_of_a_training_window_know_nothing_of_the_step_out(recording):
    windows, ahead = training_windows_from_past(recording, [6], stride=5), training_windows(recording, [6], stride=5)
    assert windows.shape == ahead.shape
    np.testing.assert_array_equal(windows[:, -1], ahead[:, -1])
    assert 0 < np.abs(windows - ahead).max() < 1.0
    changed = replace(recording, tracks=recording.tracks.with_columns(pl.col(c.X) + 1.0))
    np.testing.assert_array_equal(training_windows_from_past(changed, [6], stride=5)[:, :-1], windows[:, :-1])


def test_a_smoothed_recording_without_its_raw_one_is_refused(recording, anchors):
    with pytest.raises(RecordingError, match="corrected mode needs the raw recording"):
        scenes_from_past(replace(recording, raw=None), anchors)


def test_target_slots_hold_vehicles_of_the_target_lane(recording, scenes):
    for scene in range(0, len(scenes), 40):
        lanes = seen_lately(recording.raw, float(scenes.t0[scene]))
        for slot in TARGET_SLOTS:
            if not scenes.virtual[scene, slot]:
                assert lanes[int(scenes.vehicle[scene, slot])] == SITE.target_lane
