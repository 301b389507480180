"""Sets of drivers: from which ranges SUMO's drivers are drawn, and what all of a set have alike."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from rampcast.errors import RampcastError
from rampcast.file_values import not_one_of
from rampcast.recording.columns import KINDS

Ranges = Mapping[str, tuple[float, float]]

# Uniform ranges of a driver's parameters in SUMO's EIDM and LC2013 models. A range of drivers rather than one spreads
# the merge places; the values were chosen by trial so that the traffic meets `realism.ACCEPTED`.
CAR_RANGES: Final[Ranges] = {
    "tau": (0.7, 1.4),  # time headway [s]
    "accel": (1.0, 2.0),  # [m/s^2]
    "decel": (1.5, 3.0),  # comfortable braking [m/s^2]
    "minGap": (1.5, 3.0),  # standstill gap [m]
    "speedFactor": (0.85, 1.15),  # desired speed over the limit
    "lcStrategic": (0.2, 3.0),  # eagerness to change for the route's sake
    "lcAssertive": (0.6, 1.8),  # willingness to take small gaps
    "lcCooperative": (0.5, 1.0),  # willingness to make room
}
TRUCK_RANGES: Final[Ranges] = {**CAR_RANGES, "tau": (1.2, 1.8), "accel": (0.6, 1.0), "speedFactor": (0.8, 0.95)}
# SUMO's drivers keep to the right and do not pass on the right, as in Europe; on a Californian freeway they may.
EVERY_DRIVER: Final[Mapping[str, object]] = {
    "carFollowModel": "EIDM",
    "lcKeepRight": 0,
    "lcSpeedGain": 1,
    "lcSpeedGainRight": 1,
    "lcOvertakeRight": 1,
}


@dataclass(frozen=True)
class Drivers:
    """Who may drive.

    Attributes:
        name: of the set.
        ranges: bounds of each parameter of SUMO's driver that is drawn, by kind of vehicle.
        alike: what all drivers have alike, as attributes of SUMO's vType.
        queue_tau: factor on the time headway of who is in a queue, or has left one; 1 is as any other.
        queue_memory: how long it is kept after the queue [s].
    """

    name: str
    ranges: Mapping[str, Ranges] = field(
        default_factory=lambda: {"motorcycle": CAR_RANGES, "car": CAR_RANGES, "truck": TRUCK_RANGES}
    )
    alike: Mapping[str, object] = field(default_factory=lambda: EVERY_DRIVER)
    queue_tau: float = 1.0
    queue_memory: float = 0.0

    @property
    def parameters(self) -> tuple[str, ...]:
        """Returns the names of what is drawn, in the order in which it is drawn."""
        return tuple(self.ranges[KINDS[0]])


DEFAULT: Final = Drivers("default")
# A bottleneck that breaks down as real ones do; docs/control.md says how it was chosen.
_ASSERTIVE: Final = {"lcAssertive": (2.3, 4.6)}
QUEUE_HEADWAY: Final = Drivers(
    "queue_headway",
    ranges={kind: {**ranges, **_ASSERTIVE} for kind, ranges in DEFAULT.ranges.items()},
    queue_tau=1.15,
    queue_memory=60.0,
)
DRIVERS: Final[Mapping[str, Drivers]] = {one.name: one for one in (DEFAULT, QUEUE_HEADWAY)}


def drivers_of(name: str) -> Drivers:
    """Returns the set of drivers of that name.

    Raises:
        RampcastError: there is none.
    """
    if name not in DRIVERS:
        raise RampcastError(not_one_of(tuple(DRIVERS), name, place="drivers"))
    return DRIVERS[name]
