"""A motorway with metered on-ramps for SUMO: room for queues before and beside it, a stop line on each ramp.

    main_0 -> merge_0 -> main_1 [-> merge_1 -> main_2 ...]            main road, every lane
    queue_0 -> ramp_0 -^                                              one lane, joins `merge_0` as its rightmost lane

The stop line with its light stands between `queue_k` and `ramp_k`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
import polars as pl

from rampcast.simulate.demand import draw_drivers, write_routes
from rampcast.simulate.drivers import Drivers
from rampcast.simulate.network import RAMP_SPEED, element, write_files
from rampcast.sites import Site
from rampcast.sites.site import LANE_WIDTH, Lane

VIEW: Final = 300.0  # [m] before the gore where the section that is watched begins; x = 0
BEHIND: Final = 250.0  # [m] of it after the end of the ramp lane
STORE: Final = 300.0  # [m] room for the queue on the ramp, some 40 cars
STOP_LINE: Final = 80.0  # [m] before the gore: room to reach 15 m/s at 1.5 m/s^2
SENSOR_BEFORE, SENSOR_AFTER = 150.0, 100.0  # [m] of the sensors before the gore and after the end of the ramp lane
SENSOR_PERIOD: Final = 10.0  # [s]

Profile = Sequence[tuple[float, float]]  # (time [s], flow [vehicles/h]), linear in between


@dataclass(frozen=True)
class Corridor:
    """The geometry.

    Attributes:
        lanes: of the main road.
        ramps: on-ramps along it.
        ramp_lane: length of the lane in which ramp vehicles run beside the main road [m].
        spacing: from gore to gore [m].
        approach: from the source to the first section [m].
        onward: after the last section [m].
        speed_limit: [m/s].
    """

    lanes: int = 2
    ramps: int = 1
    ramp_lane: float = 200.0
    spacing: float = 1500.0
    approach: float = 1500.0
    onward: float = 400.0
    speed_limit: float = 27.78

    def gore(self, ramp: int = 0) -> float:
        """Returns where the lane of a ramp begins [m]."""
        return VIEW + ramp * self.spacing

    @property
    def site(self) -> Site:
        """Returns the section around the first ramp as a site; lane 1 is the leftmost."""
        n = self.lanes
        centres = [-(k + 0.5) * LANE_WIDTH for k in range(n + 1)]
        end = self.gore() + self.ramp_lane
        return Site(
            name="corridor",
            title="Metered on-ramp (SUMO)",
            simulated=True,
            length=end + BEHIND,
            speed_limit=self.speed_limit,
            lanes=tuple(Lane(k + 1, "main" if k < n else "ramp", y) for k, y in enumerate(centres)),
            gore=self.gore(),
            ramp_end=end,
            merge_zone=(self.gore(), end),
            target_lane=n,
            lane_line=((0.0, -n * LANE_WIDTH), (end + BEHIND, -n * LANE_WIDTH)),
        )

    @property
    def starts(self) -> dict[str, float]:
        """Returns where each edge of the main road begins, in driving order, and its end as "sink" [m]."""
        found = {"main_0": -self.approach}
        for ramp in range(self.ramps):
            found[f"merge_{ramp}"] = self.gore(ramp)
            found[f"main_{ramp + 1}"] = self.gore(ramp) + self.ramp_lane
        return found | {"sink": self.gore(self.ramps - 1) + self.ramp_lane + BEHIND + self.onward}

    @property
    def routes(self) -> dict[str, list[str]]:
        """Returns the edges of each route by its name: "main", "ramp_0", ..."""
        edges = [name for name in self.starts if name != "sink"]
        ramps = {
            f"ramp_{k}": [f"queue_{k}", f"ramp_{k}", *edges[edges.index(f"merge_{k}") :]] for k in range(self.ramps)
        }
        return {"main": edges, **ramps}


def write_corridor(corridor: Corridor, folder: Path) -> Path:
    """Writes the network into a folder with SUMO's netconvert, and sensors.xml beside it; returns its path."""
    starts = corridor.starts
    names = list(starts)
    nodes = [element("node", id=name, x=x, y=0) for name, x in starts.items()]
    edges, joints = [], []
    for name, after in pairwise(names):
        lanes = corridor.lanes + name.startswith("merge")
        values = {"from": name, "to": after, "numLanes": lanes, "length": starts[after] - starts[name]}
        edges.append(element("edge", id=name, speed=corridor.speed_limit, priority=2, **values))
        if after != "sink":
            off = (int(after.startswith("merge")), int(name.startswith("merge")))
            joints += [(name, after, lane + off[1], lane + off[0]) for lane in range(corridor.lanes)]
    for ramp in range(corridor.ramps):
        gore = corridor.gore(ramp)
        for name, x, kind in (("source", STOP_LINE + STORE, "priority"), ("line", STOP_LINE, "traffic_light")):
            nodes.append(element("node", id=f"{name}_{ramp}", x=gore - x, y=-0.3 * x, type=kind))
        for name, begin, end, length in (
            (f"queue_{ramp}", f"source_{ramp}", f"line_{ramp}", STORE),
            (f"ramp_{ramp}", f"line_{ramp}", f"merge_{ramp}", STOP_LINE),
        ):
            values = {"from": begin, "to": end, "numLanes": 1, "length": length}
            edges.append(element("edge", id=name, speed=RAMP_SPEED, priority=1, **values))
        joints += [(f"queue_{ramp}", f"ramp_{ramp}", 0, 0), (f"ramp_{ramp}", f"merge_{ramp}", 0, 0)]
    connections = [element("connection", **{"from": a, "to": b, "fromLane": i, "toLane": k}) for a, b, i, k in joints]
    (folder / "sensors.xml").write_text(_sensors(corridor), encoding="utf-8")
    return write_files({"nodes": nodes, "edges": edges, "connections": connections}, folder)


def sensors(corridor: Corridor) -> dict[str, tuple[str, float]]:
    """Returns the edge of each row of sensors by its name, and how far along it stands [m]."""
    starts, found = corridor.starts, {}
    for ramp in range(corridor.ramps):
        before, after = f"main_{ramp}", f"main_{ramp + 1}"
        found[f"before_{ramp}"] = (before, corridor.gore(ramp) - SENSOR_BEFORE - starts[before])
        found[f"after_{ramp}"] = (after, SENSOR_AFTER)
    return found


def _sensors(corridor: Corridor) -> str:
    rows = [
        element(
            "inductionLoop",
            id=f"{name}_{lane}", lane=f"{edge}_{lane}", pos=place, period=SENSOR_PERIOD, file="/dev/null",
        )
        for name, (edge, place) in sensors(corridor).items()
        for lane in range(corridor.lanes)
    ]  # fmt: skip
    return "<additional>" + "".join(rows) + "</additional>"


def draw_demand(
    corridor: Corridor,
    demand: Mapping[str, Profile],
    *,
    shares: tuple[float, float, float],
    drivers: Drivers,
    seed: int,
) -> pl.DataFrame:
    """Returns one row per vehicle in order of departure.

    Args:
        corridor: the geometry.
        demand: flow over time of each route; departures are a Poisson process of that rate.
        shares: of motorcycles, cars and trucks; they sum to 1.
        drivers: who may drive.
        seed: of all draws.
    """
    tables = []
    for number, (route, profile) in enumerate(demand.items()):
        streams = (np.random.default_rng([seed, number, key]) for key in range(100))
        depart = _departures(profile, next(streams))
        lanes = corridor.lanes if route == "main" else 1
        tables.append(draw_drivers(streams, depart, route=route, lanes=lanes, shares=shares, drivers=drivers))
    return pl.concat(tables).sort("depart", maintain_order=True)


def _departures(profile: Profile, stream: np.random.Generator) -> np.ndarray:
    time, flow = np.array(profile).T
    grid = np.arange(time[0], time[-1] + 1.0)
    expected = np.append(0.0, np.cumsum(np.interp(grid, time, flow)[:-1] / 3600.0))
    count = int(2 * expected[-1]) + 50
    arrivals = np.cumsum(stream.exponential(1.0, count))
    return np.round(np.interp(arrivals[arrivals < expected[-1]], expected, grid), 1)


def write_demand(corridor: Corridor, vehicles: pl.DataFrame, path: Path, *, drivers: Drivers) -> None:
    """Writes SUMO's file of routes, drivers and vehicles."""
    write_routes(vehicles, corridor.routes, path, drivers=drivers)
