"""What a forecast of one moment counts in its samples: quantiles, merges, gaps, conflicts, tables.

Run: python benchmarks/bench_forecast.py
60 vehicles on five lanes 30 m apart, 200 samples of 75 steps; those of the ramp lane merge at any time or not.
"""

from dataclasses import replace

import numpy as np

from measure import how_many, once, print_ratio, seconds
from rampcast.forecast import Forecast
from rampcast.forecast.leaders import leaders
from rampcast.forecast.tables import BANDS
from rampcast.horizon import FUTURE, STEP
from rampcast.sites import load_site

VEHICLES, SAMPLES = how_many(60, tiny=10), how_many(200, tiny=3)
LEVELS = tuple(BANDS.values())
COUNTED = ("speeds", "p_merged", "gap", "conflicts")


def main() -> None:
    """Prints the time of everything that is counted, then ratios to the plain ways."""
    forecast = made_up()
    for name in COUNTED:
        print(f"{name:>10}: {1e3 * seconds(lambda name=name: getattr(replace(forecast), name)):6.1f} ms")
    ours = seconds(lambda: replace(forecast).quantiles(LEVELS))
    print(
        f" quantiles: {1e3 * ours:6.1f} ms, the first; {1e3 * seconds(lambda: forecast.quantiles(LEVELS)):.1f} ms more"
    )
    print(f"    tables: {1e3 * seconds(lambda: replace(forecast).tables()):6.1f} ms, everything included")
    plain = seconds(lambda: np.quantile(forecast.samples, LEVELS, axis=1, method="weibull"))
    print_ratio("numpy's quantiles to ours", plain / ours)
    one = replace(forecast, samples=forecast.samples[:, :1], lane=forecast.lane[:, :1])
    plain = once(lambda: [plain_leaders(one, step) for step in range(FUTURE)])
    ours = seconds(lambda: leaders(one.samples, one.lane))
    print_ratio("leaders by sorting each step in numpy to ours, one sample", plain / ours)


def plain_leaders(forecast: Forecast, step: int) -> np.ndarray:
    """Returns the leader of each vehicle in the first sample; its own place where there is none."""
    lane, x = forecast.lane[:, 0, step], forecast.samples[:, 0, step]
    order = np.lexsort((x, lane))
    found = np.arange(len(x))
    same = lane[order[1:]] == lane[order[:-1]]
    found[order[:-1][same]] = order[1:][same]
    return found


def made_up() -> Forecast:
    """Returns the forecast that is measured."""
    chance, site = np.random.default_rng(1), load_site("i80")
    lane = np.arange(VEHICLES) % 5 + 3
    start = 30.0 * (np.arange(VEHICLES) // 5)
    noise = (
        chance.normal(0.0, one, size) for one, size in ((1.0, (1, SAMPLES, 1)), (0.3, (VEHICLES, SAMPLES, FUTURE)))
    )
    x = start[:, None, None] + np.cumsum(STEP * np.maximum(15.0 + sum(noise), 0.0), axis=2)
    merged = np.arange(FUTURE) >= chance.integers(0, 90, (VEHICLES, SAMPLES, 1))
    on_ramp = np.isin(lane, site.ramp_lanes)[:, None, None]
    return Forecast(
        site=site,
        t0=10.0,
        vehicle=np.arange(VEHICLES),
        start=start,
        start_lane=lane,
        length=np.full(VEHICLES, 4.5),
        samples=x.astype(np.float32),
        lane=np.where(merged & on_ramp, site.target_lane, lane[:, None, None]).astype(np.int16),
    )


if __name__ == "__main__":
    main()
