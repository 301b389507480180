"""One run, as a row of numbers; and, if asked, what was driven."""

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl

from rampcast.control.controller import Controller
from rampcast.control.futures import Futures, Model, Shuffled, constant_speeds
from rampcast.control.loop import CAR_AND_GAP, Loop, Moment
from rampcast.control.measures import joined, safety_measures, trip_measures
from rampcast.control.truth import Truth
from rampcast.files import write_whole
from rampcast.recording import columns as c
from rampcast.simulate.corridor import SENSOR_PERIOD, STORE
from rampcast.simulate.network import RAMP_SPEED
from rampcast.simulate.plant import Plant, Scenario, driving

FULL_RAMP: Final = 0.95  # of its room: the queue of a ramp has reached the street
KEPT_EVERY: Final = 1.0  # [s] rows of a run that is kept for its picture
Load = Callable[[], Any]


@dataclass
class Watch:
    """What is counted while a run goes on.

    Attributes:
        frames: the view at each step.
        outflow: vehicles/h behind the last merge, for each period of the sensors: time [s], flow.
        waits: on the ramps, of those who passed a stop line [s].
        spillback: time in which the queue of some ramp reached the street [s].
        teleports, collisions: faults of the simulation.
    """

    frames: list[tuple[float, dict[str, np.ndarray]]] = field(default_factory=list)
    outflow: list[tuple[float, float]] = field(default_factory=list)
    waits: list[float] = field(default_factory=list)
    spillback: float = 0.0
    teleports: int = 0
    collisions: int = 0
    _since: dict[str, float] = field(default_factory=dict)

    def look(self, plant: Plant, moment: Moment, number: int) -> None:
        """Looks at one step."""
        corridor, dt = plant.scenario.corridor, plant.scenario.step
        self.frames.append((moment.time, moment.frame))
        queues = [plant.waiting(ramp) for ramp in range(corridor.ramps)]
        self.spillback += dt * any(len(queue) > FULL_RAMP * STORE / CAR_AND_GAP for queue in queues)
        there = {name for queue in queues for name in queue}
        for name in there - self._since.keys():
            self._since[name] = moment.time
        for name in self._since.keys() - there:
            self.waits.append(moment.time - self._since.pop(name) - STORE / RAMP_SPEED)
        self.teleports += plant.sumo.simulation.getStartingTeleportNumber()
        self.collisions += plant.sumo.simulation.getCollidingVehiclesNumber()
        if number % round(SENSOR_PERIOD / dt) == 0:
            self.outflow.append((moment.time, plant.sensed(f"after_{corridor.ramps - 1}").flow))

    def mean_outflow(self, peak: tuple[float, float]) -> float:
        """Returns the mean flow behind the last merge between two times [vehicles/h]."""
        return float(np.mean([flow for when, flow in self.outflow if peak[0] <= when <= peak[1]]))

    def faults(self) -> dict[str, int]:
        """Returns how often SUMO did what no vehicle can."""
        return {"teleports": self.teleports, "collisions": self.collisions}

    def longest_wait(self, time: float) -> float:
        """Returns the longest wait before a stop line, of who still stands there too [s]."""
        standing = [time - since - STORE / RAMP_SPEED for since in self._since.values()]
        return max([0.0, *self.waits, *standing])


def futures_of(controller: Controller, load: Load, *, samples: int, seed: int, plant: Plant) -> Futures | None:
    """Returns where a controller knows the future from.

    Args:
        controller: see there.
        load: gives the forecaster, if it is needed.
        samples: futures of each forecast.
        seed: of what is shuffled.
        plant: whose future it is.
    """
    near = controller.rule in ("gap_release", "gap_advice")  # the other lanes are not asked about
    match controller.knows:
        case "nothing":
            return None
        case "constant":
            return constant_speeds
        case "model":
            return Model(load(), samples, near)
        case "shuffled":
            return Shuffled(Model(load(), samples, near), np.random.default_rng([seed, 11]))
    return Truth(plant)


def measured(
    scenario: Scenario,
    controller: Controller,
    *,
    load: Load,
    samples: int = 25,
    peak: tuple[float, float],
    keep: Path | None = None,
) -> dict[str, Any]:
    """Returns the numbers of one run; docs/control.md says what each is.

    Args:
        scenario: what is driven.
        controller: who controls it.
        load: gives the forecaster, if it is needed.
        samples: futures of each forecast.
        peak: from when to when the outflow is measured [s].
        keep: file for rows of the target lane and the ramp, once a second; or None.
    """
    began = time.perf_counter()
    watch = Watch()
    with tempfile.TemporaryDirectory(prefix="rampcast-") as name:
        with driving(scenario, trips=(trips := Path(name) / "trips.xml")) as plant:
            futures = futures_of(controller, load, samples=samples, seed=scenario.seed, plant=plant)
            _drive(Loop(plant, controller, futures, seed=scenario.seed), watch)
            spent, routes, end = plant.spent, plant.routes, plant.time
        found = trip_measures(trips, set(scenario.demand) - {"main"}, routes)
    rows = joined(watch.frames)
    if keep is not None:
        _keep(rows, scenario, keep)
    return {
        "total_time": spent / 3600.0,
        **found,
        "longest_ramp_wait": watch.longest_wait(end),
        "spillback": watch.spillback,
        "outflow": watch.mean_outflow(peak),
        **safety_measures(rows, scenario.corridor.site),
        **watch.faults(),
        "seconds": time.perf_counter() - began,
    }


def _drive(loop: Loop, watch: Watch) -> None:
    try:
        for number, moment in enumerate(loop, start=1):
            watch.look(loop.plant, moment, number)
    finally:
        if isinstance(loop.futures, Truth):
            loop.futures.close()


def _keep(rows: dict[str, np.ndarray], scenario: Scenario, path: Path) -> None:
    """Writes a row a second of each vehicle in the target lane or on the ramp, for a picture."""
    site = scenario.corridor.site
    table = pl.DataFrame({name: rows[name] for name in ("time", c.VEHICLE, c.X, c.LANE, c.V)})
    near = pl.col(c.LANE).is_in([site.target_lane, *site.ramp_lanes])
    second = (pl.col("time") / KEPT_EVERY).round(6) % 1.0 == 0.0
    path.parent.mkdir(parents=True, exist_ok=True)
    with write_whole(path) as new:
        table.filter(near & second).with_columns(pl.col(c.X, c.V).cast(pl.Float32).round(2)).write_parquet(new)
