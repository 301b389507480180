"""Vehicles of I-24 MOTION's json files, checked, in metres, and interpolated to frames at equal times.

Each element of the array is one vehicle: arrays of times and of places of the middle of its rear, and its size in feet.
Source of keys, units and place: the schema of I-24 MOTION's reconciled trajectories; see docs/formats/i24.md.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from rampcast.formats.steps.units import FOOT
from rampcast.formats.steps.vehicles import TYPICAL_SIZES
from rampcast.recording import columns as c

NOMINAL_STEP = 0.04  # [s] 25 Hz
HOLE = 5  # time steps between two times of a vehicle beyond which nothing is interpolated
ON_FRAME = 0.01  # of a time step that a time may be off its frame: 2 cm at 50 m/s
DAY = 86_400  # [s]
MOST_DAYS = 4  # that one recording may last
LARGEST_FLOAT = float(np.finfo(float).max)
LONGEST, WIDEST = 200.0, 60.0  # [ft] of a vehicle
KINDS = {0: "car", 1: "car", 2: "car", 3: "car", 4: "truck", 5: "truck", 6: "motorcycle"}  # coarse_vehicle_class
RIGHT = "right"  # distance from the left edge of the carriageway [m]
WEST, EAST = -1, 1  # direction
LANES = tuple(range(21))  # lane numbers; 0 is off the road


@dataclass(frozen=True)
class Layout:
    """How a file of this family is written.

    Attributes:
        title: for reports.
        source: the format's name.
        id, x, y: keys; the id may lie in an object of its own.
        unit: of x and y [m].
        lane: key of the number of a vehicle's lane; "" if there is none.
        extra: arrays that are read as well: our column, and the key.
        has_direction: whether a vehicle must say its direction; else it is west unless it says another.
    """

    title: str
    source: str
    id: str
    x: str
    y: str
    unit: float
    lane: str = ""
    extra: Mapping[str, str] = field(default_factory=dict)
    has_direction: bool = True


@dataclass(frozen=True)
class Clock:
    """The frames of a recording: frame 0 is at `start` [s since 1970], frames are `step` [s] apart."""

    start: float
    step: float


@dataclass(frozen=True)
class Track:
    """One vehicle.

    Attributes:
        id: its name in the source.
        time: [s since 1970], growing.
        x: of the middle of its rear, grows to the east [m].
        right: how far right of the left edge of its carriageway [m].
        direction: of travel, -1 west, 1 east.
        length, width: [m]; NaN where not known.
        kind: of our kinds.
        lane: the numbers of its lanes, 0 off the road; None where the source has none.
        extra: other arrays, by our names; NaN where not known.
    """

    id: str
    time: Float[np.ndarray, "moment"]
    x: Float[np.ndarray, "moment"]
    right: Float[np.ndarray, "moment"]
    direction: int
    length: float
    width: float
    kind: str
    lane: Int[np.ndarray, "moment"] | None
    extra: Mapping[str, Float[np.ndarray, "moment"]]


@dataclass(frozen=True)
class Sampled:
    """A vehicle at the frames of its recording.

    Attributes:
        track: the vehicle.
        frames: growing.
        values: at the frames: `x` of the front centre, `right` [m], and the `extra` ones.
        lane: the number of the lane at the nearest time; None where the source has none.
        between: how many frames lay between two times of the source.
        off: how many times of the source lay on no frame of their own.
    """

    track: Track
    frames: Int[np.ndarray, "row"]
    values: Mapping[str, Float[np.ndarray, "row"]]
    lane: Int[np.ndarray, "row"] | None
    between: int
    off: int


class Fault(Exception):
    """What is wrong with a vehicle, in words."""


def track_of(value: Any, layout: Layout) -> Track:
    """Returns the vehicle that an element of the array describes.

    Raises:
        Fault: it is not as the layout says.
    """
    if not isinstance(value, dict):
        raise Fault(f"expected an object with the keys of a vehicle, found {_shown(value)}")
    time = _numbers(value, "timestamp")
    if (np.diff(time) <= 0).any():
        at = int(np.argmax(np.diff(time) <= 0))
        raise Fault(f"timestamp, entry {at + 2}: expected growing times, found {time[at + 1]:.2f} after {time[at]:.2f}")
    x, y = (_numbers(value, key, count=len(time)) * layout.unit for key in (layout.x, layout.y))
    return Track(
        id=_id(value, layout.id),
        time=time,
        x=x,
        right=y if np.median(y) >= 0 else -y,  # y of the eastbound carriageway may be counted below zero
        direction=_choice(value, "direction", (WEST, EAST), None if layout.has_direction else WEST),
        length=_size(value, "length", LONGEST),
        width=_size(value, "width", WIDEST),
        kind=KINDS[_choice(value, "coarse_vehicle_class", tuple(KINDS))],
        lane=np.full(len(time), _choice(value, layout.lane, LANES)) if layout.lane else None,
        extra={name: _numbers(value, key, count=len(time)) for name, key in layout.extra.items()},
    )


def clock_of(tracks: Sequence[Track]) -> Clock:
    """Returns the clock of a recording, told from the longest of these of its vehicles: its times are on frames.

    Frame 0 is at midnight (UTC), to half a time step.
    """
    return clock_of_times(max(tracks, key=lambda track: len(track.time)).time)


def clock_of_times(time: Float[np.ndarray, "moment"]) -> Clock:
    """Returns the clock of a recording, as `clock_of`, from the times of one vehicle [s since 1970]."""
    steps = np.sort(np.diff(time))
    step = round(float(steps[(len(steps) - 1) // 2]), 3) if len(steps) else NOMINAL_STEP  # the lower of two medians
    step = step if step > 0 else NOMINAL_STEP
    since = time[0] - time[0] // DAY * DAY
    return Clock(float(time[0] - round(since / step) * step), step)


def sampled(track: Track, clock: Clock) -> Sampled:
    """Returns the vehicle at the frames of a recording.

    Between two times it is interpolated linearly; in holes of more than 5 time steps there are no frames.

    Raises:
        Fault: a time is not of this recording.
    """
    check_times(track.time[:1], track.time[-1:], clock)
    place = (track.time - clock.start) / clock.step
    frames = _known_frames(place)
    before = np.clip(np.searchsorted(place, frames + ON_FRAME, side="right") - 1, 0, len(place) - 1)
    after = np.minimum(before + 1, len(place) - 1)
    between = int((np.abs(place[before] - frames) > ON_FRAME).sum())
    nearest = np.where(frames - place[before] <= place[after] - frames, before, after)
    length = TYPICAL_SIZES[track.kind][0] if np.isnan(track.length) else track.length
    values = {c.X: track.x + track.direction * length, RIGHT: track.right, **track.extra}
    return Sampled(
        track=track,
        frames=frames.astype(np.int32),
        values={name: np.interp(frames, place, array) for name, array in values.items()},
        lane=None if track.lane is None else track.lane[nearest],
        between=between,
        off=len(place) - (len(frames) - between),
    )


def check_times(first: Float[np.ndarray, "vehicle"], last: Float[np.ndarray, "vehicle"], clock: Clock) -> None:
    """Raises Fault if a vehicle's first or last time [s since 1970] is not of a recording."""
    is_before = (first - clock.start) / clock.step < -ON_FRAME
    is_other = is_before | ((last - clock.start) / clock.step > MOST_DAYS * DAY / clock.step)
    if is_other.any():
        at = int(is_other.argmax())
        raise Fault(
            f"timestamp: expected {MOST_DAYS} days at most from the midnight before the first vehicle's, found "
            f"{first[at]:.2f} to {last[at]:.2f} where that was {clock.start:.2f}"
        )


def _known_frames(place: Float[np.ndarray, "moment"]) -> Float[np.ndarray, "row"]:
    """Returns the frames at which a vehicle is seen, or between two moments that are not too far apart."""
    is_held = np.append(np.diff(place) <= HOLE, False)
    first = np.ceil(place - ON_FRAME)
    last = np.floor(np.where(is_held, np.append(place[1:], place[-1]), place) + ON_FRAME)
    frames = first[:, None] + np.arange(HOLE + 2)  # not all from the first to the last: a hole may be of days
    return np.unique(frames[frames <= last[:, None]])


def _numbers(value: dict[str, Any], key: str, *, count: int | None = None) -> Float[np.ndarray, "moment"]:
    found = _present(value, key)
    if not isinstance(found, list):
        raise Fault(f"{key}: expected an array of numbers, found {_shown(found)}")
    if count is not None and len(found) != count:
        raise Fault(f"{key}: expected {count:,} entries, as many as timestamp has, found {len(found):,}")
    if not found:
        raise Fault(f"{key}: expected at least one entry, the array is empty")
    try:
        array = np.array(found)
    except ValueError:  # arrays of different lengths
        array = np.array(found, dtype=object)
    if array.dtype.kind in "iuf" and array.ndim == 1 and np.isfinite(array).all():
        return array.astype(float)
    at = next((index for index, one in enumerate(found) if not _is_number(one)), None)
    if at is not None:
        raise Fault(f"{key}, entry {at + 1}: expected a finite number, found {_shown(found[at])}")
    return np.array(found, dtype=float)  # whole numbers of many digits


def _size(value: dict[str, Any], key: str, most: float) -> float:
    """Returns a size [m]; NaN where it is null or zero."""
    found = value.get(key)
    if found is None:
        return np.nan
    if not _is_number(found) or not 0 <= found <= most:
        raise Fault(f"{key}: expected 0 to {most:g} ft, found {_shown(found)}")
    return found * FOOT if found else np.nan


def _choice(value: dict[str, Any], key: str, known: tuple[int, ...], default: int | None = None) -> int:
    found = _present(value, key) if default is None else value.get(key, default)
    if not _is_number(found) or found not in known:
        raise Fault(f"{key}: expected one of {', '.join(map(str, known))}, found {_shown(found)}")
    return int(found)


def _id(value: dict[str, Any], key: str) -> str:
    found = _present(value, key)
    if isinstance(found, dict) and len(found) == 1:  # {"$oid": "..."} as databases write it
        (found,) = found.values()
    if not isinstance(found, str | int) or found == "":
        raise Fault(f"{key}: expected a name, found {_shown(found)}")
    return str(found)


def _present(value: dict[str, Any], key: str) -> Any:
    if key not in value:
        raise Fault(f"no key '{key}'; the keys are {', '.join(key[:30] for key in list(value)[:30])}")
    return value[key]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < LARGEST_FLOAT


def _shown(value: Any) -> str:
    if isinstance(value, list | dict):
        return f"{'an array' if isinstance(value, list) else 'an object'} of {len(value)}"
    return "null" if value is None else repr(value)[:40]
