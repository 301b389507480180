"""Places on the earth and back, and what V2X tells in JSON."""

import json

import numpy as np
import pytest

from rampcast.live.earth import Earth
from rampcast.live.frames import FrameError
from rampcast.live.geo import site_geojson
from rampcast.live.v2x import advice_of, frames_of_v2x
from rampcast.sites import load_site

LAT, LON = 37.8408, -122.2989
EARTH = Earth(load_site("i80"), LAT, LON)
RADIUS = 6_371_000.0  # [m] of a sphere: within 0.6 % of the earth's bend anywhere


def test_a_place_on_the_earth_and_back_is_the_same():
    x, y = np.array([0.0, 250.0, 500.0]), np.array([0.0, -23.9, -5.0])
    lat, lon = EARTH.of_road(x, y)
    there = EARTH.on_road(lat, lon)
    np.testing.assert_allclose(there, (x, y), atol=1e-6)


def test_distances_are_those_of_the_earth():
    lat, lon = EARTH.of_road(np.array([0.0, 1000.0]), np.array([0.0, 0.0]))
    east = RADIUS * np.radians(lon[1] - lon[0]) * np.cos(np.radians(LAT))
    assert east == pytest.approx(1000.0, rel=6e-3)
    assert lat[0] == pytest.approx(LAT)


def test_a_site_on_the_earth_has_its_lanes_there():
    made = site_geojson("i80", EARTH.site, EARTH)
    assert made["rampcast"]["coordinates"] == "wgs84"
    lines = [one for one in made["features"] if one["properties"]["what"] == "lane"]
    assert len(lines) == len(EARTH.site.lanes)
    for one in lines:
        np.testing.assert_allclose(one["geometry"]["coordinates"], [[LON, LAT]] * 2, atol=0.01)


def test_a_detected_object_is_a_frame_of_one():
    message = {
        "type": "CAR", "confidence": 0.7, "sensorId": "sensor1", "objectId": 123, "timestamp": 1200,
        "projString": f"+proj=tmerc +lat_0={LAT} +lon_0={LON} +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs",
        "position": {"x": 150.0, "y": -23.9, "z": 0.0}, "velocity": {"x": 1.0, "y": 1.0, "z": 1.0},
        "size": {"length": 4.0, "height": 1.0, "width": 1.8},
    }  # fmt: skip
    (frame,) = frames_of_v2x(json.dumps(message).encode(), EARTH)
    (seen,) = frame.objects
    assert (frame.t_ms, seen.id, seen.length, seen.class_) == (1200, 123, 4.0, "car")
    assert (seen.x, seen.y) == pytest.approx((152.0, -23.9), abs=1e-6)


def test_objects_that_were_measured_at_other_times_are_in_frames_of_their_own():
    thing = {"x_distance": 0, "y_distance": 0}
    place = {"latitude": round(1e7 * LAT), "longitude": round(1e7 * LON)}
    body = {
        "management_container": {"reference_position": place},
        "perceived_object_container": [
            thing | {"object_id": 1, "time_of_measurement": 50},
            thing | {"object_id": 2, "time_of_measurement": -20},
        ],
    }
    frames = frames_of_v2x(json.dumps({"timestamp": 1000, "message": body}).encode(), EARTH)
    assert [(one.t_ms, one.objects[0].id) for one in frames] == [(980, 2), (1050, 1)]


@pytest.mark.parametrize(
    "message",
    [b"", b"[]", b"{}", b'{"timestamp":1,"message":{}}', b'{"projString":"+proj=utm","objectId":1}', b"x" * 300_000],
)
def test_what_is_neither_is_refused_with_a_sentence(message):
    with pytest.raises(FrameError, match=r"\w+"):
        frames_of_v2x(message, EARTH)
    with pytest.raises(FrameError, match="origin"):
        frames_of_v2x(message, None)


def test_advice_is_for_the_ramp_and_moves_over_where_the_merge_is_likely():
    vehicle = {
        "id": 7, "lane": 7, "on_ramp": True, "q": [[150.0 + 10.0 * s] * 5 for s in range(16)],
        "p_merged": [0.0] * 5 + [0.9] * 11,
    }  # fmt: skip
    stays = vehicle | {"id": "text", "p_merged": [0.0] * 16}
    message = {"site": "i80", "t_pub_ms": 1.7e12, "vehicles": [vehicle, stays, vehicle | {"on_ramp": False}]}
    (advice,) = advice_of(message, EARTH)
    one, other = advice["message"]["mcm_data"]["advised_manoeuvre_container"]
    assert one["executant_id"] == 7
    assert "current_state_advised_change" not in one
    assert other["current_state_advised_change"] == "stay_in_lane"
    points = one["submanoeuvres"][0]["advised_trajectory"]
    lat, lon = (np.array([point[name] for point in points]) / 1e7 for name in ("latitude", "longitude"))
    x, y = EARTH.on_road(lat, lon)
    np.testing.assert_allclose(x, 160.0 + 10.0 * np.arange(10), atol=0.02)
    np.testing.assert_allclose(y[:4], EARTH.site.lane_centre(7), atol=0.02)
    np.testing.assert_allclose(y[4:], EARTH.site.lane_centre(6), atol=0.02)
    assert [point["speed"] for point in points] == [10] * 10
    assert advice_of({"site": "i80", "t_pub_ms": 0.0, "vehicles": []}, EARTH) == []
