"""What every model of the benchmark must hold to, and the baselines against closed forms and plain loops."""

from dataclasses import replace

import numpy as np
import pytest

from rampcast.benchmark import Forecasts, Training, forecast_cases, models, paper_rows
from rampcast.benchmark.models import ORACLE, TIME, constant_velocity, oracle, relax_to_leader, with_bands
from rampcast.forecast.calibrated import CalibratedSpec
from rampcast.forecasters import places
from rampcast.models.correction import CorrectionSpec
from rampcast.models.pooled_driver import START, fit_pooled_driver, follow_true_leader, roll_chain
from rampcast.paper.algorithm_1 import follow
from rampcast.paper.laws.laws import LAWS
from rampcast.paper.neighbours.lstm import LstmSpec
from rampcast.traffic.merge_scenes import without_target
from rampcast.traffic.platoons import Platoons, no_traffic
from tests.benchmark.made_up import HEADWAY

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module", autouse=True)
def quick_lstm():
    """A small LSTM and few trees, with little training: the contracts hold for any weights."""
    few = CalibratedSpec(samples=30, folds=3, correction=CorrectionSpec(trees=8, least_in_leaf=10))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(paper_rows, "LSTM", LstmSpec(units=8, epochs=1, batch=256))
        patch.setattr(paper_rows, "WINDOWS", (512,))
        patch.setattr(models, "FORECASTER", few)
        yield


@pytest.fixture(scope="module")
def sides(cases):
    """Returns the cases of windows 1 and 3, and of window 2."""
    second = np.char.startswith(cases.case.astype(str), "2-")
    return cases.select(~second), cases.select(second)


@pytest.fixture(scope="module")
def forecasts(sides, quick_lstm):
    return forecast_cases(Training(sides[0]), sides[1], models=places())


@pytest.fixture(scope="module")
def predictors(sides, quick_lstm):
    training = Training(sides[0])
    return {name: fit(training) for name, fit in places().items()}


def test_every_model_forecasts_every_case_at_every_step(forecasts, sides):
    assert list(forecasts) == [*places(), ORACLE]
    for name, forecast in forecasts.items():
        assert forecast.x.shape == sides[1].truth.shape
        assert np.isfinite(forecast.x).all(), name
        assert forecast.quantiles.shape == (*forecast.x.shape, 5)
        assert (np.diff(forecast.quantiles, axis=2) >= 0.0).all(), name


def test_changing_the_truth_changes_the_oracle_and_nothing_else(forecasts, sides):
    train, test = sides
    rng = np.random.default_rng(0)
    changed = replace(
        test,
        truth=rng.normal(100.0, 30.0, test.truth.shape),
        leader_truth=test.leader_truth + np.linspace(0.0, 40.0, test.truth.shape[1]),
    )
    again = forecast_cases(Training(train), changed, models=places())
    for name in places():
        np.testing.assert_array_equal(again[name].x, forecasts[name].x, err_msg=name)
        np.testing.assert_array_equal(again[name].quantiles, forecasts[name].quantiles, err_msg=name)
    assert np.abs(again[ORACLE].x - forecasts[ORACLE].x).max() > 5.0


def test_the_forecast_of_a_case_does_not_depend_on_the_other_cases(predictors, sides):
    scenes = sides[1].scenes
    for name, predict in predictors.items():
        together = predict(scenes).x
        for row in (0, 17, len(scenes) - 1):
            alone = predict(scenes.select(np.array([row]))).x[0]
            np.testing.assert_allclose(alone, together[row], atol=1e-3, err_msg=name)


def test_shifting_all_places_changes_no_displacement(predictors, sides):
    platoons = sides[1].platoons
    here, moved = (without_target(replace(platoons, x=platoons.x + shift)) for shift in (0.0, 300.0))
    for name in ("constant_velocity", "relax_to_leader", "pooled_idm", "chain_8", "lstm"):
        np.testing.assert_allclose(predictors[name](moved).x, predictors[name](here).x, atol=1e-3, err_msg=name)


def test_a_place_that_is_empty_changes_nothing_whatever_lies_in_it(predictors, sides):
    platoons = sides[1].platoons
    noise = np.random.default_rng(2).normal(50.0, 20.0, platoons.x.shape)
    x, v, a = (np.where(platoons.valid, values, noise) for values in (platoons.x, platoons.v, platoons.a))
    length = np.where(platoons.present, platoons.length, 77.0)
    changed = without_target(replace(platoons, x=x, v=v, a=a, length=length))
    for name in ("idm", "chain_1", "chain_8", "pooled_idm", "relax_to_leader"):
        np.testing.assert_array_equal(predictors[name](changed).x, predictors[name](sides[1].scenes).x, err_msg=name)


def test_constant_velocity_is_speed_times_time(sides):
    platoons = sides[1].platoons
    x = constant_velocity(Training(sides[0]))(sides[1].scenes).x
    np.testing.assert_allclose(x, platoons.v[:, 0, -1, None] * TIME)


def test_the_time_constant_of_the_relaxation_is_found_again(sides):
    """Truths made with 7 s: v_l t + (v - v_l) 7 (1 - exp(-t / 7))."""
    train, test = sides
    v, leader = train.platoons.v[:, 0, -1, None], train.platoons.v[:, 1, -1, None]
    truth = leader * TIME + (v - leader) * 7.0 * (1.0 - np.exp(-TIME / 7.0))
    x = relax_to_leader(Training(replace(train, truth=truth)))(test.scenes).x
    v, leader = test.platoons.v[:, 0, -1, None], test.platoons.v[:, 1, -1, None]
    np.testing.assert_allclose(x, leader * TIME + (v - leader) * 7.0 * (1.0 - np.exp(-TIME / 7.0)), atol=1e-2)


def test_a_chain_of_one_is_the_roll_out_behind_a_leader_at_constant_speed(sides):
    platoons = sides[1].platoons
    time = np.append(0.0, TIME)
    speed = platoons.v[:, 1, -1, None]
    motion = follow(
        LAWS["idm"],
        np.tile(START, (len(platoons), 1)),
        x=platoons.x[:, 0, -1],
        v=platoons.v[:, 0, -1],
        leader_x=platoons.x[:, 1, -1, None] + speed * time,
        leader_v=np.repeat(speed, len(time), axis=1),
        leader_length=platoons.length[:, 1],
        v_max=np.inf,
    )
    found = roll_chain(np.array(START), platoons, leaders=1)
    np.testing.assert_allclose(found, motion.x - platoons.x[:, 0, -1:], atol=1e-9)


def made_up_platoon(gaps: list[float], speeds: list[float]) -> Platoons:
    """Returns one platoon of vehicles of 5 m at those net gaps and speeds, which they had all the time."""
    x = np.full((1, 9, 21), np.nan)
    v = np.full((1, 9, 21), np.nan)
    back = np.linspace(-4.0, 0.0, 21)
    place = 0.0
    for k, speed in enumerate(speeds):
        place += (gaps[k - 1] + 5.0) if k else 0.0
        x[0, k], v[0, k] = place + speed * back, speed
    valid = np.isfinite(x)
    length = np.where(valid[:, :, -1], 5.0, np.nan)
    a = np.where(valid, 0.0, np.nan)
    kind = np.ones((1, 9), dtype=np.int64)
    return Platoons(x=x, v=v, a=a, valid=valid, length=length, kind=kind, traffic=no_traffic(1))


def test_a_chain_is_what_a_plain_loop_makes_of_it():
    platoons = made_up_platoon([12.0, 9.0, 30.0], [11.0, 8.0, 5.0, 9.0])
    s0, headway, most, comfortable, desired, exponent = START
    x, v = [0.0, 17.0, 31.0, 66.0], [11.0, 8.0, 5.0, 9.0]
    expected = []
    for _ in range(75):
        faster = []
        for k in range(3):
            gap = max(x[k + 1] - x[k] - 5.0, 1.0)
            wish = s0 + headway * v[k] + v[k] * (v[k] - v[k + 1]) / (2 * (most * comfortable) ** 0.5)
            a = most * (1 - (max(v[k], 0.1) / desired) ** exponent - (wish / gap) ** 2)
            faster.append(max(v[k] + 0.2 * min(max(a, -comfortable), most), 0.0))
        v = [*faster, v[3]]
        x = [place + 0.2 * speed for place, speed in zip(x, v, strict=True)]
        expected.append(x[0])
    np.testing.assert_allclose(roll_chain(np.array(START), platoons, leaders=8)[0], expected, atol=1e-9)
    assert abs(roll_chain(np.array(START), platoons, leaders=1)[0, -1] - expected[-1]) > 1.0


def test_a_vehicle_without_a_leader_keeps_its_speed(predictors):
    platoons = made_up_platoon([], [13.0])
    for name in ("idm", "ghr", "gipps_paper"):
        fitted = predictors[name](without_target(platoons)).x[0]
        np.testing.assert_allclose(fitted, 13.0 * TIME, err_msg=name)
    np.testing.assert_allclose(roll_chain(np.array(START), platoons, leaders=8)[0], 13.0 * TIME)
    np.testing.assert_allclose(follow_true_leader(np.array(START), platoons, np.full((1, 75), np.nan)), np.nan)


def test_the_fit_behind_true_leaders_finds_drivers_who_are_all_alike(cases):
    """The drivers are stepped at 0.1 s and the fit at 0.2 s, so their parameters are found about, their places well."""
    parameters = fit_pooled_driver(cases.platoons, cases.truth, leader_truth=cases.leader_truth)
    assert parameters[1] == pytest.approx(HEADWAY, rel=0.15)
    x = follow_true_leader(parameters, cases.platoons, cases.leader_truth)
    assert np.abs(x - cases.truth).mean() < 0.3


def test_the_oracle_is_silent_once_the_leader_is_no_longer_seen(sides):
    train, test = sides
    ahead = test.leader_truth.copy()
    ahead[0, 30:] = np.nan
    tell = oracle(Training(train))
    whole, cut = (tell(test.scenes, known).x for known in (test.leader_truth, ahead))
    np.testing.assert_allclose(cut[0, :30], whole[0, :30], atol=1e-9)
    assert np.isnan(cut[0, 30:]).all()
    np.testing.assert_array_equal(cut[1:], whole[1:])


def test_the_order_of_errors_is_as_it_must_be_in_a_wave(forecasts, sides):
    """Nothing is a better leader than the true one, and the whole queue tells more than one vehicle."""
    deep = sides[1].platoons.depth >= 3
    error = {name: np.abs(f.x - sides[1].truth)[deep, 49].mean() for name, f in forecasts.items()}
    assert error[ORACLE] < error["chain_3"] < error["chain_1"] < error["constant_velocity"]


def test_bands_are_the_quantiles_of_the_training_errors():
    errors = np.linspace(-10.0, 10.0, 101)[:, None] * np.array([1.0, 2.0])
    truth = 50.0 + errors
    banded = with_bands(Forecasts(np.array([[30.0, 5.0]])), Forecasts(np.full((101, 2), 50.0)), truth)
    np.testing.assert_allclose(banded.quantiles[0, 0], [21.0, 25.0, 30.0, 35.0, 39.0])
    np.testing.assert_allclose(banded.quantiles[0, 1], [0.0, 0.0, 5.0, 15.0, 23.0])  # no vehicle reverses


def test_bands_of_a_model_that_gives_its_own_are_left_alone():
    own = Forecasts(np.zeros((1, 2)), np.zeros((1, 2, 5)))
    assert with_bands(own, own, np.zeros((1, 2))) is own


def test_too_few_errors_give_no_band():
    truth = np.full((30, 2), 50.0)
    truth[15:, 1] = np.nan
    banded = with_bands(Forecasts(np.zeros((1, 2))), Forecasts(np.full((30, 2), 40.0)), truth)
    assert np.isfinite(banded.quantiles[0, 0]).all()
    assert np.isnan(banded.quantiles[0, 1]).all()


def test_a_sample_overlaps_once_it_has_been_in_another_vehicle():
    """Three samples of a vehicle of 4 m: one ends in its leader, one was in it and came out, one is in its follower."""
    x = np.array([[[1.0, 2.0, 3.0], [1.0, 4.0, 5.0], [1.0, 2.0, 3.0]]])
    counts = models.overlaps(
        x,
        leader_rear=np.array([[[2.0, 2.5, 2.9], [2.0, 3.9, 9.0], [2.0, 2.005, 9.0]]]),
        follower_front=np.array([[[-9.0, -9.0, -9.0], [-9.0, -9.0, -9.0], [-3.0, -2.0, 0.0]]]),
        length=np.array([4.0]),
    )
    assert counts.tolist() == [[0, 1, 3]]
