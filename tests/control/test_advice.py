"""Advice: whom it reaches, when, and what it says."""

import pytest

from rampcast.control.advice import Equipped, Postman, Told, gap_advice, speed_advice
from tests.control.made_up import RAMP, forecast


def test_as_many_obey_as_are_equipped_and_comply():
    obey = [Equipped(0.5, compliance=0.7, seed=3).obeys(vehicle) for vehicle in range(2000)]
    assert sum(obey) / len(obey) == pytest.approx(0.35, abs=0.03)  # 3 standard deviations
    assert not any(Equipped(0.0).obeys(vehicle) for vehicle in range(100))


def test_who_is_equipped_at_a_small_penetration_is_so_at_a_large_one():
    few, many = (Equipped(share, compliance=1.0) for share in (0.2, 0.5))
    assert all(many.obeys(vehicle) for vehicle in range(500) if few.obeys(vehicle))


def test_advice_arrives_after_its_delay_and_only_once():
    postman = Postman(Equipped(1.0, compliance=1.0, delay=1.0))
    postman.post(5.0, [Told(1, 15.0)])
    assert postman.arrived(5.9) == []
    assert postman.arrived(6.0) == [Told(1, 15.0)]
    assert postman.arrived(7.0) == []


def test_who_is_quicker_than_the_queue_to_come_is_told_its_speed():
    slow = forecast((250.0, 1, 14.0))
    (told,) = speed_advice(slow, {7: 25.0, 8: 13.0}, below=20.0)
    assert told.vehicle == 7
    assert told.speed == pytest.approx(14.0, abs=1e-3)
    assert speed_advice(slow, {7: 25.0}, below=10.0) == []
    assert speed_advice(forecast(), {7: 25.0}, below=20.0) == []


def test_who_will_be_behind_a_merge_is_told_to_be_2_metres_a_second_slower():
    found = forecast((350.0, RAMP, 20.0), (340.0, 2, 20.0), (340.0, 1, 20.0))
    assert gap_advice(found, {1: 20.0, 2: 20.0, 3: 20.0}) == [Told(2, 18.0)]
