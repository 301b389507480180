"""Made-up platoons of IDM drivers behind a head in stop-and-go, stepped exactly as the models step them."""

from typing import NamedTuple

import numpy as np

from rampcast.horizon import FUTURE, STEP
from rampcast.traffic.platoons import CAR, HISTORY, PLACES, Platoons, no_traffic

DRIVER = (2.0, 1.3, 1.1, 1.8, 22.0, 4.0)
LENGTH = 4.6  # [m]


class Drive(NamedTuple):
    """Platoons, and what became of the central vehicles and of their leaders."""

    platoons: Platoons
    truth: np.ndarray
    leader_truth: np.ndarray
    group: np.ndarray
    t0: np.ndarray


def idm(driver: np.ndarray, v: np.ndarray, ahead: np.ndarray, gap: np.ndarray) -> np.ndarray:
    """Returns the acceleration [m/s^2] within the law's limits."""
    s0, headway, most, comfortable, desired, exponent = driver
    wish = s0 + headway * v + v * (v - ahead) / (2 * np.sqrt(most * comfortable))
    a = most * (1 - (np.maximum(v, 0.1) / desired) ** exponent - (wish / np.maximum(gap, 1.0)) ** 2)
    return np.clip(a, -comfortable, most)


def drive(
    count: int, *, seed: int = 0, vehicles: int = 3, scatter: float = 0.0, noise: float = 0.0, driver=DRIVER
) -> Drive:
    """Returns platoons of so many vehicles; each sixth case is another platoon's, and all have the same clock.

    Args:
        count: of the platoons.
        seed: of heads, drivers and noise.
        vehicles: in each.
        scatter: standard deviation of the logarithms of the drivers' parameters but the exponent.
        noise: standard deviation of the acceleration in each step beside the law's [m/s^2].
    """
    rng = np.random.default_rng(seed)
    steps = HISTORY + FUTURE
    own = np.array(driver)[:, None, None] * np.ones((6, vehicles, count))
    own[:5] *= np.exp(scatter * rng.standard_normal((5, vehicles, count)))
    phase, swing = rng.uniform(0.0, 6.3, count), rng.uniform(1.0, 4.0, count)
    x = np.zeros((vehicles, count, steps))
    v = np.zeros((vehicles, count, steps))
    a = np.zeros((vehicles, count, steps))
    x[:, :, 0] = (20.0 * np.arange(vehicles))[:, None] + rng.uniform(0.0, 3.0, (vehicles, count))
    v[:, :, 0] = 9.0
    for step in range(1, steps):
        then = x[:, :, step - 1], v[:, :, step - 1]
        a[:-1, :, step - 1] = idm(own[:, :-1], then[1][:-1], then[1][1:], np.diff(then[0], axis=0) - LENGTH)
        kick = noise * rng.standard_normal((vehicles, count))
        faster = np.maximum(then[1] + STEP * (a[:, :, step - 1] + kick), 0.0)
        faster[-1] = 9.0 + swing * np.sin(0.4 * STEP * step + phase)
        v[:, :, step] = faster
        x[:, :, step] = then[0] + STEP * faster
    a[:, :, -1] = a[:, :, -2]
    return Drive(
        platoons=_platoons(x, v, a),
        truth=x[0, :, HISTORY:] - x[0, :, HISTORY - 1 : HISTORY],
        leader_truth=x[min(1, vehicles - 1), :, HISTORY:] - x[0, :, HISTORY - 1 : HISTORY],
        group=np.array([f"{row % 3 + 1}-{row // 6}" for row in range(count)]),
        t0=np.full(count, np.nan),
    )


def _platoons(x: np.ndarray, v: np.ndarray, a: np.ndarray) -> Platoons:
    vehicles, count, _ = x.shape
    states = []
    for values in (x, v, a):
        held = np.full((count, PLACES, HISTORY), np.nan)
        held[:, :vehicles] = np.moveaxis(values[:, :, :HISTORY], 1, 0)
        states.append(held)
    valid = np.isfinite(states[0])
    length = np.where(valid[:, :, -1], LENGTH, np.nan)
    kind = np.full((count, PLACES), CAR)
    return Platoons(*states, valid=valid, length=length, kind=kind, traffic=no_traffic(count))
