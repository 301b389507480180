"""The test protocol: which scenes are scored in which mode, and all tables of one forecaster on one recording."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int

from rampcast.errors import RecordingError
from rampcast.forecast.scene_forecaster import SceneForecaster
from rampcast.horizon import FUTURE, STEP, STEPS_PER_SECOND
from rampcast.paper.errors import central_errors, neighbour_errors
from rampcast.paper.examples import example_scenes
from rampcast.paper.framework import READINGS, Forecaster, window_hashes
from rampcast.paper.lane_change.forests import importance_table, training_table
from rampcast.paper.lane_change.scores import lane_change_scores, lane_change_table
from rampcast.paper.lane_change.sets import (
    KINDS,
    TIMES,
    Anchors,
    Reading,
    Sampling,
    lane_change_anchors,
)
from rampcast.paper.laws.laws import LAWS
from rampcast.paper.laws.mode import Mode
from rampcast.paper.neighbours.predict import continue_at_constant_speed
from rampcast.paper.parameters import outcome_table, parameter_table
from rampcast.paper.result import OWN, Forecast, lane_change_at_seconds
from rampcast.paper.scenes import Scenes, build_neighbour_scenes_at, build_scenes, build_scenes_at
from rampcast.paper.scenes.scenes import CENTRAL
from rampcast.recording import Recording
from rampcast.traffic import find_anchors
from rampcast.traffic.merge_scenes import build_merge_scenes

DRAWS_PER_VEHICLE = 2  # the paper: two random sub-trajectories of each test vehicle
CHUNK = 1024  # scenes whose samples are kept at the same time: 100 MB
LONGEST_WAIT = 16.0  # [s] before a lane change; the last of these says "no" to "within 15 s"


@dataclass(frozen=True)
class Evaluation:
    """What came out of a test.

    Attributes:
        scenes: the scenes that were scored.
        forecast: what was forecast for them.
        tables: tidy tables by name: longitudinal, parameters, outcomes, lane_change, importance, training, examples.
    """

    scenes: Scenes
    forecast: Forecast
    tables: dict[str, pl.DataFrame]


def evaluate(forecaster: Forecaster, recording: Recording, *, every: float = 1.0, seed: int = 1) -> Evaluation:
    """Returns the scores of a forecaster on a smoothed recording that it was not trained on.

    Args:
        forecaster: fitted on other windows.
        recording: the test windows.
        every: corrected mode: time between the anchors that are scored [s].
        seed: fixes what the paper draws at random.

    Raises:
        RecordingError: a window of the recording was trained on, or it holds no scene.
    """
    hashes = zip(recording.names, window_hashes(recording), strict=True)
    leaked = sorted(
        name for name, found in hashes if name in forecaster.trained_on or found in forecaster.window_hashes
    )
    if leaked:
        raise RecordingError(
            f"the windows {leaked} were used to train this model, so a score on them says nothing; evaluate on others"
        )
    scenes = test_scenes(recording, forecaster.mode, every=every, seed=seed)
    forecast = forecaster.predict(scenes)
    at_constant_speed = continue_at_constant_speed(scenes, steps=FUTURE)
    longitudinal = [
        central_errors(scenes, forecast.x),
        neighbour_errors(scenes, forecast.neighbours),
        neighbour_errors(scenes, at_constant_speed, model="constant_velocity"),
    ]
    tables = {
        "longitudinal": pl.concat(longitudinal),
        "parameters": pl.concat(
            [parameter_table(LAWS[name], fit, forecaster.mode) for name, fit in forecast.calibrations.items()]
        ),
        "outcomes": pl.concat([outcome_table(LAWS[name], fit) for name, fit in forecast.calibrations.items()]),
        "examples": example_scenes(scenes, forecast),
    }
    with_mode = {name: _with_mode(table, forecaster.mode) for name, table in tables.items()}
    lane_changes = _lane_change_tables(forecaster, recording, scenes, forecast, seed)
    return Evaluation(scenes, forecast, with_mode | lane_changes)


def test_scenes(recording: Recording, mode: Mode, *, every: float, seed: int) -> Scenes:
    """Returns the scenes to score.

    Paper mode: two random anchors of each vehicle that is seen for 4 s before and 15 s after them. Corrected mode: an
    anchor at every `every` [s]; each second is scored for which the truth was seen (erratum 6).
    """
    if mode is Mode.CORRECTED:
        return build_scenes(recording, every=every)
    anchors = find_anchors(recording, every=STEP)
    whole = anchors[build_neighbour_scenes_at(recording, anchors).seen_for >= FUTURE * STEP - 1e-9]
    if not len(whole):
        raise RecordingError(
            "the paper's protocol needs on-ramp vehicles that are seen for 19 s, 4 of them in the ramp lane; there are "
            "none. Corrected mode scores each second for which the truth was seen: train with --mode corrected"
        )
    drawn = _draw_per_vehicle(_vehicle_number(recording)[whole], np.random.default_rng(seed))
    return build_scenes_at(recording, whole[drawn])


test_scenes.__test__ = False  # type: ignore[attr-defined]


def run_counts(recording: Recording, scenes: Scenes) -> dict[str, int]:
    """Returns the counts of a test for the run record."""
    full = scenes.future_valid[:, CENTRAL].all(axis=1)
    return {
        "test_rows": recording.tracks.height,
        "scenes": len(scenes),
        "scenes_seen_for_15_s": int(full.sum()),
        "on_ramp_vehicles_scored": len({*zip(scenes.recording, scenes.vehicle[:, CENTRAL].tolist(), strict=True)}),
    }


def _lane_change_tables(
    forecaster: Forecaster, recording: Recording, scenes: Scenes, forecast: Forecast, seed: int
) -> dict[str, pl.DataFrame]:
    """Returns the lane-change scores by both readings of the time, and the importances."""
    all_rows = find_anchors(recording, every=STEP)
    anchors = build_neighbour_scenes_at(recording, all_rows)
    scores = [
        lane_change_table(forecaster.forests, lane_change_anchors(anchors, reading), seed=seed)
        for reading in _readings(forecaster.mode)
    ]
    if forecaster.scene is not None and forecast.scene is not None:
        natural = lane_change_at_seconds(forecast.scene)
        of_samples = [
            _own_scores(natural, lane_change_anchors(scenes, reading), forecaster.mode, Sampling.NATURAL, seed)
            for reading in _readings(forecaster.mode)
        ]
        rows = _before_changes(anchors)
        balanced = _lane_changes_of_samples(forecaster.scene, recording, all_rows[rows])
        few = lane_change_anchors(anchors.select(rows), READINGS[forecaster.mode])
        scores = [*of_samples, _own_scores(balanced, few, forecaster.mode, Sampling.BALANCED, seed), *scores]
    return {
        "lane_change": pl.concat(scores),
        "importance": importance_table(forecaster.forests),
        "training": training_table(forecaster.forests),
    }


def _own_scores(
    probability: tuple[Float[np.ndarray, "scene 16"], ...], anchors: Anchors, mode: Mode, sampling: Sampling, seed: int
) -> pl.DataFrame:
    """Returns the lane-change scores of the scene forecaster.

    The forests are scored on an anchor every 0.2 s, as in the paper; to draw samples for each would take hours. At the
    natural base rate the scenes whose positions are scored are a sample of the same.
    """
    by_kind = dict(zip(KINDS, probability, strict=True))
    return lane_change_scores(by_kind, anchors, model=OWN, mode=mode, seed=seed, samplings=(sampling,))


def _lane_changes_of_samples(
    model: SceneForecaster, recording: Recording, rows: Int[np.ndarray, "scene"]
) -> tuple[Float[np.ndarray, "scene 16"], ...]:
    """Returns the probability of a lane change within, and at, each second, for vehicles at those rows."""
    if not len(rows):
        return (np.zeros((0, len(TIMES))),) * len(KINDS)
    around = build_merge_scenes(recording, rows)
    number = np.arange(len(rows))
    parts = [
        lane_change_at_seconds(model.predict(around.select(number[first : first + CHUNK])))
        for first in range(0, len(rows), CHUNK)  # samples of all of them at once would fill the memory
    ]
    return tuple(np.concatenate(part) for part in zip(*parts, strict=True))


def _before_changes(scenes: Scenes) -> Int[np.ndarray, "row"]:
    """Returns the scenes at whole seconds, up to `LONGEST_WAIT`, and one step, before a lane change or else a last row.

    They are few, and balanced sets can be drawn of them: every vehicle has one at t, and one within t, for each t.
    """
    until = np.where(np.isnan(scenes.change_crossing), scenes.seen_for, scenes.change_crossing)
    step = np.rint(until / STEP).astype(np.int64)
    whole = (step % STEPS_PER_SECOND == 0) & (step > 0) & (step <= LONGEST_WAIT / STEP)
    return np.flatnonzero(whole | (step == 1))


def _readings(mode: Mode) -> Sequence[Reading]:
    """Returns the reading that the mode is trained on first, then the other."""
    return sorted(Reading, key=lambda reading: reading is not READINGS[mode])


def _with_mode(table: pl.DataFrame, mode: Mode) -> pl.DataFrame:
    return table.select(pl.lit(mode.value).alias("mode"), pl.all())


def _vehicle_number(recording: Recording) -> Int[np.ndarray, "row"]:
    numbers = recording.tracks.select(pl.struct("recording", "vehicle").rank("dense")).to_series()
    return numbers.to_numpy().astype(np.int64)


def _draw_per_vehicle(vehicle: Int[np.ndarray, "anchor"], generator: np.random.Generator) -> Bool[np.ndarray, "anchor"]:
    """Returns which anchors are drawn: at most `DRAWS_PER_VEHICLE` of each vehicle."""
    order = generator.permutation(len(vehicle))
    rank = pl.DataFrame({"vehicle": vehicle[order]}).select(pl.int_range(pl.len()).over("vehicle")).to_series()
    drawn = np.zeros(len(vehicle), dtype=bool)
    drawn[order] = rank.to_numpy() < DRAWS_PER_VEHICLE
    return drawn
