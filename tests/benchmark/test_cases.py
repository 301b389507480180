"""The cases: their names, anchors and truths, and that the two sides of a split share nothing."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from rampcast.benchmark import DATA_SETS, folds, split
from rampcast.benchmark.cases import BEFORE, WHOLE_TRUTH
from rampcast.benchmark.splits import committed_rules, group_hash
from rampcast.horizon import FUTURE
from tests.benchmark import made_up


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


def whole_road(time_step: float, count: int) -> pl.DataFrame:
    """Returns vehicles 1, 2 and 3 at 20 m/s in lane 1, 3 ahead, and vehicle 4 at 25 m/s in lane 2, in between."""
    time = time_step * np.arange(count)
    lanes = {1: (1, 0.0, 20.0), 2: (1, 30.0, 20.0), 3: (1, 70.0, 20.0), 4: (2, 20.0, 25.0)}
    return pl.concat(
        pl.DataFrame({"vehicle": vehicle, "frame": np.arange(count), "x": x + v * time, "lane": lane, "length": length})
        for (vehicle, (lane, x, v)), length in zip(lanes.items(), (4.0, 5.0, 6.0, 7.0), strict=True)
    )


def test_a_platoon_at_30_hz_has_the_leaders_of_each_lane_at_every_second(tmp_path):
    """600 frames are 20 s: 15 s of truth remain at 4 s, and not at 5 s. Lengths are not known, places are middles."""
    table = whole_road(1 / 30, 600).drop("length")
    cases = read("i75_platoon", table, tmp_path)
    assert cases.case.tolist() == ["1-1-120", "1-2-120"]
    assert cases.platoons.depth.tolist() == [2, 1]
    np.testing.assert_allclose(cases.t0, 4.0)
    np.testing.assert_allclose(cases.truth[0, [4, 74]], [20.0, 300.0], atol=1e-6)
    np.testing.assert_allclose(cases.leader_truth[0, 4], 50.0, atol=1e-6)
    np.testing.assert_allclose(cases.platoons.x[0, :2, -1], [82.25, 112.25], atol=1e-3)
    assert np.isnan(cases.platoons.length).all()
    np.testing.assert_allclose(cases.platoons.traffic[0, 0, 1:3], [20.0, 22.5], atol=1e-6)  # 0, 30, 40 and 70 m ahead


def test_a_scene_at_25_hz_has_truth_as_far_as_seen_and_fronts_a_length_ahead_of_the_rears(tmp_path):
    """150 frames are 6 s: 1 s of truth remains at 4 s. Then the rear of vehicle 1 is at 80 m, of vehicle 2 at 110 m."""
    cases = read("i24_scene", whole_road(1 / 25, 150), tmp_path)
    assert cases.case.tolist() == ["1-1-100", "1-2-100"]
    np.testing.assert_allclose(cases.platoons.x[0, :2, -1], [84.0, 115.0], atol=1e-3)
    np.testing.assert_allclose(cases.platoons.length[0, :2], [4.0, 5.0])
    assert np.isfinite(cases.truth).sum(axis=1).tolist() == [9, 9]  # until frame 149, 1.96 s later


def merge_table(count: int = 60) -> pl.DataFrame:
    """Returns a merging vehicle at 10 m/s among five others that are as fast; x of its front is -distance_to_end.

    Slot 5 is the leader in its own lane, 25 m ahead. From index 20 on that vehicle is in slot 3: it has changed lane,
    and the one that was 40 m ahead in slot 3 is in slot 4. From index 30 on the vehicle of slot 2 is beside and then
    ahead in slot 3, overtaking, and the others have moved on by one slot.
    """
    time = 0.1 * np.arange(count)
    table = pl.DataFrame({"merge": 3, "time": time, "v": 10.0, "distance_to_end": 200.0 - 10.0 * time})
    early, late = np.arange(count) < 20, np.arange(count) >= 30
    overtaking = -10.0 + 4.0 * np.maximum(time - 0.5, 0.0)  # 0 at index 30
    slots = {
        1: (np.where(late, -60.0, -40.0), 0.0),
        2: (np.where(late, -40.0, overtaking), np.where(late | (time < 0.55), 0.0, 4.0)),
        3: (np.where(early, 40.0, np.where(late, overtaking, 25.0)), np.where(late, 4.0, 0.0)),
        4: (np.where(early, 90.0, np.where(late, 25.0, 40.0)), 0.0),
        5: (np.where(early, 25.0, np.nan), np.where(early, 0.0, np.nan)),
    }
    columns = {f"{name}_{k}": values[which] for k, values in slots.items() for which, name in enumerate(("gap", "dv"))}
    return table.with_columns(
        **{name: pl.lit(values) if np.isscalar(values) else values for name, values in columns.items()}
    )


@pytest.fixture(scope="module")
def merges(tmp_path_factory):
    return read("us101_ramp_merges", merge_table(), tmp_path_factory.mktemp("merges"))


def test_merges_are_anchored_every_half_second_until_the_merge(merges):
    """60 rows, the last of them the merge; one second of truth is left until index 49."""
    assert merges.case.tolist() == [f"3-{index}" for index in range(5, 60, 5)]
    assert merges.longitudinal.tolist() == [index <= 49 for index in range(5, 60, 5)]
    assert merges.merging.all()
    np.testing.assert_allclose(merges.truth[:9, 4], 10.0, atol=1e-6)
    np.testing.assert_allclose(merges.change_time, 5.9 - 0.1 * np.arange(5, 60, 5), atol=1e-9)
    np.testing.assert_allclose(merges.seen_for, merges.change_time)
    np.testing.assert_allclose(merges.place, 10.0 * merges.change_time, atol=1e-6)
    np.testing.assert_allclose(merges.since_entry, 0.1 * np.arange(5, 60, 5), atol=1e-9)
    np.testing.assert_allclose(merges.scenes.to_end, 200.0 - np.arange(5, 60, 5), atol=1e-9)


def test_slot_5_is_the_leader_in_the_own_lane_and_the_others_are_the_target_lane(merges):
    at_15 = merges.scenes.select(np.array([2]))
    assert at_15.own.depth.tolist() == [1]
    assert at_15.own.x[0, 1, -1] - at_15.own.x[0, 0, -1] == pytest.approx(25.0)
    assert at_15.target.present[0].tolist() == [True, True, True, True, *[False] * 6]
    ahead = at_15.target.x[0, :4, -1] - at_15.own.x[0, 0, -1]
    np.testing.assert_allclose(ahead, [-40.0, -6.0, 40.0, 90.0], atol=0.3)


def test_a_vehicle_is_the_same_in_another_slot(merges):
    """At index 25 the vehicle 25 m ahead has been in slot 3 for 0.5 s, and in slot 5 before."""
    at_25 = merges.scenes.select(np.array([4]))
    assert at_25.own.depth.tolist() == [0]
    assert at_25.target.valid[0, 2].sum() == 13  # index 1, 3 ... 25, as long as the central vehicle
    assert at_25.target.x[0, 2, -1] - at_25.own.x[0, 0, -1] == pytest.approx(25.0)
    np.testing.assert_allclose(merges.leader_truth[2, 20], 25.0 + 42.0, atol=1e-6)  # 4.2 s later it is still known


def test_the_gap_merged_into_counts_who_passed(merges):
    """The vehicle of slot 2 overtakes at index 30: before that the gap is one behind, after it is the nearest."""
    assert merges.gap.tolist() == [-1.0] * 5 + [0.0] * 6


def test_pairs_of_the_german_highway_have_no_leader_and_truth_as_far_as_seen(tmp_path):
    time = 0.2 * np.arange(40)
    table = pl.DataFrame({"pair": 4, "time": time, "x_main": 25.0 * time, "x_ramp": 100.0 + 20.0 * time})
    cases = read("hee_merge_pairs", table.with_columns(lane_main=1.0, lane_ramp=0.1 * time), tmp_path)
    assert cases.case.tolist() == ["4-main-20", "4-main-32", "4-ramp-20", "4-ramp-32"]
    assert cases.platoons.depth.tolist() == [0] * 4
    np.testing.assert_allclose(cases.truth[0, :19], 25.0 * 0.2 * np.arange(1, 20), atol=1e-6)
    assert np.isnan(cases.truth[0, 19:]).all()


def test_the_ramp_vehicle_of_a_german_pair_merges_where_its_lane_number_passes_a_half(tmp_path):
    """0.1 lanes a second from 0.005: beyond 0.5 from index 25 (5.0 s) on; anchors at index 20 and 32.

    The vehicle on the main road is at 25 t, the other at 15 + 20 t: they are abreast at 3 s, so it is ahead at 4 s.
    """
    time = 0.2 * np.arange(40)
    table = pl.DataFrame({"pair": 4, "time": time, "x_main": 25.0 * time, "x_ramp": 15.0 + 20.0 * time})
    cases = read("hee_merge_pairs", table.with_columns(lane_main=1.0, lane_ramp=0.005 + 0.1 * time), tmp_path)
    assert cases.merging.tolist() == [False, False, True, False]
    assert cases.scenes.may_merge.tolist() == [False, False, True, True]
    np.testing.assert_allclose(cases.change_time[2:], [1.0, -1.4], atol=1e-9)
    assert cases.gap[2] == 0.0
    assert cases.scenes.target.present[2].nonzero()[0].tolist() == [2]  # l1
    np.testing.assert_allclose(cases.scenes.offset[2], 3.75 * (0.5 - 0.405), atol=1e-4)
    np.testing.assert_allclose(cases.scenes.approach[2], 0.375, atol=1e-3)
    np.testing.assert_allclose(cases.place[2], 20.0, atol=1e-6)
    assert np.isposinf(cases.scenes.to_end[2])


def test_cases_without_a_merge_know_of_none(cases):
    assert not cases.merging.any()
    for values in (cases.change_time, cases.gap, cases.place, cases.since_entry):
        assert np.isnan(values).all()
    assert (cases.seen_for >= WHOLE_TRUTH - 1e-9).all()


@pytest.mark.parametrize("rule", [{"test_numbers": [2]}, {"test_from_number": 3}])
def test_no_vehicle_is_on_both_sides_of_a_split(cases, rule):
    sides = split(cases, {"i80_pairs_three_windows": rule})
    ((train, test),) = ((set(side.group.tolist()) for side in part) for part in sides.parts)
    assert train
    assert test
    assert not train & test


def test_a_split_by_time_leaves_out_what_lies_across_the_border(cases):
    """Frames of the first queue are 0 to 290, of the second 1000 to 1290."""
    ((train, test),) = split(cases, {"i80_pairs_three_windows": {"test_from_time": 100.0}}).parts
    assert train.t0.max() + WHOLE_TRUTH < 100.0 <= test.t0.min() - BEFORE
    ((across, others),) = split(cases, {"i80_pairs_three_windows": {"test_from_time": 20.0}}).parts
    assert len(across) == 0  # every vehicle of the first queue has truth on both sides
    assert set(others.case.tolist()) == set(test.case.tolist())


def test_a_split_by_time_and_vehicle_cuts_the_truth_of_training_and_shows_no_vehicle_twice(cases):
    """Vehicles 2 to 5 and 12 to 15 of each window; the lower ones train until 12 s, the others test from then on."""
    rule = {"test_from_time": 12.0, "train_below_vehicle": 12}
    ((train, test),) = split(cases, {"i80_pairs_three_windows": rule}).parts
    assert set(train.group.tolist()) == {f"{window}-{vehicle}" for window in (1, 2, 3) for vehicle in (2, 3, 4, 5)}
    assert set(test.group.tolist()) == {f"{window}-{vehicle}" for window in (1, 2, 3) for vehicle in (12, 13, 14, 15)}
    left = 12.0 - train.t0
    assert left.min() >= 1.0 - 1e-9
    np.testing.assert_array_equal(np.isfinite(train.truth).sum(axis=1), np.minimum(np.floor(left / 0.2 + 1e-6), 75))
    np.testing.assert_array_equal(np.isfinite(train.leader_truth), np.isfinite(train.truth))
    np.testing.assert_allclose(train.seen_for, left)
    assert test.t0.min() - BEFORE >= 12.0


def test_in_parts_every_vehicle_tests_once_and_never_trains_its_own_model(cases):
    parts = split(cases, {"i80_pairs_three_windows": {"parts": 5}}).parts
    assert sorted(name for _, test in parts for name in test.case.tolist()) == sorted(cases.case.tolist())
    for train, test in parts:
        assert not set(train.group.tolist()) & set(test.group.tolist())
        assert len(train) + len(test) == len(cases)


def test_what_was_not_seen_until_a_border_is_not_known(merges):
    """The merge of the case at index 5 comes 5.4 s later, that of index 45 after 1.4 s."""
    clocked = replace(merges, t0=0.1 * np.array([int(name.split("-")[1]) for name in merges.case.tolist()]))
    until = clocked.until(5.7)
    assert until.case.tolist() == merges.case.tolist()[:9]
    assert np.isnan([until.change_time, until.gap, until.place]).all()
    whole = clocked.until(9.0)
    np.testing.assert_array_equal(whole.change_time, merges.change_time[: len(whole)])


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
    for train, test in sides.parts:
        assert not set(train.group.tolist()) & set(test.group.tolist())
    assert len(np.unique(cases.case)) == len(cases)


@pytest.mark.data
def test_the_chains_of_the_real_pairs_are_1160_cases(data_folder):
    """As many as were counted on the file by a loop of its own."""
    data_set = DATA_SETS["i80_car_following_pairs"]
    cases = data_set.read(data_set.find(data_folder / "real"))
    assert len(cases) == 1160
    assert [int((cases.platoons.depth >= depth).sum()) for depth in (1, 2, 3, 4)] == [1160, 466, 168, 63]
