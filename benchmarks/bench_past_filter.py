"""States from the past alone: errors of several filters against smoothing that looks ahead, and the time of ours.

Run: python benchmarks/bench_past_filter.py
Reads the real recordings in the folder that RAMPCAST_DATA names (default ../shared/data), where they are, and a
simulated window. Each window is 4 s of past and 2 s of future of one vehicle; the truth is the filter of
`recording.clean` over all of it.
"""

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import polars as pl
from jaxtyping import Float
from scipy.signal import savgol_coeffs, savgol_filter

from measure import how_many, once, print_ratio, seconds
from rampcast.recording import read_recording
from rampcast.recording.smoothing import HALF_WINDOW, ORDER
from rampcast.simulate import shipped_sample
from rampcast.traffic.moments import GRID
from rampcast.traffic.past_filter import FADING, JERK, POSITION_NOISE, states_from_past

REAL = Path(os.environ.get("RAMPCAST_DATA", "../shared/data")) / "real"
FOOT = 0.3048  # [m]
PAST, FUTURE, EVERY = 4.0, 2.0, 1.0  # [s]
MOST = how_many(1500, tiny=20)  # windows of a set
Windows = Float[np.ndarray, "window sample"]
States = tuple[Float[np.ndarray, "window"], ...]  # position, speed, acceleration at t0


def main() -> None:
    """Prints a table of errors [m, m/s, m/s^2] for each set and axis, then how long ours and a plain loop take."""
    for name, table, time_step in data_sets():
        for axis, z in windows(table, time_step).items():
            truth = two_sided(z, time_step)
            print(
                f"{name}, {axis}: {len(z)} windows at {1 / time_step:.0f} Hz; rms error of place, speed, acceleration"
            )
            for label, found in filters(z, time_step, 0 if axis == "x" else 1).items():
                print(
                    f"  {label:<44}" + "".join(f"{rms(one - two):>9.3f}" for one, two in zip(found, truth, strict=True))
                )
    z = windows(*next(simulated())[1:])["x"]
    ours = seconds(lambda: past_filter(z, 0.1, 0))
    plain = once(lambda: [plain_filter(row[None], 0.1) for row in z])
    print(f"{len(z)} vehicles of 4 s at 10 Hz: ours {ours * 1e3:.1f} ms, smoothed over the 4 s too")
    print_ratio("a Python loop of the filter alone to ours", plain / ours)


def data_sets() -> Iterator[tuple[str, pl.DataFrame, float]]:
    """Yields name, columns vehicle, frame, x, y [m] and time step [s] of each set that is there."""
    if (path := REAL / "us101_excerpts.csv").is_file():
        feet = {"x": pl.col("Local_Y") * FOOT, "y": pl.col("Local_X") * FOOT}
        yield path.stem, pl.read_csv(path).select(vehicle="Vehicle_ID", frame="Frame_ID", **feet), 0.1
    if (path := REAL / "us101_lane_changers.parquet").is_file():
        yield path.stem, pl.read_parquet(path).select("frame", "x", "y", vehicle="track"), 0.1
    if (path := REAL / "i80_camera6.parquet").is_file():
        yield path.stem, pl.read_parquet(path).select("vehicle", "frame", "x", y=pl.lit(0.0)), 0.1
    if (path := REAL / "i24_scene.parquet").is_file():
        yield path.stem, pl.read_parquet(path).select("vehicle", "frame", "x", "y"), 0.04
    yield from simulated()


def simulated() -> Iterator[tuple[str, pl.DataFrame, float]]:
    """Yields the first simulated window."""
    recording = read_recording(shipped_sample()[0])
    yield "simulated", recording.tracks.select("vehicle", "frame", "x", "y"), recording.time_step


def windows(table: pl.DataFrame, time_step: float) -> dict[str, Windows]:
    """Returns 6 s of single vehicles without a hole, by axis; an axis along which nothing moves is left out."""
    table = table.unique(("vehicle", "frame"), keep="first", maintain_order=True).sort("vehicle", "frame")
    vehicle, frame = table["vehicle"].to_numpy(), table["frame"].to_numpy()
    size = round((PAST + FUTURE) / time_step) + 1
    gaps = np.flatnonzero((np.diff(vehicle) != 0) | (np.diff(frame) != 1)) + 1
    runs = zip([0, *gaps], [*gaps, len(vehicle)], strict=True)
    first = np.concatenate([np.arange(start, stop - size + 1, round(EVERY / time_step)) for start, stop in runs])
    first = first[np.unique(np.linspace(0, len(first) - 1, MOST).astype(int))].astype(int)
    chosen = {axis: table[axis].to_numpy()[first[:, None] + np.arange(size)] for axis in ("x", "y")}
    return {axis: z for axis, z in chosen.items() if np.ptp(z) > 0}


def two_sided(z: Windows, time_step: float) -> States:
    """Returns the states at t0 of the filter that sees the future too."""
    at = round(PAST / time_step)
    return tuple(states[:, at] for states in smoothed(z, time_step))


def smoothed(z: Windows, time_step: float) -> tuple[Windows, ...]:
    """Returns place, speed and acceleration as `recording.clean` derives them."""
    x = savgol_filter(z, 2 * round(HALF_WINDOW / time_step) + 1, ORDER, axis=1)
    v = np.gradient(x, time_step, axis=1, edge_order=2)
    return x, v, np.gradient(v, time_step, axis=1, edge_order=2)


def filters(z: Windows, time_step: float, axis: int) -> dict[str, States]:
    """Returns the states at t0 by several filters of the past alone."""
    past = z[:, : round(PAST / time_step) + 1]
    cut = tuple(states[:, -1] for states in smoothed(past, time_step))
    found: dict[str, States] = {"smoothing cut off at t0 (Savitzky-Golay, cubic)": cut}
    for length, order in ((0.6, 2), (1.0, 2), (1.0, 3), (2.0, 2)):
        found[f"one-sided Savitzky-Golay, {length} s, order {order}"] = one_sided(past, time_step, length, order)
    for jerk in (3.0, 10.0):
        found[f"Kalman, jerk noise {jerk:g}, no fading"] = plain_filter(past, time_step, jerk=jerk, fading=1e-3)
    for jerk, fading in ((3.0, 1.0), (6.0, 1.5), (10.0, 2.0)):
        found[f"Kalman, jerk noise {jerk:g}, fading {fading:g}/s"] = plain_filter(
            past, time_step, jerk=jerk, fading=fading
        )
    return found | {f"ours: jerk noise {JERK[axis]:g}, fading {FADING:g}/s": past_filter(z, time_step, axis)}


def one_sided(past: Windows, time_step: float, length: float, order: int) -> States:
    """Returns place and derivatives at the end of a polynomial through the last `length` seconds."""
    size = round(length / time_step) + 1
    weights = (savgol_coeffs(size, order, deriv=n, delta=time_step, pos=size - 1, use="dot") for n in range(3))
    return tuple(past[:, -size:] @ weight for weight in weights)


def past_filter(z: Windows, time_step: float, axis: int) -> States:
    """Returns the states at t0 of rampcast's filter."""
    count = round(PAST / time_step) + 1
    past = np.ascontiguousarray(z[:, :count]).ravel()
    still = np.zeros(len(past))
    time = np.tile((np.arange(count) - count + 1) * time_step, len(z))
    x, y = (past, still) if axis == 0 else (still, past)
    states, _ = states_from_past(time, x, y, np.arange(len(z) + 1) * count, grid=GRID)
    return tuple(states[:, 2 * order + axis, -1] for order in range(3))


def plain_filter(past: Windows, time_step: float, *, jerk: float = JERK[0], fading: float = FADING) -> States:
    """Returns the last state of a Kalman filter with fading acceleration, in plain numpy."""
    e = np.exp(-fading * time_step)
    move = np.array([[1, time_step, (fading * time_step - 1 + e) / fading**2], [0, 1, (1 - e) / fading], [0, 0, e]])
    t = time_step
    noise = jerk**2 * np.array(
        [[t**5 / 20, t**4 / 8, t**3 / 6], [t**4 / 8, t**3 / 3, t**2 / 2], [t**3 / 6, t**2 / 2, t]]
    )
    mean = np.stack([past[:, 0], *np.zeros((2, len(past)))], axis=1)
    cov = np.diag([POSITION_NOISE**2, 40.0**2, 2.0**2])
    for seen in past[:, 1:].T:
        mean, cov = mean @ move.T, move @ cov @ move.T + noise
        gain = cov[:, 0] / (cov[0, 0] + POSITION_NOISE**2)
        mean, cov = mean + (seen - mean[:, 0])[:, None] * gain, cov - np.outer(gain, cov[0])
    return tuple(mean.T)


def rms(values: Float[np.ndarray, "window"]) -> float:
    """Returns the root mean square."""
    return float(np.sqrt(np.mean(values**2)))


if __name__ == "__main__":
    main()
