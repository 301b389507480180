"""The forecaster: neighbour models, car-following laws and lane-change forests put together as in the paper."""

import hashlib
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import jax
import numpy as np
import polars as pl
from jaxtyping import Float, Int

from rampcast.errors import ModelError
from rampcast.forecast.longitudinal import MODELS, Inputs, calibrate_scenes
from rampcast.forecast.neighbours import NeighbourForecast, predict_neighbours
from rampcast.models import forests as lane_change
from rampcast.models.calibration import Calibration
from rampcast.models.forest_sets import TIMES, Reading, lane_change_anchors
from rampcast.models.forests import SPECS, LaneChangeForests
from rampcast.models.lstm import LstmSpec, NeighbourLstm, fit_lstm
from rampcast.physics.laws import LAWS
from rampcast.physics.mode import Mode
from rampcast.recording import Recording, Site
from rampcast.recording import columns as c
from rampcast.recording.sites import differences
from rampcast.scenes import FUTURE, STEP, build_scenes, need_ramp, training_windows
from rampcast.scenes.scenes import CENTRAL, Scenes
from rampcast.scenes.stand_ins import with_stand_ins

Progress = Callable[[str, int, int], None]  # what is being done, steps done, steps in all

LANES = ("ramp", "target")
READINGS = {Mode.PAPER: Reading.LABEL, Mode.CORRECTED: Reading.CROSSING}  # erratum 7


@dataclass(frozen=True)
class TrainingSpec:
    """How a forecaster is trained.

    Attributes:
        lstm: hyper-parameters of both neighbour models.
        window_stride: take a training window of the LSTMs at every so many steps; the paper takes all (1).
        anchor_spacing: time between the forests' training anchors [s]; the paper takes every step (0.2).
        trees: trees in each of the 32 forests.
        seed: of weights, sample orders and forests.
    """

    lstm: LstmSpec = field(default_factory=LstmSpec)
    window_stride: int = 1
    anchor_spacing: float = STEP
    trees: int = 100  # scikit-learn's default; the paper gives none
    seed: int = 1


@dataclass(frozen=True)
class Forecaster:
    """A fitted forecaster of one site.

    Attributes:
        mode: which reading of the paper.
        site: where it was trained.
        ramp, target: the neighbour models of the two lanes.
        forests: the lane-change classifiers.
        training: how it was trained.
        trained_on: names of the windows it was trained on.
        data_hash: SHA-256 of their tracks.
        window_hashes: SHA-256 of the tracks of each of them, whatever its name.
    """

    mode: Mode
    site: Site
    ramp: NeighbourLstm
    target: NeighbourLstm
    forests: LaneChangeForests
    training: TrainingSpec
    trained_on: tuple[str, ...]
    data_hash: str
    window_hashes: tuple[str, ...]

    def predict(self, scenes: Scenes, *, models: Sequence[str] = tuple(MODELS), steps: int = FUTURE) -> "Forecast":
        """Returns the forecast for every scene: positions by each model, and lane-change probabilities.

        Args:
            scenes: what is under a False of their masks, and their futures, are taken out before any model sees them.
            models: keys of `MODELS`.
            steps: how many steps of 0.2 s to forecast.

        Raises:
            ModelError: a model is unknown, or the scenes are of another site.
        """
        _need_same_site(self.site, scenes.site)
        unknown = [name for name in models if name not in MODELS]
        if unknown:
            raise ModelError(f"unknown models {unknown}; there are {', '.join(MODELS)}")
        scenes = with_stand_ins(scenes)
        neighbours = predict_neighbours(scenes, ramp=self.ramp, target=self.target, steps=steps)
        calibrations = {name: calibrate_scenes(law, scenes, self.mode) for name, law in LAWS.items()}
        inputs = Inputs(scenes=scenes, mode=self.mode, predicted=neighbours, calibrations=calibrations)
        p_within, p_at = lane_change.predict(self.forests, lane_change_anchors(scenes, Reading.LABEL).features)
        return Forecast(
            recording=scenes.recording,
            vehicle=scenes.vehicle[:, CENTRAL],
            t0=scenes.t0,
            x={name: MODELS[name].predict(inputs) for name in models},
            p_within=p_within,
            p_at=p_at,
            neighbours=neighbours,
            calibrations=calibrations,
        )


@dataclass(frozen=True)
class Forecast:
    """What is forecast for each scene.

    Attributes:
        recording, vehicle, t0: which window, which vehicle, and when [s].
        x: by model, front position of the central vehicle at 0.2, 0.4, ... s after t0 [m].
        p_within: probability of a lane change within 0, 1, ..., 15 s.
        p_at: probability of a lane change at 0, 1, ..., 15 s.
        neighbours: the predicted neighbours.
        calibrations: the drivers fitted to the history, by car-following law.
    """

    recording: np.ndarray
    vehicle: Int[np.ndarray, "scene"]
    t0: Float[np.ndarray, "scene"]
    x: dict[str, Float[np.ndarray, "scene future"]]
    p_within: Float[np.ndarray, "scene 16"]
    p_at: Float[np.ndarray, "scene 16"]
    neighbours: NeighbourForecast
    calibrations: dict[str, Calibration]

    def position_table(self) -> pl.DataFrame:
        """Returns the columns recording, vehicle, t0 [s], horizon [s], x [m], model."""
        tables = []
        for name, x in self.x.items():
            steps = x.shape[1]
            horizon = np.round(np.arange(1, steps + 1) * STEP, 1)
            tables.append(
                self._keys(steps).with_columns(
                    horizon=pl.Series(np.tile(horizon, len(x))), x=pl.Series(x.ravel()), model=pl.lit(name)
                )
            )
        return pl.concat(tables)

    def lane_change_table(self) -> pl.DataFrame:
        """Returns the columns recording, vehicle, t0 [s], t [s], p_within, p_at."""
        return self._keys(len(TIMES)).with_columns(
            t=pl.Series(np.tile(np.array(TIMES, dtype=float), len(self.t0))),
            p_within=pl.Series(self.p_within.ravel()),
            p_at=pl.Series(self.p_at.ravel()),
        )

    def _keys(self, repeats: int) -> pl.DataFrame:
        return pl.DataFrame(
            {
                "recording": np.repeat(self.recording, repeats),
                "vehicle": np.repeat(self.vehicle, repeats),
                "t0": np.round(np.repeat(self.t0, repeats), 1),
            }
        )


def fit_forecaster(
    recording: Recording, *, mode: Mode, spec: TrainingSpec | None = None, progress: Progress | None = None
) -> Forecaster:
    """Returns a forecaster trained on a smoothed recording.

    Args:
        recording: all windows to train on, of one site.
        mode: which reading of the paper.
        spec: how to train.
        progress: called as (what, done, total).

    Raises:
        RecordingError: its site has no ramp, or it holds no vehicle that stays long enough in the ramp lane or the
            target lane.
    """
    need_ramp(recording)
    spec = spec or TrainingSpec()
    ramp, target = for_each_lane(lambda lane: fit_neighbours(recording, lane, mode=mode, spec=spec, progress=progress))
    forests = fit_lane_changes(recording, mode=mode, spec=spec, progress=progress)
    return assemble(recording, mode=mode, spec=spec, ramp=ramp, target=target, forests=forests)


def _need_same_site(trained: Site, site: Site) -> None:
    if site.name != trained.name:
        what = f"at site '{trained.name}', the scenes are of site '{site.name}'"
    elif different := differences(trained, site):
        what = f"at another site '{trained.name}' than that of the scenes: {', '.join(different)}"
    else:
        return
    raise ModelError(
        f"this model was trained {what}; its lane-change forests know positions on the road, so train a model of that "
        "site, or read both recordings with one site file (--site)"
    )


def for_each_lane(fit: Callable[[str], NeighbourLstm]) -> list[NeighbourLstm]:
    """Returns the neighbour model of each of `LANES`, fitted at the same time: one training keeps one core busy."""
    with ThreadPoolExecutor(len(LANES)) as pool:
        return list(pool.map(fit, LANES))


def fit_neighbours(
    recording: Recording, lane: str, *, mode: Mode, spec: TrainingSpec, progress: Progress | None = None
) -> NeighbourLstm:
    """Returns the neighbour model of one of `LANES`, "ramp" or "target"; see `fit_forecaster`."""
    site = recording.site
    numbers = {"ramp": site.ramp_lanes, "target": (site.target_lane,)}[lane]
    key = jax.random.split(jax.random.key(spec.seed), len(LANES))[LANES.index(lane)]
    tell = progress or _silent
    return fit_lstm(
        training_windows(recording, numbers, stride=spec.window_stride),
        mode=mode,
        spec=spec.lstm,
        key=key,
        progress=lambda epoch, epochs, _: tell(f"{mode} mode: LSTM of the {lane} lane", epoch, epochs),
    )


def fit_lane_changes(
    recording: Recording, *, mode: Mode, spec: TrainingSpec, progress: Progress | None = None
) -> LaneChangeForests:
    """Returns the 32 lane-change forests; see `fit_forecaster`."""
    tell = progress or _silent
    return lane_change.fit(
        lane_change_anchors(build_scenes(recording, every=spec.anchor_spacing, future=0), READINGS[mode]),
        spec=replace(SPECS[mode], n_trees=spec.trees),
        seed=spec.seed,
        progress=lambda done, total: tell(f"{mode} mode: lane-change forests", done, total),
    )


def assemble(
    recording: Recording,
    *,
    mode: Mode,
    spec: TrainingSpec,
    ramp: NeighbourLstm,
    target: NeighbourLstm,
    forests: LaneChangeForests,
) -> Forecaster:
    """Returns the forecaster made of parts that were fitted to that recording."""
    return Forecaster(
        mode=mode,
        site=recording.site,
        ramp=ramp,
        target=target,
        forests=forests,
        training=spec,
        trained_on=tuple(recording.names),
        data_hash=recording_hash(recording),
        window_hashes=window_hashes(recording),
    )


def recording_hash(recording: Recording) -> str:
    """Returns the SHA-256 of a recording's tracks."""
    digest = hashlib.sha256()
    for name in sorted(recording.tracks.columns):
        values = recording.tracks[name]
        numbers = values if values.dtype.is_numeric() else values.cast(pl.String).rank("dense")
        digest.update(name.encode())
        digest.update(np.ascontiguousarray(numbers.to_numpy()).tobytes())
    return digest.hexdigest()


def window_hashes(recording: Recording) -> tuple[str, ...]:
    """Returns the SHA-256 of the tracks of each window, without its name."""
    unnamed = pl.lit("")
    return tuple(
        recording_hash(replace(window, tracks=window.tracks.with_columns(unnamed.alias(c.RECORDING))))
        for window in map(recording.window, recording.names)
    )


def _silent(what: str, done: int, total: int) -> None:
    """Tells nobody."""
