"""The forecaster: learns from recordings of a site how its vehicles drive and merge, and forecasts others of it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import overload

import numpy as np
from jaxtyping import Float, Int

from rampcast.errors import RecordingError
from rampcast.forecast.calibrated import SPEC, Calibrated, CalibratedSpec, fit_calibrated
from rampcast.forecast.examples import training_of
from rampcast.forecast.forecast import Forecast
from rampcast.forecast.forecasts import Forecasts, joined
from rampcast.forecast.held_out import HeldOut, check_enough, held_out
from rampcast.forecast.parts import in_batches, moment_parts, parts_at
from rampcast.forecast.protocol import NEEDS_RAW, Parts, Progress, check_same_site, tell_nobody
from rampcast.forecast.stages import stages_of
from rampcast.horizon import FUTURE
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.recording.frame_door import frame_door, refused_frame
from rampcast.recording.hashes import recording_hash, window_hashes
from rampcast.recording.invariants import check_believable
from rampcast.sites import Site
from rampcast.sites.site import NO_LANE
from rampcast.threads import choosing_threads
from rampcast.traffic import find_anchors
from rampcast.traffic.anchors import need_ramp
from rampcast.traffic.around import joined as around_joined
from rampcast.traffic.around import merge_scenes_at
from rampcast.traffic.moments import Traffic, traffic_at_times
from rampcast.traffic.situation import forecastable, joined_situations, situation_of_traffic

MOST_VEHICLES = 20_000  # at one moment: 72 s of the processor and 3.2 GB; a jam of 8 km on five lanes has 6,000


@dataclass(frozen=True)
class ForecasterSpec:
    """How a forecaster is trained.

    Attributes:
        spacing: time between training anchors [s], a multiple of 0.2.
        model: what may be chosen of its models.
        seed: of trees and samples.
    """

    spacing: float = 1.0  # nearer ones are much alike
    model: CalibratedSpec = SPEC
    seed: int = 1


@dataclass(frozen=True, repr=False)
class Forecaster:
    """A fitted forecaster of one site.

    Attributes:
        site: where it was trained; None for one of any site, as the pretrained one is.
        model: drives all vehicles of a moment together.
        training: how it was trained.
        trained_on: names of the windows it was trained on.
        data_hash: SHA-256 of their tracks.
        window_hashes: SHA-256 of the tracks of each of them, whatever its name.
        score: of the minutes that were held out while it was trained; see `held_out.HeldOut`.
    """

    site: Site | None
    model: Calibrated
    training: ForecasterSpec
    trained_on: tuple[str, ...]
    data_hash: str
    window_hashes: tuple[str, ...]
    score: HeldOut | None = None

    def __repr__(self) -> str:
        return f"<Forecaster of {self.site.name if self.site else 'any site'}, trained on {', '.join(self.trained_on)}>"

    @overload
    def predict(self, what: Recording, *, every: float = 1.0, threads: int | None = None) -> Forecasts: ...

    @overload
    def predict(self, what: Traffic, *, threads: int | None = None) -> Forecast: ...

    def predict(
        self, what: Recording | Traffic, *, every: float = 1.0, threads: int | None = None
    ) -> Forecasts | Forecast:
        """Returns the forecast of the traffic of a moment, or those of the on-ramp vehicles of a recording.

        Of traffic, as `rc.traffic`, `rc.moments` or a stream give it, the `Forecast` of all its vehicles that were seen
        for 0.4 s; with nobody there it is empty, which is no error. Of a recording, the `Forecasts` of its on-ramp
        vehicles at every anchor time at which their last 4 s lie on the ramp. Both from the past alone.

        Args:
            what: the traffic of a moment, or a recording smoothed by `clean`, which keeps the raw rows that the states
                come from.
            every: of a recording, time between anchors [s], a multiple of 0.2.
            threads: to work with; None for RAMPCAST_THREADS, or all cores.

        Raises:
            RampcastError: it is no smoothed recording, it is not as roads and vehicles are, or there is nothing to
                forecast in it.
            ModelError: it is of another site.
        """
        with choosing_threads(threads):
            if isinstance(what, Traffic):
                _check_states(what)
                return self._of_traffics([what])[0]
            rows = find_anchors(what, every=every)
            check_believable(what, doing="the forecast")
            return self.predict_at(what, rows)

    def check(self, site: Site) -> None:
        """Checks that it may forecast vehicles of that site.

        Raises:
            ModelError: it was trained at another one.
        """
        if self.site is not None:
            check_same_site(self.site, site)

    def _of_traffics(self, traffics: Sequence[Traffic]) -> list[Forecast]:
        for traffic in traffics:
            self.check(traffic.site)
        return forecast_traffics(self.model, traffics)

    def predict_at(self, recording: Recording, rows: Int[np.ndarray, "scene"]) -> Forecasts:
        """Returns the forecasts of the vehicles at those rows of a recording, which `find_anchors` gave."""
        self.check(recording.site)
        return _of_rows(recording, rows, self._of_traffics)

    def in_parts(self, recording: Recording, *, every: float = 1.0) -> Parts:
        """Returns the forecasts of all vehicles of a recording, raw or smoothed, a moment after the other."""
        self.check(recording.site)
        check_believable(recording, doing="the forecast")
        return moment_parts(self._of_traffics, recording, every=every)

    def at_times(self, recording: Recording, times: Mapping[str, Float[np.ndarray, "moment"]]) -> Parts:
        """Returns what `in_parts` does, at those times [s] of the windows of a recording that may be part of a whole.

        Args:
            recording: with all rows of the 4 s before each time.
            times: by name of the window.
        """
        self.check(recording.site)
        check_believable(recording, doing="the forecast")
        return parts_at(self._of_traffics, recording, times)


def _check_states(traffic: Traffic) -> None:
    """Raises RecordingError where vehicles of a moment are as none can be, unless somebody accepted them."""
    if traffic.is_accepted:
        return
    some = traffic.valid[:, -1]
    x = np.where(np.isfinite(traffic.v[some, -1]) & np.isfinite(traffic.a[some, -1]), traffic.x[some, -1], np.nan)
    states = {"length": traffic.length[some], "width": traffic.width[some], "v": traffic.v[some, -1]}
    found = frame_door(traffic.site, traffic.vehicle[some].tolist(), x, traffic.y[some, -1], **states)
    refused_frame(found, doing=f"the forecast at t0 = {traffic.t0:g} s")


def _check_count(traffic: Traffic) -> None:
    """Raises RecordingError where a moment, even one that somebody accepted, has too many vehicles."""
    if len(traffic.vehicle) > MOST_VEHICLES:
        raise RecordingError(
            f"the forecast at t0 = {traffic.t0:g} s is refused: {len(traffic.vehicle):,} vehicles at one moment, "
            f"expected {MOST_VEHICLES:,} at most. Cut the recording into roads, or its times into moments"
        )


def forecast_traffic(
    model: Calibrated,
    traffic: Traffic,
    *,
    samples: int | None = None,
    scale: Float[np.ndarray, "knot"] | None = None,
) -> Forecast:
    """Returns the forecast of all vehicles of a moment that can be forecast; see `Calibrated.futures`."""
    return forecast_traffics(model, [traffic], samples=samples, scale=scale)[0]


def forecast_traffics(
    model: Calibrated,
    traffics: Sequence[Traffic],
    *,
    samples: int | None = None,
    scale: Float[np.ndarray, "knot"] | None = None,
) -> list[Forecast]:
    """Returns the forecast of each moment, which are driven together: sooner done, and the same as one by one."""
    for traffic in traffics:
        _check_count(traffic)
    rows = [forecastable(traffic) for traffic in traffics]
    known = [place for place, some in enumerate(rows) if len(some)]
    found = [_of_nobody(traffic, samples or model.spec.samples) for traffic in traffics]
    if not known:
        return found
    situation = joined_situations([situation_of_traffic(traffics[place]) for place in known])
    scenes = around_joined([merge_scenes_at(traffics[place], rows[place]) for place in known])
    vehicle = np.arange(situation.first[-1])
    beginning, driven = model.futures(situation, scenes, vehicle, vehicle, samples=samples, scale=scale)
    for place, (first, stop) in zip(known, pairwise(situation.first.tolist()), strict=True):
        some = slice(first, stop)
        site, lane = traffics[place].site, situation.lane[some]
        numbers = _lane_numbers(site, situation.end.shape[1])
        found[place] = Forecast(
            site=site,
            t0=traffics[place].t0,
            vehicle=traffics[place].vehicle[rows[place]],
            start=beginning.start.x[some],
            start_lane=numbers[lane].astype(np.int64),
            length=situation.length[some],
            samples=driven.x[some],
            lane=numbers.take(driven.lane[some], mode="clip"),
        )
    return found


def _of_nobody(traffic: Traffic, samples: int) -> Forecast:
    nobody, empty = np.zeros((0, samples, FUTURE), np.float32), np.zeros(0)
    whole = empty.astype(int)
    return Forecast(
        traffic.site, traffic.t0, traffic.vehicle[:0], empty, whole, empty, nobody, nobody.astype(int)
    )  # fmt: skip


def _lane_numbers(site: Site, count: int) -> Int[np.ndarray, "lane"]:
    """Returns the number of each lane of a situation, of which those beyond the site's are none."""
    numbers = [lane.number for lane in site.lanes]
    return np.array(numbers + [NO_LANE] * (count - len(numbers)), dtype=np.int16)


def fit(
    recording: Recording,
    *,
    every: float | None = None,
    spec: ForecasterSpec | None = None,
    start: Forecaster | None = None,
    kept: Path | None = None,
    progress: Progress | None = None,
    threads: int | None = None,
) -> Forecaster:
    """Returns a forecaster trained on a smoothed recording.

    Args:
        recording: all windows to train on, of one site.
        every: time between training moments [s], a multiple of 0.2, the longer the quicker; None takes the spec's.
        spec: how to train.
        start: to whose sites a small recording is drawn, and whose parts are taken where it is too little, as
            `rc.load("pretrained")`. With it the last minutes of the recording are held out first, to score both.
        kept: folder for the stages of the training, which goes on there when it is called again after an interruption.
        progress: called as (what, done, total).
        threads: to work with; None for RAMPCAST_THREADS, or all cores.

    Raises:
        RampcastError: it is no smoothed recording, its site has no ramp, or nobody follows or merges in it.
    """
    spec, tell = _spec_of(spec, every), progress or tell_nobody
    need_ramp(recording)
    check_believable(recording, doing="training")
    data_hash = recording_hash(recording)
    with choosing_threads(threads):
        model, score = _learned(recording, data_hash, spec, start, kept, tell)
    return Forecaster(
        site=recording.site,
        model=model,
        training=spec,
        trained_on=tuple(recording.names),
        data_hash=data_hash,
        window_hashes=window_hashes(recording),
        score=score,
    )


def _spec_of(spec: ForecasterSpec | None, every: float | None) -> ForecasterSpec:
    spec = spec or ForecasterSpec()
    return spec if every is None else replace(spec, spacing=every)


def _learned(
    recording: Recording,
    data_hash: str,
    spec: ForecasterSpec,
    start: Forecaster | None,
    kept: Path | None,
    tell: Progress,
) -> tuple[Calibrated, HeldOut | None]:
    """Returns what a recording teaches, and what that is worth on the minutes held out; see `fit`."""
    # the tags name this module's classes, so they are known only by now
    stages = stages_of(kept, import_module("rampcast.forecast.tags").STAGES, data_hash, spec, start and start.data_hash)
    training = training_of(recording, spacing=spec.spacing, tell=partial(tell, "moments"))
    check_enough(training, recording)
    learn = partial(fit_calibrated, seed=spec.seed, spec=spec.model, start=None if start is None else start.model)
    score = None
    if start is not None:
        score = held_out(training, start.model, partial(learn, tell=partial(tell, "held-out score")), stages)
    model = learn(training, stages=stages, tell=partial(tell, "stages"))
    stages.forget()
    return model, score


def _of_rows(
    recording: Recording,
    rows: Int[np.ndarray, "scene"],
    predict: Callable[[Sequence[Traffic]], list[Forecast]],
) -> Forecasts:
    """Returns the forecasts of the vehicles at those rows of a smoothed recording, some moments after the others."""
    if recording.raw is None:
        raise RecordingError(NEEDS_RAW)
    anchors = recording.tracks.select(c.RECORDING, c.VEHICLE, c.FRAME)[rows].with_row_index("scene")
    parts, order = [], []
    for (window,), some in anchors.sort(c.RECORDING, c.FRAME, maintain_order=True).group_by(
        c.RECORDING, maintain_order=True
    ):
        by_frame = some.partition_by(c.FRAME, maintain_order=True)
        times = np.array([part[c.FRAME][0] for part in by_frame]) * recording.time_step
        found = in_batches(predict, traffic_at_times(recording.raw, str(window), times))
        for forecast, part in zip(found, by_frame, strict=True):
            place = forecast.places(part[c.VEHICLE].to_list())
            parts.append(forecast.reduced(place, recording=str(window)))
            order.append(part["scene"].to_numpy())
    return joined(parts).select(np.argsort(np.concatenate(order), kind="stable"))
