"""V2X in JSON: perceived objects in, advice out, in the words of two public projects.

In: the CPM of Orange's its-client (cpm_schema_1-2-1.json) and V2X-Hub's SensorDetectedObject. Out: an MCM as in
its-client (mcm_schema_2-0-1.json), as far as a forecast from outside has something to say. docs/live-messages.md tells
which fields are read and written.
"""

import math
import re
import zlib
from typing import Annotated, Any, Final

import msgspec
import numpy as np

from rampcast.live.earth import Earth
from rampcast.live.frames import MOST_BYTES, MOST_OBJECTS, VERSION, Frame, FrameError, Seen, checked

DEGREES: Final = 1e-7  # of a unit of latitude and longitude
CENTIMETRE: Final = 1e-2  # [m] of a unit of distance
DECIMETRE: Final = 0.1  # [m] of a unit of size
EPOCH: Final = 1_072_915_200_000  # [ms] 2004-01-01, from which TimestampIts counts; leap seconds are left out
AHEAD: Final = {0: 0.5, 2: 0.5, 7: 0.5, 1: 1.0, 4: 1.0, 6: 1.0}  # lengths from the reference point to the front
CLASSES: Final = {2: "truck", 3: "truck", 4: "truck", 5: "truck"}  # of "vehicle": bus, light and heavy truck, trailer
PROJECTION: Final = re.compile(r"\+(proj|lat_0|lon_0|k|k_0|x_0|y_0)=(\S+)")
WAY_POINTS: Final = 10  # of a trajectory, at most
LIKELY: Final = 0.5  # probability from which a vehicle is taken to have merged

Whole = Annotated[int, msgspec.Meta(ge=-(1 << 31), le=1 << 31)]


class _Position(msgspec.Struct):
    latitude: Annotated[int, msgspec.Meta(ge=-900_000_000, le=900_000_000)]
    longitude: Annotated[int, msgspec.Meta(ge=-1_800_000_000, le=1_800_000_000)]


class _Management(msgspec.Struct):
    reference_position: _Position
    station_type: int = 0


class _ObjectClass(msgspec.Struct):
    vehicle: int | None = None
    single_vru: dict[str, Any] | None = None
    vru_group: Any = None
    other: Any = None


class _Classification(msgspec.Struct):
    object_class: _ObjectClass


class _Perceived(msgspec.Struct):
    object_id: Whole
    x_distance: Whole
    y_distance: Whole
    time_of_measurement: Annotated[int, msgspec.Meta(ge=-5000, le=5000)] = 0
    planar_object_dimension_1: Annotated[int, msgspec.Meta(ge=0, le=1023)] | None = None
    planar_object_dimension_2: Annotated[int, msgspec.Meta(ge=0, le=1023)] | None = None
    object_ref_point: int = 0
    classification: list[_Classification] = []


class _CpmBody(msgspec.Struct):
    management_container: _Management
    perceived_object_container: Annotated[list[_Perceived], msgspec.Meta(max_length=MOST_OBJECTS)] = []


class Cpm(msgspec.Struct):
    """A collective perception message."""

    timestamp: Annotated[int, msgspec.Meta(ge=0, le=1 << 53)]
    message: _CpmBody


class _Vector(msgspec.Struct):
    x: Annotated[float, msgspec.Meta(ge=-1e6, le=1e6)]
    y: Annotated[float, msgspec.Meta(ge=-1e6, le=1e6)]


class _Dimensions(msgspec.Struct):
    length: Annotated[float, msgspec.Meta(gt=0.0, le=100.0)] | None = None
    width: Annotated[float, msgspec.Meta(gt=0.0, le=100.0)] | None = None


class SensorDetectedObject(msgspec.Struct, rename="camel"):
    """One object of a sensor, as V2X-Hub and CARMA-Streets tell it."""

    object_id: int | str
    position: _Vector
    timestamp: Annotated[int, msgspec.Meta(ge=0, le=1 << 53)]
    proj_string: Annotated[str, msgspec.Meta(max_length=500)]
    type: str = ""
    size: _Dimensions = msgspec.field(default_factory=_Dimensions)


def frames_of_v2x(message: bytes, earth: Earth | None) -> list[Frame]:
    """Returns the frames that a message of V2X holds, the oldest first: one for each time of measurement.

    Args:
        message: a CPM, or a SensorDetectedObject, as JSON.
        earth: where the site is.

    Raises:
        FrameError: it is none, or the site is nowhere on the earth.
    """
    if earth is None:
        raise FrameError("V2X tells of places on the earth, and the site has none: give its --origin")
    if len(message) > MOST_BYTES:
        raise FrameError(f"expected a message of at most {MOST_BYTES:,} bytes, got {len(message):,}")
    try:
        if b'"projString"' in message:
            return [_of_detected(msgspec.json.decode(message, type=SensorDetectedObject), earth)]
        return _of_cpm(msgspec.json.decode(message, type=Cpm), earth)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise FrameError(f"the message is neither a CPM nor a SensorDetectedObject: {error}") from error


def _of_cpm(cpm: Cpm, earth: Earth) -> list[Frame]:
    place = cpm.message.management_container.reference_position
    east, north = earth.plane(DEGREES * place.latitude, DEGREES * place.longitude)
    by_time: dict[int, list[Seen]] = {}
    for one in cpm.message.perceived_object_container:
        kind = _kind(one)
        if kind is None:
            continue
        length = _size(one.planar_object_dimension_2)
        x, y = earth.of_plane(east + CENTIMETRE * one.x_distance, north + CENTIMETRE * one.y_distance)
        ahead = AHEAD.get(one.object_ref_point, 0.0) * (length or 0.0)
        width = _size(one.planar_object_dimension_1)
        seen = Seen(id=one.object_id, x=x + ahead, y=y, length=length, width=width, class_=kind)
        by_time.setdefault(cpm.timestamp + one.time_of_measurement, []).append(seen)
    return [checked(Frame(v=VERSION, t_ms=time, objects=by_time[time])) for time in sorted(by_time)]


def _kind(one: _Perceived) -> str | None:
    """Returns the kind of a vehicle; None for what is no motor vehicle."""
    for found in one.classification[:1]:
        if found.object_class.vehicle is not None:
            return CLASSES.get(found.object_class.vehicle, "car")
        if found.object_class.single_vru is not None and "motorcylist" in found.object_class.single_vru:
            return "motorcycle"
        return None
    return "car"


def _size(units: int | None) -> float | None:
    return DECIMETRE * units if units else None


def _of_detected(one: SensorDetectedObject, earth: Earth) -> Frame:
    told = dict(PROJECTION.findall(one.proj_string))
    if told.get("proj") != "tmerc":
        raise FrameError("projString: expected +proj=tmerc with +lat_0 and +lon_0")
    try:
        lat, lon = float(told["lat_0"]), float(told["lon_0"])
        moved = float(told.get("x_0", 0.0)), float(told.get("y_0", 0.0))
    except (KeyError, ValueError) as error:
        raise FrameError("projString: expected +lat_0 and +lon_0 as numbers") from error
    if not (abs(lat) <= 90.0 and abs(lon) <= 180.0 and all(map(math.isfinite, moved))):
        raise FrameError("projString: +lat_0 and +lon_0 are no place on the earth")
    east, north = earth.plane(lat, lon)
    x, y = earth.of_plane(east + one.position.x - moved[0], north + one.position.y - moved[1])
    ahead = 0.5 * (one.size.length or 0.0)
    kind = one.type.lower()[:32]
    seen = Seen(id=one.object_id, x=x + ahead, y=y, length=one.size.length, width=one.size.width, class_=kind)
    return checked(Frame(v=VERSION, t_ms=one.timestamp, objects=[seen]))


def advice_of(message: dict[str, Any], earth: Earth) -> list[dict[str, Any]]:
    """Returns an MCM for a forecast: for each ramp vehicle the places and speeds that are likeliest, until 10 s.

    Args:
        message: of a forecast, as JSON tells it.
        earth: where the site is.
    """
    advised = [_advice(one, earth) for one in message["vehicles"] if one["on_ramp"]]
    if not advised:
        return []
    now = round(message["t_pub_ms"])
    unknown = {"semi_major_confidence": 4095, "semi_minor_confidence": 4095, "semi_major_orientation": 3601}
    position = {"latitude": round(earth.lat / DEGREES), "longitude": round(earth.lon / DEGREES)}
    body = {
        "protocol_version": 1,
        "station_id": zlib.crc32(message["site"].encode()),
        "generation_delta_time": (now - EPOCH) % 65_536,
        "station_type": 2,
        "itss_role": 0,
        "position": position | {"position_confidence_ellipse": unknown},
        "mcm_data": {"advised_manoeuvre_container": advised},
    }
    return [
        {
            "message_type": "mcm",
            "message_format": "json/raw",
            "source_uuid": f"rampcast_{message['site']}",
            "timestamp": now,
            "version": "2.0.1-dev",
            "message": body,
        }
    ]


def _advice(vehicle: dict[str, Any], earth: Earth) -> dict[str, Any]:
    site = earth.site
    x = np.array([row[2] for row in vehicle["q"][: WAY_POINTS + 1]])
    merged = np.array(vehicle["p_merged"][1 : WAY_POINTS + 1]) >= LIKELY
    here, there = site.lane_centre(vehicle["lane"]), site.lane_centre(site.target_lane)
    lat, lon = earth.of_road(x[1:], np.where(merged, there, here))
    speed = np.clip(np.rint(np.diff(x)), 0, 511).astype(int)
    points = [
        {
            "way_point_type": 0 if place == 0 else 2 if place == WAY_POINTS - 1 else 1,
            "latitude": round(float(lat[place]) / DEGREES),
            "longitude": round(float(lon[place]) / DEGREES),
            "speed": int(speed[place]),
        }
        for place in range(WAY_POINTS)
    ]
    name = vehicle["id"]
    number = name if isinstance(name, int) and 0 <= name < 1 << 32 else zlib.crc32(str(name).encode())
    change = {} if merged.any() else {"current_state_advised_change": "stay_in_lane"}
    return {"executant_id": number, **change, "submanoeuvres": [{"submanoeuvre_id": 0, "advised_trajectory": points}]}
