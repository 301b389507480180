"""Where a rule's knowledge of the future comes from: a model, constant speeds, a shuffled forecast, or the truth."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from rampcast.forecast.forecast import Forecast
from rampcast.forecast.forecaster import Forecaster, forecast_traffic
from rampcast.horizon import EDGE, FUTURE, STEP
from rampcast.recording import columns as c
from rampcast.sites import Site
from rampcast.traffic.moments import SPAN, Rows, traffic_of_rows

AGES: Final = (60.0, 600.0)  # [s] how old a forecast is that a shuffled one is made of
MERGES_AT: Final = 0.5  # of the ramp lane: where constant speeds let ramp vehicles merge


@dataclass
class Past:
    """The frames of the last 4 s of a site.

    Attributes:
        site: the geometry.
        time: of the newest [s].
    """

    site: Site
    time: float = 0.0
    _frames: deque[tuple[float, dict[str, np.ndarray]]] = field(default_factory=deque)

    def add(self, time: float, frame: dict[str, np.ndarray]) -> None:
        """Takes the newest frame in."""
        self.time = time
        self._frames.append((time, frame))
        while self._frames[0][0] < time - SPAN - EDGE:
            self._frames.popleft()

    @property
    def newest(self) -> dict[str, np.ndarray]:
        """Returns the newest frame."""
        return self._frames[-1][1]

    def rows(self, *, near: bool = False) -> Rows:
        """Returns all rows, by vehicle and time.

        Args:
            near: whether only those in the target lane and on the ramp are asked for.
        """
        columns = {
            name: np.concatenate([frame[name] for _, frame in self._frames])
            for name in (c.VEHICLE, c.X, c.Y, c.LANE, c.LENGTH, c.WIDTH, c.KIND)
        }
        time = np.concatenate([np.full(len(frame[c.X]), when) for when, frame in self._frames])
        order = np.lexsort((time, columns[c.VEHICLE]))
        if near:
            order = order[np.isin(columns[c.LANE][order], (self.site.target_lane, *self.site.ramp_lanes))]
        return Rows(time=time[order], **{name: values[order] for name, values in columns.items()})


Futures = Callable[[Past], Forecast]  # what becomes of the traffic of the newest moment


@dataclass
class Model:
    """A fitted forecaster.

    Attributes:
        forecaster: what `rampcast.fit` or `rampcast.load` gave.
        samples: futures of each forecast.
        near: whether only who is in the target lane or on the ramp is forecast, which takes two thirds of the time.
    """

    forecaster: Forecaster
    samples: int
    near: bool = False

    def __call__(self, past: Past) -> Forecast:
        """Returns its forecast."""
        traffic = traffic_of_rows(past.site, past.time, past.rows(near=self.near))
        return forecast_traffic(self.forecaster.model, traffic, samples=self.samples)


def constant_speeds(past: Past) -> Forecast:
    """Returns one future in which all keep their speeds, and ramp vehicles merge in the middle of their lane."""
    frame, site = past.newest, past.site
    ahead = STEP * np.arange(1, FUTURE + 1)
    x = frame[c.X][:, None] + frame[c.V][:, None] * ahead
    on_ramp = site.on_ramp(frame[c.LANE])[:, None]
    merged = on_ramp & (x > site.gore + MERGES_AT * (site.ramp_end - site.gore))
    lane = np.where(merged, site.target_lane, frame[c.LANE][:, None])
    return forecast_of(past, x[:, None].astype(np.float32), lane[:, None])


def forecast_of(past: Past, samples: np.ndarray, lane: np.ndarray) -> Forecast:
    """Returns the forecast of the vehicles of the newest frame that those fronts and lanes are."""
    frame = past.newest
    return Forecast(
        past.site, past.time, frame[c.VEHICLE], frame[c.X], frame[c.LANE], frame[c.LENGTH], samples, lane
    )  # fmt: skip


@dataclass
class Shuffled:
    """Another's forecasts, of the wrong moment and the wrong vehicles: each gets what was forecast of somebody else.

    The forecast of a random moment one to ten minutes ago; of its vehicles in the same kind of lane, one at random.

    Attributes:
        futures: whose.
        stream: of the draws.
    """

    futures: Futures
    stream: np.random.Generator
    _before: deque[Forecast] = field(default_factory=lambda: deque(maxlen=700))

    def __call__(self, past: Past) -> Forecast:
        """Returns the forecast."""
        now = self.futures(past)
        self._before.append(now)
        old = [one for one in self._before if AGES[0] <= now.t0 - one.t0 <= AGES[1] and len(one)]
        if not old or not len(now):
            return now if not len(now) else _standing_order(now, now, self.stream)
        return _standing_order(now, old[int(self.stream.integers(len(old)))], self.stream)


def _standing_order(now: Forecast, other: Forecast, stream: np.random.Generator) -> Forecast:
    """Returns the vehicles of a forecast with the drives of another's."""
    given = np.zeros(len(now), dtype=np.int64)
    for kind in (False, True):
        mine, theirs = np.flatnonzero(now.on_ramp == kind), np.flatnonzero(other.on_ramp == kind)
        theirs = theirs if len(theirs) else np.arange(len(other))
        given[mine] = stream.choice(theirs, len(mine))
    drive = other.samples[given] - other.start[given].astype(np.float32)[:, None, None]
    merged = (other.lane[given] == now.site.target_lane) & now.on_ramp[:, None, None]
    lane = np.where(merged, now.site.target_lane, now.start_lane[:, None, None])
    samples = now.start.astype(np.float32)[:, None, None] + drive
    return replace(now, samples=samples, lane=lane)
