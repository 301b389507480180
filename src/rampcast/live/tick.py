"""The tick: from the newest snapshot of a site to the forecast of all its vehicles, as a message."""

import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rampcast.forecast.forecaster import Forecaster
from rampcast.forecast.online import NEW, Online
from rampcast.live.degrading import Degrading
from rampcast.live.messages import MILLIMETRES, Encoded, encoded_forecast, head, kind_name, known
from rampcast.live.told import vehicles_of
from rampcast.live.tracks import Snapshot
from rampcast.sites import Site
from rampcast.traffic.moments import Traffic, traffic_of_rows


@dataclass
class Tick:
    """Forecasts one site, moment after moment.

    Attributes:
        name: id of the site.
        site: its geometry.
        forecaster: what `fit` returned.
        recalibrates: whether bands are widened or narrowed by what came true.
        degrading: what is left out when there is more to do than time.
    """

    name: str
    site: Site
    forecaster: Forecaster
    recalibrates: bool
    degrading: Degrading = field(default_factory=Degrading)
    _online: Online = field(init=False)
    _epoch: int | None = None

    def __post_init__(self) -> None:
        self._online = Online(self.forecaster, self.site, recalibration=NEW if self.recalibrates else None)

    def forecast(self, snapshot: Snapshot, note: dict[str, Any]) -> tuple[Encoded, dict[str, Any]]:
        """Returns the message of a forecast, and what the service keeps of it.

        Args:
            snapshot: rows up to a moment.
            note: seq, epoch, t_obs_ms and t_in_ms of the frame.
        """
        if note["epoch"] != self._epoch:
            self._online.reset()
            self._epoch = note["epoch"]
        began = time.perf_counter()
        traffic = traffic_of_rows(self.site, snapshot.t0, snapshot.rows)
        forecast = self._online.forecast(traffic, samples=self.degrading.samples)
        vehicles = vehicles_of(forecast, states(traffic, snapshot.ids), snapshot.ids)
        took = time.perf_counter() - began
        message = head("forecast", self.name, seq=note["seq"], epoch=note["epoch"], t_obs_ms=note["t_obs_ms"])
        message |= {
            "t_in_ms": note["t_in_ms"],
            "t_pub_ms": round(1e3 * time.time(), 1),
            "model": self.forecaster.training and "rampcast",
            "samples": forecast.samples.shape[1],
            "degraded": self.degrading.told,
            "took_ms": round(1e3 * took, 1),
        }
        return encoded_forecast(message, vehicles), {"took": took, "risks": risks(vehicles, self.site.gore)}


def states(traffic: Traffic, names: dict[int, str]) -> dict[int, dict[str, Any]]:
    """Returns what is known of each vehicle at t0, by its number."""
    number = traffic.vehicle.tolist()
    x, y, v = (np.round(values[:, -1], MILLIMETRES).tolist() for values in (traffic.x, traffic.y, traffic.v))
    length, width = (np.round(values, 2).tolist() for values in (traffic.length, traffic.width))
    age = np.rint(1e3 * traffic.age).astype(int).tolist()
    columns = zip(number, x, y, v, traffic.lane.tolist(), length, width, traffic.kind.tolist(), age, strict=True)
    return {
        one[0]: {
            "id": names.get(one[0], one[0]),
            "x": one[1],
            "y": known(one[2]),
            "v": known(one[3]),
            "lane": one[4],
            "length": known(one[5]),
            "width": known(one[6]),
            "class": kind_name(one[7]),
            "age_ms": one[8],
        }
        for one in columns
    }


def risks(vehicles: list[dict[str, Any]], gore: float) -> list[tuple[Any, float, float, float | None, float]]:
    """Returns of each vehicle what alarms look at: id, p(ttc), p(drac) within 5 s, p(merged) at the end, x [m].

    Who has not come to the gore yet cannot merge, and is waited for by nobody: its p(merged) is None.
    """
    return [
        (
            one["id"],
            one["conflicts"]["ttc_5s"],
            one["conflicts"]["drac_5s"],
            None if one["p_merged"] is None or one["x"] < gore else round(float(one["p_merged"][-1]), 3),
            one["x"],
        )
        for one in vehicles
    ]
