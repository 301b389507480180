"""Prints what each part of the joint forecast is worth: the same traffic forecast without one after the other.

Run: python benchmarks/joint_parts.py

The forecaster of the demo, trained on the shipped windows 1 and 3 (simulated), on window 2 every 10 s, from the past
alone: mean error of the median at 1, 5, 10 and 15 s [m], share of truths in the 90 % band at 15 s, and Brier score of
having merged within 10 s. A part is left out of the forecast; the others were learned with it.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

import rampcast as rc
from rampcast.forecast.calibrated import Calibrated
from rampcast.forecast.forecast import Forecast
from rampcast.forecast.forecaster import forecast_traffic
from rampcast.paper.reproduce import DEMO
from rampcast.recording import columns as c
from rampcast.simulate.shipped import shipped_sample

STEPS = np.array([4, 24, 49, 74])  # of 0.2 s
TEN = 49
TIMES = range(60, 880, 10)  # [s]
SAMPLES = 100


def main() -> None:
    """Prints a Markdown table."""
    files = shipped_sample()
    training, _ = rc.clean(rc.read([files[0], files[2]]))
    model = rc.fit(training, spec=DEMO.ours).model
    test = rc.read(files[1])
    print("| forecast | who | 1 s | 5 s | 10 s | 15 s | in the band | Brier |\n|---|---|---:|---:|---:|---:|---:|---:|")
    for name, one in without(model):
        rows = np.concatenate([scored(one, test, time) for time in TIMES])
        for who, some in (("ramp", rows[rows[:, 0] == 1.0]), ("main lanes", rows[rows[:, 0] == 0.0])):
            means = [np.nanmean(column) for column in some[:, 1:-1].T]
            brier = f"{np.nanmean(some[:, -1]):.3f}" if who == "ramp" else ""
            print(f"| {name} | {who} | " + " | ".join(f"{mean:.2f}" for mean in means) + f" | {brier} |", flush=True)


def without(model: Calibrated) -> Iterator[tuple[str, Calibrated]]:
    """Yields the whole model, and models that lack a part, with what they lack."""
    driven = model.base.roll_out
    yield "all parts", model
    yield "without corrections", replace(model, in_lane=None, merging=None)
    plain = replace(model, in_lane=None, merging=None)
    for name, one in {
        "and without the putative leader": replace(driven, manners=replace(driven.manners, putative_leader=0.0)),
        "and without courtesy": replace(driven, manners=replace(driven.manners, courtesy=0.0)),
        "and with the paper's actual leader": replace(driven, manners=replace(driven.manners, putative_leader=0.5)),
        "and with the main lanes' drivers on the ramp": replace(driven, ramp=driven.main),
        "and without habits": replace(
            driven, main=replace(driven.main, habit=0.0), ramp=replace(driven.ramp, habit=0.0)
        ),
        "and without residuals": replace(driven, disturbance=replace(driven.disturbance, size=0.0, trust=0.0)),
    }.items():
        yield name, replace(plain, base=replace(plain.base, roll_out=one))
    yield "and without the forest", replace(plain, base=replace(plain.base, forest=None))


def scored(model: Calibrated, test: rc.Recording, time: int) -> np.ndarray:
    """Returns a row for each vehicle: is it on the ramp; errors [m]; is the truth in the band; squared error of
    having merged."""
    forecast = forecast_traffic(model, rc.traffic(test, at=float(time)), samples=SAMPLES)
    x, lane = truth(test, forecast)
    low, median, high = np.moveaxis(forecast.quantiles((0.05, 0.5, 0.95)), 2, 0)
    inside = np.where(np.isfinite(x), (low <= x) & (x <= high), np.nan)[:, -1]
    merged = (lane[:, : TEN + 1] == test.site.target_lane).any(axis=1)
    seen = np.isfinite(x[:, TEN])
    brier = np.where(seen, (forecast.p_merged[:, TEN] - merged) ** 2, np.nan)
    return np.column_stack([forecast.on_ramp, np.abs(median - x)[:, STEPS], inside, brier])


def truth(test: rc.Recording, forecast: Forecast) -> tuple[np.ndarray, np.ndarray]:
    """Returns fronts [m] and lanes at 0.2, 0.4 ... 15 s; NaN where the vehicle is not seen."""
    rows = test.tracks.select(c.VEHICLE, c.FRAME, c.X, c.LANE).to_numpy()
    steps = (rows[:, 1] * test.time_step - forecast.t0) / 0.2
    kept = (np.abs(steps - np.round(steps)) < 0.01) & (steps > 0.5) & (steps < 75.5)
    kept &= np.isin(rows[:, 0], forecast.vehicle)
    x, lane = np.full((2, len(forecast), 75), np.nan)
    place = forecast.places(rows[kept, 0].astype(int).tolist()), np.round(steps[kept]).astype(int) - 1
    x[place], lane[place] = rows[kept, 2], rows[kept, 3]
    return x, lane


if __name__ == "__main__":
    main()
