"""Moments and forecasts that are made up."""

import numpy as np

from rampcast.control.futures import Past, constant_speeds
from rampcast.forecast.forecast import Forecast
from rampcast.recording import columns as c
from rampcast.simulate.corridor import Corridor

SITE = Corridor().site  # two lanes, the gore at 300 m, the ramp lane ends at 500 m
RAMP = 3


def past(*vehicles: tuple[float, int, float], time: float = 10.0) -> Past:
    """Returns a moment with vehicles of x [m], lane, speed [m/s], numbered from 1."""
    x, lane, v = np.array(vehicles, dtype=float).reshape(-1, 3).T
    number = np.arange(1, len(x) + 1)
    frame = {
        c.VEHICLE: number, c.X: x, c.Y: np.zeros(len(x)), c.LANE: lane.astype(np.int64), c.LENGTH: np.full(len(x), 5.0),
        c.WIDTH: np.full(len(x), 2.0), c.KIND: np.ones(len(x), np.int64), c.V: v, c.A: np.zeros(len(x)),
    }  # fmt: skip
    found = Past(SITE)
    found.add(time, frame)
    return found


def forecast(*vehicles: tuple[float, int, float]) -> Forecast:
    """Returns the forecast at constant speeds."""
    return constant_speeds(past(*vehicles))
