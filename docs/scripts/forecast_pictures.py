"""Draws the pictures of docs/limits.md into docs/images, and prints what they show, or writes it into the page.

    rampcast benchmark --out out/benchmark
    python docs/scripts/forecast_pictures.py out/benchmark --write

The forecasts are of simulated vehicles: trained on windows 1 and 3, shown of window 2, each the one with the median
error of those that a rule names. Reliability and coverage come from the tables of the run of the benchmark. Without a
run only the forecasts are drawn.
"""

import argparse
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from textwrap import fill

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int
from matplotlib.figure import Figure

from rampcast.benchmark import Cases, Forecasts, MergeForecasts, Training, case_table, merge_case_table
from rampcast.benchmark.cases import make_cases, names, regular_anchors, smoothed_runs
from rampcast.benchmark.merge_sets import simulated
from rampcast.benchmark.merges import base_rate
from rampcast.benchmark.models import LEVELS, constant_velocity
from rampcast.benchmark.pictures import benchmark_pictures, read_benchmark, save_pictures
from rampcast.benchmark.reliability import typical_merges, with_merges
from rampcast.forecast.scene_forecaster import SceneForecast
from rampcast.horizon import FUTURE, STEP
from rampcast.plots.forecast_pictures import arriving_wave, forecast_fan, merge_densities
from rampcast.plots.style import figure_of
from rampcast.recording import read_recording
from rampcast.simulate import shipped_sample
from rampcast.traffic.around import joined
from rampcast.traffic.platoons import HISTORY, Tracks, chain_ahead, tracks_of_recording

DOCS = Path(__file__).parents[1]
IMAGES, PAGE = DOCS / "images", DOCS / "limits.md"
BEGIN, END = "<!-- pictures: begin -->", "<!-- pictures: end -->"
TEST = 2  # window
MAIN_EVERY, RAMP_EVERY = 12, 4  # one of so many training cases in the target lane, and on the ramp: 1,500 of each
PAST = HISTORY - 1  # steps before t = 0
TIME = np.arange(-PAST, FUTURE + 1) * STEP
QUANTILES = tuple(f"x_q{round(100 * level):02d}" for level in LEVELS)

LEADERS, SAME, FALL = 4, 1.0, 3.0  # of a vehicle that a wave is coming to: known leaders, [m/s], [m/s]
FROM, UNTIL = 3.0, 12.0  # [s] when the wave reaches it
LONGEST = round(5.0 / STEP)  # steps from one vehicle to the next one
MERGES_FROM, MERGES_UNTIL = 3.0, 12.0  # [s] when the vehicle of the fan merges

ALTERNATIVES = {
    "forecast_fan": "Displacement over 15 s: median, bands, truth; below, the probability to have merged",
    "forecast_wave": "Vehicles in time and space, a wave that runs upstream, and a forecast that bends before it",
    "merge_densities": "Five densities of the time of the merge, with the true times",
    "reliability_of_places": "Share of the truths below each forecast quantile, by data set",
    "band_coverage": "Share of the truths in the band of 90 %, by data set and second",
    "reliability_of_merges_simulated": "Observed share of merges by forecast probability",
    "reliability_of_merges_us101_ramp_merges": "The same for the ramp merges of US-101",
    "error_over_horizon": "Mean absolute error over 1 to 15 s, by data set and model",
}
SAID = {
    "forecast_fan": """
        **A vehicle that merges.** Where it will be, as median and bands of 50 and 90 %, and where it was. Below,
        from the same samples, the probability to have merged.
    """,
    "forecast_wave": """
        **A wave that has not come yet.** At t = 0 the vehicle keeps its speed, while those ahead of it brake one
        after the other. The forecast made then bends where the wave will come; a constant speed does not.
    """,
    "merge_densities": """
        **When it will merge.** How likely a vehicle is said to merge in each second, and when it did; dashed, the
        Kaplan-Meier curve of all training cases.
    """,
    "reliability_of_places": """
        **Are the quantiles right?** How many truths lie below the quantiles of the forecast, on the test parts: 25
        % should lie below that of 25 %, and a calibrated forecast is on the diagonal. Above it, forecasts are too
        far downstream. Open markers: fewer than 100 cases; with fewer than 20 nothing is drawn.
    """,
    "band_coverage": """
        **Are the bands right?** How many truths lie in the band of 90 %, at every second; the zone is 87 to 93 %.
        The cases of one vehicle are alike, so that a line of few vehicles may leave the zone by chance.
    """,
    "reliability_of_merges_simulated": """
        **Are the probabilities right?** Of the simulated cases that were said to merge within 3, 5 or 10 s with
        about 70 %, 70 % should do so. What is observed is the share of the cases whose merge was seen, in bins of
        10 %. Below stands how many cases are in each; bins of fewer than 10 are left out. The base rate says the
        same of all.
    """,
    "reliability_of_merges_us101_ramp_merges": """
        The same for the ramp merges of US-101. Nearly all of them merge within 10 s, so that there is little to
        tell apart.
    """,
    "error_over_horizon": """
        **How far off?** Mean error on the test parts, at every second that at least 20 cases reach.
    """,
}


@dataclass(frozen=True)
class Window:
    """A simulated window: tracks, smoothed places [m], and the cases in the target lane with their rows."""

    tracks: Tracks
    x: Float[np.ndarray, "row"]
    rows: Int[np.ndarray, "case"]
    cases: Cases


def main() -> None:
    """Draws the pictures."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("benchmark", type=Path, nargs="?", help="folder that rampcast benchmark wrote")
    options.add_argument("--images", type=Path, default=IMAGES, help="where to put the pictures")
    options.add_argument("--write", action="store_true", help="put what they show into docs/limits.md")
    options.add_argument("--fewer", type=int, default=1, help="use only each so-manieth of the training cases, to try")
    chosen = options.parse_args()
    windows = [window(file, number) for number, file in enumerate(shipped_sample(), start=1)]
    ramp = simulated(shipped_sample())
    in_test = np.char.startswith(ramp.case, f"{TEST}-")
    training = Training(
        joined(
            [thinned(one.cases, MAIN_EVERY * chosen.fewer) for number, one in enumerate(windows, 1) if number != TEST]
            + [thinned(ramp.select(~in_test), RAMP_EVERY * chosen.fewer)]
        )
    )
    ramp = ramp.select(in_test & ramp.merging)
    pictures, rules = {}, {}
    pictures["forecast_fan"], rules["forecast_fan"] = fan(training, ramp)
    pictures["forecast_wave"], rules["forecast_wave"] = wave(training, windows[TEST - 1])
    pictures["merge_densities"], rules["merge_densities"] = densities(training, ramp)
    if chosen.benchmark:
        of_run = benchmark_pictures(read_benchmark(chosen.benchmark))
        pictures |= {name: of_run[name] for name in SAID if name in of_run}
    chosen.images.mkdir(parents=True, exist_ok=True)
    for name in pictures:  # those of earlier releases are in the repository, and are replaced
        (chosen.images / f"{name}.png").unlink(missing_ok=True)
    for path in save_pictures(pictures, chosen.images, kinds=("png",)):
        print(f"{path}: {path.stat().st_size / 1000:.0f} kB")
    text = page_text(pictures, rules)
    if chosen.write:
        before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
        _, _, after = rest.partition(END)
        PAGE.write_text(f"{before}{BEGIN}\n\n{text}\n\n{END}{after}", encoding="utf-8")
    else:
        print(text)


def page_text(pictures: Iterable[str], rules: Mapping[str, str]) -> str:
    """Returns the pictures with what is said of them, as Markdown."""
    parts = []
    for name in pictures:
        words = " ".join(f"{SAID[name]} {rules.get(name, '')}".split())
        parts += [f"![{ALTERNATIVES[name]}](images/{name}.png)", fill(words, width=120, break_on_hyphens=False)]
    return "\n\n".join(parts)


def window(file: Path, number: int) -> Window:
    """Returns a window with a case for each vehicle in the target lane behind another, every 2.5 s."""
    recording = read_recording(file)
    tracks = tracks_of_recording(recording)
    rows = regular_anchors(tracks)
    lane = recording.tracks["lane"].to_numpy()
    rows = rows[(lane[rows] == recording.site.target_lane) & tracks.led[rows]]
    vehicle = recording.tracks["vehicle"].to_numpy()[rows]
    group = names(np.full(len(rows), number), vehicle)
    t0 = tracks.frame[rows] * tracks.time_step
    cases = make_cases("main", tracks, rows, case=rows.astype(np.str_), group=group, t0=t0)
    return Window(tracks, smoothed_runs(tracks), cases.case.astype(np.int64), cases)


def thinned(cases: Cases, every: int) -> Cases:
    """Returns one of so many cases."""
    return cases.select(np.arange(0, len(cases), every))


def fan(training: Training, ramp: Cases) -> tuple[Figure, str]:
    """Returns the picture of a vehicle that merges, and by what rule it was chosen."""
    eligible = (ramp.change_time >= MERGES_FROM) & (ramp.change_time <= MERGES_UNTIL)
    cases = ramp.select(eligible & np.isfinite(ramp.truth).all(axis=1))
    forecast = training.scene_forecaster.predict(cases.scenes)
    row = median_row(forecast, cases)
    one, own = cases.select(np.array([row])), part(forecast, row)
    merges = {"rampcast": MergeForecasts(own.p_within, own.p_at, own.median_time)}
    table = with_merges(case_table(one, forecasts_of(training, one, own)), merge_case_table(one, merges))
    event = float(one.change_time[0])
    errors, naive = errors_of(cases, forecast)
    rule = (
        f"Of the {len(cases):,} cases on the ramp that merge {MERGES_FROM:.0f} to {MERGES_UNTIL:.0f} s later and are "
        f"seen for 15 s, the one with the median error after 15 s: {errors[row]:.1f} m, where a constant speed is off "
        f"by {naive[row]:.1f} m. It merged after {event:.1f} s."
    )
    return figure_of(forecast_fan(table)), rule


def wave(training: Training, test: Window) -> tuple[Figure, str]:
    """Returns the picture of a wave that comes to a vehicle, and by what rule it was chosen."""
    coming = np.flatnonzero(wave_is_coming(test.cases))
    coming = coming[[runs_through(tracks_around(test, platoon(test, row))) for row in test.rows[coming]]]
    cases, rows = test.cases.select(coming), test.rows[coming]
    forecast = training.scene_forecaster.predict(cases.scenes)
    row = median_row(forecast, cases)
    one = cases.select(np.array([row]))
    table = wave_table(
        tracks_around(test, platoon(test, rows[row])), case_table(one, forecasts_of(training, one, part(forecast, row)))
    )
    errors, naive = errors_of(cases, forecast)
    rule = (
        f"Of the {len(cases):,} cases in the target lane to which a wave is coming, the one with the median error "
        f"after 15 s: {errors[row]:.1f} m, where a constant speed is off by {naive[row]:.1f} m. A wave is coming "
        f"where a vehicle ahead is {FALL:.0f} m/s slower at t = 0, while the vehicle itself has not slowed down, keeps "
        f"its speed to {SAME:.0f} m/s in the next {FROM:.0f} s, and loses more than {FALL:.0f} m/s from then to "
        f"{UNTIL:.0f} s, after the wave has run upstream through the four vehicles ahead. The mean errors over all "
        f"these cases are {errors.mean():.1f} and {naive.mean():.1f} m."
    )
    return figure_of(arriving_wave(table)), rule


def densities(training: Training, ramp: Cases) -> tuple[Figure, str]:
    """Returns the picture of the forecast merge times of a few vehicles, and by what rule it was chosen."""
    found = training.scene_forecaster.predict(ramp.scenes)
    own = MergeForecasts(found.p_within, found.p_at, found.median_time)
    table = merge_case_table(ramp, {"base_rate": base_rate(training)(ramp.scenes, ramp.since_entry), "rampcast": own})
    soon = ramp.change_time[ramp.change_time <= FUTURE * STEP]
    rule = (
        "Shown are the cases on the ramp whose true times are nearest to the 10, 30, 50, 70 and 90 % quantiles of the "
        f"{len(soon):,} true times up to 15 s."
    )
    return figure_of(merge_densities(typical_merges(table))), rule


def wave_is_coming(cases: Cases) -> Bool[np.ndarray, "case"]:
    """Returns to which cases a wave is coming that the vehicles ahead show at t = 0."""
    own = cases.platoons
    now = own.v[:, 0, -1]
    speed = np.diff(np.column_stack([np.zeros(len(cases)), cases.truth]), axis=1) / STEP
    first, last = round(FROM / STEP), round(UNTIL / STEP)
    slower_ahead = np.where(own.present[:, 1:], own.v[:, 1:, -1], np.inf).min(axis=1) < now - FALL
    keeps = (np.abs(speed[:, :first] - now[:, None]) < SAME).all(axis=1)
    not_before = np.where(own.valid[:, 0], own.v[:, 0], 0.0).max(axis=1) < now + SAME
    falls = speed[:, first - 1] - speed[:, first:last].min(axis=1) > FALL
    known = np.isfinite(cases.truth).all(axis=1) & (own.depth >= LEADERS)
    return known & slower_ahead & keeps & not_before & falls


def platoon(test: Window, row: int) -> Int[np.ndarray, "place"]:
    """Returns the rows of a vehicle and those ahead of it."""
    places, there = chain_ahead(test.tracks, np.array([row]))
    return places[0, there[0]]


def runs_through(x: Float[np.ndarray, "place time"]) -> bool:
    """Returns whether the wave runs upstream through `LEADERS` vehicles ahead and then reaches the vehicle itself."""
    steps = np.array(braking_steps(x)[: LEADERS + 1])
    places = x[np.arange(len(steps)), steps]
    return bool((steps >= 0).all() and (np.diff(places) > 0.0).all())


def median_row(forecast: SceneForecast, cases: Cases) -> int:
    """Returns the case with the median error after 15 s."""
    error, _ = errors_of(cases, forecast)
    return int(np.argsort(error, kind="stable")[len(error) // 2])


def errors_of(cases: Cases, forecast: SceneForecast) -> tuple[Float[np.ndarray, "case"], Float[np.ndarray, "case"]]:
    """Returns how far the medians, and a constant speed, are off after 15 s [m]."""
    naive = np.maximum(cases.platoons.v[:, 0, -1], 0.0) * FUTURE * STEP
    return np.abs(forecast.median[:, -1] - cases.truth[:, -1]), np.abs(naive - cases.truth[:, -1])


def part(forecast: SceneForecast, row: int) -> SceneForecast:
    """Returns the forecast of one scene."""
    return SceneForecast(**{field.name: getattr(forecast, field.name)[[row]] for field in fields(SceneForecast)})


def forecasts_of(training: Training, cases: Cases, found: SceneForecast) -> dict[str, Forecasts]:
    """Returns what the pictures compare."""
    own = Forecasts(found.median.astype(float), found.quantiles_at(*LEVELS).astype(float))
    return {"rampcast": own, "constant_velocity": constant_velocity(training)(cases.scenes)}


def tracks_around(test: Window, rows: Int[np.ndarray, "place"]) -> Float[np.ndarray, "place time"]:
    """Returns the smoothed places of the vehicles at those rows from 4 s before to 15 s after [m]; NaN if not seen."""
    tracks = test.tracks
    vehicle = np.repeat(tracks.vehicle[rows][:, None], len(TIME), axis=1)
    steps = np.arange(-PAST, FUTURE + 1) * tracks.every
    found, seen = tracks.find(vehicle, tracks.frame[rows][:, None] + steps)
    return np.where(seen, test.x[found], np.nan)


def wave_table(x: Float[np.ndarray, "place time"], forecast: pl.DataFrame) -> pl.DataFrame:
    """Returns the table that `arriving_wave` draws.

    Args:
        x: of the vehicle and those ahead [m].
        forecast: the table `cases` of that vehicle.
    """
    brakes = braking_steps(x)
    parts = []
    for place, own in enumerate(x):
        seen = np.isfinite(own)
        rows = pl.DataFrame({"t": TIME, "x": own, "brakes": np.arange(len(TIME)) == brakes[place]}).filter(seen)
        before = rows.filter(pl.col("t") < STEP / 2).with_columns(series=pl.lit("observed"))
        after = rows.filter(pl.col("t") > -STEP / 2).with_columns(series=pl.lit("future"))
        parts += [part.with_columns(place=pl.lit(place)) for part in (before, after)]
    start = x[0, PAST]
    moved = forecast.select(
        pl.col("model").alias("series"),
        pl.col("horizon").alias("t"),
        start + pl.col("x", *QUANTILES),
        brakes=pl.lit(value=False),
        place=pl.lit(0),
    )
    at_start = moved.unique("series").with_columns(pl.lit(0.0).alias("t"), pl.col("x", *QUANTILES) * 0.0 + start)
    return pl.concat([*parts, at_start, moved], how="diagonal_relaxed")


def braking_steps(x: Float[np.ndarray, "place time"]) -> list[int]:
    """Returns the step at which the wave reaches each vehicle, from the last to the first; -1 where it does not.

    It has reached a vehicle whose speed falls below the middle between the central vehicle's speed at t = 0 and its
    lowest one after: of several such steps the last that lies before that of the vehicle behind.
    """
    speed = np.gradient(x, STEP, axis=1)
    middle = (speed[0, PAST] + speed[0, PAST:].min()) / 2
    falling = (speed[:, :-1] >= middle) & (speed[:, 1:] < middle)
    steps, latest = [], len(TIME)
    for place in range(len(x)):
        found = np.flatnonzero(falling[place, :latest]) if latest > 0 else []
        if place == 0:
            found = found[found >= PAST][:1]
        latest = int(found[-1]) + 1 if len(found) and (not steps or latest - found[-1] < LONGEST) else 0
        steps.append(latest if latest > 0 else -1)
    return steps


if __name__ == "__main__":
    main()
