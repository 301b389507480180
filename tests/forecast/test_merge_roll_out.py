"""Merge scenes driven along: physics, gaps, and that samples depend on nothing that they should not."""

from dataclasses import replace

import numpy as np
import pytest

from rampcast.forecast.merge_roll_out import MergeRollOut, sample_merges, waiting_features
from rampcast.forecast.platoon_roll_out import RollOut
from rampcast.horizon import FUTURE, STEP
from rampcast.models.disturbance import Disturbance
from rampcast.models.drivers import DriverPrior
from rampcast.models.merging import FEATURES, RARE, MergeHazard
from rampcast.models.platoon_head import Head
from rampcast.traffic.merge_scenes import BEHIND, MergeScenes, nobody
from tests.forecast.merges_made_up import LENGTH, merges

CENTRE = np.array([2.0, 1.2, 1.0, 2.0, 20.0, 4.0])
OFFSETS = 0.2 * np.random.default_rng(0).standard_normal((16, 5))
PRIOR = DriverPrior(CENTRE, 0.2, 1.0, np.column_stack([CENTRE[:5] * np.exp(OFFSETS), np.full(16, CENTRE[5])]))
LIMIT = 25.0
ROLL_OUT = RollOut(PRIOR, Disturbance(), Head(), LIMIT)
OFTEN = MergeRollOut(ROLL_OUT, MergeHazard(np.zeros(FEATURES), -2.0, 300.0, 0.0))
ALWAYS = replace(OFTEN, hazard=replace(OFTEN.hazard, constant=20.0))
SAMPLES = 20


def drawn(scenes, model=OFTEN, *, seed=1, rate=None):
    return sample_merges(model, scenes, samples=SAMPLES, seed=seed, rate=rate)


@pytest.fixture(scope="module")
def scenes():
    return merges(48, seed=1).scenes


@pytest.fixture(scope="module")
def found(scenes):
    return drawn(scenes)


def test_nobody_overlaps_reverses_or_exceeds_the_limit(found):
    led, followed = (np.isfinite(place) for place in (found.leader_rear, found.follower_front))
    assert (found.x <= found.leader_rear + 1e-3)[led].all()
    assert (found.follower_front <= found.x - LENGTH + 1e-3)[followed].all()
    assert led.any()
    assert followed.any()
    speed = np.diff(found.x, axis=2, prepend=0.0) / STEP
    assert speed.min() >= -1e-3
    assert speed.max() <= LIMIT + 1e-2
    assert found.x.std(axis=1)[:, -1].min() > 0.1  # samples differ


@pytest.mark.parametrize("absent", [(0,), (0, 1)])
def test_vehicles_absent_behind_hide_nobody_ahead(scenes, absent):
    target = scenes.target
    valid = target.valid.copy()
    valid[:, list(absent)] = False
    fewer = replace(target, valid=valid, **{name: np.where(valid, getattr(target, name), np.nan) for name in "xva"})
    found = drawn(replace(scenes, target=fewer), ALWAYS)
    ahead = target.x[:, BEHIND, -1] - scenes.own.x[:, 0, -1]  # l1: its leader now, unless one from the ramp is nearer
    at_once = (found.merge_step == 0) & target.present[:, BEHIND, None]
    assert at_once.any()
    farther = found.leader_rear[:, :, 0] - (ahead - LENGTH)[:, None]
    assert farther[at_once].max() < LIMIT * STEP


def test_who_does_not_merge_stops_at_the_end_of_the_lane(scenes):
    never = replace(OFTEN, hazard=replace(OFTEN.hazard, constant=-40.0))
    found = drawn(scenes, never)
    assert (found.merge_step == FUTURE).all()
    assert (found.x <= scenes.to_end[:, None, None] + 1e-3).all()
    assert np.isnan(found.follower_front).all()
    np.testing.assert_allclose(found.chance, 0.0, atol=1e-12)


def test_nobody_merges_upstream_of_the_first_merge(scenes):
    late = replace(ALWAYS, hazard=replace(ALWAYS.hazard, first=60.0))
    found = drawn(scenes, late)
    row, sample = np.nonzero(found.merge_step < FUTURE)
    step = found.merge_step[row, sample]
    before = np.where(step > 0, found.x[row, sample, step - 1], 0.0)
    assert (scenes.to_end[row] - before <= 60.0 + 1e-3).all()
    assert len(row) > 100


def test_a_vehicle_beside_a_gap_merges_at_once_and_beside_a_vehicle_not(scenes):
    """Those abreast at t = 0 are within a vehicle's length ahead or behind."""
    ahead = scenes.target.x[:, :, -1] - scenes.own.x[:, :1, -1]
    abreast = (np.abs(ahead) < LENGTH).any(axis=1)
    assert 5 < abreast.sum() < 43
    step = drawn(scenes, ALWAYS).merge_step
    assert (step[abreast] > 0).all()
    assert (step[~abreast] == 0).all()


def test_the_gap_is_counted_from_that_of_t_0(scenes):
    """Much faster than the lane it merges in front of l1 when there is room; much slower behind f1."""
    rows = np.arange(len(scenes))
    for factor, expected in ((0.25, 1), (4.0, -1)):
        v = factor * scenes.own.v[:, :1].max(axis=1, keepdims=True) * np.ones_like(scenes.target.v)
        v = np.where(scenes.target.valid, v, np.nan)
        at = scenes.own.x[:, 0, -1]
        shift = np.where(factor < 1.0, at - scenes.target.x[:, BEHIND, -1], at - scenes.target.x[:, BEHIND - 1, -1])
        x = scenes.target.x[:, :, -1] + (shift + (1.0 if factor < 1.0 else -1.0))[:, None]
        back = np.arange(1 - v.shape[2], 1) * STEP
        lane = replace(scenes.target, x=x[:, :, None] + v * back, v=v)
        some = replace(scenes, target=lane).select(rows[scenes.target.present[:, BEHIND]])
        found = drawn(some, ALWAYS)
        merged = found.merge_step < FUTURE
        assert merged.mean() > 0.7
        assert (found.gap[merged] == expected).mean() > 0.7


def test_chances_add_up_to_the_share_that_merges(found):
    by_hazard, by_samples = found.chance.sum(axis=1), (found.merge_step < FUTURE).mean(axis=1)
    assert abs(by_hazard.mean() - by_samples.mean()) < 0.03


def test_a_rate_makes_merges_rarer_and_none_with_zero(scenes, found):
    rate = np.ones((len(scenes), FUTURE))
    rarer = drawn(scenes, rate=0.3 * rate)
    assert (rarer.merge_step < FUTURE).mean() < (found.merge_step < FUTURE).mean()
    assert (rarer.merge_step >= found.merge_step).mean() > 0.95
    assert (drawn(scenes, rate=0.0 * rate).merge_step == FUTURE).all()


def test_a_seed_gives_the_same_samples_again_and_another_seed_others(scenes, found):
    np.testing.assert_array_equal(drawn(scenes).x, found.x)
    assert np.abs(drawn(scenes, seed=2).x - found.x).max() > 0.1


def test_a_scene_alone_is_driven_as_in_company(scenes, found):
    for row in (0, 17, 47):
        alone = drawn(scenes.select(np.array([row])))
        np.testing.assert_allclose(alone.x[0], found.x[row], atol=1e-2)
        np.testing.assert_array_equal(alone.merge_step[0], found.merge_step[row])
        np.testing.assert_array_equal(alone.gap[0], found.gap[row])


def test_where_the_road_begins_to_count_changes_nothing(scenes, found):
    own, target = (replace(part, x=part.x + 4000.0) for part in (scenes.own, scenes.target))
    moved = drawn(replace(scenes, own=own, target=target))
    np.testing.assert_allclose(moved.x, found.x, atol=2e-2)
    assert (moved.merge_step == found.merge_step).mean() > 0.99


def test_short_and_broken_histories_are_fine(scenes):
    def cut(part, gone):
        valid = part.valid & ~gone
        states = {name: np.where(valid, getattr(part, name), np.nan) for name in ("x", "v", "a")}
        return replace(part, valid=valid, **states)

    step = np.arange(scenes.own.x.shape[2])
    for gone in (step < 18, (step > 5) & (step < 12)):
        found = drawn(replace(scenes, own=cut(scenes.own, gone), target=cut(scenes.target, gone)))
        assert np.isfinite(found.x).all()
        assert np.isfinite(found.chance).all()


def test_an_empty_lane_and_an_endless_one_are_merged_into(scenes):
    empty = MergeScenes(scenes.own, nobody(len(scenes)), np.full(len(scenes), np.inf), scenes.offset, scenes.approach)
    found = drawn(empty, ALWAYS)
    assert (found.merge_step == 0).all()
    assert (found.gap == 0).all()
    assert np.isnan(found.follower_front).all()


def test_waiting_vehicles_see_the_gap_beside_and_never_merge(scenes):
    found = waiting_features(ALWAYS, scenes, samples=2, seed=1)
    assert found.features.shape == (len(scenes), 2, FUTURE, FEATURES)
    assert np.isfinite(found.features).all()
    assert (found.x <= scenes.to_end[:, None, None] + 1e-3).all()
    ahead = scenes.target.x[:, BEHIND, -1] - LENGTH - scenes.own.x[:, 0, -1]
    seen = np.where(scenes.target.present[:, BEHIND], np.clip(ahead, 1.0, 60.0), 60.0)
    np.testing.assert_allclose(found.features[:, 0, 0, 0], np.log(seen / 10.0), atol=1e-3)


def test_nothing_is_known_of_merges_at_first():
    assert 1.0 / (1.0 + np.exp(-RARE)) == pytest.approx(0.0025, abs=1e-4)
