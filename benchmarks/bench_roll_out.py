"""Speed of a forecast: from the newest frame of a stream to the futures of all its vehicles, and many moments.

Run: python benchmarks/bench_roll_out.py
Reach, warm and on two idle cores: 60 vehicles x 200 samples in 30 ms (99 % of the frames in 60 ms), 300 x 100 in
100 ms, 1,000 moments of 20 vehicles x 100 samples in 10 s. Docs: decisions/roll_out.md.
"""

import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

PROJECT = Path(__file__).parents[1]
sys.path[:0] = [str(PROJECT), str(Path(__file__).parent)]

from tests.forecast.plain_roll_out import Plain  # noqa: E402
from tests.made_up_traffic import SITE, random_traffic  # noqa: E402

from measure import how_many, once, print_ratio  # noqa: E402
from rampcast.forecast.calibrated import CalibratedSpec  # noqa: E402
from rampcast.forecast.forecaster import Forecaster, ForecasterSpec, fit, forecast_traffic  # noqa: E402
from rampcast.forecast.roll_out import begin, drive  # noqa: E402
from rampcast.forecast.roll_out_arrays import Draws, Law  # noqa: E402
from rampcast.horizon import FUTURE  # noqa: E402
from rampcast.models.correction import CorrectionSpec  # noqa: E402
from rampcast.models.driver_loops import free_table  # noqa: E402
from rampcast.recording import clean  # noqa: E402
from rampcast.traffic.moments import Traffic  # noqa: E402
from rampcast.traffic.situation import situation_of_traffic  # noqa: E402
from rampcast.traffic.stream import Stream  # noqa: E402

FRAMES, MOMENTS = how_many(100, tiny=2), how_many(1_000, tiny=4)
SMALL, FEW = 6, 2  # vehicles and samples: the plain loop is too slow for more
SPEC = ForecasterSpec(
    spacing=2.0, model=CalibratedSpec(folds=2, correction=CorrectionSpec(trees=how_many(120, tiny=3)))
)


def main() -> None:
    """Prints wall and processor time of a frame, of a large site, and of many moments; and a ratio."""
    forecaster = fit(clean(random_traffic(5, vehicles=how_many(120, tiny=40)))[0], spec=SPEC)
    for vehicles, samples in ((60, 200), (300, 100)):
        print_times(forecaster, vehicles, samples)
    some = [newest(20, seed) for seed in range(MOMENTS)]
    forecast_traffic(forecaster.model, some[0])
    took = once(lambda: [forecast_traffic(forecaster.model, one, samples=100) for one in some])
    print(f"{MOMENTS:,} moments of 20 vehicles x 100 samples: {took:.2f} s")
    roll_out = forecaster.model.base.roll_out
    beginning = begin(roll_out, situation_of_traffic(newest(SMALL, 1)))
    drive(roll_out, beginning, samples=200, seed=1)
    ours = once(lambda: drive(roll_out, beginning, samples=200, seed=1)) / 200
    plain = once(lambda: plain_loop(forecaster, beginning)) / FEW
    print(f"one future of {SMALL} vehicles: {1e3 * ours:.3f} ms, in a plain loop {1e3 * plain:.0f} ms")
    print_ratio("futures a second over those of a plain loop", plain / ours)


def print_times(forecaster: Forecaster, vehicles: int, samples: int) -> None:
    """Prints how long it takes from a frame of a stream to the forecast of all its vehicles."""
    model = replace(forecaster.model, spec=replace(forecaster.model.spec, samples=samples))
    own, stream, wall, work = replace(forecaster, model=model), Stream(SITE, doubtful="accept"), [], []
    for number, frame in enumerate(frames(vehicles, 1, FRAMES + 45)):
        begins = time.perf_counter(), time.process_time()
        # 300 of them need more road than the site has
        traffic = replace(stream.push(0.1 * number, frame), is_accepted=True)
        if number < 40:
            continue
        own.predict(traffic)
        if number >= 45:  # warm by then
            wall.append(time.perf_counter() - begins[0])
            work.append(time.process_time() - begins[1])
    half, most = 1e3 * np.quantile(wall, (0.5, 0.99))
    print(
        f"newest frame -> forecast, {vehicles} vehicles x {samples} samples: p50 {half:.1f} ms, p99 {most:.1f} ms; "
        f"processor {1e3 * np.median(work):.1f} ms"
    )


def frames(vehicles: int, seed: int, count: int) -> Iterator[dict[str, np.ndarray]]:
    """Yields frames at 10 Hz of lanes 4 to 7 at about 10 m/s, vehicles 15 m or more apart."""
    rng = np.random.default_rng(seed)
    number = np.arange(vehicles)
    lane = 4 + number % 4
    x = np.where(lane == 7, 40.0 + 12.0 * (number // 4 % 15), 20.0 + 18.0 * (number // 4)) + rng.uniform(0, 5, vehicles)
    v = rng.uniform(8.0, 12.0, vehicles)
    lane = np.where((lane == 7) & (number >= 60), 3, lane)
    y = np.array([SITE.lane_centre(one) for one in lane.tolist()])
    for step in range(count):
        yield {"vehicle": number, "x": x + 0.1 * step * v, "y": y, "lane": lane, "length": np.full(vehicles, 4.6)}


def newest(vehicles: int, seed: int) -> Traffic:
    """Returns the traffic of the newest frame of a stream of 4 s."""
    stream = Stream(SITE, doubtful="accept")
    return [stream.push(0.1 * number, frame) for number, frame in enumerate(frames(vehicles, seed, 41))][-1]


def plain_loop(forecaster: Forecaster, beginning) -> None:
    """Drives the same vehicles by the same law in plain Python; see tests/forecast/plain_roll_out.py."""
    rng, model = np.random.default_rng(1), forecaster.model.base.roll_out
    start = beginning.start._replace(draw=np.arange(SMALL))
    hazard = np.array([*model.hazard.weights, model.hazard.constant, model.hazard.first, model.hazard.last])
    numbers = np.array([0.9, 0.2, 1 / 20.0, 0.1, 0.5, 0.5, 0.4, 0.1, model.limit])
    noise = rng.standard_normal((SMALL, FEW, FUTURE))
    draws = Draws(noise, rng.exponential(size=(SMALL, FEW)), rng.exponential(size=(SMALL, FEW)), np.ones(FEW))
    driver, rate = rng.integers(0, 64, (SMALL, FEW)), np.ones((SMALL, FUTURE))
    learned = Law(model.main.table, free_table(model.main.table), numbers, hazard)
    for sample in range(FEW):
        Plain(start, learned, draws, driver, rate, np.ones(SMALL, dtype=bool), sample).run()


if __name__ == "__main__":
    main()
