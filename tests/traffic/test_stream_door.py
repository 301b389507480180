"""The door of a stream: a frame with vehicles that no road has is refused by name, and the stream goes on."""

import numpy as np
import pytest

import rampcast as rc
from rampcast.errors import RampcastError, RecordingError
from rampcast.sites import load_site
from tests.traffic.test_moments import _same as assert_same

SITE = load_site("i80")


def frame(time: float, **changes: float) -> dict[str, list]:
    """Returns three vehicles at 10 m/s, the second of them with other values."""
    found = {
        "vehicle": [7, 8, 9],
        "x": [20.0 + 10 * time, 60.0 + 10 * time, 100.0 + 10 * time],
        "y": [SITE.lane_centre(6)] * 3,
        "lane": [6, 6, 6],
        "length": [4.5, 4.5, 4.5],
    }
    for name, value in changes.items():
        found[name][1] = value
    return found


def begun(**options) -> rc.Stream:
    stream = rc.Stream(SITE, **options)
    for tenth in range(10):
        stream.push(tenth / 10, frame(tenth / 10))
    return stream


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"x": 1e6}, r"positions far beyond the section .*1e\+06, expected x from 0.*Likely the wrong site, unit"),
        ({"x": 260.0}, r"speeds that no vehicle has \[m/s\] .*1,910, expected 70 m/s.*Likely a jump"),
        ({"lane": 12}, r"lanes that the site has not .*12, expected 1, .*Likely the wrong site"),
        ({"y": 1e4}, "positions far beside the lanes"),
        ({"length": 450.0}, "lengths that no vehicle has"),
    ],
)
def test_a_vehicle_that_no_road_has_is_named_and_the_stream_is_as_it_was(changes, words):
    stream, other = begun(), begun()
    with pytest.raises(RecordingError, match=rf"^the frame at 1 s is refused, .*{words}") as raised:
        stream.push(1.0, frame(1.0, **changes))
    assert "vehicle 8" in str(raised.value)
    assert 'doubtful="accept"' in str(raised.value)
    assert stream.counts == other.counts
    assert_same(stream.push(1.1, frame(1.1)), other.push(1.1, frame(1.1)))


def test_an_object_wider_than_long_stays_and_is_there_to_be_followed():
    stream = begun()
    seen = frame(1.0, length=1.6) | {"width": [1.8, 1.9, 1.8]}
    assert len(stream.push(1.0, seen).vehicle) == 3


def test_all_vehicles_in_one_place_are_refused_and_one_that_two_sensors_see_is_not():
    stream = begun()
    stream.push(1.0, frame(1.0, x=30.2, vehicle=10))
    with pytest.raises(
        RecordingError, match="since it is not as roads and vehicles are: vehicles in the place of another"
    ):
        stream.push(1.1, frame(1.1) | {"vehicle": [11, 12, 13], "x": [70.0, 70.0, 70.0]})


def test_who_accepts_doubtful_vehicles_gets_their_traffic_and_its_forecast():
    stream = begun(doubtful="accept")
    traffic = stream.push(1.0, frame(1.0, x=260.0))
    assert traffic.is_accepted
    assert len(traffic) == 3
    assert np.isfinite(rc.load("pretrained").predict(traffic).samples).all()
    with pytest.raises(RampcastError, match="doubtful: expected one of 'refuse', 'accept'"):
        rc.Stream(SITE, doubtful="perhaps")


def test_forecasts_of_a_stream_are_refused_likewise():
    online = rc.Online(rc.load("pretrained"), SITE)
    online.push(0.0, frame(0.0))
    with pytest.raises(RecordingError, match=r"the frame at 0\.1 s is refused"):
        online.push(0.1, frame(0.1, x=260.0))
    accepting = rc.Online(rc.load("pretrained"), SITE, doubtful="accept")
    accepting.push(0.0, frame(0.0))
    accepting.push(0.1, frame(0.1, x=260.0))


def test_what_a_sensor_does_is_no_breach():
    """Boxes that slip by some metres from one camera to the next, late frames, ids that come back after seconds."""
    stream = begun()
    stream.push(0.91, frame(0.9, x=71.5))
    stream.push(0.95, frame(0.95))
    stream.push(0.93, frame(0.93, y=np.nan, lane=0, length=np.nan))
    stream.push(4.0, frame(4.0, x=10.0))
    stream.push(9.5, frame(9.5, x=300.0))


def test_two_moments_of_a_vehicle_far_from_each_other_are_no_speed_once_the_first_is_forgotten():
    stream = rc.Stream(SITE)
    stream.push(0.0, {"vehicle": ["a"], "x": [10.0], "y": [0.0]})
    stream.push(4.2, {"vehicle": ["b"], "x": [10.0], "y": [0.0]})
    stream.push(4.3, {"vehicle": ["a"], "x": [480.0], "y": [0.0]})
    assert stream.counts.frames == 3


def test_times_in_milliseconds_are_told_and_an_outage_is_not():
    stream = rc.Stream(SITE)
    for tenth in range(3):
        stream.push(100.0 * tenth, frame(tenth / 10))
    with pytest.raises(
        RecordingError, match=r"300 s comes 100 s after the one before.*milliseconds\? Expected seconds"
    ):
        stream.push(300.0, frame(0.3))
    assert stream.counts.frames == 3
    assert len(stream.push(300.1, frame(0.1)).vehicle) == 3  # frames come in seconds again
