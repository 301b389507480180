"""How far forecasts move when positions are noisy by a millimetre: of samples alone, corrected, and at constant speed.

Run: python benchmarks/noise_on_positions.py
Takes the pretrained model and twelve moments of a shipped simulated window. Independent normal noise is put on every
raw position x; the rows tell how far the mean and the median of each vehicle's samples move after 5 and 15 s: half of
the vehicles, nine of ten, ninety-nine of a hundred, and all within. A vehicle at constant speed is the floor: what the
noise makes of its speed at t = 0, times the horizon.
"""

import sys
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import polars as pl
from jaxtyping import Float

import rampcast as rc
from measure import how_many
from rampcast.forecast.calibrated import Calibrated
from rampcast.horizon import STEP
from rampcast.recording import Recording, read_recording
from rampcast.recording import columns as c
from rampcast.simulate import shipped_sample
from rampcast.traffic import Traffic
from rampcast.traffic.around import merge_scenes_at
from rampcast.traffic.moments import traffic_at_times
from rampcast.traffic.situation import forecastable, situation_of_traffic

MOMENTS = np.arange(100.0, 800.0, 60.0)[: how_many(12, tiny=2)]  # [s]
NOISE = (1e-12, 1e-3)  # [m]
STEPS = (24, 74)  # 5 and 15 s
WITHIN = (0.5, 0.9, 0.99, 1.0)
SAMPLES = (50, 200, 800)


def main() -> None:
    """Prints a row for each noise, way and statistic."""
    recording, model = read_recording(shipped_sample()[1]), rc.load("pretrained").model
    alone = replace(model, in_lane=None, merging=None)
    for size in NOISE:
        noisy = _noisy(recording, size)
        print(f"noise of {size:g} m: moved after 5 | 15 s by, within which {WITHIN} of vehicles are [m]")
        ways = {f"roll-outs alone, {n} samples": (alone, n) for n in SAMPLES[: how_many(3, tiny=1)]}
        for name, (forecaster, samples) in (ways | {"corrected, 200 samples": (model, 200)}).items():
            pairs = list(
                zip(_futures(recording, forecaster, samples), _futures(noisy, forecaster, samples), strict=True)
            )
            for statistic in (np.mean, np.median):
                moves = [np.abs(statistic(one, axis=1) - statistic(other, axis=1)) for one, other in pairs]
                _print_row(f"{statistic.__name__}, {name}", np.concatenate(moves)[:, STEPS])
        _print_row("constant speed", _moves_at_constant_speed(recording, noisy))


def _noisy(recording: Recording, size: float) -> Recording:
    noise = size * np.random.default_rng(1).standard_normal(recording.tracks.height)
    return replace(recording, tracks=recording.tracks.with_columns(pl.col(c.X) + pl.Series(noise)))


def _futures(
    recording: Recording, model: Calibrated, samples: int
) -> Iterator[Float[np.ndarray, "vehicle sample step"]]:
    for traffic in _traffics(recording):
        rows = forecastable(traffic)
        every = np.arange(len(rows))
        scenes = merge_scenes_at(traffic, rows)
        yield model.futures(situation_of_traffic(traffic), scenes, every, every, samples=samples)[1].x.astype(float)


def _traffics(recording: Recording) -> Iterator[Traffic]:
    yield from traffic_at_times(recording, recording.names[0], MOMENTS)


def _moves_at_constant_speed(recording: Recording, noisy: Recording) -> Float[np.ndarray, "vehicle horizon"]:
    horizon = (np.array(STEPS) + 1) * STEP
    places = [
        np.concatenate([one.x[:, -1, None] + one.v[:, -1, None] * horizon for one in _traffics(which)])
        for which in (recording, noisy)
    ]
    return np.abs(places[0] - places[1])


def _print_row(name: str, moves: Float[np.ndarray, "vehicle horizon"]) -> None:
    columns = [" ".join(f"{value:7.3f}" for value in np.quantile(at, WITHIN)) for at in moves.T]
    print(f"  {name:<44}{' | '.join(columns)}")


if __name__ == "__main__":
    sys.exit(main())
