"""Made-up merges in the form of us101_ramp_merges.parquet: each vehicle waits for a gap that suits it."""

from pathlib import Path

import numpy as np
import polars as pl

from rampcast.benchmark import DATA_SETS, Cases

STEP = 0.1
PLACES = (-38.0, -17.0, 16.0, 41.0)  # [m] of the four vehicles of the target lane, from the merging one's, at first


def merges(count: int = 18, *, seed: int = 4) -> pl.DataFrame:
    """Returns merges that come when the vehicle beside has been passed, after 2 to 10 s."""
    rng = np.random.default_rng(seed)
    return pl.concat([_merge(number, rng) for number in range(1, count + 1)])


def _merge(number: int, rng: np.random.Generator) -> pl.DataFrame:
    slower = rng.uniform(1.0, 6.0)  # [m/s] than the target lane or faster: after 12 m of that it merges
    speed = rng.uniform(12.0, 17.0)
    time = STEP * np.arange(1 + round(12.0 / slower / STEP) + round(rng.uniform(0.0, 1.5) / STEP))
    sign = rng.choice([-1.0, 1.0])
    columns = {"merge": np.full(len(time), number, dtype=np.int32), "time": time, "v": np.full(len(time), speed)}
    columns["distance_to_end"] = 210.0 - speed * time
    wave = 0.3 * np.sin(0.5 * time + rng.uniform(0.0, 6.0))
    gaps = np.array(PLACES)[:, None] + rng.uniform(-2.0, 2.0, (4, 1)) + sign * slower * time + wave
    relative = np.gradient(gaps, STEP, axis=1)
    for slot in range(4):
        columns[f"gap_{slot + 1}"], columns[f"dv_{slot + 1}"] = gaps[slot], relative[slot]
    leads = number % 3 > 0
    columns["gap_5"] = (35.0 + 1.5 * time) if leads else np.full(len(time), np.nan)
    columns["dv_5"] = np.full(len(time), 1.5 if leads else np.nan)
    return pl.DataFrame(columns)


def cases(folder: Path, table: pl.DataFrame) -> Cases:
    """Returns the cases of a table of merges."""
    path = folder / "us101_ramp_merges.parquet"
    table.write_parquet(path)
    return DATA_SETS["us101_ramp_merges"].read([path])
