"""Made-up forecasts of a moment: vehicles that drive in two lanes, and merge."""

from collections.abc import Sequence

import numpy as np

from rampcast.forecast.forecast import Forecast
from rampcast.horizon import FUTURE, STEP
from tests.factories import TEST_SITE

TARGET, RAMP = 6, 7
TIME = STEP * np.arange(1, FUTURE + 1)


def driving(
    *,
    start: Sequence[float],
    lane: Sequence[int],
    speed: Sequence[float],
    merge: Sequence[float | None],
    length: float = 5.0,
) -> Forecast:
    """Returns a forecast of one sample in which everybody keeps a speed [m/s], and merges at a time [s] or never."""
    place, began = np.array(start), np.array(lane)
    at = np.array([np.inf if time is None else time for time in merge])
    x = place[:, None] + np.array(speed)[:, None] * TIME
    lanes = np.where(TIME > at[:, None] - 1e-9, TARGET, began[:, None])
    return Forecast(
        site=TEST_SITE,
        t0=12.0,
        vehicle=np.arange(101, 101 + len(place)),
        start=place.astype(np.float64),
        start_lane=began,
        length=np.full(len(place), length),
        samples=x[:, None].astype(np.float32),
        lane=lanes[:, None].astype(np.int16),
    )


def random_forecast(seed: int, *, vehicles: int = 12, samples: int = 20, steps: int = FUTURE) -> Forecast:
    """Returns a forecast of vehicles at changing speeds in two lanes, which merge at any time or not; some overlap."""
    rng = np.random.default_rng(seed)
    start = rng.uniform(0.0, 200.0, vehicles)
    began = rng.choice([TARGET, RAMP], vehicles)
    moved = np.cumsum(rng.uniform(0.0, 4.0, (vehicles, samples, steps)), axis=2)
    at = rng.integers(0, 2 * steps, (vehicles, samples, 1))
    return Forecast(
        site=TEST_SITE,
        t0=12.0,
        vehicle=np.sort(rng.choice(20 * vehicles, vehicles, replace=False)),
        start=start,
        start_lane=began,
        length=rng.uniform(4.0, 12.0, vehicles),
        samples=(start[:, None, None] + moved).astype(np.float32),
        lane=np.where(np.arange(steps) >= at, TARGET, began[:, None, None]).astype(np.int16),
    )
