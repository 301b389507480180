"""The forecaster: neighbour models, car-following laws and lane-change forests put together as in the paper.

In corrected mode the scene forecaster stands beside them, which drives all vehicles around into the future together.
"""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import polars as pl
from jaxtyping import Float

from rampcast.compute import computing, jax
from rampcast.errors import ModelError
from rampcast.forecast.platoon_forecaster import FORECASTER, PlatoonForecasterSpec
from rampcast.forecast.scene_forecaster import SceneForecast, SceneForecaster, fit_scene_forecaster
from rampcast.horizon import FUTURE, STEP
from rampcast.models.plain_data import as_plain
from rampcast.paper.lane_change import forests as lane_change
from rampcast.paper.lane_change.forests import SPECS, LaneChangeForests
from rampcast.paper.lane_change.sets import Reading, lane_change_anchors
from rampcast.paper.laws.laws import LAWS
from rampcast.paper.laws.mode import Mode
from rampcast.paper.neighbours.lstm import LstmSpec, NeighbourLstm, fit_lstm
from rampcast.paper.neighbours.predict import predict_neighbours
from rampcast.paper.neighbours.windows import training_windows
from rampcast.paper.position_models import MODELS, Inputs, calibrate_scenes, models_of
from rampcast.paper.result import OWN, Forecast
from rampcast.paper.scenes import build_neighbour_scenes_at, build_scenes
from rampcast.paper.scenes.scenes import CENTRAL, LEADER, Scenes
from rampcast.paper.scenes.stand_ins import with_stand_ins
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.sites import Site
from rampcast.sites.site import differences
from rampcast.threads import in_threads
from rampcast.traffic import find_anchors, need_ramp
from rampcast.traffic.anchors import X

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
        scene_spacing: time between the scene forecaster's training anchors [s], a multiple of 0.2.
        scene: what may be chosen of the scene forecaster.
        seed: of weights, sample orders, forests and samples.
    """

    lstm: LstmSpec = field(default_factory=LstmSpec)
    window_stride: int = 1
    anchor_spacing: float = STEP
    trees: int = 100  # scikit-learn's default; the paper gives none
    scene_spacing: float = 1.0  # nearer ones are much alike
    scene: PlatoonForecasterSpec = FORECASTER
    seed: int = 1


@dataclass(frozen=True)
class Forecaster:
    """A fitted forecaster of one site.

    Attributes:
        mode: which reading of the paper.
        site: where it was trained.
        ramp, target: the neighbour models of the two lanes.
        forests: the lane-change classifiers.
        scene: forecasts scenes as a whole; None in paper mode.
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
    scene: SceneForecaster | None
    training: TrainingSpec
    trained_on: tuple[str, ...]
    data_hash: str
    window_hashes: tuple[str, ...]

    def predict(self, scenes: Scenes, *, models: Sequence[str] | None = None, steps: int = FUTURE) -> Forecast:
        """Returns the forecast for every scene: positions by each model, and lane-change probabilities.

        Args:
            scenes: what is under a False of their masks, and their futures, are taken out before any model sees them.
            models: keys of `MODELS`; None for all that belong to the mode.
            steps: how many steps of 0.2 s to forecast; the model "rampcast" gives 75 at most.

        Raises:
            ModelError: a model is unknown, or the scenes are of another site.
        """
        _need_same_site(self.site, scenes.site)
        known = models_of(self.mode)
        models = known if models is None else models
        unknown = [name for name in models if name not in known]
        if unknown:
            raise ModelError(f"unknown models {unknown}; there are {', '.join(known)} in {self.mode} mode")
        scenes = with_stand_ins(scenes)
        scene = self._predict_scene(scenes, steps) if OWN in models else None
        neighbours = predict_neighbours(scenes, ramp=self.ramp, target=self.target, steps=steps)
        calibrations = {name: calibrate_scenes(law, scenes, self.mode) for name, law in LAWS.items()}
        inputs = Inputs(scenes=scenes, mode=self.mode, predicted=neighbours, calibrations=calibrations, scene=scene)
        p_within, p_at = lane_change.predict(self.forests, lane_change_anchors(scenes, Reading.LABEL).features)
        return Forecast(
            recording=scenes.recording,
            vehicle=scenes.vehicle[:, CENTRAL],
            t0=scenes.t0,
            start=scenes.past[:, CENTRAL, -1, X],
            x={name: MODELS[name].predict(inputs) for name in models},
            p_within=p_within,
            p_at=p_at,
            neighbours=neighbours,
            calibrations=calibrations,
            scene=scene,
        )

    def _predict_scene(self, scenes: Scenes, steps: int) -> SceneForecast:
        if scenes.around is None or self.scene is None or steps > FUTURE:
            raise ModelError(
                f"the model '{OWN}' needs scenes with the traffic around them, which `build_scenes` makes, and "
                f"forecasts {FUTURE * STEP:g} s at most"
            )
        return self.scene.predict(scenes.around)


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
    scene = fit_scenes(recording, spec=spec, progress=progress) if mode is Mode.CORRECTED else None
    return assemble(recording, mode=mode, spec=spec, ramp=ramp, target=target, forests=forests, scene=scene)


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
    return in_threads(fit, LANES)


@computing()
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
    anchors = find_anchors(recording, every=spec.anchor_spacing)
    return lane_change.fit(
        lane_change_anchors(build_neighbour_scenes_at(recording, anchors), READINGS[mode]),
        spec=replace(SPECS[mode], n_trees=spec.trees),
        seed=spec.seed,
        progress=lambda done, total: tell(f"{mode} mode: lane-change forests", done, total),
    )


def fit_scenes(recording: Recording, *, spec: TrainingSpec, progress: Progress | None = None) -> SceneForecaster:
    """Returns the scene forecaster, which belongs to corrected mode; see `fit_forecaster`."""
    tell = progress or _silent
    what = f"{Mode.CORRECTED} mode: scene forecaster"
    tell(what, 0, 1)
    scenes = build_scenes(recording, every=spec.scene_spacing)
    assert scenes.around is not None
    window = {name: number for number, name in enumerate(recording.names, start=1)}
    names = zip(scenes.recording.tolist(), scenes.vehicle[:, CENTRAL].tolist(), strict=True)
    fitted = fit_scene_forecaster(
        scenes.around,
        _displacement(scenes, CENTRAL),
        _displacement(scenes, LEADER),
        change_time=scenes.change_crossing,
        seen_for=scenes.seen_for,
        group=np.array([f"{window[name]}-{vehicle}" for name, vehicle in names]),
        t0=scenes.t0,
        seed=spec.seed,
        spec=spec.scene,
    )
    tell(what, 1, 1)
    return as_plain(fitted)


def _displacement(scenes: Scenes, slot: int) -> Float[np.ndarray, "scene future"]:
    """Returns where the vehicle in a slot was, from the central vehicle's place at t = 0 [m]; NaN where not seen."""
    x = scenes.future[:, slot, :, X] - scenes.past[:, CENTRAL, -1, X, None]
    return np.where(scenes.future_valid[:, slot], x, np.nan)


def assemble(
    recording: Recording,
    *,
    mode: Mode,
    spec: TrainingSpec,
    ramp: NeighbourLstm,
    target: NeighbourLstm,
    forests: LaneChangeForests,
    scene: SceneForecaster | None,
) -> Forecaster:
    """Returns the forecaster made of parts that were fitted to that recording."""
    return Forecaster(
        mode=mode,
        site=recording.site,
        ramp=ramp,
        target=target,
        forests=forests,
        scene=scene,
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
