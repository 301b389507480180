"""A recording as a source: played at any speed, stopped, stepped, and moved, as one plays a film."""

import asyncio
import time
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, Any, Final

import msgspec
import numpy as np
import polars as pl

from rampcast.arguments import expected
from rampcast.errors import RecordingError
from rampcast.live.frames import VERSION, Frame, Seen
from rampcast.live.service import Service
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.traffic.moments import SPAN

SLOWEST, QUICKEST = 0.05, 100.0  # times as quick as it was recorded
CATCH_UP: Final = 1.0  # [s] behind its own clock after which a replay goes on from where it is
LOOK: Final = 0.1  # [s] between two looks at whether forecasts can be had
MOST_ROWS: Final = 200_000  # of one answer


@dataclass
class Replay:
    """Plays a window of a recording into a site.

    Attributes:
        recording: raw.
        station: id of the site in the service.
        window: name of the window.
        speed: times as quick as it was recorded.
        playing: whether it goes on by itself.
        repeats: whether it begins anew at its end.
        waits: whether it begins when forecasts can be had, not before.
        at: number of the next frame to play.
    """

    recording: Recording
    station: str
    window: str = ""
    speed: float = 1.0
    playing: bool = True
    repeats: bool = False
    waits: bool = False
    at: int = 0
    _frames: "Frames" = field(init=False, repr=False)
    _times: list[float] = field(default_factory=list, repr=False)
    _changed: asyncio.Event = field(default_factory=asyncio.Event, repr=False)
    _service: Service | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        recording = expected(Recording, self.recording, name="recording", advice="rc.read makes one of files")
        if recording.is_smoothed:
            raise RecordingError("a smoothed recording knows what comes: replay the raw one, as `rc.read` returns it")
        self.window = self.window or recording.names[0]
        self.recording = recording.window(self.window)
        self._frames = Frames(self.recording)
        self._times = self._frames.t_ms

    async def run(self, service: Service) -> None:
        """Plays until its end, or for ever if it repeats; waits where it is stopped, or at its end."""
        self._service = service
        service.stations[self.station].told_by_source = lambda: {"replay": self.state}
        while self.waits and not service.is_ready:
            await asyncio.sleep(LOOK)
        begun, first = time.monotonic(), self.at
        while True:
            if not self.playing or self.at >= len(self._frames):
                self._tell()
                await self._wait(None)
                begun, first = time.monotonic(), self.at
                continue
            due = begun + (self._times[self.at] - self._times[first]) / 1e3 / self.speed
            late = time.monotonic() - due
            if late < 0 and await self._wait(-late):
                begun, first = time.monotonic(), self.at
                continue
            if late > CATCH_UP:
                begun, first = time.monotonic(), self.at
            self._play_one()
            await asyncio.sleep(0)

    def control(self, action: str, value: float | None = None) -> dict[str, Any]:
        """Does what a viewer asks for and returns the state after it.

        Args:
            action: "play", "pause", "step" (value: frames, back if below 0), "seek" (value: t_obs_ms), or "speed".
            value: see there.

        Raises:
            RecordingError: there is no such action, or the value is not what it takes.
        """
        actions: dict[str, Callable[[float | None], None]]
        actions = {"play": self._go, "pause": self._stop, "step": self.step, "seek": self.seek, "speed": self._hurry}
        if action not in actions:
            raise RecordingError(f"action: expected one of {', '.join(actions)}, got {action!r}")
        if value is not None and not np.isfinite(value):
            raise RecordingError(f"value: expected a finite number, got {value}")
        actions[action](value)
        self._changed.set()
        self._tell()
        return self.state

    @property
    def state(self) -> dict[str, Any]:
        """Returns where the replay is."""
        return {
            "window": self.window,
            "playing": self.playing and self.at < len(self._frames),
            "speed": self.speed,
            "t_obs_ms": self._times[max(self.at - 1, 0)],
            "first_ms": self._times[0],
            "last_ms": self._times[-1],
            "step_ms": round(1e3 * self.recording.time_step, 3),
            "ended": self.at >= len(self._frames),
        }

    def step(self, count: float | None = None) -> None:
        """Stops, and moves by so many frames: one on if none is told."""
        self._stop(None)
        count = 1 if count is None else int(count)
        if count == 1 and self.at < len(self._frames):
            self._play_one()
        elif count != 1:
            self.seek(self._times[int(np.clip(self.at - 1 + count, 0, len(self._times) - 1))])

    def seek(self, t_obs_ms: float | None) -> None:
        """Moves to the first frame at or after that time, and plays the 4 s up to it at once."""
        if t_obs_ms is None:
            raise RecordingError("seek: expected value, the time to go to [ms]")
        target = min(bisect_left(self._times, t_obs_ms), len(self._times) - 1)
        self.at = bisect_left(self._times, self._times[target] - 1e3 * SPAN)
        if self._service is not None:
            self._service.stations[self.station].restart()
            while self.at <= target:
                self._play_one(last=self.at == target)
        self._changed.set()

    def merges(self) -> list[dict[str, Any]]:
        """Returns when and where vehicles came from a ramp lane into the target lane: t_obs_ms, id, x [m]."""
        site, tracks = self.recording.site, self.recording.tracks.sort(c.VEHICLE, c.FRAME)
        before = pl.col(c.LANE).shift(1).over(c.VEHICLE)
        found = tracks.filter(before.is_in(site.ramp_lanes) & (pl.col(c.LANE) == site.target_lane)).sort(c.FRAME)
        step = 1e3 * self.recording.time_step
        return [
            {"t_obs_ms": round(frame * step, 3), "id": vehicle, "x": round(x, 2)}
            for vehicle, frame, x in found.select(c.VEHICLE, c.FRAME, c.X).iter_rows()
        ]

    def truth(self, begin_ms: float, end_ms: float, every_ms: float) -> dict[str, list[list[float]]]:
        """Returns what vehicles did: of each id its rows of t_obs_ms, x, y [m] and lane."""
        first, last = bisect_left(self._times, begin_ms), bisect_left(self._times, end_ms + 0.5)
        stride = max(round(every_ms / (1e3 * self.recording.time_step)), 1)
        found: dict[str, list[list[float]]] = {}
        rows = 0
        for frame in (self._frames[place] for place in range(first, last, stride)):
            rows += len(frame.objects)
            if rows > MOST_ROWS:
                break
            for one in frame.objects:
                row = [frame.t_ms, round(one.x or 0.0, 2), round(one.y or 0.0, 2), one.lane or 0]
                found.setdefault(str(one.id), []).append(row)
        return found

    def _go(self, _: float | None) -> None:
        if self.at >= len(self._frames):
            self.at = 0
            if self._service is not None:
                self._service.stations[self.station].restart()
        self.playing = True

    def _stop(self, _: float | None) -> None:
        self.playing = False

    def _hurry(self, value: float | None) -> None:
        if value is None or not SLOWEST <= value <= QUICKEST:
            raise RecordingError(f"speed: expected a value from {SLOWEST:g} to {QUICKEST:g}, got {value}")
        self.speed = float(value)

    def _play_one(self, *, last: bool = True) -> None:
        assert self._service is not None
        station, frame = self._service.stations[self.station], self._frames[self.at]
        self.at += 1
        if last:
            self._service.take(station, frame)
        else:
            station.take(frame)
        if self.at >= len(self._frames) and self.repeats:
            self.at = 0
            station.restart()

    async def _wait(self, seconds: float | None) -> bool:
        """Returns whether something was changed within that time."""
        self._changed.clear()
        try:
            async with asyncio.timeout(seconds):
                await self._changed.wait()
        except TimeoutError:
            return False
        return True

    def _tell(self) -> None:
        if self._service is not None:
            station = self._service.stations[self.station]
            station.rests = not self.state["playing"]
            self._service.say(station)


class Control(msgspec.Struct):
    """What a viewer asks of a replay; see `Replay.control`."""

    action: Annotated[str, msgspec.Meta(max_length=16)]
    value: float | None = None


class Frames:
    """The frames of a window, those without vehicles too, as messages would bring them, each made when it is asked."""

    def __init__(self, recording: Recording) -> None:
        rows = recording.tracks.sort(c.FRAME, c.VEHICLE)
        frame = rows[c.FRAME].to_numpy()
        numbers = np.arange(frame[0], frame[-1] + 1)
        self.t_ms = np.round(1e3 * numbers * recording.time_step, 6).tolist()
        self._bounds = np.searchsorted(frame, np.append(numbers, numbers[-1] + 1))
        self._rows = rows.select(c.VEHICLE, c.X, c.Y, c.LENGTH, c.WIDTH, c.KIND, c.LANE)

    def __len__(self) -> int:
        return len(self.t_ms)

    def __getitem__(self, place: int) -> Frame:
        rows = self._rows[int(self._bounds[place]) : int(self._bounds[place + 1])]
        seen = [
            Seen(id=vehicle, x=x, y=y, length=length, width=width, class_=kind, lane=lane)
            for vehicle, x, y, length, width, kind, lane in rows.iter_rows()
        ]
        return Frame(v=VERSION, t_ms=self.t_ms[place], seq=place, objects=seen)
