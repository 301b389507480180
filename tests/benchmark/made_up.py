"""Made-up traffic for the tests of the benchmark: queues of IDM drivers behind a leader in stop-and-go."""

from pathlib import Path

import numpy as np
import polars as pl

from rampcast.benchmark import Cases
from rampcast.benchmark.data_sets import i80_pairs_three_windows

STEP, FRAMES, VEHICLES = 0.1, 291, 5
STANDING_GAP, HEADWAY, MOST, COMFORTABLE, DESIRED, EXPONENT = 2.0, 1.3, 1.2, 1.8, 25.0, 4.0  # of all drivers
LENGTH = 4.8  # [m]


def queue(seed: int) -> np.ndarray:
    """Returns x [m] of five vehicles, the first of them at the head, at 10 Hz."""
    time = STEP * np.arange(FRAMES)
    wave = np.random.default_rng(seed).uniform(0.0, 6.0)
    head = 200.0 + np.cumsum((9.0 + 4.0 * np.sin(0.45 * time + wave)) * STEP)
    places = [head]
    for _ in range(VEHICLES - 1):
        ahead, x, v = places[-1], places[-1][0] - 18.0, 9.0
        own = [x]
        for frame in range(1, FRAMES):
            leader_speed = (ahead[frame] - ahead[frame - 1]) / STEP
            wish = STANDING_GAP + HEADWAY * v + v * (v - leader_speed) / (2 * (MOST * COMFORTABLE) ** 0.5)
            a = MOST * (1 - (v / DESIRED) ** EXPONENT - (wish / (ahead[frame - 1] - x - LENGTH)) ** 2)
            v = max(v + a * STEP, 0.0)
            x += v * STEP
            own.append(x)
        places.append(np.array(own))
    return np.array(places)


def pairs(windows: tuple[int, ...] = (1, 2, 3), queues: int = 2) -> pl.DataFrame:
    """Returns leader-follower pairs in the form of i80_pairs_three_windows.parquet."""
    parts = []
    for window in windows:
        for number in range(queues):
            x = queue(10 * window + number)
            for k in range(1, VEHICLES):
                vehicle = 10 * number + k
                parts.append(
                    pl.DataFrame(
                        {
                            "window": window,
                            "pair": f"{window}-{vehicle}",
                            "follower": vehicle + 1,
                            "leader": vehicle,
                            "frame": 1000 * number + np.arange(FRAMES),
                            "x_follower": x[k],
                            "x_leader": x[k - 1],
                            "length_leader": LENGTH,
                        }
                    )
                )
    return pl.concat(parts)


def cases(tmp_path: Path) -> Cases:
    """Returns the cases of all windows."""
    path = tmp_path / "i80_pairs_three_windows.parquet"
    pairs().write_parquet(path)
    return i80_pairs_three_windows([path])
