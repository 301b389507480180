"""What every merge model must hold to, and the baselines against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from rampcast.benchmark import Training, models
from rampcast.benchmark.merges import TIME, median_time
from rampcast.forecast.calibrated import CalibratedSpec
from rampcast.forecasters import merges
from rampcast.models.correction import CorrectionSpec
from rampcast.paper.lane_change import forests
from rampcast.traffic.around import joined
from tests.benchmark import made_up_merges

pytestmark = pytest.mark.slow

FEW = CalibratedSpec(samples=20, folds=2, correction=CorrectionSpec(trees=5, least_in_leaf=10))


@pytest.fixture(scope="module")
def sides(merging):
    """Returns training and test cases; every third vehicle tests."""
    tests = np.array([int(name) % 3 == 0 for name in merging.group.tolist()])
    return merging.select(~tests), merging.select(tests)


@pytest.fixture(scope="module")
def predictors(sides):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(models, "FORECASTER", FEW)
        patch.setattr(forests, "SPECS", {mode: replace(spec, n_trees=10) for mode, spec in forests.SPECS.items()})
        training = Training(sides[0])
        return {name: fit(training) for name, fit in merges().items()}


@pytest.fixture(scope="module")
def forecasts(predictors, sides):
    test = sides[1]
    return {name: predict(test.scenes, test.since_entry) for name, predict in predictors.items()}


def test_probabilities_never_fall_and_are_probabilities(forecasts, sides):
    assert list(forecasts) == list(merges())
    for name, forecast in forecasts.items():
        assert forecast.p_within.shape == forecast.p_at.shape == (len(sides[1]), len(TIME))
        assert (np.diff(forecast.p_within, axis=1) >= -1e-12).all(), name
        assert (forecast.p_within >= 0.0).all(), name
        assert (forecast.p_within <= 1.0).all(), name
        assert (forecast.p_at >= -1e-12).all(), name
        assert ((forecast.median_time > 0.0) & (forecast.median_time <= 15.0)).all(), name


def test_the_forecast_of_a_case_does_not_depend_on_the_other_cases(predictors, forecasts, sides):
    test = sides[1]
    for name, predict in predictors.items():
        for row in (0, len(test) - 1):
            alone = predict(test.scenes.select(np.array([row])), test.since_entry[[row]])
            np.testing.assert_allclose(alone.p_within[0], forecasts[name].p_within[row], atol=1e-9, err_msg=name)
            np.testing.assert_allclose(alone.median_time[0], forecasts[name].median_time[row], err_msg=name)
            if alone.place is not None:
                np.testing.assert_allclose(alone.place[0], forecasts[name].place[row], atol=1e-2, err_msg=name)


def test_what_comes_after_t0_changes_no_forecast(predictors, forecasts, sides, tmp_path):
    """All merges end earlier, or go on otherwise: the cases before that are forecast as they were."""
    table = made_up_merges.merges()
    later = table["time"].to_numpy() > 2.05
    rng = np.random.default_rng(0)
    changed = table.with_columns(
        table[name] + np.where(later, rng.normal(0.0, 5.0, table.height), 0.0)
        for name in ("v", "distance_to_end", "gap_2", "gap_3", "gap_5", "dv_3")
    )
    again = made_up_merges.cases(tmp_path, changed.filter(changed["time"] < 2.35))
    test = sides[1]
    before = [name for name in again.case.tolist() if name in test.case and int(name.split("-")[1]) <= 20]
    assert len(before) > 20
    here, there = (np.array([cases.case.tolist().index(name) for name in before]) for cases in (test, again))
    assert np.abs(test.change_time[here] - again.change_time[there]).min() > 0.1
    for name, predict in predictors.items():
        found = predict(again.scenes.select(there), again.since_entry[there])
        np.testing.assert_array_equal(found.p_within, forecasts[name].p_within[here], err_msg=name)
        np.testing.assert_array_equal(found.median_time, forecasts[name].median_time[here], err_msg=name)


def test_the_base_rate_is_the_share_of_training_cases_that_merge_by_then(forecasts, sides):
    share = (sides[0].change_time[:, None] <= TIME + 1e-9).mean(axis=0)
    np.testing.assert_allclose(forecasts["base_rate"].p_within, np.tile(share, (len(sides[1]), 1)), atol=1e-12)


def test_kaplan_meier_is_the_share_of_the_vehicles_that_have_waited_as_long(forecasts, sides):
    """No vehicle is lost: it is a count of the training vehicles that are on the lane for as long and merge by then."""
    train, test = sides
    _, first = np.unique(train.group, return_index=True)
    whole = train.since_entry[first] + train.change_time[first]
    for row in (0, 5, 9):
        lasting = whole > test.since_entry[row] + 1e-6
        if lasting.sum() < 6:
            continue
        share = (whole[lasting, None] <= test.since_entry[row] + TIME + 1e-9).mean(axis=0)
        np.testing.assert_allclose(forecasts["kaplan_meier"].p_within[row], share, atol=1e-12)


def test_curves_without_a_place_of_their_own_go_on_at_the_present_speed(forecasts, sides):
    speed = sides[1].scenes.own.v[:, 0, -1]
    for name in ("base_rate", "kaplan_meier", "forests"):
        np.testing.assert_allclose(forecasts[name].place, speed * forecasts[name].median_time)


def test_forests_know_which_gap_suits_and_the_base_rate_does_not(forecasts, sides):
    error = {name: np.abs(f.median_time - sides[1].change_time).mean() for name, f in forecasts.items()}
    assert error["forests_natural"] < 0.75 * error["base_rate"]


def test_a_joint_forecast_is_that_of_its_parts(forecasts):
    whole = forecasts["forests"]
    both = joined([whole, whole])
    np.testing.assert_array_equal(both.p_within, np.concatenate([whole.p_within, whole.p_within]))
    assert both.gap is None
    np.testing.assert_array_equal(median_time(both.p_within), both.median_time)
