"""The test protocol: which scenes are scored in which mode, and all tables of forecasters on one recording.

Forecasters are scored side by side, ours as any other that satisfies `forecast.protocol`; the tables on neighbours,
drivers and forests are the paper's own.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int

from rampcast.errors import ModelError, RecordingError
from rampcast.forecast.protocol import RecordingForecast, RecordingForecaster, check_unseen
from rampcast.forecast.tables import TIMES
from rampcast.horizon import FUTURE, STEP, STEPS_PER_SECOND
from rampcast.paper.errors import central_errors, neighbour_errors
from rampcast.paper.examples import Shown, example_scenes
from rampcast.paper.forecast import PaperForecast
from rampcast.paper.framework import READINGS, SCENES, PaperForecaster
from rampcast.paper.lane_change.forests import importance_table, training_table
from rampcast.paper.lane_change.scores import lane_change_scores, lane_change_table
from rampcast.paper.lane_change.sets import KINDS, Reading, Sampling, lane_change_anchors
from rampcast.paper.laws.laws import LAWS
from rampcast.paper.laws.mode import Mode
from rampcast.paper.neighbours.predict import continue_at_constant_speed
from rampcast.paper.parameters import outcome_table, parameter_table
from rampcast.paper.scenes import Scenes
from rampcast.paper.scenes.scenes import CENTRAL
from rampcast.recording import Recording
from rampcast.traffic import find_anchors
from rampcast.traffic.outcomes import outcomes

DRAWS_PER_VEHICLE = 2  # the paper: two random sub-trajectories of each test vehicle
CHUNK = 1024  # scenes whose samples are kept at the same time: 100 MB
BASELINE = "constant_velocity"  # scored beside all
LONGEST_WAIT = 16.0  # [s] before a lane change; the last of these says "no" to "within 15 s"
Probabilities = tuple[Float[np.ndarray, "scene 16"], ...]  # within, and at, each second
Tables = dict[str, pl.DataFrame]


@dataclass(frozen=True)
class Evaluation:
    """What came out of a test.

    Attributes:
        mode: which reading of the paper the test follows.
        scenes: the scenes that were scored.
        forecasts: what was forecast for them, by each forecaster.
        tables: tidy tables by name: longitudinal and lane_change; where the paper's framework is among the forecasters
            also parameters, outcomes, importance, training, examples.
    """

    mode: Mode
    scenes: Scenes
    forecasts: tuple[RecordingForecast, ...]
    tables: Tables

    @property
    def shown(self) -> Shown:
        """Returns what pictures of single scenes show."""
        return shown(self.forecasts)


@dataclass(frozen=True)
class Test:
    """What a forecaster is scored on.

    Attributes:
        recording: the test windows.
        rows: the scenes that are scored, as rows of it.
        scenes: the same with their truths.
        mode: which reading of the paper is followed.
        seed: fixes what the paper draws at random.
    """

    __test__ = False

    recording: Recording
    rows: Int[np.ndarray, "scene"]
    scenes: Scenes
    mode: Mode
    seed: int


def evaluate(
    forecasters: Sequence[RecordingForecaster], recording: Recording, *, every: float = 1.0, seed: int = 1
) -> Evaluation:
    """Returns the scores of forecasters, side by side, on a smoothed recording that they were not trained on.

    Args:
        forecasters: fitted on other windows. The paper's framework among them says by its mode which scenes are scored;
            without it they are those of corrected mode.
        recording: the test windows.
        every: corrected mode: time between the anchors that are scored [s].
        seed: fixes what the paper draws at random.

    Raises:
        RecordingError: a window of the recording was trained on, or it holds no scene.
        ModelError: there is no forecaster, or there are two of different modes.
    """
    mode = _mode_of(forecasters)
    for forecaster in forecasters:
        check_unseen(forecaster, recording)
    rows = test_rows(recording, mode, every=every, seed=seed)
    test = Test(recording, rows, SCENES[mode](recording, rows), mode, seed)
    forecasts = tuple(forecaster.predict_at(recording, rows) for forecaster in forecasters)
    x = {name: x for forecast in forecasts for name, x in forecast.x.items()}
    x.setdefault(BASELINE, continue_at_constant_speed(test.scenes, steps=FUTURE).x[:, CENTRAL, 1:])
    parts: list[Tables] = [{"longitudinal": _with_mode(central_errors(test.scenes, x), mode)}]
    before = before_changes(recording)
    for forecaster, forecast in zip(forecasters, forecasts, strict=True):
        if isinstance(forecaster, PaperForecaster) and isinstance(forecast, PaperForecast):
            parts.append(_framework_tables(forecaster, forecast, test))
        else:
            parts.append({"lane_change": _lane_changes(forecaster, forecast, test, before)})
    if any(isinstance(forecast, PaperForecast) for forecast in forecasts):
        parts.append({"examples": _with_mode(example_scenes(test.scenes, shown(forecasts)), mode)})
    names = dict.fromkeys(name for part in parts for name in part)
    tables = {name: pl.concat([part[name] for part in parts if name in part]) for name in names}
    return Evaluation(mode, test.scenes, forecasts, tables)


def shown(forecasts: Sequence[RecordingForecast]) -> Shown:
    """Returns what pictures of single scenes show of forecasts for the same scenes."""
    neighbours = [forecast.neighbours for forecast in forecasts if isinstance(forecast, PaperForecast)]
    return Shown(
        x={name: x for forecast in forecasts for name, x in forecast.x.items()},
        bands={name: bands for forecast in forecasts for name, bands in forecast.bands.items()},
        neighbours=neighbours[0] if neighbours else None,
    )


def test_rows(recording: Recording, mode: Mode, *, every: float, seed: int) -> Int[np.ndarray, "scene"]:
    """Returns the scenes to score, as rows of the recording.

    Paper mode: two random anchors of each vehicle that is seen for 4 s before and 15 s after them. Corrected mode: an
    anchor at every `every` [s]; each second is scored for which the truth was seen (erratum 6).
    """
    if mode is Mode.CORRECTED:
        return find_anchors(recording, every=every)
    anchors = find_anchors(recording, every=STEP)
    whole = anchors[outcomes(recording, anchors).seen_for >= FUTURE * STEP - 1e-9]
    if not len(whole):
        raise RecordingError(
            "the paper's protocol needs on-ramp vehicles that are seen for 19 s, 4 of them in the ramp lane; there are "
            "none. Corrected mode scores each second for which the truth was seen: train with --paper corrected"
        )
    drawn = _draw_per_vehicle(_vehicle_number(recording)[whole], np.random.default_rng(seed))
    return whole[drawn]


test_rows.__test__ = False  # type: ignore[attr-defined]


def run_counts(recording: Recording, scenes: Scenes) -> dict[str, int]:
    """Returns the counts of a test for the run record."""
    full = scenes.future_valid[:, CENTRAL].all(axis=1)
    return {
        "test_rows": recording.tracks.height,
        "scenes": len(scenes),
        "scenes_seen_for_15_s": int(full.sum()),
        "on_ramp_vehicles_scored": len({*zip(scenes.recording, scenes.vehicle[:, CENTRAL].tolist(), strict=True)}),
    }


def _mode_of(forecasters: Sequence[RecordingForecaster]) -> Mode:
    modes = {forecaster.mode for forecaster in forecasters if isinstance(forecaster, PaperForecaster)}
    if not forecasters or len(modes) > 1:
        raise ModelError(f"expected forecasters of one mode, got {len(forecasters)} of the modes {sorted(modes)}")
    return modes.pop() if modes else Mode.CORRECTED


def _framework_tables(forecaster: PaperForecaster, forecast: PaperForecast, test: Test) -> Tables:
    """Returns the tables on the parts of the paper's framework: neighbours, drivers, forests."""
    at_constant_speed = continue_at_constant_speed(test.scenes, steps=FUTURE)
    fits = {name: forecast.inputs.calibration(name) for name in LAWS}
    tables = {
        "longitudinal": pl.concat(
            [
                neighbour_errors(test.scenes, forecast.neighbours),
                neighbour_errors(test.scenes, at_constant_speed, model="constant_velocity"),
            ]
        ),
        "parameters": pl.concat([parameter_table(LAWS[name], fit, test.mode) for name, fit in fits.items()]),
        "outcomes": pl.concat([outcome_table(LAWS[name], fit) for name, fit in fits.items()]),
    }
    anchors = SCENES[test.mode](test.recording, find_anchors(test.recording, every=STEP), future=0)
    of_forests = [
        lane_change_table(forecaster.forests, lane_change_anchors(anchors, reading), seed=test.seed)
        for reading in _readings(test.mode)
    ]
    return {name: _with_mode(table, test.mode) for name, table in tables.items()} | {
        "lane_change": pl.concat(of_forests),
        "importance": importance_table(forecaster.forests),
        "training": training_table(forecaster.forests),
    }


def _lane_changes(
    forecaster: RecordingForecaster, forecast: RecordingForecast, test: Test, before: Int[np.ndarray, "row"]
) -> pl.DataFrame:
    """Returns the lane-change scores of a forecaster whose probabilities take long.

    The forests are scored on an anchor every 0.2 s, as in the paper; to draw samples for each would take hours. At the
    natural base rate the scenes whose positions are scored are a sample of the same. Balanced sets need scenes just
    before lane changes, see `before_changes`.
    """
    few = SCENES[test.mode](test.recording, before, future=0)
    tables = []
    for name, natural in forecast.lane_changes.items():
        balanced = _lane_changes_at(forecaster, name, test.recording, before)
        jobs = [(natural, test.scenes, reading, Sampling.NATURAL) for reading in _readings(test.mode)]
        for found, scenes, reading, sampling in [*jobs, (balanced, few, READINGS[test.mode], Sampling.BALANCED)]:
            by_kind = dict(zip(KINDS, found, strict=True))
            anchors = lane_change_anchors(scenes, reading)
            tables.append(
                lane_change_scores(by_kind, anchors, model=name, mode=test.mode, seed=test.seed, samplings=(sampling,))
            )
    return pl.concat(tables)


def _lane_changes_at(
    forecaster: RecordingForecaster, model: str, recording: Recording, rows: Int[np.ndarray, "scene"]
) -> Probabilities:
    """Returns the probability of a lane change within, and at, each second, for vehicles at those rows."""
    parts = [
        forecaster.predict_at(recording, rows[first : first + CHUNK]).lane_changes[model]
        for first in range(0, len(rows), CHUNK)  # samples of all of them at once would fill the memory
    ]
    nothing = (np.zeros((0, len(TIMES))),) * len(KINDS)
    return tuple(np.concatenate(part) for part in zip(nothing, *parts, strict=True))


def before_changes(recording: Recording) -> Int[np.ndarray, "scene"]:
    """Returns the rows at whole seconds, up to `LONGEST_WAIT`, and one step, before a lane change or else a last row.

    They are few, and balanced sets can be drawn of them: every vehicle has one at t, and one within t, for each t.
    """
    rows = find_anchors(recording, every=STEP)
    became = outcomes(recording, rows)
    until = np.where(np.isnan(became.change_time), became.seen_for, became.change_time)
    step = np.rint(until / STEP).astype(np.int64)
    whole = (step % STEPS_PER_SECOND == 0) & (step > 0) & (step <= LONGEST_WAIT / STEP)
    return rows[whole | (step == 1)]


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
