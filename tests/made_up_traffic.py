"""Small made-up traffic for tests: random but plausible, every vehicle at its own speed."""

import numpy as np
import polars as pl

from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.sites import load_site

SITE = load_site("i80")


def random_traffic(seed: int, *, vehicles: int = 30, seconds: float = 40.0, name: str = "i80-1") -> Recording:
    """Returns a raw 10 Hz recording of vehicles in lanes 5, 6 and 7; most of those of lane 7 move to lane 6."""
    rng = np.random.default_rng(seed)
    parts = [_vehicle(rng, number + 1, seconds) for number in range(vehicles)]
    tracks = pl.concat(parts).with_columns(pl.lit(name).alias(c.RECORDING)).select(c.SCHEMA.keys()).cast(dict(c.SCHEMA))
    return Recording(
        tracks=tracks.sort(c.RECORDING, c.VEHICLE, c.FRAME), site=SITE, time_step=0.1, source="made up for a test"
    )


def _vehicle(rng: np.random.Generator, number: int, seconds: float) -> pl.DataFrame:
    start = int(rng.integers(0, int(seconds * 10 * 0.6)))
    size = int(rng.integers(60, int(seconds * 10 * 0.9)))
    frame = np.arange(start, start + size)
    t = np.arange(size) * 0.1
    x = rng.uniform(0, 150) + rng.uniform(4, 10) * t + 3 * np.sin(t / 3 + rng.uniform(0, 6))
    lane = int(rng.choice([5, 6, 7], p=[0.2, 0.4, 0.4]))
    lanes = np.full(size, lane)
    y = np.full(size, SITE.lane_centre(lane))
    if lane == 7 and rng.random() < 0.8:
        change = rng.integers(30, size)
        lanes[change:] = 6
        share = np.clip((np.arange(size) - change + 10) / 30, 0, 1)
        y = SITE.lane_centre(7) + share * (SITE.lane_centre(6) - SITE.lane_centre(7))
    return pl.DataFrame(
        {
            c.VEHICLE: np.full(size, number),
            c.FRAME: frame,
            c.X: x,
            c.Y: y,
            c.LANE: lanes,
            c.LENGTH: np.full(size, rng.uniform(4, 12)),
            c.WIDTH: np.full(size, 1.9),
            c.KIND: ["car"] * size,
        }
    )
