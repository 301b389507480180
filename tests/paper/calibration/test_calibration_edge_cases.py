"""Calibration of histories at the edges of what is recorded, and at the ends of the ranges."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rampcast.paper.calibration.calibration import Calibration, Outcome, calibrate
from rampcast.paper.laws.laws import LAWS, Law
from rampcast.paper.laws.mode import Mode
from tests.paper.calibration.followers import driven, mean_squared_error

pytestmark = pytest.mark.slow

PAST = 20
EVERY_LAW = pytest.mark.parametrize("law", list(LAWS.values()), ids=list(LAWS))


def assert_usable(law: Law, fit: Calibration, mode: Mode = Mode.CORRECTED) -> None:
    low, high = np.array([(bound.low, bound.high) for bound in law.ranges(mode)]).T
    assert np.isfinite(fit.parameters).all()
    assert ((fit.parameters >= low) & (fit.parameters <= high)).all()
    assert np.isfinite(fit.mse[fit.outcome <= Outcome.AT_BOUND]).all()


def steady(**changed: float) -> dict[str, Any]:
    """Returns one history in which nothing changes, with noise on the acceleration."""
    values = {"speed": 8.0, "leader_speed": 7.0, "gap": 12.0} | changed
    states: dict[str, Any] = {name: np.full((1, PAST), value) for name, value in values.items()}
    noise = np.random.default_rng(0).normal(0.0, 0.5, (1, PAST))
    return {**states, "acceleration": noise, "valid": np.ones((1, PAST), dtype=bool)}


@EVERY_LAW
@pytest.mark.parametrize(
    "history",
    [
        steady(),
        steady(speed=0.0),
        steady(speed=0.0, leader_speed=0.0),
        steady(leader_speed=8.0),
        steady(leader_speed=8.0 + 1e-12),
        steady(gap=0.0),
        steady(gap=-6.0),
        steady(gap=1e6),
        steady(speed=0.0, leader_speed=0.0, gap=0.0),
        steady() | {"acceleration": np.zeros((1, PAST))},
        steady() | {"acceleration": np.full((1, PAST), -40.0)},
    ],
    ids=[
        "steady",
        "standing behind a leader that leaves",
        "standing behind one that stands",
        "equal speeds",
        "nearly equal speeds",
        "no gap",
        "overlap",
        "far away",
        "standing without a gap",
        "no acceleration",
        "a fault of the recording",
    ],
)
def test_a_history_from_which_little_can_be_learnt_gives_numbers_within_the_ranges(law, history):
    assert_usable(law, calibrate(law, **history))


@EVERY_LAW
@settings(deadline=None, max_examples=15)
@given(seed=st.integers(0, 2**32 - 1), size=st.floats(0.01, 20.0), mode=st.sampled_from(Mode))
def test_whatever_is_recorded_the_parameters_lie_within_their_ranges(law, seed, size, mode):
    rng, shape = np.random.default_rng(seed), (8, PAST)
    fit = calibrate(
        law,
        speed=np.maximum(rng.normal(5.0, size, shape), 0.0),
        leader_speed=np.maximum(rng.normal(5.0, size, shape), 0.0),
        gap=np.where(rng.random(shape) < 0.05, np.inf, rng.normal(15.0, size, shape)),
        acceleration=rng.normal(0.0, size, shape),
        valid=rng.random(shape) < rng.random((8, 1)),
        mode=mode,
    )
    assert_usable(law, fit, mode)


@EVERY_LAW
def test_a_fit_that_ends_at_an_end_of_a_range_has_that_value_to_the_last_digit_and_says_so(law):
    """An end of a range comes back from its logarithm a rounding inside of it."""
    low, high = np.array([(bound.low, bound.high) for bound in law.ranges(Mode.CORRECTED)]).T
    fit = calibrate(law, **driven(200, seed=6, noise=0.3))
    near = np.minimum(fit.parameters - low, high - fit.parameters) < 1e-9 * (high - low)
    assert near.any()
    np.testing.assert_array_equal(near, (fit.parameters == low) | (fit.parameters == high))
    np.testing.assert_array_equal(near.any(axis=1), fit.outcome == Outcome.AT_BOUND)


@EVERY_LAW
def test_as_many_points_as_parameters_are_fitted_and_one_fewer_is_not(law):
    count = len(law.bounds)
    history = driven(2, seed=3)
    history["valid"] = np.arange(PAST) < np.array([[count], [count - 1]])
    fit = calibrate(law, **history)
    assert fit.outcome[0] <= Outcome.AT_BOUND
    assert fit.outcome[1] == Outcome.TOO_FEW_POINTS


@EVERY_LAW
def test_no_driver_of_the_ranges_drawn_at_random_fits_better(law):
    history = driven(50, seed=4, noise=0.3)
    fit = calibrate(law, **history)
    bounds = law.ranges(Mode.CORRECTED)
    rng = np.random.default_rng(0)
    for _ in range(100):
        drawn = rng.uniform([b.low for b in bounds], [b.high for b in bounds], (50, len(bounds)))
        assert (fit.mse <= mean_squared_error(law, drawn, history) + 1e-12).all()


def test_a_law_whose_speeds_are_equal_throughout_fits_as_badly_as_no_acceleration_at_all():
    history = steady(leader_speed=8.0)
    for name in ("ghr", "gipps_paper"):
        fit = calibrate(LAWS[name], **history)
        assert fit.mse[0] == pytest.approx(np.mean(history["acceleration"] ** 2))


def test_the_ranges_of_a_net_gap_are_used_in_corrected_mode_alone():
    history = driven(100, seed=5)  # of drivers with standing gaps of 1 m to 3 m
    lowest = {mode: calibrate(LAWS["idm"], **history, mode=mode).parameters[:, 0].min() for mode in Mode}
    assert lowest[Mode.PAPER] >= 5.0 > lowest[Mode.CORRECTED] >= 0.5


def test_a_leader_abreast_at_a_valid_step_is_told():
    """A gap at the floor of 1 m or below; what invalid steps hold does not count."""
    gap = np.full((3, PAST), 12.0)
    gap[1, 4] = 0.4
    gap[2, 4] = 0.4
    valid = np.ones((3, PAST), dtype=bool)
    valid[2, 4] = False
    speed = np.full((3, PAST), 8.0)
    fit = calibrate(LAWS["ghr"], speed=speed, leader_speed=speed, gap=gap, acceleration=0.0 * speed, valid=valid)
    assert fit.abreast.tolist() == [False, True, False]
