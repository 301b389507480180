"""Headways of drivers who are in a queue, or left one, by a SUMO that is made up."""

import sys
from types import SimpleNamespace

import pytest

from rampcast.simulate.drivers import DEFAULT, QUEUE_HEADWAY
from rampcast.simulate.queue_headway import QueueHeadway, with_queue_headway


class Vehicles:
    """One vehicle, whose speed and road are set."""

    def __init__(self):
        self.tau, self.speed, self.road = 1.0, 20.0, "main_0"

    def getIDList(self):
        return ["0"]

    def getSpeed(self, name):
        return self.speed

    def getRoadID(self, name):
        return self.road

    def getTau(self, name):
        return self.tau

    def setTau(self, name, tau):
        self.tau = tau


@pytest.fixture
def vehicles():
    return Vehicles()


@pytest.fixture
def headways(vehicles):
    return QueueHeadway(SimpleNamespace(vehicle=vehicles), 1.2, 60.0, ("main",))


def test_a_headway_is_longer_in_a_queue_and_for_a_minute_after_it(vehicles, headways):
    for time, speed, tau in (
        (0, 20.0, 1.0),
        (1, 3.0, 1.2),
        (2, 3.0, 1.2),
        (61, 20.0, 1.2),
        (62, 20.0, 1.2),
        (63, 20.0, 1.0),
    ):
        vehicles.speed = speed
        headways.look(float(time))
        assert vehicles.tau == pytest.approx(tau), time


def test_who_waits_on_a_ramp_is_in_no_queue_of_the_main_road(vehicles, headways):
    vehicles.speed, vehicles.road = 0.0, "queue_0"
    headways.look(0.0)
    assert vehicles.tau == 1.0


def test_only_drivers_with_such_headways_need_another_program():
    assert with_queue_headway(["sumo", "-n", "net.xml"], DEFAULT) == ["sumo", "-n", "net.xml"]
    found = with_queue_headway(["sumo", "-n", "net.xml"], QUEUE_HEADWAY)
    assert found[0] == sys.executable
    assert found[-5:] == [1.15, 60.0, "sumo", "-n", "net.xml"]
