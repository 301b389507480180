"""The paper's framework: neighbour models, car-following laws and lane-change forests put together."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from jaxtyping import Int

from rampcast.arguments import chosen
from rampcast.compute import computing, jax
from rampcast.errors import ModelError
from rampcast.forecast.parts import scene_parts
from rampcast.forecast.protocol import Parts, Progress, check_same_site, tell_nobody
from rampcast.forecasters import positions
from rampcast.horizon import FUTURE, STEP
from rampcast.paper.forecast import PaperForecast
from rampcast.paper.inputs import Inputs
from rampcast.paper.lane_change import forests as lane_change
from rampcast.paper.lane_change.forests import SPECS, LaneChangeForests
from rampcast.paper.lane_change.sets import Reading, lane_change_anchors
from rampcast.paper.laws.mode import Mode
from rampcast.paper.neighbours.lstm import LstmSpec, NeighbourLstm, fit_lstm
from rampcast.paper.neighbours.predict import predict_neighbours
from rampcast.paper.neighbours.windows import (
    in_influence_area,
    is_seen_long,
    seen_long,
    training_windows,
    training_windows_from_past,
)
from rampcast.paper.scenes import build_scenes_at, scenes_from_past
from rampcast.paper.scenes.scenes import Scenes
from rampcast.paper.scenes.stand_ins import with_stand_ins
from rampcast.recording import Recording, clean
from rampcast.recording.hashes import recording_hash, window_hashes
from rampcast.recording.invariants import check_believable
from rampcast.sites import Site
from rampcast.threads import choosing_threads, in_threads
from rampcast.traffic import find_anchors, need_ramp

LANES = ("ramp", "target")
READINGS = {Mode.PAPER: Reading.LABEL, Mode.CORRECTED: Reading.CROSSING}  # erratum 7
SCENES = {Mode.PAPER: build_scenes_at, Mode.CORRECTED: scenes_from_past}  # erratum 9


@dataclass(frozen=True)
class PaperSpec:
    """How the paper's framework is trained.

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


@dataclass(frozen=True, repr=False)
class PaperForecaster:
    """The paper's framework, fitted to one site.

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
    training: PaperSpec
    trained_on: tuple[str, ...]
    data_hash: str
    window_hashes: tuple[str, ...]

    def __repr__(self) -> str:
        return f"<PaperForecaster of {self.site.name} in {self.mode} mode, trained on {', '.join(self.trained_on)}>"

    def predict(
        self,
        recording: Recording,
        *,
        every: float = 1.0,
        models: Sequence[str] | None = None,
        threads: int | None = None,
    ) -> PaperForecast:
        """Returns the forecast of every on-ramp vehicle, at every anchor time at which its last 4 s lie on the ramp.

        Args:
            recording: smoothed (see `clean`).
            every: time between anchors [s], a multiple of 0.2.
            models: see `predict_scenes`.
            threads: to work with; None for RAMPCAST_THREADS, or all cores.

        Raises:
            RampcastError: it is no smoothed recording, or there is nothing to forecast in it.
            ModelError: a model is unknown, or the recording is of another site.
        """
        with choosing_threads(threads):
            rows = find_anchors(recording, every=every)
            check_believable(recording, doing="the forecast")
            return self.predict_at(recording, rows, models=models)

    def predict_at(
        self, recording: Recording, rows: Int[np.ndarray, "scene"], *, models: Sequence[str] | None = None
    ) -> PaperForecast:
        """Returns the forecast of the vehicles at those rows of a recording, which `find_anchors` gave."""
        return self.predict_scenes(SCENES[self.mode](recording, rows, future=0), models=models)

    def in_parts(self, recording: Recording, *, every: float = 1.0) -> Parts:
        """Returns what `predict` does, in parts that are made one after the other; a raw recording is smoothed."""
        check_believable(recording, doing="the forecast")
        smoothed = recording if recording.is_smoothed else clean(recording)[0]
        return scene_parts(self.predict_at, smoothed, find_anchors(smoothed, every=every))

    def predict_scenes(
        self, scenes: Scenes, *, models: Sequence[str] | None = None, steps: int = FUTURE
    ) -> PaperForecast:
        """Returns the forecast for every scene: positions by each model, and lane-change probabilities.

        Laws are fitted, and neighbours and lane changes predicted, only where a model asks for them.

        Args:
            scenes: what is under a False of their masks, and their futures, are taken out before any model sees them.
            models: names, see `forecasters.positions`; None for all.
            steps: how many steps of 0.2 s to forecast.

        Raises:
            ModelError: a model is unknown, or the scenes are of another site.
        """
        check_same_site(self.site, scenes.site)
        known = positions()
        models = tuple(known) if models is None else models
        if unknown := [name for name in models if name not in known]:
            raise ModelError(f"unknown models {unknown}; there are {', '.join(known)}")
        scenes = with_stand_ins(scenes)
        inputs = Inputs(
            scenes,
            self.mode,
            steps,
            partial(predict_neighbours, scenes, ramp=self.ramp, target=self.target, steps=steps),
            lambda: lane_change.predict(self.forests, lane_change_anchors(scenes, Reading.LABEL).features),
        )
        return PaperForecast({name: known[name](inputs) for name in models}, inputs)


def fit_paper(
    recording: Recording,
    *,
    mode: Mode | str,
    spec: PaperSpec | None = None,
    progress: Progress | None = None,
    threads: int | None = None,
) -> PaperForecaster:
    """Returns the paper's framework trained on a smoothed recording.

    Args:
        recording: all windows to train on, of one site.
        mode: which reading of the paper, "paper" or "corrected".
        spec: how to train.
        progress: called as (what, done, total).
        threads: to work with; None for RAMPCAST_THREADS, or all cores.

    Raises:
        RecordingError: its site has no ramp, or it holds no vehicle that stays long enough in the ramp lane or the
            target lane.
    """
    need_ramp(recording)
    check_believable(recording, doing="training")
    mode, spec = chosen(Mode, mode, name="mode"), spec or PaperSpec()
    with choosing_threads(threads):
        ramp, target = for_each_lane(
            lambda lane: fit_neighbours(recording, lane, mode=mode, spec=spec, progress=progress)
        )
        forests = fit_lane_changes(recording, mode=mode, spec=spec, progress=progress)
    return assemble(recording, mode=mode, spec=spec, ramp=ramp, target=target, forests=forests)


def for_each_lane(fit: Callable[[str], NeighbourLstm]) -> list[NeighbourLstm]:
    """Returns the neighbour model of each of `LANES`, fitted at the same time: one training keeps one core busy."""
    return in_threads(fit, LANES)


@computing()
def fit_neighbours(
    recording: Recording, lane: str, *, mode: Mode, spec: PaperSpec, progress: Progress | None = None
) -> NeighbourLstm:
    """Returns the neighbour model of one of `LANES`, "ramp" or "target"; see `fit_paper`."""
    site = recording.site
    numbers = {"ramp": site.ramp_lanes, "target": (site.target_lane,)}[lane]
    key = jax.random.split(jax.random.key(spec.seed), len(LANES))[LANES.index(lane)]
    tell = progress or tell_nobody
    if mode is Mode.CORRECTED:
        windows = training_windows_from_past(recording, numbers, stride=spec.window_stride)
    else:
        printed = {"ramp": seen_long, "target": in_influence_area}[lane](recording)
        windows = training_windows(printed, numbers, stride=spec.window_stride)
    return fit_lstm(
        windows,
        mode=mode,
        spec=spec.lstm,
        key=key,
        progress=lambda epoch, epochs, _: tell(f"{mode} mode: LSTM of the {lane} lane", epoch, epochs),
    )


def fit_lane_changes(
    recording: Recording, *, mode: Mode, spec: PaperSpec, progress: Progress | None = None
) -> LaneChangeForests:
    """Returns the 32 lane-change forests; see `fit_paper`."""
    tell = progress or tell_nobody
    anchors = find_anchors(recording, every=spec.anchor_spacing)
    if mode is Mode.PAPER:
        anchors = anchors[is_seen_long(recording).to_numpy()[anchors]]
    return lane_change.fit(
        lane_change_anchors(SCENES[mode](recording, anchors, future=0), READINGS[mode]),
        spec=replace(SPECS[mode], n_trees=spec.trees),
        seed=spec.seed,
        progress=lambda done, total: tell(f"{mode} mode: lane-change forests", done, total),
    )


def assemble(
    recording: Recording,
    *,
    mode: Mode,
    spec: PaperSpec,
    ramp: NeighbourLstm,
    target: NeighbourLstm,
    forests: LaneChangeForests,
) -> PaperForecaster:
    """Returns the framework made of parts that were fitted to that recording."""
    return PaperForecaster(
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
