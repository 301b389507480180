"""Calibration against scipy's curve_fit, and the roll-out against a Python loop over scenes and against numpy.

Run: python benchmarks/bench_car_following.py
Reach: IDM 60 times, GHR 500 times as fast as curve_fit, roll-out 100 times as fast as the loop. curve_fit gets one
start, ours searches from four. Compiling is timed apart: it happens once, and the programs are kept on disk.
"""

import math
import time
import warnings
from typing import Any

import numpy as np
from scipy.optimize import OptimizeWarning, curve_fit

from measure import how_many, once, peak_memory, print_ratio, seconds
from rampcast.forecasters import label
from rampcast.horizon import FUTURE, PAST, STEP
from rampcast.paper.algorithm_1 import follow
from rampcast.paper.calibration.calibration import calibrate
from rampcast.paper.laws.laws import LAWS
from rampcast.paper.laws.mode import Mode

DRIVERS, PLAIN_FITS = how_many(20_000, tiny=20), how_many(40, tiny=2)
SCENES, PLAIN_SCENES = how_many(10_000, tiny=20), how_many(200, tiny=5)
NOISE = 0.1  # [m/s^2] of the observed accelerations
SPEED_LIMIT = 29.06  # [m/s]


def main() -> None:
    """Prints fits and forecasts per second, and the ratios."""
    history = histories(DRIVERS)
    for name in ("idm", "ghr", "gipps_paper", "gipps"):
        fits(name, history)
    roll_outs()


def histories(count: int) -> dict[str, Any]:
    """Returns 4 s of vehicles behind leaders in stop-and-go traffic that follow the IDM, with noise."""
    rng = np.random.default_rng(0)
    time_now = np.arange(PAST) * STEP
    leader = rng.uniform(3, 12, (count, 1)) * (1 + 0.3 * np.sin(0.5 * time_now + rng.uniform(0, 6, (count, 1))))
    speed = np.maximum(leader + rng.normal(0, 1, (count, 1)) * (1 + 0.1 * time_now), 0.0)
    gap = rng.uniform(5, 25, (count, 1)) + np.cumsum(leader - speed, axis=1) * STEP
    gap = np.maximum(gap, 1.0)
    drivers = np.array([2.0, 1.2, 1.5, 2.0, 20.0, 4.0]) * rng.uniform(0.7, 1.3, (count, 6))
    a = said("idm", drivers.T[:, :, None], speed, leader, gap) + NOISE * rng.normal(size=speed.shape)
    states = {"speed": speed, "leader_speed": leader, "gap": gap, "acceleration": a}
    return states | {"valid": np.ones_like(speed, dtype=bool)}


def said(name: str, parameters: Any, speed: np.ndarray, leader: np.ndarray, gap: np.ndarray) -> np.ndarray:
    """Returns a law's accelerations in plain numpy [m/s^2]."""
    if name == "idm":
        s_0, headway, most, least, wished, exponent = parameters
        room = s_0 + headway * speed + speed * (speed - leader) / (2 * np.sqrt(most * least))
        return most * (1 - (np.maximum(speed, 0.1) / wished) ** exponent - (room / gap) ** 2)
    alpha, beta, gamma = parameters
    return alpha * np.maximum(speed, 0.1) ** beta * (leader - speed) / gap**gamma


def fits(name: str, history: dict[str, Any]) -> None:
    """Prints the rate of one law's fits, and of curve_fit where there is a plain form to give it."""
    law = LAWS[name]
    first = once(lambda: calibrate(law, **history))
    ours = DRIVERS / seconds(lambda: calibrate(law, **history), 3)
    memory = peak_memory(lambda: calibrate(law, **history))
    line = f"{label(law.name):<14} {ours:>10,.0f} fits/s; first call {first:.1f} s; peak memory {memory:+.0f} MB"
    if name in ("idm", "ghr"):
        start = time.perf_counter()
        errors = [one_fit(name, history, row) for row in range(PLAIN_FITS)]
        plain = PLAIN_FITS / (time.perf_counter() - start)
        better = calibrate(law, **{key: values[:PLAIN_FITS] for key, values in history.items()}).mse
        line += f"; curve_fit {plain:,.0f}/s"
        line += f"; mean squared error {np.mean(better):.4f}, curve_fit {np.mean(errors):.4f} m^2/s^4"
        print_ratio(f"{label(law.name)}, fits a second over those of curve_fit", ours / plain)
    print(line)


def one_fit(name: str, history: dict[str, Any], row: int) -> float:
    """Returns the mean squared error of one vehicle's fit by curve_fit from the middle of the ranges."""
    low, high = np.array([(bound.low, bound.high) for bound in LAWS[name].ranges(Mode.CORRECTED)]).T
    states = [history[key][row] for key in ("speed", "leader_speed", "gap")]
    observed = history["acceleration"][row]

    def law(_: np.ndarray, *parameters: float) -> np.ndarray:
        return said(name, parameters, *states)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", OptimizeWarning)
        best, _ = curve_fit(
            law, np.arange(PAST), observed, p0=0.5 * (low + high) + 0.1, bounds=(low, high), maxfev=4000
        )
    return float(np.mean((law(observed, *best) - observed) ** 2))


def roll_outs() -> None:
    """Prints the rate of 15 s forecasts of the IDM behind a given leader, three ways."""
    rng = np.random.default_rng(1)
    steps = np.arange(FUTURE + 1) * STEP
    speed = rng.uniform(2, 12, SCENES)
    leader_v = np.repeat(speed[:, None], FUTURE + 1, axis=1)
    leader_x = rng.uniform(10, 30, (SCENES, 1)) + speed[:, None] * steps
    drivers = np.array([2.0, 1.2, 1.5, 2.0, 20.0, 4.0]) * rng.uniform(0.7, 1.3, (SCENES, 6))

    def ours() -> np.ndarray:
        start = {"x": np.zeros(SCENES), "v": speed, "leader_length": np.zeros(SCENES)}
        return follow(LAWS["idm"], drivers, **start, leader_x=leader_x, leader_v=leader_v, v_max=SPEED_LIMIT).x

    def loop(rows: int) -> np.ndarray:
        each = (drivers.tolist(), speed.tolist(), leader_x.tolist(), leader_v.tolist())
        return np.array([loop_roll_out(*(values[row] for values in each)) for row in range(rows)])

    def arrays() -> np.ndarray:
        return numpy_roll_out(drivers.T, speed, leader_x.T, leader_v.T).T

    rate = SCENES / seconds(ours, 5)
    by_loop, by_numpy = PLAIN_SCENES / seconds(lambda: loop(PLAIN_SCENES), 3), SCENES / seconds(arrays, 3)
    difference = np.abs(ours()[:PLAIN_SCENES] - loop(PLAIN_SCENES)).max()
    print(f"\nroll-out of {FUTURE} steps: {rate:,.0f} forecasts/s; peak memory {peak_memory(ours):+.0f} MB")
    print(f"  Python loop {by_loop:,.0f}/s; numpy {by_numpy:,.0f}/s")
    print_ratio("roll-outs a second over those of a Python loop", rate / by_loop)
    print_ratio("roll-outs a second over those of numpy", rate / by_numpy)
    print(f"  largest difference from the loop after 15 s: {difference:.1e} m")


def loop_roll_out(driver: list[float], v: float, leader_x: list[float], leader_v: list[float]) -> list[float]:
    """Returns the positions of one vehicle after each step, in plain Python numbers."""
    s_0, headway, most, least, wished, exponent = driver
    x, places = 0.0, []
    for step in range(FUTURE):
        gap = max(leader_x[step] - x, 1.0)
        room = s_0 + headway * v + v * (v - leader_v[step]) / (2 * math.sqrt(most * least))
        a = most * (1 - (max(v, 0.1) / wished) ** exponent - (room / gap) ** 2)
        v = min(max(v + min(max(a, -least), most) * STEP, 0.0), SPEED_LIMIT)
        x += v * STEP
        places.append(x)
    return places


def numpy_roll_out(drivers: np.ndarray, v: np.ndarray, leader_x: np.ndarray, leader_v: np.ndarray) -> np.ndarray:
    """Returns the positions of all vehicles after each step, a step of all at a time."""
    x, places = np.zeros_like(v), []
    for step in range(FUTURE):
        gap = np.maximum(leader_x[step] - x, 1.0)
        a = np.clip(said("idm", drivers, v, leader_v[step], gap), -drivers[3], drivers[2])
        v = np.clip(v + a * STEP, 0.0, SPEED_LIMIT)
        x = x + v * STEP
        places.append(x)
    return np.array(places)


if __name__ == "__main__":
    main()
