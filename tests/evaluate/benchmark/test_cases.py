"""The cases: their names, anchors and truths, and that the two sides of a split share nothing."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from rampcast.evaluate.benchmark import DATA_SETS, folds, split
from rampcast.evaluate.benchmark.cases import BEFORE, WHOLE_TRUTH
from rampcast.evaluate.benchmark.splits import committed_rules, group_hash
from rampcast.scenes.scenes import FUTURE
from tests.evaluate.benchmark import made_up


def read(name: str, table: pl.DataFrame, tmp_path: Path):
    path = tmp_path / f"{name}.parquet"
    table.write_parquet(path)
    return DATA_SETS[name].read([path])


def test_anchors_are_at_index_40_65_90_as_long_as_15_seconds_of_truth_remain(cases):
    """291 frames: the last index with 150 after it is 140."""
    mine = [case for case in cases.case.tolist() if case.startswith("1-2-")]
    assert mine == ["1-2-40", "1-2-65", "1-2-90", "1-2-115", "1-2-140"]
    assert np.isfinite(cases.truth).all()
    assert len(cases) == 3 * 2 * 4 * 5  # windows, queues, followers, anchors


def test_chains_are_joined_by_vehicle_and_frame(cases):
    depth = dict(zip(cases.group.tolist(), cases.platoons.depth.tolist(), strict=True))
    assert [depth[f"1-{vehicle}"] for vehicle in (2, 3, 4, 5)] == [1, 2, 3, 4]


def test_the_truth_is_how_far_the_vehicle_went(cases):
    """The smoothing of a wave of 14 s moves its places by less than a centimetre."""
    x = made_up.queue(10)  # window 1, first queue
    row = cases.case.tolist().index("1-3-65")
    went = x[2][65 + 2 * np.arange(1, FUTURE + 1)] - x[2][65]
    np.testing.assert_allclose(cases.truth[row], went, atol=0.05)
    ahead = x[1][65 + 2 * np.arange(1, FUTURE + 1)] - x[2][65]
    np.testing.assert_allclose(cases.leader_truth[row], ahead, atol=0.05)


def test_changing_what_comes_after_t0_changes_the_truth_and_not_the_platoon(cases, tmp_path):
    table = made_up.pairs()
    later = pl.col("frame") % 1000 > 140
    table = table.with_columns(
        pl.when(later).then(pl.col(name) + 30.0).otherwise(pl.col(name)) for name in ("x_follower", "x_leader")
    )
    changed = read("i80_pairs_three_windows", table, tmp_path)
    for name in ("x", "v", "a", "valid"):
        np.testing.assert_array_equal(getattr(changed.platoons, name), getattr(cases.platoons, name))
    last = [name.endswith("140") for name in cases.case.tolist()]
    assert np.abs(changed.truth - cases.truth)[last].min() > 5.0


def test_an_event_is_followed_by_integrating_its_speed(tmp_path):
    """A follower at 10 m/s, a leader at 12 m/s: the gap opens from 8 m by 2 m/s; at index 40 it is 16 m."""
    count = 215
    table = pl.DataFrame({"event": 7, "time": 0.1 * np.arange(count), "v_follower": 10.0, "v_leader": 12.0})
    table = table.with_columns(gap=8.0 + 2.0 * pl.col("time"))
    cases = read("ngsim_car_following_events", table, tmp_path)
    assert cases.case.tolist() == ["7-40"]
    np.testing.assert_allclose(cases.truth[0, [4, 74]], [10.0, 150.0], atol=1e-6)
    np.testing.assert_allclose(cases.leader_truth[0, [4, 74]], [16.0 + 12.0, 16.0 + 180.0], atol=1e-6)
    np.testing.assert_allclose(cases.platoons.x[0, 1, -1] - cases.platoons.x[0, 0, -1], 16.0, atol=1e-6)
    assert cases.platoons.length[0, :2].tolist() == [0.0, 0.0]


def merge_table(count: int = 60) -> pl.DataFrame:
    """Returns a merging vehicle at 10 m/s with two others ahead; the first is another one from index 20 on."""
    time = 0.1 * np.arange(count)
    table = pl.DataFrame({"merge": 3, "time": time, "v": 10.0, "distance_to_end": 200.0 - 10.0 * time})
    gap = np.where(np.arange(count) < 20, 15.0, 25.0)
    return table.with_columns(gap_3=gap, dv_3=0.0, gap_4=60.0, dv_4=0.0)


def test_merges_are_anchored_every_half_second_and_a_jump_in_a_gap_is_another_vehicle(tmp_path):
    cases = read("us101_ramp_merges", merge_table(), tmp_path)
    assert cases.case.tolist() == [f"3-{index}" for index in range(5, 50, 5)]
    np.testing.assert_allclose(cases.truth[:, 4], 10.0, atol=1e-6)
    at_25 = cases.platoons.select(np.array([4]))
    assert at_25.depth.tolist() == [2]
    ahead = at_25.x[0, :, -1] - at_25.x[0, 0, -1]
    np.testing.assert_allclose(ahead[1:3], [25.0, 60.0], atol=1e-6)
    seen = at_25.valid[0, 1]  # the new vehicle since index 20: steps 21, 23, 25
    assert seen.sum() == 3


def test_pairs_of_the_german_highway_have_no_leader_and_truth_as_far_as_seen(tmp_path):
    time = 0.2 * np.arange(40)
    table = pl.DataFrame({"pair": 4, "time": time, "x_main": 25.0 * time, "x_ramp": 100.0 + 20.0 * time})
    cases = read("hee_merge_pairs", table, tmp_path)
    assert cases.case.tolist() == ["4-main-20", "4-main-32", "4-ramp-20", "4-ramp-32"]
    assert cases.platoons.depth.tolist() == [0] * 4
    np.testing.assert_allclose(cases.truth[0, :19], 25.0 * 0.2 * np.arange(1, 20), atol=1e-6)
    assert np.isnan(cases.truth[0, 19:]).all()


@pytest.mark.parametrize("rule", [{"test_numbers": [2]}, {"test_from_number": 3}])
def test_no_vehicle_is_on_both_sides_of_a_split(cases, rule):
    sides = split(cases, {"i80_pairs_three_windows": rule})
    train, test = (set(cases.group[rows].tolist()) for rows in (sides.train, sides.test))
    assert train
    assert test
    assert not train & test


def test_a_split_by_time_leaves_out_what_lies_across_the_border(cases):
    """Frames of the first queue are 0 to 290, of the second 1000 to 1290."""
    sides = split(cases, {"i80_pairs_three_windows": {"test_from_time": 100.0}})
    assert cases.t0[sides.train].max() + WHOLE_TRUTH < 100.0 <= cases.t0[sides.test].min() - BEFORE
    across = split(cases, {"i80_pairs_three_windows": {"test_from_time": 20.0}})
    assert len(across.train) == 0  # every vehicle of the first queue has truth on both sides
    assert set(across.test.tolist()) == set(sides.test.tolist())


def test_every_case_tests_in_one_fold_and_no_fold_trains_on_the_time_that_it_tests(cases):
    parts = folds(cases, 4)
    assert sorted(np.concatenate([test for _, test in parts]).tolist()) == list(range(len(cases)))
    window = np.array([int(name[0]) for name in cases.group.tolist()])
    for train, test in parts:
        assert len(train)
        assert not set(cases.group[train].tolist()) & set(cases.group[test].tolist())
        for one in np.unique(window[test]):
            tested, trained = (cases.t0[rows[window[rows] == one]] for rows in (test, train))
            for t0 in trained:
                assert t0 + WHOLE_TRUTH <= tested.min() - BEFORE or t0 - BEFORE >= tested.max() + WHOLE_TRUTH


def test_folds_of_a_data_set_without_a_clock_are_by_vehicle_alone(cases):
    parts = folds(replace(cases, t0=np.full(len(cases), np.nan)), 3)
    assert [len(train) + len(test) for train, test in parts] == [len(cases)] * 3


def test_the_hash_of_a_side_depends_on_its_groups_alone():
    one, other = np.array(["b", "a", "b"]), np.array(["a", "b"])
    assert group_hash(one) == group_hash(other) != group_hash(np.array(["a", "c"]))


def test_every_data_set_has_a_committed_rule():
    assert list(committed_rules()) == list(DATA_SETS)


@pytest.mark.data
@pytest.mark.parametrize("name", [name for name in DATA_SETS if name != "simulated"])
def test_the_real_files_give_the_committed_splits(name, data_folder):
    cases = DATA_SETS[name].read(DATA_SETS[name].find(data_folder / "real"))
    sides = split(cases)
    assert sides.as_committed
    assert not set(cases.group[sides.train].tolist()) & set(cases.group[sides.test].tolist())
    assert len(np.unique(cases.case)) == len(cases)


@pytest.mark.data
def test_the_chains_of_the_real_pairs_are_1160_cases(data_folder):
    """As many as were counted on the file by a loop of its own."""
    data_set = DATA_SETS["i80_car_following_pairs"]
    cases = data_set.read(data_set.find(data_folder / "real"))
    assert len(cases) == 1160
    assert [int((cases.platoons.depth >= depth).sum()) for depth in (1, 2, 3, 4)] == [1160, 466, 168, 63]
