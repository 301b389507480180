"""The door for a frame: every kind of nonsense by hand, and what is right passes."""

import numpy as np
import pytest

from rampcast.errors import RecordingError
from rampcast.recording.frame_door import frame_door, refused_frame
from rampcast.sites import load_site

SITE = load_site("i80")
X, Y = np.array([50.0, 80.0, 110.0]), np.array([-3.6, -3.6, -7.2])
V = np.array([20.0, 21.0, 22.0])
SIZES = {"length": np.full(3, 4.5), "width": np.full(3, 1.8)}
SOUND = {**SIZES, "v": V, "before": X - V * 0.1, "lane": np.array([6, 6, 0])}


def test_a_frame_that_is_as_it_should_be_passes_with_what_is_not_known():
    assert frame_door(SITE, [1, 2, 3], X, Y, **SOUND).breaches == ()
    assert frame_door(SITE, [1, 2, 3], X, np.full(3, np.nan)).is_believable.all()
    assert frame_door(SITE, [], X[:0], Y[:0]).breaches == ()


def test_more_vehicles_than_fit_on_the_road_are_refused_at_once():
    x = np.linspace(0.0, 500.0, 500_000)
    found = frame_door(SITE, range(len(x)), x, np.zeros(len(x)))
    assert [one.name for one in found.breaches] == ["crowds"]
    assert not found.is_believable.any()
    with pytest.raises(RecordingError, match=r"more vehicles at once than fit .*500,000, expected 6,419 at most"):
        refused_frame(found, doing="a forecast")


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("no_numbers", {"x": np.nan}),
        ("far_places", {"x": 1e6}),
        ("far_aside", {"y": 4000.0}),
        ("impossible_speeds", {"v": 1e6}),
        ("impossible_speeds", {"before": 1500.0}),
        ("jumps", {"v": 65.0, "before": 80.0 + 5.0}),
        ("impossible_lengths", {"length": 450.0}),
        ("upstream", {"v": -20.0, "before": 82.0}),
        ("unknown_lanes", {"lane": 12}),
        ("one_place", {"x": 50.2, "y": -3.6, "before": 48.1}),
    ],
)
def test_nonsense_is_named_and_its_vehicle_left_out(name, changes):
    values = {"x": X.copy(), "y": Y.copy(), **{key: value.copy() for key, value in SOUND.items()}}
    for key, value in changes.items():
        values[key][1] = value
    found = frame_door(SITE, ["a", "b", "c"], values.pop("x"), values.pop("y"), frame=7, **values)
    breach = next(one for one in found.breaches if one.name == name)
    assert (breach.vehicle, breach.frame) == ("b", 7)
    assert found.is_believable.tolist() == [True, False, True]
    assert "vehicle b, frame 7" in str(breach)


def test_a_vehicle_that_two_sensors_see_is_one_though_another_drives_beside_it():
    x, y = np.array([50.0, 50.1, 50.2]), np.array([-3.6, -7.2, -3.5])
    found = frame_door(SITE, [1, 2, 3], x, y)
    assert [(one.name, one.vehicle) for one in found.breaches] == [("one_place", 3)]
    assert found.is_believable.tolist() == [True, True, False]


def test_a_point_that_a_radar_sees_is_named_and_stays_a_leader():
    values = SOUND | {"width": np.array([1.8, 4.8, 1.8])}
    found = frame_door(SITE, [1, 2, 3], X, Y, **values)
    assert [(one.name, one.vehicle) for one in found.breaches] == [("wider_than_long", 2)]
    assert found.is_believable.all()
    refused_frame(found, doing="a forecast")
    with pytest.raises(RecordingError, match=r"wider than long .*\(3 of 3\)"):
        refused_frame(frame_door(SITE, [1, 2, 3], X, Y, **SOUND | {"width": np.full(3, 4.8)}), doing="a forecast")


def test_one_of_the_opposite_carriageway_stops_no_forecast_and_a_line_turned_round_does():
    one = frame_door(SITE, [1, 2, 3], X, Y, v=np.array([20.0, -8.0, 20.0]))
    assert [(one.name, one.vehicle) for one in one.breaches] == [("upstream", 2)]
    refused_frame(one, doing="a forecast")
    with pytest.raises(RecordingError, match=r"drive upstream .*\(3 of 3\)"):
        refused_frame(frame_door(SITE, [1, 2, 3], X, Y, v=-V), doing="a forecast")
