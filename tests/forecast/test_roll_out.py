"""The joint roll-out: against a plain loop, what holds in every sample, and what its random numbers depend on."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rampcast.forecast.roll_out import Manners, begin, drawn_drivers, drive, drive_waiting, sharing
from rampcast.forecast.roll_out_arrays import Draws, Law
from rampcast.forecast.roll_out_kernel import drive as kernel_drive
from rampcast.horizon import FUTURE
from rampcast.models.driver_loops import free_table
from rampcast.threads import choosing_threads
from rampcast.traffic.situation import joined_situations, situation_of_traffic
from tests.forecast.plain_roll_out import Plain
from tests.forecast.traffics_made_up import MAIN, RAMP, assert_possible, model, traffic_of, traffics

SAMPLES = 4
ALONE = Manners()  # nobody minds who is in another lane


def six(seed: int):
    """Returns six vehicles of two lanes, three of them on the ramp."""
    rng = np.random.default_rng(seed)
    x = np.concatenate([60.0 + 25.0 * np.arange(3), 50.0 + 30.0 * np.arange(3)]) + rng.uniform(0.0, 12.0, 6)
    lane, v = np.repeat([RAMP, 6], 3), rng.uniform(5.0, 14.0, 6)
    return traffic_of(x, v, lane, seen=np.full(6, 40), vehicle=np.arange(1, 7))


@pytest.mark.parametrize("seed", range(8))
def test_the_compiled_roll_out_is_what_a_plain_loop_makes_of_it(seed):
    rng = np.random.default_rng(seed)
    made = model(hazard=-4.0, manners=Manners(0.5, 0.4, 0.1))
    beginning = begin(made, situation_of_traffic(six(seed)))
    draws = Draws(
        rng.standard_normal((6, SAMPLES, FUTURE)).astype(np.float32),
        rng.exponential(size=(6, SAMPLES)),
        rng.exponential(size=(6, SAMPLES)),
        rng.lognormal(size=SAMPLES),
    )
    start = beginning.start._replace(draw=np.arange(6), residual=rng.normal(0.0, 0.3, 6))
    hazard = np.array([*made.hazard.weights, made.hazard.constant, made.hazard.first, made.hazard.last])
    numbers = np.array([0.9, 0.2, 1 / 20.0, 0.1, 0.5, 0.5, 0.4, 0.1, 30.0])
    drivers = np.concatenate([made.main.table, made.ramp.table])
    learned = Law(drivers, free_table(drivers), numbers, hazard)
    driver, rate, may = rng.integers(0, 32, (6, SAMPLES)), rng.uniform(0.2, 3.0, (6, FUTURE)), np.arange(6) != 1
    x, lane = np.empty((6, SAMPLES, FUTURE), np.float32), np.empty((6, SAMPLES, FUTURE), np.int16)
    seen, can = np.empty((6, SAMPLES, 0, len(hazard) - 3)), np.zeros((6, SAMPLES, 0), dtype=bool)
    kernel_drive(start, learned, draws, driver, rate, may, np.arange(6), (0, 1), (0, SAMPLES), x, lane,
                 np.zeros((6, FUTURE), np.int64), seen, can)  # fmt: skip
    for sample in range(SAMPLES):
        there, then = Plain(start, learned, draws, driver, rate, may, sample).run()
        np.testing.assert_array_equal(lane[:, sample], then)
        np.testing.assert_allclose(x[:, sample], there, atol=2e-3)
    changed = (lane != start.lane[:, None, None]).any(axis=2)
    assert changed.any()
    assert not changed[1].any()  # who may not


def test_at_a_site_that_is_not_known_all_merge_sooner_or_later_in_the_same_samples():
    """The mean of the logarithm of the pace is 0, and who merges first in a sample tells of the others."""
    situation = situation_of_traffic(six(1))
    known = model(hazard=-4.0, manners=ALONE)
    unknown = replace(known, hazard=replace(known.hazard, unknown=1.5))
    waited = {}
    for made in (known, unknown):
        driven = drive(made, begin(made, situation), samples=400, seed=1)
        merged = driven.lane[:3] != driven.lane[:3, :, :1]
        waited[made.hazard.unknown] = np.where(merged.any(axis=2), merged.argmax(axis=2), FUTURE)
        # what the hazards give is what happens
        happened = merged.any(axis=2).mean(axis=1)
        np.testing.assert_allclose(1.0 - np.prod(1.0 - driven.chance[:3], axis=1), happened, atol=0.12)
    together = {spread: np.corrcoef(steps)[0, 2] for spread, steps in waited.items()}
    assert abs(together[0.0]) < 0.15 < 0.2 < together[1.5]


@given(traffics(), st.sampled_from((-6.0, -1.0, 4.0)))
@settings(max_examples=60, deadline=None)
def test_every_sample_of_any_traffic_is_possible(traffic, hazard):
    situation = situation_of_traffic(traffic)
    made = model(hazard=hazard)
    driven = drive(made, begin(made, situation), samples=SAMPLES, seed=1)
    x = situation.x[:, -1]
    assert_possible(driven.x, driven.lane, start=x, length=situation.length, end=situation.end[0])
    fastest = np.maximum(situation.v[:, -1], made.limit)
    speed = np.diff(driven.x, axis=2, prepend=np.broadcast_to(x[:, None, None], (len(x), SAMPLES, 1))) / 0.2
    assert (speed <= fastest[:, None, None] + 0.01).all()
    assert ((driven.chance >= 0.0) & (driven.chance <= 1.0)).all()


@given(traffics())
@settings(max_examples=15, deadline=None)
def test_one_thread_gives_what_two_give_bit_for_bit(traffic):
    made, situation = model(), situation_of_traffic(traffic)
    several = joined_situations([situation] * 9)
    for some in (situation, several):
        found = []
        for threads in (1, 2):
            with choosing_threads(threads):
                found.append(drive(made, begin(made, some), samples=SAMPLES, seed=1))
        np.testing.assert_array_equal(found[0].x, found[1].x)
        np.testing.assert_array_equal(found[0].lane, found[1].lane)


@given(traffics())
@settings(max_examples=15, deadline=None)
def test_moments_together_are_driven_as_each_alone(traffic):
    made, other = model(), situation_of_traffic(six(1))
    situation = situation_of_traffic(traffic)
    alone = drive(made, begin(made, situation), samples=SAMPLES, seed=1)
    together = drive(made, begin(made, joined_situations([other, situation])), samples=SAMPLES, seed=1)
    np.testing.assert_array_equal(together.x[6:], alone.x)
    np.testing.assert_array_equal(together.lane[6:], alone.lane)


@pytest.mark.parametrize("vehicle", [1, 13, 1000])
def test_the_random_numbers_of_a_vehicle_do_not_depend_on_its_company(vehicle):
    """Alone in its lane it is driven the same with vehicles of other lanes, and without; 13 and 1000 have low rows."""
    x, v, lane = np.append(100.0, np.linspace(50.0, 300.0, 5)), np.full(6, 12.0), np.append(MAIN[0], np.full(5, 6))
    ids = np.append(vehicle, 2000 + np.arange(5))
    both, one = (
        situation_of_traffic(traffic_of(x[some], v[some], lane[some], seen=np.full(6, 40)[some], vehicle=ids[some]))
        for some in (slice(6), slice(1))
    )
    assert both.draw[0] == one.draw[0]
    made = model(manners=ALONE)
    company, alone = (drive(made, begin(made, some), samples=SAMPLES, seed=1) for some in (both, one))
    np.testing.assert_array_equal(company.x[0], alone.x[0])


def test_the_same_seed_gives_the_same_futures_and_another_others():
    made = model()
    beginning = begin(made, situation_of_traffic(six(3)))
    first, again, other = (drive(made, beginning, samples=SAMPLES, seed=seed).x for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any(axis=2).all()


def test_only_who_is_asked_for_is_returned_and_as_always():
    made = model()
    beginning = begin(made, situation_of_traffic(six(4)))
    wanted = np.arange(6) % 2 == 1
    whole, some = (drive(made, beginning, samples=SAMPLES, seed=1, wanted=one) for one in (None, wanted))
    np.testing.assert_array_equal(some.x, whole.x[wanted])
    np.testing.assert_array_equal(some.chance, whole.chance[wanted])


def test_who_waits_does_not_merge_and_all_that_its_hazard_sees_is_known():
    made = model(hazard=2.0)
    situation = situation_of_traffic(six(5))
    found = drive_waiting(made, begin(made, situation), samples=SAMPLES, seed=1)
    assert (found.lane == situation.lane[0]).all()
    assert np.isfinite(found.seen).all()
    assert found.can.any()


def test_a_hazard_of_nothing_merges_nobody_and_a_certain_one_everybody_who_has_room():
    made = model()
    beginning = begin(made, situation_of_traffic(six(6)))
    none = drive(made, beginning, samples=SAMPLES, seed=1, rate=np.zeros((6, FUTURE)))
    assert (none.lane[:3] == beginning.situation.lane[0]).all()
    sure = drive(made, beginning, samples=SAMPLES, seed=1, rate=np.full((6, FUTURE), 1e6))
    assert (sure.lane[:3, :, -1] != beginning.situation.lane[0]).all()


def test_the_chance_of_a_merge_is_how_often_it_happens():
    """Of many samples: the mean of the hazards is the share of those that merge."""
    made = replace(model(hazard=-4.0), manners=ALONE)
    found = drive(made, begin(made, situation_of_traffic(six(7))), samples=2000, seed=1)
    merged = (found.lane[:3] != found.lane[:3, :, :1]).any(axis=2).mean(axis=1)
    np.testing.assert_allclose(found.chance[:3].sum(axis=1), merged, atol=0.05)


def test_drivers_are_drawn_in_proportion_to_their_weights():
    rng = np.random.default_rng(1)
    weights = rng.dirichlet(np.ones(7), 5)
    order = np.stack([rng.permutation(50) for _ in range(5)])
    drawn = drawn_drivers(weights, order)
    for row in range(5):
        count = np.bincount(drawn[row], minlength=7)
        assert np.abs(count - 50 * weights[row]).max() < 1.0
    np.testing.assert_array_equal(drawn_drivers(np.eye(7)[[2]], order[:1]), 2)


def test_chances_are_the_same_whatever_the_threads():
    made, situation = model(), _four()
    found = []
    for threads in (1, 2, 3):
        with choosing_threads(threads):
            found.append(drive(made, begin(made, situation), samples=30, seed=1).chance)
    assert found[0].max() > 0.0
    np.testing.assert_array_equal(found[1], found[0])
    np.testing.assert_array_equal(found[2], found[0])


@pytest.mark.parametrize("samples", [0, 1, 7])
def test_shares_are_all_samples_once_whatever_the_threads(samples):
    for threads in (1, 2, 3, 8):
        with choosing_threads(threads):
            shares = sharing(lambda task: task, 2, samples)
        assert [one for *_, low, high in shares for one in range(low, high)] == list(range(samples))


def _four():
    x, v, lane = np.array([160.0, 120.0, 150.0, 90.0]), np.full(4, 9.0), np.array([RAMP, RAMP, MAIN[-1], MAIN[-1]])
    return situation_of_traffic(traffic_of(x, v, lane, seen=np.full(4, 40), vehicle=np.arange(4)))
