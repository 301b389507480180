"""Advice to equipped vehicles: who has the device and obeys, and what is told to whom, some time later."""

from collections import deque
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from rampcast.control.ahead import makes_room, slows_ahead
from rampcast.forecast.forecast import Forecast

LONGEST: Final = 5.0  # [s] that an advice holds if no other follows
ROOM: Final = 2.0  # [m/s] by which who shall make room is told to be slower: opens 10 m within 5 s
SLOWEST: Final = 12.0  # [m/s] that is ever told to vehicles which come near a merge


@dataclass(frozen=True)
class Told:
    """An advice: whom, which speed [m/s]."""

    vehicle: int
    speed: float


@dataclass(frozen=True)
class Equipped:
    """Who can be told something.

    Attributes:
        penetration: share of the vehicles that have the device.
        compliance: share of those whose drivers do what it says.
        delay: from the forecast to the driver's doing [s].
        seed: of the draws.
    """

    penetration: float = 1.0
    compliance: float = 0.7
    delay: float = 1.0
    seed: int = 1

    def obeys(self, vehicle: int) -> bool:
        """Returns whether a vehicle is equipped and its driver does what is told."""
        has, does = np.random.default_rng([self.seed, 9, vehicle]).random(2)
        return bool(has < self.penetration and does < self.compliance)


@dataclass
class Postman:
    """Advice on its way.

    Attributes:
        equipped: who gets it.
    """

    equipped: Equipped
    _underway: deque[tuple[float, Told]] = field(default_factory=deque)
    _known: dict[int, bool] = field(default_factory=dict)

    def post(self, time: float, told: list[Told]) -> None:
        """Sends advice at a time [s]; what goes to who has no device, or does not obey, is lost."""
        for one in told:
            if one.vehicle not in self._known:
                self._known[one.vehicle] = self.equipped.obeys(one.vehicle)
            if self._known[one.vehicle]:
                self._underway.append((time + self.equipped.delay, one))

    def arrived(self, time: float) -> list[Told]:
        """Returns what has come by a time [s]."""
        found = []
        while self._underway and self._underway[0][0] <= time + 1e-9:
            found.append(self._underway.popleft()[1])
        return found


def speed_advice(forecast: Forecast, approaching: dict[int, float], *, below: float, ahead: float = 10.0) -> list[Told]:
    """Returns the advice to come slowly where it will be slow: the speed forecast there, to those who are quicker.

    Ours; the idea of holding flow back before a bottleneck is that of Hegyi et al. 2010, "SPECIALIST".

    Args:
        forecast: of the traffic.
        approaching: speeds of the vehicles on the main road before the gore [m/s].
        below: the speed forecast beside the ramp from which all is well [m/s].
        ahead: time after t0 [s].
    """
    slow = slows_ahead(forecast, ahead=ahead)
    if not slow < below:
        return []
    speed = max(SLOWEST, slow)
    return [Told(vehicle, speed) for vehicle, own in approaching.items() if own > speed]


def gap_advice(forecast: Forecast, speeds: dict[int, float], *, within: float = 8.0, chance: float = 0.5) -> list[Told]:
    """Returns the advice to open a gap: 2 m/s slower, to who will be behind a merge by that share of the futures. Ours.

    Args:
        forecast: of the traffic.
        speeds: of all vehicles in view [m/s].
        within: of t0 the merge must come [s].
        chance: least share.
    """
    return [
        Told(int(str(one)), max(SLOWEST / 2.0, speeds[int(str(one))] - ROOM))
        for one in makes_room(forecast, within=within, chance=chance)
        if int(str(one)) in speeds
    ]
