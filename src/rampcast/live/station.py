"""One site of the service: takes frames in, tells its state at once, and keeps what is newest of its forecasts."""

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from rampcast.live.alarms import Alarms
from rampcast.live.clock import Clock, Verdict
from rampcast.live.earth import Earth
from rampcast.live.frames import Frame, FrameError, Id, Seen
from rampcast.live.messages import Encoded, encoded, head, kind_name, known
from rampcast.live.tracks import TrackStore, kind_of
from rampcast.live.viewers import Viewers
from rampcast.live.work import Answer
from rampcast.recording.frame_door import frame_door
from rampcast.roads.project import lanes_at
from rampcast.sites import Site
from rampcast.sites.site import NO_LANE

STALE: Final = 1.0  # [s] without a forecast, or a frame, after which the site is stale
MEMORY: Final = 600  # forecasts whose ages and times are kept for quantiles: a minute at 10 Hz


@dataclass(frozen=True)
class Taken:
    """What became of a frame."""

    verdict: Verdict
    rows: int
    epoch: int


@dataclass
class Station:
    """A site, its clock, its vehicles, who watches it, and the newest messages.

    Attributes:
        name: id of the site in addresses.
        site: its geometry.
        earth: from degrees to its plane; None where it has no place on the earth.
        place: its number in the shared memory.
    """

    name: str
    site: Site
    place: int = 0
    earth: Earth | None = None
    clock: Clock = field(default_factory=Clock)
    store: TrackStore = field(default_factory=TrackStore)
    viewers: Viewers = field(default_factory=Viewers)
    alarms: Alarms = field(init=False)
    alarms_published: int = 0  # number of the last one that a broker has
    seq: int = 0
    lost_frames: int = 0
    doubtful_rows: int = 0  # left out: places and lengths that no vehicle of the site has
    forecasts: int = 0
    failures: int = 0
    heard: float | None = None  # [s] monotonic, of the last frame
    forecast_at: float | None = None  # [s] monotonic, of the last forecast
    latest: Encoded | None = None
    degraded: str | None = None
    ages: deque[float] = field(default_factory=lambda: deque(maxlen=MEMORY))
    took: deque[float] = field(default_factory=lambda: deque(maxlen=MEMORY))
    told_by_source: Callable[[], dict[str, Any]] | None = None
    rests: bool = False  # nothing is expected to come: a replay that was stopped
    _source_seq: int | None = None
    _control: dict[str, Any] | None = None
    _advice: dict[Id, str] = field(default_factory=dict)
    _lanes: frozenset[int] = field(init=False)

    def __post_init__(self) -> None:
        self.alarms = Alarms(self.name)
        self._lanes = frozenset(lane.number for lane in self.site.lanes)

    def take(self, frame: Frame) -> Taken:
        """Takes a frame in and tells viewers the state; the caller hands the snapshot on.

        Raises:
            FrameError: it tells of places that the site cannot place.
        """
        arrays = self._arrays(frame.objects)
        self._count_lost(frame.seq)
        verdict = self.clock.judge(float(frame.t_ms))
        self.heard = time.monotonic()
        if not verdict.is_taken:
            return Taken(verdict, 0, self.clock.epoch)
        if verdict is Verdict.JUMPED:
            self.store.clear()
        fresh = self.store.add(frame.t_ms / 1e3, self._believable(arrays))
        if fresh or not frame.objects:
            self.seq += 1
        if verdict is not Verdict.REORDERED:
            self._control = frame.control
            self._advice = {one.id: one.advice for one in frame.objects if one.advice is not None}
        return Taken(verdict, fresh, self.clock.epoch)

    def restart(self) -> None:
        """Forgets all vehicles and begins a new epoch."""
        self.clock.restart()
        self.store.clear()
        self._source_seq = None

    def state(self, t_in_ms: float) -> Encoded:
        """Returns the message that tells where all vehicles of the newest frame are."""
        message = head("state", self.name, seq=self.seq, epoch=self.clock.epoch, t_obs_ms=self.clock.newest)
        message |= {"t_in_ms": t_in_ms, "t_pub_ms": round(1e3 * time.time(), 1), "vehicles": self._vehicles()}
        if self._control is not None:
            message["control"] = self._control
        return encoded(message)

    def note(self, t_in_ms: float) -> dict[str, Any]:
        """Returns what goes with a snapshot to the forecast and back."""
        return {"seq": self.seq, "epoch": self.clock.epoch, "t_obs_ms": self.clock.newest, "t_in_ms": t_in_ms}

    def forecast(self, answer: Answer) -> None:
        """Takes the newest forecast in, and hands it to viewers, unless it is of an epoch that is over."""
        if answer.note["epoch"] != self.clock.epoch:
            return
        self.forecasts += 1
        self.forecast_at, self.degraded = time.monotonic(), answer.degraded
        self.latest = Encoded(answer.json, answer.binary)
        self.ages.append(time.time() - answer.note["t_in_ms"] / 1e3)
        self.took.append(answer.took)
        self.viewers.publish("forecast", self.latest)

    @property
    def stale(self) -> str | None:
        """Returns what is missing for more than a second: "source", "forecaster", or nothing."""
        now = time.monotonic()
        if self.rests:
            return None
        if self.heard is None or now - self.heard > STALE:
            return "source"
        if self.forecast_at is None or now - self.forecast_at > STALE:
            return "forecaster"
        return None

    def status(self, **more: Any) -> dict[str, Any]:
        """Returns the message that tells how the service is."""
        counts = {str(verdict): count for verdict, count in self.clock.counts.items()}
        counts |= {"lost": self.lost_frames, "repeated_rows": self.store.repeated, "id_reuses": self.store.restarted}
        counts["doubtful_rows"] = self.doubtful_rows
        return head(
            "status",
            self.name,
            t_pub_ms=round(1e3 * time.time(), 1),
            epoch=self.clock.epoch,
            stale=self.stale,
            degraded=self.degraded,
            frames=counts,
            forecasts=self.forecasts,
            failures=self.failures,
            viewers=len(self.viewers),
            tick_ms=quantiles(self.took),
            age_ms=quantiles(self.ages),
            **(self.told_by_source() if self.told_by_source else {}),
            **more,
        )

    def _believable(self, arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Returns the rows that can be of this site; those that cannot, and would spoil forecasts, are counted."""
        x, y, length, width = (arrays[name] for name in ("x", "y", "length", "width"))
        found = frame_door(self.site, arrays["vehicle"].tolist(), x, y, length=length, width=width).is_believable
        self.doubtful_rows += int((~found).sum())
        return {name: values[found] for name, values in arrays.items()}

    def _count_lost(self, seq: int | None) -> None:
        """Counts the numbers that are missing between the frames of one source."""
        if seq is None:
            return
        if self._source_seq is not None and 1 < seq - self._source_seq < 1_000:
            self.lost_frames += seq - self._source_seq - 1
        self._source_seq = seq

    def _arrays(self, objects: list[Seen]) -> dict[str, np.ndarray]:
        x, y = self._places(objects)
        lane = [one.lane if one.lane in self._lanes else NO_LANE for one in objects]
        length = [np.nan if one.length is None else one.length for one in objects]
        width = [np.nan if one.width is None else one.width for one in objects]
        return {
            "vehicle": np.array([self.store.number(one.id) for one in objects], dtype=np.int64),
            "x": x,
            "y": y,
            "lane": np.array(lane, dtype=np.int64),
            "length": np.array(length, dtype=np.float32).astype(np.float64),  # as precise as a recording's
            "width": np.array(width, dtype=np.float32).astype(np.float64),
            "kind": np.array([kind_of(one.class_) for one in objects], dtype=np.int64),
        }

    def _places(self, objects: list[Seen]) -> tuple[np.ndarray, np.ndarray]:
        x = np.array([np.nan if one.x is None else one.x for one in objects], dtype=np.float64)
        y = np.array([np.nan if one.y is None else one.y for one in objects], dtype=np.float64)
        there = np.flatnonzero(np.isnan(x))
        if len(there):
            if self.earth is None:
                raise FrameError(f"site {self.name} has no place on the earth: give x and y [m], not lat and lon")
            lat, lon = (np.array([getattr(objects[one], name) for one in there]) for name in ("lat", "lon"))
            x[there], y[there] = self.earth.on_road(lat, lon)
        return x, y

    def _vehicles(self) -> list[dict[str, Any]]:
        """Returns where every vehicle is that was seen just now."""
        rows, speed = self.store.current()
        lane = np.where(rows["lane"] == NO_LANE, lanes_by_place(self.site, rows["y"]), rows["lane"])
        age = np.rint(1e3 * (self.store.newest - rows["time"])).astype(int)
        values = (rows["x"], rows["y"], speed, rows["length"], rows["width"])
        columns = (rows["vehicle"], *(np.round(one, 2) for one in values), lane, rows["kind"], age)
        names = self.store.names()
        found = [
            {
                "id": names.get(number, number), "x": x, "y": known(y), "v": known(v), "lane": lane,
                "length": known(length), "width": known(width), "class": kind_name(kind), "age_ms": age,
            }
            for number, x, y, v, length, width, lane, kind, age in zip(*(one.tolist() for one in columns), strict=True)
        ]  # fmt: skip
        return [one | {"advice": self._advice[one["id"]]} if one["id"] in self._advice else one for one in found]


def lanes_by_place(site: Site, y: np.ndarray) -> np.ndarray:
    """Returns the lanes that are at those y [m]; `NO_LANE` where y is not known."""
    found = np.full(len(y), NO_LANE, dtype=np.int64)
    known = np.isfinite(y)
    if known.any():
        found[known], _ = lanes_at(y[known], site.lanes)
    return found


def quantiles(seconds: deque[float]) -> dict[str, float | None]:
    """Returns the median and the 99 % quantile [ms]."""
    if not seconds:
        return {"p50": None, "p99": None}
    half, most = np.quantile(np.array(seconds), (0.5, 0.99))
    return {"p50": round(1e3 * float(half), 1), "p99": round(1e3 * float(most), 1)}
