"""The 42 features of the lane-change classifiers."""

from collections import Counter
from dataclasses import replace

import numpy as np

from rampcast.paper.lane_change.features import FEATURE_KIND, FEATURE_NAMES, FEATURE_VEHICLE, lane_change_features
from rampcast.paper.scenes.scenes import CENTRAL, LEADER, TARGET_FOLLOWER_1
from tests.factories import random_scenes


def column(name: str) -> int:
    return FEATURE_NAMES.index(name)


def test_there_are_42_features_neighbours_first_and_the_central_vehicle_last() -> None:
    assert len(set(FEATURE_NAMES)) == 42
    assert FEATURE_NAMES[:7] == ("leader.x", "leader.y", "leader.v", "leader.u", "leader.a", "leader.e", "follower.x")
    assert FEATURE_NAMES[-6:] == tuple(f"central.{kind}" for kind in "xyvuae")


def test_the_groupings_cover_every_feature() -> None:
    assert Counter(FEATURE_KIND) == dict.fromkeys("xyvuae", 7)
    assert Counter(FEATURE_VEHICLE) == {"central": 6, "ramp": 12, "target": 24}
    assert FEATURE_VEHICLE[column("follower.v")] == "ramp"
    assert FEATURE_VEHICLE[column("target_follower_2.v")] == "target"


def test_features_of_a_scene_by_hand() -> None:
    scenes = random_scenes(np.random.default_rng(0), 1)
    past = scenes.past.copy()
    past[0, CENTRAL, -1] = [150.0, -23.5, 9.0, 0.1, 0.5, -0.2]
    past[0, LEADER, -1] = [175.0, -23.0, 8.0, 0.2, -1.0, 0.3]
    past[0, TARGET_FOLLOWER_1, -1] = [140.0, -20.0, 12.0, -0.3, 0.4, 0.0]
    features = lane_change_features(replace(scenes, past=past))[0]
    assert np.allclose(features[:6], [25.0, 0.5, 8.0, 0.2, -1.0, 0.3])
    start = column("target_follower_1.x")
    assert np.allclose(features[start : start + 6], [10.0, 3.5, 12.0, -0.3, 0.4, 0.0])  # a distance, also behind
    assert np.allclose(features[-6:], [150.0, -23.5, 9.0, 0.1, 0.5, -0.2])


def test_a_virtual_neighbour_enters_with_its_stand_in() -> None:
    scenes = random_scenes(np.random.default_rng(1), 200)
    rows = np.flatnonzero(scenes.virtual[:, LEADER])
    features = lane_change_features(scenes)[rows]
    assert np.allclose(features[:, column("leader.x")], np.abs(230.0 - scenes.past[rows, CENTRAL, -1, 0]))
    assert np.all(features[:, column("leader.v") : column("leader.e") + 1] == 0.0)


def test_only_the_state_at_the_anchor_counts_and_the_scenes_stay_as_they_were() -> None:
    scenes = random_scenes(np.random.default_rng(2), 20)
    before = scenes.past.copy()
    features = lane_change_features(scenes)
    assert np.array_equal(scenes.past, before)
    other = scenes.past.copy()
    other[:, :, :-1] += 7.0
    changed = replace(scenes, past=other, future=scenes.future + 5.0)
    assert np.array_equal(lane_change_features(changed), features)
    assert np.isfinite(features).all()
