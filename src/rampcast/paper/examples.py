"""Scenes worth looking at, chosen by rule: two in which a wave surprises the forecast, two that are forecast well."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import polars as pl
from jaxtyping import Bool, Float

from rampcast.forecast.tables import BANDS
from rampcast.forecasters import label
from rampcast.horizon import FUTURE, PAST, STEP
from rampcast.paper.neighbours.predict import NeighbourForecast
from rampcast.paper.scenes.scenes import CENTRAL, SLOTS, Scenes
from rampcast.traffic.anchors import V, X

SHOWN_MODEL = "ghr"  # the paper shows its scenes with GHR
SHOWN_MODELS = ("rampcast", "ghr", "idm", "lstm_alone")
BAND = {"x_q05": "5 % quantile", "x_q95": "95 % quantile"}  # of the forecast that has them
GOOD_ERROR = 5.0  # [m] the paper's closer bound: a good scene stays within it for the whole 15 s
WAVE_SPEED_CHANGE = 3.0  # [m/s] a vehicle whose speed changes by more in 15 s has met a wave


@dataclass(frozen=True)
class Shown:
    """What pictures of single scenes show of forecasts.

    Attributes:
        x: by model, front position of the central vehicle at 0.2, 0.4, ... s after t0 [m].
        bands: quantiles of it, at `forecast.tables.BANDS`, by the models that give some [m].
        neighbours: as they were predicted; None if nobody has.
    """

    x: Mapping[str, Float[np.ndarray, "scene future"]]
    bands: Mapping[str, Float[np.ndarray, "scene future band"]]
    neighbours: NeighbourForecast | None


PAST_TIME = np.round(np.arange(1 - PAST, 1) * STEP, 1)
FUTURE_TIME = np.round(np.arange(1, FUTURE + 1) * STEP, 1)


def example_scenes(scenes: Scenes, forecast: Shown) -> pl.DataFrame:
    """Returns the tracks of up to four chosen scenes; columns example, title, series, slot, kind, t [s], x [m].

    shock_1 and shock_2: of the vehicles that met a wave, the one forecast furthest too far and the one furthest
    too short after 15 s. good_1 and good_2: of the vehicles forecast within 5 m throughout, the two whose neighbours
    were predicted worst. Only scenes whose truth was seen for 15 s are eligible; an example without one is left out.
    """
    chosen = choose_examples(scenes, forecast)
    tables = [_tracks(name, scene, scenes, forecast) for name, scene in chosen.items()]
    return pl.concat(tables) if tables else pl.DataFrame(schema=_SCHEMA)


def choose_examples(scenes: Scenes, forecast: Shown) -> dict[str, int]:
    """Returns the scene number of each example that could be found."""
    seen = np.flatnonzero(scenes.future_valid[:, CENTRAL].all(axis=1))
    if not len(seen) or SHOWN_MODEL not in forecast.x or forecast.neighbours is None:
        return {}
    observed = scenes.future[seen, CENTRAL]
    error = forecast.x[SHOWN_MODEL][seen] - observed[..., X]
    met_wave = np.ptp(observed[..., V], axis=1) > WAVE_SPEED_CHANGE
    too_far = _best(error[:, -1], met_wave & (error[:, -1] > GOOD_ERROR), 1)
    too_short = _best(-error[:, -1], met_wave & (error[:, -1] < -GOOD_ERROR), 1)
    good = np.abs(error).max(axis=1) < GOOD_ERROR
    surprised = _neighbour_error(scenes, forecast.neighbours)[seen]
    best = _best(surprised, good, len(seen))
    good_vehicles: dict[tuple[str, int], int] = {}
    for row in best:
        scene = seen[row]
        good_vehicles.setdefault((str(scenes.recording[scene]), int(scenes.vehicle[scene, CENTRAL])), int(scene))
    picked = {f"shock_{n + 1}": int(seen[row[0]]) for n, row in enumerate((too_far, too_short)) if len(row)}
    return picked | {f"good_{n + 1}": scene for n, scene in enumerate(list(good_vehicles.values())[:2])}


def _best(score: Float[np.ndarray, "scene"], eligible: Bool[np.ndarray, "scene"], count: int) -> np.ndarray:
    """Returns the positions of the highest finite scores among the eligible, highest first."""
    ranked = np.argsort(-np.where(eligible & np.isfinite(score), score, -np.inf), kind="stable")
    return ranked[: min(count, int(np.count_nonzero(eligible & np.isfinite(score))))]


def _neighbour_error(scenes: Scenes, neighbours: NeighbourForecast) -> Float[np.ndarray, "scene"]:
    """Returns the mean absolute error of the predicted neighbours over the last second for which each was seen [m]."""
    error = np.abs(neighbours.x[:, 1:, 1:] - scenes.future[:, 1:, :, X])
    known = scenes.future_valid[:, 1:]
    total, count = np.where(known, error, 0.0).sum(axis=(1, 2)), known.sum(axis=(1, 2))
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


_SCHEMA = {
    "example": pl.String,
    "title": pl.String,
    "series": pl.String,
    "slot": pl.String,
    "kind": pl.String,
    "t": pl.Float64,
    "x": pl.Float64,
}


def scene_tracks(scene: int, scenes: Scenes, forecast: Shown) -> pl.DataFrame:
    """Returns the observed, predicted and forecast tracks of one scene; columns series, slot, kind, t [s], x [m].

    Of a forecast with samples there are the 5 % and the 95 % quantile too, of the kind "band".
    """
    parts = []
    for slot in np.flatnonzero(~scenes.virtual[scene]):
        name = SLOTS[slot]
        known_past, known_future = scenes.past_valid[scene, slot], scenes.future_valid[scene, slot]
        time = np.concatenate([PAST_TIME[known_past], FUTURE_TIME[: len(known_future)][known_future]])
        x = np.concatenate([scenes.past[scene, slot, known_past, X], scenes.future[scene, slot, known_future, X]])
        parts.append(_series(f"{name} observed", name, "observed", time, x))
        if slot != CENTRAL and forecast.neighbours is not None:
            predicted = forecast.neighbours.x[scene, slot, 1:]
            parts.append(_series(f"{name} predicted", name, "predicted", FUTURE_TIME[: len(predicted)], predicted))
    for model in (name for name in SHOWN_MODELS if name in forecast.x):
        x = forecast.x[model][scene]
        series = f"central forecast ({label(model)})"
        parts.append(_series(series, "central", "forecast", FUTURE_TIME[: len(x)], x))
    for bands in forecast.bands.values():
        for name, text in BAND.items():
            x = bands[scene, :, list(BANDS).index(name)]
            parts.append(_series(f"central {text}", "central", "band", FUTURE_TIME[: len(x)], x))
    return pl.concat(parts)


def _tracks(example: str, scene: int, scenes: Scenes, forecast: Shown) -> pl.DataFrame:
    title = f"vehicle {scenes.vehicle[scene, CENTRAL]} of {scenes.recording[scene]}, t0 = {scenes.t0[scene]:.1f} s"
    return scene_tracks(scene, scenes, forecast).select(
        pl.lit(example).alias("example"), pl.lit(title).alias("title"), pl.all()
    )


def _series(
    series: str, slot: str, kind: str, time: Float[np.ndarray, "step"], x: Float[np.ndarray, "step"]
) -> pl.DataFrame:
    return pl.DataFrame({"t": time, "x": x}).select(
        pl.lit(series).alias("series"), pl.lit(slot).alias("slot"), pl.lit(kind).alias("kind"), pl.all()
    )
