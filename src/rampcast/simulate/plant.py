"""A corridor that drives while somebody controls its ramps: SUMO inside the process (libsumo), step after step.

libsumo holds one simulation a process, and gets along badly with pyarrow: runs belong in processes of their own.
"""

import tempfile
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl

from rampcast.errors import MissingExtra, RampcastError
from rampcast.recording import columns as c
from rampcast.recording.columns import KINDS
from rampcast.simulate.corridor import (
    SENSOR_PERIOD,
    STOP_LINE,
    VIEW,
    Corridor,
    Profile,
    draw_demand,
    write_corridor,
    write_demand,
)
from rampcast.simulate.demand import SUMO_CLASSES
from rampcast.simulate.drivers import DEFAULT, Drivers
from rampcast.simulate.queue_headway import LOOK_EVERY, QueueHeadway
from rampcast.simulate.simulation import RAMP_SLOPE, SHARES

FASTEST_RATE: Final = 900.0  # [vehicles/h] one car a green, 4 s from green to green: FHWA, Ramp Metering Handbook 2006
NAMES: Final = {sumo: kind for kind, sumo in SUMO_CLASSES.items()}


@dataclass(frozen=True)
class Scenario:
    """What is driven.

    Attributes:
        corridor: the geometry.
        demand: flow over time of each route.
        drivers: who may drive.
        shares: of motorcycles, cars and trucks.
        seed: of every draw.
        step: of the simulation [s].
        duration: of the run [s]; None for as long as vehicles set out.
    """

    corridor: Corridor
    demand: Mapping[str, Profile]
    drivers: Drivers = DEFAULT
    shares: tuple[float, float, float] = SHARES
    seed: int = 1
    step: float = 0.5

    @property
    def duration(self) -> float:
        """Returns the end of the run [s]."""
        return max(profile[-1][0] for profile in self.demand.values())


@dataclass(frozen=True)
class Sensed:
    """What a row of sensors across the main road saw in the last period.

    Attributes:
        flow: all lanes together [vehicles/h].
        speed: mean of those who passed [m/s]; NaN if nobody did.
        occupancy: share of time that a vehicle stood over a sensor, mean of the lanes [%].
    """

    flow: float
    speed: float
    occupancy: float


@dataclass
class Meter:
    """A light at the stop line of a ramp: one vehicle a green.

    Attributes:
        rate: of greens [vehicles/h]; None leaves it green.
        held: whether no further green is given, whatever the rate.
        ready: for how long somebody could have had one [s].
    """

    rate: float | None = None
    held: bool = False
    ready: float = 0.0
    _credit: float = 1.0
    _passing: str | None = None

    def could_let_go(self, waiting: list[str], dt: float) -> bool:
        """Returns whether somebody would have a green in the next step if the light is not held; as for `green`."""
        passing = self._passing is not None and self._passing in waiting
        soon = self._credit + (self.rate or FASTEST_RATE) * dt / 3600.0 >= 1.0
        return bool(waiting) and not passing and (soon or self.rate is None)

    def green(self, waiting: list[str], dt: float) -> bool:
        """Returns whether the light is green in the next step.

        Args:
            waiting: ids of the vehicles before the line, the last one to come first.
            dt: the step [s].
        """
        if self.rate is None and not self.held:
            self._credit, self._passing = 1.0, None
            return True
        first = waiting[-1] if waiting else None
        self._credit = min(1.0, self._credit + (self.rate or FASTEST_RATE) * dt / 3600.0)
        if self._passing is not None and self._passing in waiting:
            return True
        self._passing = None
        self.ready = self.ready + dt if self._credit >= 1.0 and first is not None else 0.0
        if self.ready and not self.held:
            self._credit, self._passing, self.ready = 0.0, first, 0.0
            return True
        return False


@dataclass
class Plant:
    """A running simulation.

    Attributes:
        scenario: what is driven.
        sumo: the module libsumo.
        meters: one a ramp.
        routes: of each vehicle, by its id.
        spent: total time that vehicles spent on the road and waiting to enter it [s].
        backlog: vehicles that wait to enter it now.
    """

    scenario: Scenario
    sumo: Any
    meters: list[Meter]
    routes: dict[str, str]
    spent: float = 0.0
    backlog: int = 0
    _bodies: dict[str, tuple[float, float, int]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        corridor, drivers = self.scenario.corridor, self.scenario.drivers
        self._headways = QueueHeadway(self.sumo, drivers.queue_tau, drivers.queue_memory, ("main", "merge"))
        main = list(range(corridor.lanes, 0, -1))  # SUMO counts from the right
        gore, end = corridor.gore(), corridor.gore() + corridor.ramp_lane
        self._edges = {
            "main_0": (-corridor.approach, main),
            "merge_0": (gore, [corridor.lanes + 1, *main]),
            "main_1": (end, main),
            "ramp_0": (gore - STOP_LINE, [corridor.lanes + 1]),
        }
        self._length = corridor.site.length
        self._centres = np.array([np.nan, *(lane.centre for lane in corridor.site.lanes)])

    @property
    def time(self) -> float:
        """Returns the simulated time [s]."""
        return float(self.sumo.simulation.getTime())

    def step(self) -> None:
        """Drives one step."""
        dt = self.scenario.step
        for ramp, meter in enumerate(self.meters):
            green = meter.green(self.waiting(ramp), dt)
            self.sumo.trafficlight.setRedYellowGreenState(f"line_{ramp}", "G" if green else "r")
        self.sumo.simulationStep()
        self.backlog = len(self.sumo.simulation.getPendingVehicles())
        self.spent += dt * (self.sumo.vehicle.getIDCount() + self.backlog)
        if self.scenario.drivers.queue_tau != 1.0 and self.time % LOOK_EVERY < dt:
            self._headways.look(self.time)

    def waiting(self, ramp: int) -> list[str]:
        """Returns the vehicles before the stop line of a ramp, the last one to come first."""
        return list(self.sumo.edge.getLastStepVehicleIDs(f"queue_{ramp}"))

    def sensed(self, name: str) -> Sensed:
        """Returns what a row of sensors saw in the last whole period, `corridor.SENSOR_PERIOD`."""
        loop, names = self.sumo.inductionloop, [f"{name}_{k}" for k in range(self.scenario.corridor.lanes)]
        counts = [loop.getLastIntervalVehicleNumber(one) for one in names]
        speeds = [loop.getLastIntervalMeanSpeed(one) for one in names]
        total = sum(counts)
        speed = sum(n * v for n, v in zip(counts, speeds, strict=True) if n) / total if total else float("nan")
        occupancy = sum(loop.getLastIntervalOccupancy(one) for one in names) / len(names)
        return Sensed(total * 3600.0 / SENSOR_PERIOD, speed, occupancy)

    def approaching(self, distance: float) -> dict[int, float]:
        """Returns the speeds of the vehicles on the main road within a distance before the first gore [m/s]."""
        sumo, start = self.sumo.vehicle, self.scenario.corridor.gore() + self.scenario.corridor.approach - distance
        names = self.sumo.edge.getLastStepVehicleIDs("main_0")
        return {int(name): sumo.getSpeed(name) for name in names if sumo.getLanePosition(name) >= start}

    def tell(self, vehicle: str, speed: float, duration: float) -> None:
        """Lets a vehicle come to a speed [m/s] and keep it for a time [s], as far as it is safe."""
        if vehicle in self._bodies and vehicle in self.sumo.vehicle.getIDList():
            self.sumo.vehicle.slowDown(vehicle, speed, duration)

    def frame(self, *, everywhere: bool = False) -> dict[str, np.ndarray]:
        """Returns the vehicles of the first section now, as a stream takes them, with speed and acceleration besides.

        Arrays: vehicle, x, y, lane, length, width, kind (index into `KINDS`), v, a. Lanes change in one step.

        Args:
            everywhere: whether those before and after the section are told too.
        """
        sumo, rows = self.sumo.vehicle, []
        for edge, (start, numbers) in self._edges.items():
            for name in self.sumo.edge.getLastStepVehicleIDs(edge):
                x = start + sumo.getLanePosition(name)
                if everywhere or 0.0 <= x <= self._length:
                    if name not in self._bodies:
                        own = KINDS.index(NAMES.get(sumo.getVehicleClass(name), "car"))
                        self._bodies[name] = (sumo.getLength(name), sumo.getWidth(name), own)
                    number = numbers[sumo.getLaneIndex(name)]
                    rows.append(
                        (int(name), x, number, *self._bodies[name], sumo.getSpeed(name), sumo.getAcceleration(name))
                    )
        vehicle, front, lane, length, width, kind, v, a = np.array(rows, dtype=float).reshape(-1, 8).T
        y = self._centres[lane.astype(int)]
        on_ramp = lane == len(self._centres) - 1
        y = y - on_ramp * RAMP_SLOPE * np.maximum(0.0, VIEW - front)
        return {
            c.VEHICLE: vehicle.astype(np.int64), c.X: front, c.Y: y, c.LANE: lane.astype(np.int64), c.LENGTH: length,
            c.WIDTH: width, c.KIND: kind.astype(np.int64), c.V: v, c.A: a,
        }  # fmt: skip


@contextmanager
def driving(scenario: Scenario, *, trips: Path | None = None) -> Iterator[Plant]:
    """Gives a simulation that has not begun yet.

    Args:
        scenario: what is driven.
        trips: file to which SUMO writes what became of each vehicle, when it is left.

    Raises:
        MissingExtra: libsumo is not installed.
    """
    libsumo = _libsumo()
    with tempfile.TemporaryDirectory(prefix="rampcast-") as name:
        vehicles = write_scenario(scenario, Path(name))
        routes = {str(row): route for row, route in enumerate(vehicles["route"])}
        try:
            libsumo.start(_command(scenario, Path(name), trips))
        except libsumo.TraCIException as error:
            raise RampcastError(f"SUMO does not take this simulation: {error}") from error
        try:
            yield Plant(scenario, libsumo, [Meter() for _ in range(scenario.corridor.ramps)], routes)
        finally:
            libsumo.close()


def _libsumo() -> Any:
    """Returns the module, without what it says of pyarrow, which is not used beside it.

    Raises:
        MissingExtra: it is not installed.
    """
    try:
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()), warnings.catch_warnings(action="ignore"):
            import libsumo
    except ImportError as error:
        raise MissingExtra('control needs libsumo; run: pip install "rampcast[sumo]"') from error
    return libsumo


def write_scenario(scenario: Scenario, folder: Path) -> pl.DataFrame:
    """Writes SUMO's files into a folder, and returns the vehicles."""
    corridor, drivers = scenario.corridor, scenario.drivers
    write_corridor(corridor, folder)
    vehicles = draw_demand(corridor, scenario.demand, shares=scenario.shares, drivers=drivers, seed=scenario.seed)
    write_demand(corridor, vehicles, folder / "vehicles.xml", drivers=drivers)
    return vehicles


def _command(scenario: Scenario, folder: Path, trips: Path | None) -> list[str]:
    """Returns what SUMO is started with."""
    command: list[object] = ["sumo", "-n", folder / "network.xml", "-r", folder / "vehicles.xml"]
    command += ["-a", folder / "sensors.xml", "--seed", scenario.seed, "--step-length", scenario.step]
    command += ["--time-to-teleport", -1, "--collision.action", "warn", "--xml-validation", "never"]
    command += ["--no-warnings", "true", "--no-step-log", "true", "--duration-log.disable", "true"]
    if trips:
        command += ["--tripinfo-output", trips, "--tripinfo-output.write-unfinished", "true"]
        command += ["--tripinfo-output.write-undeparted", "true", "--device.emissions.probability", 1]
    return [str(part) for part in command]
