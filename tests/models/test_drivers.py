"""The prior over drivers and its posterior: the right driver is found, from little history and through holes."""

from dataclasses import replace

import numpy as np
import pytest

from rampcast.models.between_sites import Estimate
from rampcast.models.disturbance import fit_disturbance, residuals_now
from rampcast.models.drivers import (
    SCATTERING,
    DriverPrior,
    behind_leader,
    driver_evidence,
    fit_drivers,
    posterior,
    posteriors,
    with_habit,
)
from rampcast.models.platoon_head import KEPT, fit_head
from rampcast.models.pooled_driver import fit_pooled_driver
from rampcast.traffic.around import joined
from rampcast.traffic.merge_scenes import without_target
from rampcast.traffic.platoons import Platoons
from rampcast.traffic.situation import NOBODY, Situation, situation_of_scenes
from tests.models.platoons_made_up import DRIVER, LENGTH, drive, idm

HASTY, CALM = (1.5, 0.8, 2.0, 2.5, 22.0, 4.0), (3.0, 2.0, 0.8, 1.2, 22.0, 4.0)


@pytest.fixture(scope="module")
def two() -> DriverPrior:
    """A prior over two drivers."""
    return DriverPrior(np.array(DRIVER), 0.0, 0.3, 1.0, np.array([HASTY, CALM]))


def seen(platoons: Platoons, steps: np.ndarray) -> Platoons:
    """Returns the platoons as if they had been seen at those steps of the history only."""
    valid = platoons.valid & steps
    x, v, a = (np.where(valid, values, np.nan) for values in (platoons.x, platoons.v, platoons.a))
    return replace(platoons, x=x, v=v, a=a, valid=valid)


@pytest.mark.parametrize(("driver", "which"), [(HASTY, 0), (CALM, 1)])
def test_the_driver_of_noise_free_data_has_nearly_all_the_weight(two, driver, which):
    weights = posterior(two, drive(40, driver=driver).platoons)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    assert np.median(weights[:, which]) > 0.95


def test_four_tenths_of_a_second_are_enough_for_a_posterior_and_more_says_more(two):
    platoons = drive(40, driver=CALM).platoons
    short = posterior(two, seen(platoons, np.arange(21) >= 18))
    assert np.isfinite(short).all()
    assert 0.5 < short[:, 1].mean() < posterior(two, platoons)[:, 1].mean()


def test_a_hole_in_the_history_is_no_harm(two):
    platoons = drive(40, driver=CALM).platoons
    around = seen(platoons, ~np.isin(np.arange(21), np.arange(8, 13)))
    weights = posterior(two, around)
    assert np.isfinite(weights).all()
    assert np.median(weights[:, 1]) > 0.8


def test_a_vehicle_seen_at_no_time_but_now_has_the_prior(two):
    now = seen(drive(5).platoons, np.arange(21) == 20)
    np.testing.assert_allclose(posterior(two, now), 0.5)


def situation_of(platoons: Platoons) -> Situation:
    """Returns platoons as situations of one lane each, their vehicles from upstream to downstream."""
    return situation_of_scenes(without_target(platoons))


def test_every_vehicle_with_a_leader_has_its_own_posterior_and_the_head_has_the_prior(two):
    platoons = drive(12, vehicles=3, scatter=0.2).platoons
    situation = situation_of(platoons)
    weights = posteriors(two, situation, np.ones(36, dtype=bool))
    np.testing.assert_allclose(weights[::3], posterior(two, platoons), atol=1e-6)
    assert np.abs(weights[::3] - weights[1::3]).max() > 0.1
    np.testing.assert_array_equal(weights[2::3], 0.5)
    some = np.arange(36) % 3 == 1
    np.testing.assert_array_equal(posteriors(two, situation, some), weights[some])


def test_the_prior_of_drivers_who_are_all_alike_is_narrow_and_forecasts_them():
    made = drive(120)
    prior = fit_drivers(made.platoons, made.truth, made.leader_truth)
    weights = posterior(prior, made.platoons)
    forecast = np.einsum("pd,pds->ps", weights, behind_leader(prior.table, made.platoons, made.leader_truth))
    assert prior.scatter == 0.1
    assert np.abs(forecast - made.truth).mean() < 0.15


def test_drivers_who_differ_are_forecast_better_with_their_posteriors_than_all_alike():
    made = drive(200, scatter=0.3)
    prior = fit_drivers(made.platoons, made.truth, made.leader_truth)
    futures = behind_leader(prior.table, made.platoons, made.leader_truth)
    own = np.einsum("pd,pds->ps", posterior(prior, made.platoons), futures)
    assert prior.scatter > 0.1
    alike = with_habit(fit_pooled_driver(made.platoons, made.truth, leader_truth=made.leader_truth)[None], 0.0)
    pooled = behind_leader(alike, made.platoons, made.leader_truth)[:, 0]
    assert np.abs(own - made.truth).mean() < 0.75 * np.abs(pooled - made.truth).mean()


def test_the_law_of_a_driver_behind_a_given_leader_is_what_a_plain_loop_makes_of_it():
    made = drive(3)
    found = behind_leader(with_habit(np.array([CALM]), 0.0), made.platoons, made.leader_truth)[:, 0]
    leader = np.column_stack([made.platoons.x[:, 1, -1] - made.platoons.x[:, 0, -1], made.leader_truth])
    speed = np.column_stack([made.platoons.v[:, 1, -1], np.diff(leader, axis=1) / 0.2])
    x, v = np.zeros(3), made.platoons.v[:, 0, -1]
    for step in range(75):
        v = np.maximum(v + 0.2 * idm(np.array(CALM), v, speed[:, step], leader[:, step] - x - LENGTH), 0.0)
        x = x + 0.2 * v
        np.testing.assert_allclose(found[:, step], x, atol=1e-3)


@pytest.mark.slow
def test_a_disturbance_that_is_not_there_is_small_and_one_that_is_is_found():
    found = {}
    for noise in (0.0, 1.0):
        made = drive(200, noise=noise)
        prior = fit_drivers(made.platoons, made.truth, made.leader_truth)
        found[noise] = fit_disturbance(prior, made.platoons, made.truth, made.leader_truth)
    assert found[0.0].size < 0.1 < found[1.0].size
    assert found[1.0].persistence <= 0.7  # white noise: the least that is tried


def test_the_residual_at_t_0_of_a_driver_who_keeps_to_the_law_is_none():
    """What goes beyond the law is the residual; of the last vehicle, who follows nobody, nothing is known."""
    made = drive(10, driver=HASTY)
    situation = situation_of(made.platoons)
    led = situation.leader != NOBODY
    ahead = situation.leader[led]
    gap = situation.x[ahead, -1] - LENGTH - situation.x[led, -1]
    lawful = idm(np.array(HASTY), situation.v[led, -1], situation.v[ahead, -1], gap)
    a = situation.a.copy()
    a[led, -1] = np.clip(lawful + 0.1, -HASTY[3], HASTY[2])
    found = residuals_now(np.tile([*HASTY, 0.0], (30, 1)), replace(situation, a=a))
    np.testing.assert_allclose(found[led], a[led, -1] - lawful, atol=1e-6)
    assert found[led].max() > 0.09
    np.testing.assert_array_equal(found[~led], 0.0)


def test_a_head_that_keeps_its_speed_is_found_to_and_one_that_returns_too():
    made = drive(60, vehicles=2)
    time = 0.2 * np.arange(1, 76)
    gap = made.platoons.x[:, 1, -1:] - made.platoons.x[:, 0, -1:]
    speed = made.platoons.v[:, 1, -1:]
    kept = fit_head(np.array(DRIVER), made.platoons, made.truth, gap + speed * time)
    assert kept.relaxation == KEPT
    assert kept.noise < 1e-3
    mean = np.where(made.platoons.valid, made.platoons.v, 0.0).sum((1, 2)) / made.platoons.valid.sum((1, 2))
    back = 10.0 * (1.0 - np.exp(-time / 10.0))
    returning = fit_head(
        np.array(DRIVER), made.platoons, made.truth, gap + speed * back + mean[:, None] * (time - back)
    )
    assert returning.relaxation == 10.0


def test_a_head_that_goes_on_to_its_desired_speed_is_found_to():
    made = drive(60, vehicles=2)
    x = made.platoons.x[:, 1, -1] - made.platoons.x[:, 0, -1]
    v, places = made.platoons.v[:, 1, -1], []
    for _ in range(75):
        v = v + 0.2 * 0.25 * DRIVER[2] * (1.0 - (v / DRIVER[4]) ** DRIVER[5])
        x = x + 0.2 * v
        places.append(x)
    found = fit_head(np.array(DRIVER), made.platoons, made.truth, np.stack(places, axis=1))
    assert (found.relaxation, found.free) == (KEPT, 0.25)
    assert found.noise < 1e-3


def test_what_vehicles_say_of_their_law_is_what_it_is_and_the_more_the_more_there_are():
    made = drive(120, noise=0.1)
    platoons, futures = joined([made.platoons] * 6), [np.tile(one, (6, 1)) for one in (made.truth, made.leader_truth)]
    few = driver_evidence(platoons, *futures, np.tile(np.arange(120), 6))  # each six times, which says nothing new
    many = driver_evidence(platoons, *futures, np.arange(720))
    np.testing.assert_allclose(many.precision, 6.0 * few.precision)
    once = driver_evidence(made.platoons, made.truth, made.leader_truth, np.arange(120))
    np.testing.assert_allclose(few.precision, once.precision, rtol=0.02)
    of_itself = driver_evidence(made.platoons, made.truth, made.leader_truth, np.zeros(120))
    assert np.linalg.norm(of_itself.precision) > 0.2 * np.linalg.norm(once.precision)  # noise is not alike
    own, true = np.linalg.solve(once.precision, once.information), np.append(np.log(DRIVER), 0.0)
    unsure = np.sqrt(np.diag(np.linalg.inv(once.precision)))
    assert np.abs((own - true) / unsure).max() < 3.0
    assert unsure[:2].max() < 0.5


def test_too_few_vehicles_say_nothing():
    made = drive(12)
    nothing = driver_evidence(made.platoons, made.truth, made.leader_truth, np.arange(12))
    assert not nothing.precision.any()
    assert not nothing.information.any()


def test_about_a_centre_that_is_known_drivers_are_those_of_today_and_about_a_doubtful_one_they_scatter_more():
    made = drive(120, scatter=0.1)
    own = fit_drivers(made.platoons, made.truth, made.leader_truth)
    at = np.append(np.log(own.centre), own.habit)
    known = Estimate(at, np.zeros(len(at)), np.zeros(len(at)))
    same = fit_drivers(made.platoons, made.truth, made.leader_truth, about=known)
    assert (same.scatter, same.independence) == (own.scatter, own.independence)
    np.testing.assert_allclose(same.drivers, own.drivers)
    doubtful = Estimate(at, np.full(len(at), 0.4), np.ones(len(at)))
    wide = fit_drivers(made.platoons, made.truth, made.leader_truth, about=doubtful)
    for prior, unknown in ((same, 0.0), (wide, 0.4)):
        scatter = np.log(prior.drivers[:, :SCATTERING]).std(axis=0)
        np.testing.assert_allclose(scatter, np.hypot(prior.scatter, unknown), rtol=0.05)
