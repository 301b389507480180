"""Made-up histories of followers, for the tests of calibration."""

from typing import Any

import numpy as np

from rampcast.compute import jnp
from rampcast.paper.laws.laws import Law
from rampcast.paper.laws.mode import Mode
from rampcast.physics import idm

PAST, STEP = 20, 0.2


def parameters_inside(law: Law, count: int, *, seed: int, share: float = 0.8) -> np.ndarray:
    """Returns parameters in the middle share of their ranges."""
    low, high = np.array([(bound.low, bound.high) for bound in law.ranges(Mode.CORRECTED)]).T
    inside = 0.5 + share * (np.random.default_rng(seed).random((count, len(low))) - 0.5)
    result: np.ndarray = low + (high - low) * inside
    return result


def scattered(law: Law, parameters: np.ndarray, *, seed: int) -> dict[str, Any]:
    """Returns states all over the place, with exactly the law's accelerations: what can be identified, is."""
    rng, count = np.random.default_rng(seed), len(parameters)
    speed = rng.uniform(1.0, 25.0, (count, PAST))
    states = {
        "speed": speed,
        "leader_speed": np.maximum(speed + rng.normal(0.0, 3.0, speed.shape), 0.0),
        "gap": rng.uniform(5.0, 60.0, speed.shape),
    }
    a = law.acceleration(law.parameters(*parameters.T[:, :, None]), **states)
    return {**states, "acceleration": np.asarray(a), "valid": np.ones_like(speed, dtype=bool)}


def driven(count: int, *, seed: int, noise: float = 0.1) -> dict[str, Any]:
    """Returns 4 s of IDM drivers behind leaders in stop-and-go traffic, with noise on the acceleration."""
    rng = np.random.default_rng(seed)
    low, high = np.array([(1.0, 3.0), (0.8, 2.0), (0.8, 2.5), (1.0, 3.0), (12.0, 30.0), (2.0, 6.0)]).T
    parameters = idm.Parameters(*(low + (high - low) * rng.random((count, 6))).T)
    mean, wave = rng.uniform(2.0, 12.0, count), rng.uniform(0.0, 2.0 * np.pi, count)
    v = mean.copy()
    gap = np.asarray(idm.desired_gap(parameters, speed=v, leader_speed=v)) * rng.uniform(0.9, 1.4, count)
    columns = []
    for k in range(PAST):
        leader = mean * (1.0 + 0.3 * np.sin(0.5 * STEP * k + wave))
        a = np.asarray(idm.acceleration(parameters, speed=v, leader_speed=leader, gap=gap))
        columns.append((v, leader, gap, a + noise * rng.normal(size=count)))
        v = np.maximum(v + a * STEP, 0.0)
        gap = gap + (leader - v) * STEP
    speed, leader_speed, gaps, acceleration = np.moveaxis(np.array(columns), 0, -1)
    states = {"speed": speed, "leader_speed": leader_speed, "gap": gaps, "acceleration": acceleration}
    return {**states, "valid": np.ones_like(speed, dtype=bool)}


def mean_squared_error(law: Law, parameters: np.ndarray, history: dict[str, Any]) -> np.ndarray:
    """Returns the mean squared error of the law's accelerations, by the definition."""
    states = {name: jnp.asarray(history[name]) for name in ("speed", "leader_speed", "gap")}
    a = law.acceleration(law.parameters(*parameters.T[:, :, None]), **states)
    result: np.ndarray = np.mean((np.asarray(a) - history["acceleration"]) ** 2, axis=1)
    return result
