"""The door of a forecast of one moment: states that no vehicle has are named, and nothing is forecast from them."""

from dataclasses import replace

import numpy as np
import pytest

import rampcast as rc
from rampcast.errors import RecordingError
from rampcast.forecast import forecaster
from rampcast.recording.frame_door import frame_door, refused_frame
from tests.made_up_traffic import random_traffic


@pytest.fixture(scope="module")
def moment():
    return rc.traffic(random_traffic(1, vehicles=12), at=20.0)


@pytest.fixture(scope="module")
def pretrained():
    return rc.load("pretrained")


def with_state(traffic, name, value):
    """Returns the traffic with another value of one vehicle that is there at t0, and its id."""
    one = int(np.flatnonzero(traffic.valid[:, -1])[0])
    values = getattr(traffic, name).copy()
    values[(one, *(-1,) * (values.ndim - 1))] = value
    return replace(traffic, **{name: values}), traffic.vehicle[one]


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("x", 1e6, r"positions far beyond the section .*1e\+06, expected x from 0"),
        ("x", float("nan"), "positions that are no numbers"),
        ("v", 1e6, r"speeds that no vehicle has .*1e\+06"),
        ("v", float("inf"), "positions that are no numbers"),
        ("a", float("nan"), "positions that are no numbers"),
    ],
)
def test_a_state_that_no_vehicle_has_is_named_and_not_forecast(moment, pretrained, name, value, words):
    broken, vehicle = with_state(moment, name, value)
    with pytest.raises(RecordingError, match=rf"the forecast at t0 = 20 s is refused, .*{words}") as raised:
        pretrained.predict(broken)
    assert f"vehicle {vehicle}" in str(raised.value)
    assert 'doubtful="accept"' in str(raised.value)


def test_a_moment_of_too_many_vehicles_is_refused_though_accepted(moment, pretrained):
    some = np.arange(forecaster.MOST_VEHICLES + 1) % len(moment.vehicle)
    many = {name: value[some] for name, value in vars(moment).items() if isinstance(value, np.ndarray)}
    crowd = replace(moment, **(many | {"vehicle": np.arange(len(some)), "is_accepted": True}))
    with pytest.raises(RecordingError, match=r"20,001 vehicles at one moment, expected 20,000 at most\. Cut"):
        pretrained.predict(crowd)


def test_all_vehicles_in_one_place_are_refused_and_two_of_many_are_not(moment):
    count = 40
    x, y = 20.0 * np.arange(count), np.zeros(count)
    twice = np.where(np.arange(count) == 1, x[0], x)
    refused_frame(frame_door(moment.site, range(count), twice, y), doing="a forecast")
    with pytest.raises(RecordingError, match="vehicles in the place of another"):
        refused_frame(frame_door(moment.site, range(count), y + 100.0, y), doing="a forecast")


def test_who_accepted_the_recording_gets_the_forecast_of_its_moments(moment, pretrained):
    recording = replace(random_traffic(1, vehicles=12), is_accepted=True)
    accepted = rc.traffic(recording, at=20.0)
    assert accepted.is_accepted
    broken, _ = with_state(accepted, "v", 90.0)
    assert len(pretrained.predict(broken)) == len(pretrained.predict(moment))
