"""Vehicles of I-24 MOTION's json files, checked; the clock of a recording and the rows that vehicles are together.

Each element of the array is one vehicle: arrays of times and of places of the middle of its rear, and its size in feet.
Source of keys, units and place: the schema of I-24 MOTION's reconciled trajectories; see docs/formats/i24.md.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
import polars as pl
from jaxtyping import Float

NOMINAL_STEP = 0.04  # [s] 25 Hz
HOLE = 5  # time steps between two times of a vehicle beyond which nothing is interpolated
ON_FRAME = 0.01  # of a time step that a time may be off its frame: 2 cm at 50 m/s
DAY = 86_400  # [s]
MOST_DAYS = 4  # that one recording may last
LATEST = 1e10  # [s since 1970] the year 2286; milliseconds are more
LARGEST_FLOAT = float(np.finfo(float).max)
LONGEST, WIDEST = 200.0, 60.0  # [ft] of a vehicle
KINDS = {0: "car", 1: "car", 2: "car", 3: "car", 4: "truck", 5: "truck", 6: "motorcycle"}  # coarse_vehicle_class
WEST, EAST = -1, 1  # direction
ROADS = {WEST: "west", EAST: "east"}
LANES = tuple(range(21))  # lane numbers; 0 is off the road
ROWS: Mapping[str, Any] = {  # columns of vehicles' rows: time [s since 1970], places [m], sizes [ft]
    "number": pl.Int32(),
    **dict.fromkeys(("time", "x", "y"), pl.Float64()),
    "lane": pl.Int16(),
    **dict.fromkeys(("v", "a", "length", "width"), pl.Float64()),
    **dict.fromkeys(("class", "direction"), pl.Int8()),
}


@dataclass(frozen=True)
class Keys:
    """The keys of a vehicle in a file of this family.

    Attributes:
        title: of the files, for reports.
        source: the format's name.
        id: of its name, which may lie in an object of its own.
        arrays: of its arrays by our names: x and y, and what else is read.
        unit: of x and y [m].
        lane: of the number of its lane; "" if there is none.
        has_direction: whether it must say its direction; else it is west unless it says another.
    """

    title: str
    source: str
    id: str
    arrays: Mapping[str, str]
    unit: float
    lane: str = ""
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
        values: at these times: x and y of the middle of its rear [m], v [m/s] and a [m/s^2] where the source has them.
        fixed: what does not change: direction, class, length and width [ft], lane; None where not known.
    """

    id: str
    time: Float[np.ndarray, "moment"]
    values: Mapping[str, Float[np.ndarray, "moment"]]
    fixed: Mapping[str, float | int | None]


class Fault(Exception):
    """What is wrong with a vehicle, in words."""


def track_of(value: Any, keys: Keys) -> Track:
    """Returns the vehicle that an element of the array describes.

    Raises:
        Fault: it is not as the keys say.
    """
    if not isinstance(value, dict):
        raise Fault(f"expected an object with the keys of a vehicle, found {_shown(value)}")
    time = _numbers(value, "timestamp")
    if (np.diff(time) <= 0).any():
        at = int(np.argmax(np.diff(time) <= 0))
        raise Fault(f"timestamp, entry {at + 2}: expected growing times, found {time[at + 1]:.2f} after {time[at]:.2f}")
    if not 0 <= time[0] <= time[-1] <= LATEST:
        raise Fault(f"timestamp: expected seconds since 1970, and no milliseconds, found {time[-1]:.0f}")
    arrays = {name: _numbers(value, key, count=len(time)) for name, key in keys.arrays.items()}
    return Track(
        id=_id(value, keys.id),
        time=time,
        values=arrays | {name: arrays[name] * keys.unit for name in ("x", "y")},
        fixed={
            "direction": _choice(value, "direction", (WEST, EAST), None if keys.has_direction else WEST),
            "length": _size(value, "length", LONGEST),
            "width": _size(value, "width", WIDEST),
            "class": _choice(value, "coarse_vehicle_class", tuple(KINDS)),
            "lane": _choice(value, keys.lane, LANES) if keys.lane else None,
        },
    )


def table_of(tracks: Sequence[Track]) -> pl.DataFrame:
    """Returns vehicles, numbered from 1, as rows with the columns of `ROWS`."""
    counts = np.array([len(track.time) for track in tracks], int)
    vehicle = np.repeat(np.arange(len(tracks)), counts)
    columns: dict[str, Any] = {"number": vehicle + 1}
    if tracks:
        columns["time"] = np.concatenate([track.time for track in tracks])
        columns |= {name: np.concatenate([track.values[name] for track in tracks]) for name in tracks[0].values}
        for name in tracks[0].fixed:
            columns[name] = pl.Series([track.fixed[name] for track in tracks], dtype=ROWS[name]).gather(vehicle)
    absent = {name: pl.Series([None], dtype=kind).new_from_index(0, len(vehicle)) for name, kind in ROWS.items()}
    return pl.DataFrame(absent | columns).select(pl.col(name).cast(kind) for name, kind in ROWS.items())


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


def day_of(clock: Clock) -> str:
    """Returns the day of a recording (UTC)."""
    return datetime.fromtimestamp(clock.start + clock.step, UTC).date().isoformat()


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


def _size(value: dict[str, Any], key: str, most: float) -> float | None:
    """Returns a size [ft], of an array of one for each moment the median; None where it is null."""
    found = value.get(key)
    if isinstance(found, list) and found and all(map(_is_number, found)):
        found = float(np.median(found))
    if found is not None and (not _is_number(found) or not 0 <= found <= most):
        raise Fault(f"{key}: expected 0 to {most:g} ft, found {_shown(found)}")
    return None if found is None else float(found)


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
