"""The forecaster: learns from recordings of a site how its vehicles drive and merge, and forecasts others of it."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Int

from rampcast.forecast.forecast import Forecast
from rampcast.forecast.platoon_forecaster import FORECASTER, PlatoonForecasterSpec
from rampcast.forecast.protocol import Progress, check_same_site, tell_nobody
from rampcast.forecast.scene_forecaster import SceneForecaster, fit_scene_forecaster
from rampcast.horizon import STEP
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.recording.hashes import recording_hash, window_hashes
from rampcast.sites import Site
from rampcast.threads import choosing_threads
from rampcast.traffic import find_anchors
from rampcast.traffic.merge_scenes import build_merge_scenes
from rampcast.traffic.outcomes import outcomes


@dataclass(frozen=True)
class ForecasterSpec:
    """How a forecaster is trained.

    Attributes:
        spacing: time between training anchors [s], a multiple of 0.2.
        scene: what may be chosen of its models.
        seed: of trees and samples.
    """

    spacing: float = 1.0  # nearer ones are much alike
    scene: PlatoonForecasterSpec = FORECASTER
    seed: int = 1


@dataclass(frozen=True)
class Forecaster:
    """A fitted forecaster of one site.

    Attributes:
        site: where it was trained.
        scene: forecasts scenes as a whole.
        training: how it was trained.
        trained_on: names of the windows it was trained on.
        data_hash: SHA-256 of their tracks.
        window_hashes: SHA-256 of the tracks of each of them, whatever its name.
    """

    site: Site
    scene: SceneForecaster
    training: ForecasterSpec
    trained_on: tuple[str, ...]
    data_hash: str
    window_hashes: tuple[str, ...]

    def predict(self, recording: Recording, *, every: float = 1.0, threads: int | None = None) -> Forecast:
        """Returns the forecast of every on-ramp vehicle, at every anchor time at which its last 4 s lie on the ramp.

        Args:
            recording: smoothed (see `clean`); of what comes after an anchor nothing is used but by its smoothing.
            every: time between anchors [s], a multiple of 0.2.
            threads: to work with; None for RAMPCAST_THREADS, or all cores.

        Raises:
            RampcastError: it is no smoothed recording, or there is nothing to forecast in it.
            ModelError: it is of another site.
        """
        with choosing_threads(threads):
            return self.predict_at(recording, find_anchors(recording, every=every))

    def predict_at(self, recording: Recording, rows: Int[np.ndarray, "scene"]) -> Forecast:
        """Returns the forecast of the vehicles at those rows of a recording, which `find_anchors` gave."""
        check_same_site(self.site, recording.site)
        anchors = recording.tracks.select(c.RECORDING, c.VEHICLE, c.FRAME, c.X)[rows]
        return Forecast(
            recording=anchors[c.RECORDING].to_numpy(),
            vehicle=anchors[c.VEHICLE].to_numpy().astype(np.int64),
            t0=anchors[c.FRAME].to_numpy() * STEP,
            start=anchors[c.X].to_numpy(),
            scene=self.scene.predict(build_merge_scenes(recording, rows).only_seen()),
        )


def fit(
    recording: Recording,
    *,
    every: float | None = None,
    spec: ForecasterSpec | None = None,
    progress: Progress | None = None,
    threads: int | None = None,
) -> Forecaster:
    """Returns a forecaster trained on a smoothed recording.

    Args:
        recording: all windows to train on, of one site.
        every: time between training anchors [s], a multiple of 0.2, the longer the quicker; None takes the spec's.
        spec: how to train.
        progress: called as (what, done, total).
        threads: to work with; None for RAMPCAST_THREADS, or all cores.

    Raises:
        RampcastError: it is no smoothed recording, its site has no ramp, or no vehicle is on the ramp for 4 s.
    """
    spec, tell = spec or ForecasterSpec(), progress or tell_nobody
    spec = spec if every is None else replace(spec, spacing=every)
    tell("scene forecaster", 0, 1)
    with choosing_threads(threads):
        scene = _fit_scene(recording, spec)
    tell("scene forecaster", 1, 1)
    return Forecaster(
        site=recording.site,
        scene=scene,
        training=spec,
        trained_on=tuple(recording.names),
        data_hash=recording_hash(recording),
        window_hashes=window_hashes(recording),
    )


def _fit_scene(recording: Recording, spec: ForecasterSpec) -> SceneForecaster:
    anchors = find_anchors(recording, every=spec.spacing)
    became = outcomes(recording, anchors)
    return fit_scene_forecaster(
        build_merge_scenes(recording, anchors),
        became.displacement,
        became.leader_displacement,
        change_time=became.change_time,
        seen_for=became.seen_for,
        group=became.group,
        t0=became.t0,
        seed=spec.seed,
        spec=spec.scene,
    )
