"""Speed of a tick: from the newest frame of a stream to the forecast of all its vehicles, everything included.

Run: python benchmarks/bench_tick.py
Reach on two idle cores: 60 vehicles x 200 samples in 30 ms (half the ticks) and 60 ms (99 %), no step over 200 ms when
vehicles come and go; ready in 5 s with compiled programs on disk; 1,000 moments of 20 vehicles x 100 samples in 10 s.
Beside the time on the clock stands that of the processor, which other programs of the machine disturb less.
"""

import subprocess
import sys
import time
from collections.abc import Iterator

import numpy as np

import rampcast as rc
from measure import how_many, once, print_ratio
from rampcast.forecast.forecaster import Forecaster, forecast_traffics
from rampcast.forecast.parts import BATCH
from rampcast.sites import load_site

VEHICLES, SAMPLES = how_many(60, tiny=6), how_many(200, tiny=5)
TICKS, EARLIER = how_many(200, tiny=4), 45  # the first fill the 4 s, and compile what is not on disk
MOMENTS, FEW, FEW_SAMPLES = how_many(1_000, tiny=2), how_many(20, tiny=4), how_many(100, tiny=5)
RATE = 10  # [1/s]
BANDS = (0.05, 0.5, 0.95)
LANES = (3, 4, 5, 6, 7)  # of I-80; the last is the ramp's
SPACING, SPEED, LENGTH = 30.0, 10.0, 500.0  # [m], [m/s], [m] of the section
READY = """
import time; began = time.perf_counter()
import rampcast as rc
from rampcast.sites import load_site
online = rc.Online(rc.load("pretrained"), load_site("i80"))
for tenth in range(6):
    online.push(tenth / 10, {"vehicle": [1, 2], "x": [60.0 + tenth, 20.0 + tenth], "y": [-1.8, -1.8], "lane": [6, 7]})
print(time.perf_counter() - began)
"""


def main() -> None:
    """Prints times of ticks, of the first forecast in a fresh process, and of many small moments."""
    site, forecaster = load_site("i80"), rc.load("pretrained")
    first = float(subprocess.run([sys.executable, "-c", READY], capture_output=True, text=True, check=True).stdout)
    print(f"first forecast of a fresh process: {first:.2f} s")
    online = rc.Online(forecaster, site, samples=SAMPLES)
    wall, busy, sizes = ticks(online, VEHICLES, TICKS)
    print(f"{sizes.min()} to {sizes.max()} vehicles x {SAMPLES} samples, {TICKS} ticks, [ms] half, 99 %, the longest:")
    for what, times in (("on the clock", wall), ("processor", busy)):
        print(f"  {what}: " + ", ".join(f"{1e3 * np.quantile(times, level):.1f}" for level in (0.5, 0.99, 1.0)))
    print_ratio("times that a tick of 0.1 s holds the longest tick", 0.1 / wall.max())
    stream = rc.Stream(site)
    moments = [stream.push(now, frame) for now, frame in frames(FEW, EARLIER + MOMENTS)][EARLIER:]
    took = [once(lambda size=size: together(forecaster, moments, size)) for size in (1, BATCH)]
    print(f"{MOMENTS:,} moments of {FEW} vehicles x {FEW_SAMPLES}: {took[1]:.1f} s")
    print_ratio("the same moments one by one take, times", took[0] / took[1])


def together(forecaster: Forecaster, moments: list[rc.Traffic], size: int) -> None:
    """Forecasts moments, so many of them together."""
    for first in range(0, len(moments), size):
        forecast_traffics(forecaster.model, moments[first : first + size], samples=FEW_SAMPLES)


def ticks(online: rc.Online, vehicles: int, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns the time of each tick on the clock and of the processor [s], and its number of vehicles."""
    found = []
    for now, frame in frames(vehicles, EARLIER + count):
        began = time.perf_counter(), time.process_time()
        forecast = online.push(now, frame)
        forecast.quantiles(BANDS), forecast.p_merged
        found.append((time.perf_counter() - began[0], time.process_time() - began[1], len(forecast)))
    wall, busy, sizes = np.array(found[EARLIER:]).T
    return wall, busy, sizes.astype(int)


def frames(vehicles: int, count: int) -> Iterator[tuple[float, dict[str, np.ndarray]]]:
    """Yields frames of about so many vehicles in five lanes; they come in upstream, at odd times, and leave."""
    rng = np.random.default_rng(1)
    number = np.arange(vehicles)
    lane, place = np.array(LANES)[number % len(LANES)], SPACING * (number // len(LANES)) + rng.uniform(0, 8, vehicles)
    coming = vehicles
    for tick in range(count):
        yield tick / RATE, {"vehicle": number, "x": place, "y": np.full(len(number), np.nan), "lane": lane}
        place = place + SPEED / RATE + rng.normal(0.0, 0.02, len(place))
        stays = place < np.where(lane == LANES[-1], 220.0, LENGTH)
        if rng.random() < len(LANES) * SPEED / SPACING / RATE:
            number, lane = np.append(number, coming), np.append(lane, LANES[coming % len(LANES)])
            place, stays = np.append(place, rng.uniform(0.0, 2.0)), np.append(stays, True)
            coming += 1
        number, lane, place = number[stays], lane[stays], place[stays]


if __name__ == "__main__":
    main()
