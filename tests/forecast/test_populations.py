"""How sites differ in a forecaster: one alone is as before, several have a spread, a small one is among them."""

from dataclasses import replace

import numpy as np
import pytest

from rampcast.forecast.learning import Base, Training, fit_base, joined_training, with_sites
from rampcast.forecast.populations import Populations, driver_population, populations_table
from rampcast.forecast.tags import TAGS
from rampcast.models.drivers import PARAMETERS
from rampcast.models.plain_data import from_record, to_record
from rampcast.traffic.around import joined
from rampcast.traffic.situation import situation_of_scenes
from tests.forecast.merges_made_up import merges
from tests.models.platoons_made_up import DRIVER, drive

HEADWAYS = {"a": 0.8, "b": 1.0, "c": 1.3, "d": 1.6, "e": 2.0}
HEADWAY = PARAMETERS.index("log time_headway")


def training(count: int, *, seed: int, site: str | None = None) -> Training:
    made = merges(count, seed=seed)
    situation = situation_of_scenes(made.scenes)
    group = np.array([f"{seed}-{row // 3}" for row in range(count)])
    found = Training(situation, situation.first[:-1], made.scenes, made.truth, made.leader_truth, made.change_time,
                     made.seen_for, group, 4.0 * np.arange(count))  # fmt: skip
    return found if site is None else replace(found, site=np.full(count, site))


@pytest.fixture(scope="module")
def three() -> Training:
    parts = [training(90, seed=seed, site=site) for seed, site in enumerate(("north", "south", "west"), start=1)]
    return joined_training(parts)


@pytest.fixture(scope="module")
def of_three(three) -> Base:
    """A roll-out of any site, learned from three."""
    return fit_base(three, seed=1)


def test_a_known_spread_of_headways_over_sites_is_found_again():
    drivers = [(*DRIVER[:1], headway, *DRIVER[2:]) for headway in HEADWAYS.values()]
    parts = [drive(40, seed=seed, noise=0.1, driver=driver) for seed, driver in enumerate(drivers)]
    found = driver_population(
        joined([part.platoons for part in parts]),
        np.concatenate([part.truth for part in parts]),
        np.concatenate([part.leader_truth for part in parts]),
        site=np.repeat(list(HEADWAYS), 40),
        vehicle=np.arange(200),
    )
    assert found.sites == tuple(HEADWAYS)
    np.testing.assert_allclose(found.values[:, HEADWAY], np.log(list(HEADWAYS.values())), atol=0.2)
    assert found.spread[HEADWAY] == pytest.approx(np.log(list(HEADWAYS.values())).std(ddof=1), rel=0.4)


def same(one, other) -> bool:
    """Returns whether two parts of a model are the same numbers."""
    first, second = (to_record(part, TAGS) for part in (one, other))
    assert first.values == second.values
    return all(np.array_equal(values, second.arrays[name]) for name, values in first.arrays.items())


@pytest.mark.slow
def test_one_site_alone_is_learned_as_if_nobody_had_named_it():
    named, unnamed = (fit_base(training(120, seed=4, site=site), seed=1) for site in ("north", None))
    assert named.sites is None
    assert same(named, unnamed)


@pytest.mark.slow
def test_a_roll_out_of_several_sites_knows_how_they_differ_and_is_kept_with_it(of_three):
    assert of_three.sites.main.sites == ("north", "south", "west")
    assert of_three.sites.hazard.parameters.sites == ("north", "south", "west")
    assert of_three.roll_out.hazard.unknown > 0.0
    kept = from_record(to_record(of_three, TAGS), TAGS)
    assert same(kept, of_three)
    table = populations_table(of_three.sites)
    assert table.filter(what="merges", parameter="logit")["site"].to_list() == ["north", "south", "west"]
    assert table["shrinkage"].is_between(0.0, 1.0).all()
    assert populations_table(Populations()).is_empty()


@pytest.mark.slow
def test_a_site_with_few_vehicles_stays_near_the_others_and_one_with_many_goes_its_own_way(of_three):
    """Three of four do not merge there who would at the others."""
    logit = of_three.sites.hazard
    at = []
    for count in (36, 360):
        some = training(count, seed=9)
        rare = np.where(np.arange(count) % 4 == 0, some.change_time, np.nan)
        base = fit_base(replace(some, change_time=rare), seed=1, start=of_three)
        hazard = base.roll_out.hazard
        at.append(hazard.constant + hazard.weights @ logit.middle)
        assert base.sites is not None
    assert logit.parameters.mean[0] > at[0] > at[1]
    assert hazard.unknown < of_three.roll_out.hazard.unknown


@pytest.mark.slow
def test_a_forecaster_of_before_says_nothing_of_sites_and_gives_its_hazard_where_few_merge(of_three):
    old = replace(of_three, sites=None)
    some = training(60, seed=9)
    nobody = replace(some, change_time=np.full(60, np.nan))
    assert fit_base(nobody, seed=1, start=old).roll_out.hazard is old.roll_out.hazard
    found = fit_base(nobody, seed=1, start=of_three)
    assert found.roll_out.hazard.constant != old.roll_out.hazard.constant
    assert found.forest is of_three.forest


@pytest.mark.slow
def test_one_of_pooled_sites_forecasts_as_if_nobody_had_told_them_apart_and_draws_small_ones_to_their_mean(three):
    pooled = fit_base(replace(three, site=None), seed=1)
    found = with_sites(pooled, three)
    assert same(replace(found, sites=None), pooled)
    assert found.sites.main.sites == found.sites.hazard.parameters.sites == ("north", "south", "west")
    some = training(36, seed=9)
    rare = replace(some, change_time=np.where(np.arange(36) % 4 == 0, some.change_time, np.nan))
    alone, near = (fit_base(rare, seed=1, start=start).roll_out for start in (pooled, found))
    headway = found.sites.main.mean[HEADWAY]
    first, second = (abs(np.log(one.main.centre[HEADWAY]) - headway) for one in (alone, near))
    assert second < 0.7 * first
    assert near.hazard.unknown > 0.0
    assert with_sites(pooled, training(90, seed=1, site="north")).sites is None  # of one site nobody knows a spread
