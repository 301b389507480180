"""What is learned from: rows that stay together, and folds that have seen neither the vehicle nor its minutes."""

from dataclasses import fields, replace

import numpy as np
import pytest

from rampcast.forecast.calibrated import Calibrated, CalibratedSpec, rolled_rows
from rampcast.forecast.learning import Training, _of_whole_merges, fit_base
from rampcast.traffic.situation import situation_of_scenes
from tests.forecast.merges_made_up import merges

COUNT = 90
SPEC = CalibratedSpec(samples=8, folds=3)


@pytest.fixture(scope="module")
def training() -> Training:
    """Vehicles of one window, three rows each, one second after the other."""
    made = merges(COUNT, seed=3)
    situation = situation_of_scenes(made.scenes)
    group, t0 = np.array([f"1-{row // 3}" for row in range(COUNT)]), 4.0 * np.arange(COUNT)
    return Training(situation, situation.first[:-1], made.scenes, made.truth, made.leader_truth, made.change_time,
                    made.seen_for, group, t0)  # fmt: skip


def test_chosen_rows_keep_their_vehicles_and_their_traffic(training):
    rows = np.array([4, 5, 40, 41, 80])
    some = training.select(rows)
    assert len(some) == 5
    np.testing.assert_array_equal(some.situation.x[some.vehicle], training.situation.x[training.vehicle[rows]])
    np.testing.assert_array_equal(some.scenes.own.x[:, 0], some.situation.x[some.vehicle])
    for name in ("truth", "change_time", "group", "t0"):
        np.testing.assert_array_equal(getattr(some, name), getattr(training, name)[rows])
    counts = np.diff(training.situation.first)[training.situation.moment[training.vehicle[rows]]]
    np.testing.assert_array_equal(np.diff(some.situation.first), counts)
    again = some.select(np.arange(5))
    for field in fields(some.situation):
        np.testing.assert_array_equal(getattr(again.situation, field.name), getattr(some.situation, field.name))


def test_folds_share_neither_vehicles_nor_minutes(training):
    tested = []
    for train, test in training.folds(3):
        assert not set(training.group[train]) & set(training.group[test])
        begins, ends = training.t0[test].min() - 4.0, training.t0[test].max() + 15.0
        other = training.t0[train]
        assert ((other + 15.0 <= begins + 1e-6) | (other - 4.0 >= ends - 1e-6)).all()
        tested.append(test)
    np.testing.assert_array_equal(np.sort(np.concatenate(tested)), np.arange(COUNT))


@pytest.mark.slow
def test_what_became_of_the_vehicles_of_a_block_does_not_move_their_out_of_fold_roll_outs(training):
    """And it does move those of the others, whose models have seen it."""
    train, test = training.folds(3)[1]
    rng = np.random.default_rng(1)
    truth, ahead, change = training.truth.copy(), training.leader_truth.copy(), training.change_time.copy()
    truth[test] *= rng.uniform(0.3, 0.6, (len(test), 1))
    ahead[test] += 25.0
    change[test] = rng.uniform(0.2, 15.0, len(test))
    wrong = replace(training, truth=truth, leader_truth=ahead, change_time=change)

    def out_of_fold(some: Training, rows: np.ndarray, others: np.ndarray):
        model = Calibrated(SPEC, fit_base(some.select(rows), seed=1), None, None, True)
        return rolled_rows(model, some.select(others))

    right, same = (out_of_fold(some, train, test) for some in (training, wrong))
    for field in fields(right):
        np.testing.assert_array_equal(getattr(right, field.name), getattr(same, field.name), err_msg=field.name)
    seen, moved = (out_of_fold(some, test, train[:9]) for some in (training, wrong))
    assert np.abs(seen.median - moved.median).max() > 0.1


def test_manners_are_not_learned_from_windows_whose_vehicles_vanish_when_they_merge(training):
    some = replace(
        training.select(np.arange(5)),
        change_time=np.array([3.0, np.nan, 4.0, 5.0, np.nan]),
        seen_for=np.array([3.0, 15.0, 12.0, 5.0, 15.0]),
        group=np.array(["0-a", "0-b", "1-a", "1-b", "2-a"]),
    )
    np.testing.assert_array_equal(_of_whole_merges(some), [False, False, True, True, True])
