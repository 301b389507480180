"""What is known of the vehicles of a site: the rows of the last 5 s, in the order of their times."""

import zlib
from bisect import bisect_left, bisect_right
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from rampcast.horizon import EDGE
from rampcast.live.frames import Id
from rampcast.recording import columns as c
from rampcast.recording.cutting import FASTEST
from rampcast.traffic.moments import SPAN, Rows, select

KEPT: Final = 5.0  # [s] of a vehicle
APART: Final = 0.5 - EDGE  # [s] between the two frames that a speed is told from
CURRENT: Final = 0.25 + EDGE  # [s] that a vehicle stays in the state: sensors see in turn
SLIP: Final = 10.0  # [m] by which a sensor's box may slip; who is farther off than that is another under the same id
TEXTS: Final = 1 << 60  # numbers that stand for ids which are texts begin here, beyond every id that is a number
ARRAYS: Final = ("vehicle", "time", "x", "y", "lane", "length", "width", "kind")


@dataclass(frozen=True)
class Snapshot:
    """The rows of the 4 s up to the newest moment, and what the numbers of its vehicles stand for."""

    rows: Rows
    t0: float
    ids: dict[int, str]


@dataclass
class TrackStore:
    """Rows of the last 5 s of all vehicles of a site.

    Attributes:
        restarted: vehicles whose id was given to another one.
        repeated: rows left out because the vehicle had one at that time already.
    """

    restarted: int = 0
    repeated: int = 0
    _times: list[float] = field(default_factory=list)
    _frames: list[dict[str, np.ndarray]] = field(default_factory=list)
    _last: dict[int, tuple[float, float]] = field(default_factory=dict)
    _begun: dict[int, float] = field(default_factory=dict)
    _numbers: dict[str, int] = field(default_factory=dict)

    def clear(self) -> None:
        """Forgets all vehicles."""
        self._times, self._frames, self._last, self._begun, self._numbers = [], [], {}, {}, {}

    def number(self, vehicle: Id) -> int:
        """Returns the number that stands for an id: itself, if it is one."""
        if isinstance(vehicle, int):
            return vehicle
        if vehicle not in self._numbers:
            number, taken = TEXTS + zlib.crc32(vehicle.encode()), set(self._numbers.values())
            while number in taken:
                number += 1
            self._numbers[vehicle] = number
        return self._numbers[vehicle]

    def add(self, time: float, frame: dict[str, np.ndarray]) -> int:
        """Takes a frame in and returns how many of its rows are new.

        Args:
            time: of the frame [s].
            frame: arrays by the names of `ARRAYS`, without the time; each vehicle once.
        """
        place = bisect_left(self._times, time)
        if place < len(self._times) and self._times[place] == time:
            fresh = ~np.isin(frame["vehicle"], self._frames[place]["vehicle"])
            self.repeated += int((~fresh).sum())
            frame = {name: values[fresh] for name, values in frame.items()}
            there = self._frames[place]
            self._frames[place] = {name: np.concatenate([there[name], frame[name]]) for name in there}
        else:
            self._times.insert(place, time)
            self._frames.insert(place, frame)
        self._note(time, frame)
        self._forget()
        return len(frame["vehicle"])

    def _note(self, time: float, frame: dict[str, np.ndarray]) -> None:
        for vehicle, x in zip(frame["vehicle"].tolist(), frame["x"].tolist(), strict=True):
            before = self._last.get(vehicle)
            if before is not None and abs(x - before[1]) > SLIP + FASTEST * abs(time - before[0]):
                self.restarted += 1
                self._begun[vehicle] = time
            if before is None or time >= before[0]:
                self._last[vehicle] = (time, x)

    def _forget(self) -> None:
        old = bisect_left(self._times, self._times[-1] - KEPT - EDGE)
        if not old:
            return
        del self._times[:old], self._frames[:old]
        oldest = self._times[0]
        self._last = {vehicle: last for vehicle, last in self._last.items() if last[0] >= oldest}
        self._begun = {vehicle: time for vehicle, time in self._begun.items() if time >= oldest}
        self._numbers = {text: number for text, number in self._numbers.items() if number in self._last}

    @property
    def newest(self) -> float:
        """Returns the time of the newest frame [s]."""
        return self._times[-1]

    def current(self) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """Returns the last row of each vehicle that was seen just now, and how fast it came on [m/s].

        NaN is the speed of who was not seen half a second ago.
        """
        first = bisect_left(self._times, self._times[-1] - CURRENT)
        frames, sizes = self._frames[first:], [len(frame["vehicle"]) for frame in self._frames[first:]]
        rows = {name: np.concatenate([frame[name] for frame in frames[::-1]]) for name in frames[0]}
        rows["time"] = np.repeat(self._times[first:][::-1], sizes[::-1])
        _, newest = np.unique(rows["vehicle"], return_index=True)
        rows = {name: values[newest] for name, values in rows.items()}
        return rows, self._speeds(rows)

    def _speeds(self, rows: dict[str, np.ndarray]) -> np.ndarray:
        found = np.full(len(rows["vehicle"]), np.nan)
        place = bisect_right(self._times, self._times[-1] - APART) - 1
        if place < 0:
            return found
        before = self._frames[place]
        _, mine, its = np.intersect1d(rows["vehicle"], before["vehicle"], return_indices=True)
        begun = np.array([self._begun.get(one, -np.inf) for one in rows["vehicle"][mine].tolist()])
        apart = rows["time"][mine] - self._times[place]
        found[mine] = np.where(begun > self._times[place], np.nan, (rows["x"][mine] - before["x"][its]) / apart)
        return found

    def names(self) -> dict[int, str]:
        """Returns what numbers stand for that stand for texts."""
        return {number: text for text, number in self._numbers.items()}

    def snapshot(self) -> Snapshot:
        """Returns the rows of the 4 s up to the newest frame, as `rampcast.traffic.Stream` would have them."""
        first = bisect_left(self._times, self._times[-1] - SPAN - EDGE)
        frames, times = self._frames[first:], self._times[first:]
        sizes = [len(frame["vehicle"]) for frame in frames]
        arrays = {name: np.concatenate([frame[name] for frame in frames]) for name in frames[0]}
        rows = Rows(time=np.repeat(times, sizes), **arrays)
        order = np.lexsort((rows.time, rows.vehicle))
        rows = select(rows, order)
        for vehicle, begun in self._begun.items():
            rows = select(rows, np.flatnonzero((rows.vehicle != vehicle) | (rows.time >= begun)))
        return Snapshot(rows, self._times[-1], self.names())


def kind_of(name: str | None) -> int:
    """Returns the kind of a class as messages name it; a car where it is none that is known."""
    return c.KINDS.index(name) if name in c.KINDS else KINDS.get((name or "").lower(), CAR)


CAR: Final = c.KINDS.index("car")
TRUCK: Final = c.KINDS.index("truck")
MOTORCYCLE: Final = c.KINDS.index("motorcycle")
KINDS: Final = {"bus": TRUCK, "van": CAR, "heavytruck": TRUCK, "lorry": TRUCK, "trailer": TRUCK, "moped": MOTORCYCLE}
