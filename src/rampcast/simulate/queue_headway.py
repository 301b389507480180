"""Drivers who left a queue keep a longer headway for a while: the field's explanation of the capacity drop.

python -m rampcast.simulate.queue_headway FACTOR MEMORY COMMAND...     runs SUMO's command with such drivers

SUMO's car-following models know no such thing; here the headway of each driver is set while SUMO runs (libsumo).
Source: Treiber, Kesting and Helbing 2006, "Understanding widely scattered traffic flows, the capacity drop, and
platoons as effects of variance-driven time gaps", Phys. Rev. E 74.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from rampcast.simulate.drivers import Drivers

QUEUED_SPEED: Final = 8.0  # [m/s] who is slower than that is in a queue
LOOK_EVERY: Final = 1.0  # [s]


@dataclass
class QueueHeadway:
    """The headways of a simulation.

    Attributes:
        sumo: the module libsumo.
        factor: on the time headway of who is in a queue, or left one.
        memory: how long it is kept after the queue [s].
        roads: beginnings of the names of the edges on which queues count.
    """

    sumo: Any
    factor: float
    memory: float
    roads: tuple[str, ...]
    _slow: dict[str, tuple[float, float]] = field(default_factory=dict)

    def look(self, time: float) -> None:
        """Sets the headways of a time [s]."""
        vehicle = self.sumo.vehicle
        for name in vehicle.getIDList():
            if vehicle.getSpeed(name) < QUEUED_SPEED and vehicle.getRoadID(name).startswith(self.roads):
                own = self._slow[name][1] if name in self._slow else vehicle.getTau(name)
                if name not in self._slow:
                    vehicle.setTau(name, own * self.factor)
                self._slow[name] = (time, own)
            elif name in self._slow and time - self._slow[name][0] > self.memory:
                vehicle.setTau(name, self._slow.pop(name)[1])


def with_queue_headway(command: Sequence[object], drivers: Drivers) -> list[object]:
    """Returns a command of SUMO's, or the one that runs it with drivers whose headways change."""
    if drivers.queue_tau == 1.0:
        return list(command)
    own = [sys.executable, "-W", "ignore", "-m", "rampcast.simulate.queue_headway"]
    return [*own, drivers.queue_tau, drivers.queue_memory, *command]


def main(factor: float, memory: float, command: Sequence[str]) -> None:
    """Runs a simulation to its end."""
    import libsumo

    libsumo.start(command)
    end, headways = libsumo.simulation.getEndTime(), QueueHeadway(libsumo, factor, memory, ("",))
    looked = 0.0
    while (time := libsumo.simulation.getTime()) < end:
        libsumo.simulationStep()
        if time - looked >= LOOK_EVERY:
            headways.look(time)
            print(f"Step #{time:.2f}", flush=True)
            looked = time
    libsumo.close()


if __name__ == "__main__":
    main(float(sys.argv[1]), float(sys.argv[2]), sys.argv[3:])
