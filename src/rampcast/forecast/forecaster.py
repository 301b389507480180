"""The forecaster: learns from recordings of a site how its vehicles drive and merge, and forecasts others of it."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Int

from rampcast.forecast.forecast import Forecast
from rampcast.forecast.parts import scene_parts
from rampcast.forecast.platoon_forecaster import FORECASTER, PlatoonForecasterSpec
from rampcast.forecast.protocol import Parts, Progress, check_same_site, tell_nobody
from rampcast.forecast.scene_forecaster import SceneForecaster, fit_scene_forecaster, nothing
from rampcast.horizon import STEP
from rampcast.recording import Recording, clean
from rampcast.recording import columns as c
from rampcast.recording.hashes import recording_hash, window_hashes
from rampcast.sites import Site
from rampcast.threads import choosing_threads
from rampcast.traffic import find_anchors
from rampcast.traffic.around import merge_scenes_at, merge_scenes_of_rows, ramp_vehicles
from rampcast.traffic.moments import Traffic
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


@dataclass(frozen=True, repr=False)
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

    def __repr__(self) -> str:
        return f"<Forecaster of {self.site.name}, trained on {', '.join(self.trained_on)}>"

    def predict(self, what: Recording | Traffic, *, every: float = 1.0, threads: int | None = None) -> Forecast:
        """Returns the forecast of every on-ramp vehicle, from the past alone.

        Of a recording, at every anchor time at which its last 4 s lie on the ramp. Of traffic, as a stream gives it, at
        its one moment, of vehicles seen for 0.4 s; with nobody there the forecast has no scene, which is no error.

        Args:
            what: a recording smoothed by `clean`, which keeps the raw rows that the states come from; or the traffic of
                a moment.
            every: of a recording, time between anchors [s], a multiple of 0.2.
            threads: to work with; None for RAMPCAST_THREADS, or all cores.

        Raises:
            RampcastError: it is no smoothed recording, or there is nothing to forecast in it.
            ModelError: it is of another site.
        """
        with choosing_threads(threads):
            if isinstance(what, Traffic):
                return self._of_traffic(what)
            return self.predict_at(what, find_anchors(what, every=every))

    def _of_traffic(self, traffic: Traffic) -> Forecast:
        check_same_site(self.site, traffic.site)
        vehicles = ramp_vehicles(traffic)
        scenes = merge_scenes_at(traffic, vehicles) if len(vehicles) else None
        return Forecast(
            recording=np.full(len(vehicles), traffic.site.name),
            vehicle=traffic.vehicle[vehicles],
            t0=np.full(len(vehicles), traffic.t0),
            start=traffic.x[vehicles, -1],
            scene=nothing() if scenes is None else self.scene.predict(scenes.only_seen()),
        )

    def predict_at(self, recording: Recording, rows: Int[np.ndarray, "scene"]) -> Forecast:
        """Returns the forecast of the vehicles at those rows of a recording, which `find_anchors` gave."""
        check_same_site(self.site, recording.site)
        anchors = recording.tracks.select(c.RECORDING, c.VEHICLE, c.FRAME)[rows]
        scenes, start = merge_scenes_of_rows(recording, rows)
        return Forecast(
            recording=anchors[c.RECORDING].to_numpy(),
            vehicle=anchors[c.VEHICLE].to_numpy().astype(np.int64),
            t0=anchors[c.FRAME].to_numpy() * STEP,
            start=start,
            scene=self.scene.predict(scenes.only_seen()),
        )

    def in_parts(self, recording: Recording, *, every: float = 1.0) -> Parts:
        """Returns what `predict` does, in parts that are made one after the other; a raw recording is smoothed."""
        smoothed = recording if recording.is_smoothed else clean(recording)[0]
        return scene_parts(self.predict_at, smoothed, find_anchors(smoothed, every=every))


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
    scenes, start = merge_scenes_of_rows(recording, anchors)
    off = (recording.tracks[c.X].to_numpy()[anchors] - start)[:, None]  # the truth counts from where the forecast does
    return fit_scene_forecaster(
        scenes,
        became.displacement + off,
        became.leader_displacement + off,
        change_time=became.change_time,
        seen_for=became.seen_for,
        group=became.group,
        t0=became.t0,
        seed=spec.seed,
        spec=spec.scene,
    )
