"""The paper's framework on cases, with neighbour models that are known."""

from dataclasses import replace

import numpy as np
import pytest

from rampcast.benchmark import Training, models, paper_rows
from rampcast.benchmark.cases import TIME
from rampcast.benchmark.paper_rows import Kept, PaperRows, lane_parameters
from rampcast.compute import jax
from rampcast.paper.calibration.calibration import calibrate
from rampcast.paper.laws.laws import LAWS
from rampcast.paper.laws.mode import Mode
from rampcast.paper.neighbours.lstm import LstmSpec, NeighbourLstm, fit_lstm
from rampcast.traffic.merge_scenes import BEHIND, MergeScenes, nobody, without_target
from tests.benchmark.test_models import made_up_platoon


@pytest.fixture(autouse=True)
def asked(monkeypatch):
    """Neighbour models go on as in the last step. Returns for how many vehicles they are asked each time."""
    counts = []

    def predict(self, past, *, steps):
        del self
        counts.append(len(past))
        return past[:, -1:] + (past[:, -1:] - past[:, -2:-1]) * np.arange(1, steps + 1)

    monkeypatch.setattr(NeighbourLstm, "predict", predict)
    return counts


def rows(mode: Mode) -> PaperRows:
    """Returns the framework with neighbour models that nobody trained."""
    untrained = fit_lstm(
        np.cumsum(np.ones((2, 21)), axis=1), mode=mode, spec=LstmSpec(units=2, epochs=0, batch=1), key=jax.random.key(0)
    )
    return PaperRows(mode, untrained, untrained)


@pytest.fixture
def queue():
    """Returns a vehicle that nears a slower one, and another far ahead."""
    return made_up_platoon([25.0, 40.0], [14.0, 9.0, 9.0])


def merging(own, *, to_end=400.0, target=None) -> MergeScenes:
    unknown = np.full(len(own), np.nan)
    return MergeScenes(own, nobody(len(own)) if target is None else target, np.full(len(own), to_end), unknown, unknown)


@pytest.mark.parametrize("law", ["idm", "gipps_paper", "ghr"])
def test_behind_a_neighbour_at_constant_speed_it_is_the_law_behind_a_leader_at_constant_speed(queue, cases, law):
    scenes = without_target(queue)
    plain = models.car_following(Training(cases), law=law)(scenes).x
    np.testing.assert_allclose(rows(Mode.CORRECTED).behind(law, scenes, Kept()), plain, atol=1e-6)


def test_alone_it_is_what_the_model_says_of_the_vehicle_itself(queue):
    for mode in Mode:
        np.testing.assert_allclose(rows(mode).alone(without_target(queue), Kept())[0], 14.0 * TIME, atol=1e-9)


def test_with_nobody_in_the_target_lane_a_merging_vehicle_follows_its_own_leader(queue):
    one = rows(Mode.CORRECTED)
    followed = one.behind("idm", merging(queue), Kept())
    np.testing.assert_allclose(followed, one.behind("idm", without_target(queue), Kept()), atol=1e-6)


def test_a_leader_beyond_the_end_of_the_lane_is_not_followed():
    """It was 29 m ahead 4 s ago, and the lane ends after 20 m: nobody is followed, and IDM drives freely."""
    far, free = made_up_platoon([60.0], [14.0, 9.0]), made_up_platoon([], [14.0])
    one = rows(Mode.CORRECTED)
    np.testing.assert_allclose(
        one.behind("idm", merging(far, to_end=20.0), Kept()), one.behind("idm", merging(free), Kept())
    )


def test_of_two_lanes_the_actual_leader_is_half_way_between_both(queue):
    """l1 is 12 m ahead of the leader and as fast, so that both modes follow one 6 m ahead of the leader."""
    target = nobody(1)
    values = {name: getattr(target, name).copy() for name in ("x", "v", "a", "valid", "length")}
    for name in ("x", "v", "a", "valid", "length"):
        values[name][:, BEHIND] = getattr(queue, name)[:, 1]
    values["x"][:, BEHIND] += 12.0
    ahead = queue.x.copy()
    ahead[:, 1] += 6.0
    expected = without_target(replace(queue, x=ahead))
    scenes = merging(queue, target=replace(target, **values))
    for mode in Mode:
        np.testing.assert_allclose(
            rows(mode).behind("idm", scenes, Kept()), rows(mode).behind("idm", expected, Kept()), atol=1e-6
        )


def test_paper_mode_fits_gaps_from_front_to_front_in_the_ranges_of_the_paper(cases):
    some = cases.select(np.arange(12))
    own, past = some.platoons, slice(1, None)
    gap = own.x[:, 1, past] - own.x[:, 0, past]
    expected = calibrate(
        LAWS["ghr"],
        speed=own.v[:, 0, past],
        leader_speed=own.v[:, 1, past],
        gap=gap,
        acceleration=own.a[:, 0, past],
        valid=np.ones(gap.shape, dtype=bool),
        mode=Mode.PAPER,
    ).parameters
    np.testing.assert_array_equal(lane_parameters("ghr", some.scenes, Mode.PAPER, Kept()), expected)
    net = lane_parameters("ghr", some.scenes, Mode.CORRECTED, Kept())
    assert not np.allclose(net, expected)


def test_neighbours_are_predicted_once_for_all_rows(cases, asked):
    now = cases.select(np.array([name.startswith("1-") and name.endswith("-65") for name in cases.case.tolist()]))
    assert len(now) == 4
    one = rows(Mode.CORRECTED)
    kept = Kept()
    one.alone(now.scenes, kept)
    for law in ("gipps_paper", "ghr"):
        one.behind(law, now.scenes, kept)
    assert asked == [8]


def test_training_windows_are_as_many_as_one_of_a_few_counts(monkeypatch):
    monkeypatch.setattr(paper_rows, "WINDOWS", (10, 40))
    monkeypatch.setattr(paper_rows, "EACH", 4)
    tracks = np.cumsum(np.ones((3, 25)), axis=1)
    tracks[1, 3:] = np.nan
    assert paper_rows._windows(tracks[:1]).shape == (10, 21)  # 5 windows, twice each
    assert paper_rows._windows(tracks).shape == (10, 21)
    assert paper_rows._windows(np.tile(tracks[:1], (2, 1))).shape == (10, 21)  # 8 are wanted
    assert paper_rows._windows(np.tile(tracks, (30, 1))).shape == (40, 21)  # of 300
    assert paper_rows._windows(tracks[1:2]).shape == (0, 21)
