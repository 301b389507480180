"""Forecasts of merge scenes: of one vehicle each, of whose traffic no more is known than the vehicles nearest to it.

A scene is a moment of two lanes, and forecast as any other: see `calibrated`. Where the whole traffic is known, the
forecast of all its vehicles is one, and this is not needed; recordings of pairs and platoons have nothing else.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from rampcast.forecast.calibrated import SPEC, Calibrated, CalibratedSpec, counted_quantiles, fit_calibrated, unmerged
from rampcast.forecast.learning import Training
from rampcast.horizon import FUTURE, STEP
from rampcast.traffic.around import joined
from rampcast.traffic.merge_scenes import AHEAD, BEHIND, MergeScenes
from rampcast.traffic.situation import situation_of_scenes

CHUNK = 128  # scenes at a time: a few arrays of 100 samples of all their vehicles are 200 MB
GAPS = np.arange(-BEHIND, AHEAD + 1)  # that a vehicle may merge into; see `SceneForecast.gap`
FAR = 1e6  # [m] where the kernel says that nobody is


@dataclass(frozen=True)
class SceneForecast:
    """What will become of the central vehicle of each scene, at 0.2, 0.4 ... 15 s.

    Lengths are in m, counted from the vehicle's front at t = 0.

    Attributes:
        samples: displacements; none reverses, or overlaps the leader's sample.
        leader_rear: rear of the vehicle that is its leader then; NaN where there is none.
        follower_front: front of the vehicle behind it in the target lane once it has merged; NaN before, or where
            there is none.
        length: of the vehicle itself.
        merge_step: step in which it changes lane, 0 for the first 0.2 s; `FUTURE` where it does not within 15 s.
        gap: that it merges into: 0 between the vehicles of the target lane that are ahead and behind at t = 0, 1 in
            front of the one ahead, -1 behind the one behind, and so on; without a meaning where it does not merge.
        counts: whether a sample's place counts at each step: where vehicles were not seen after they merged in
            training, only samples that have not merged do.
    """

    samples: Float[np.ndarray, "scene sample step"]
    leader_rear: Float[np.ndarray, "scene sample step"]
    follower_front: Float[np.ndarray, "scene sample step"]
    length: Float[np.ndarray, "scene"]
    merge_step: Int[np.ndarray, "scene sample"]
    gap: Int[np.ndarray, "scene sample"]
    counts: Bool[np.ndarray, "scene sample step"]

    def __len__(self) -> int:
        return len(self.samples)

    @cached_property
    def median(self) -> Float[np.ndarray, "scene step"]:
        """Returns the displacement that is as likely exceeded as not [m]."""
        return self.quantiles_at(0.5)[:, :, 0]

    def quantiles_at(self, *levels: float) -> Float[np.ndarray, "scene step asked"]:
        """Returns the displacements that are not exceeded with those probabilities [m]; they never fall with time."""
        found = np.stack(counted_quantiles(self.samples, self.counts, levels), axis=-1)
        return np.maximum.accumulate(found, axis=1)

    @property
    def p_within(self) -> Float[np.ndarray, "scene step"]:
        """Returns the probability of a lane change by each step: the share of the samples that have merged."""
        count = np.stack([(self.merge_step <= step).sum(axis=1) for step in range(FUTURE)], axis=1)
        return count / self.merge_step.shape[1]

    @property
    def p_at(self) -> Float[np.ndarray, "scene step"]:
        """Returns the share of the samples that change lane in each step."""
        return np.diff(self.p_within, axis=1, prepend=0.0)

    @property
    def median_time(self) -> Float[np.ndarray, "scene"]:
        """Returns the time by which it has as likely merged as not [s]; 15 s where that is not before."""
        middle = np.sort(self.merge_step, axis=1)[:, (self.merge_step.shape[1] - 1) // 2]
        return STEP * np.minimum(middle + 0.5, FUTURE)

    @property
    def p_gap(self) -> Float[np.ndarray, "scene gap"]:
        """Returns the probability to merge within 15 s into each of `GAPS`."""
        merges = self.merge_step < FUTURE
        return np.stack([(merges & (self.gap == gap)).mean(axis=1) for gap in GAPS], axis=1)

    @property
    def merge_place(self) -> Float[np.ndarray, "scene"]:
        """Returns the median displacement at the merge over the samples that merge [m]; NaN where none does."""
        step = np.minimum(self.merge_step, FUTURE - 1)[:, :, None]
        place = np.take_along_axis(self.samples, step, axis=2)[:, :, 0].astype(float)
        place[self.merge_step == FUTURE] = np.nan
        found = np.full(len(place), np.nan)
        some = np.isfinite(place).any(axis=1)
        found[some] = np.nanmedian(place[some], axis=1)
        return found


@dataclass(frozen=True)
class SceneForecaster:
    """A fitted forecaster of scenes."""

    model: Calibrated

    def predict(self, scenes: MergeScenes) -> SceneForecast:
        """Returns the forecast of each scene, whatever the others are.

        Args:
            scenes: at least one.
        """
        rows = np.arange(len(scenes))
        return joined([self._predict(scenes.select(rows[first : first + CHUNK])) for first in rows[::CHUNK]])

    def _predict(self, scenes: MergeScenes) -> SceneForecast:
        from rampcast.forecast.roll_out_kernel import beside_first  # numba: only who forecasts waits for it

        situation = situation_of_scenes(scenes)
        vehicle = situation.first[:-1]
        beginning, driven = self.model.futures(situation, scenes, vehicle, situation.moment)
        shape = (len(scenes), driven.x.shape[1], FUTURE)
        rear, front = np.empty(shape, np.float32), np.empty(shape, np.float32)
        merge_step, gap = np.empty(shape[:2], np.int64), np.empty(shape[:2], np.int64)
        beside_first(beginning.start, driven.x, driven.lane, FAR, rear, front, merge_step, gap)
        start = beginning.start.x[vehicle][:, None, None]
        lane = driven.lane[vehicle]
        counts = np.ones(shape, dtype=bool) if self.model.beyond else unmerged(situation, vehicle, lane)
        return SceneForecast(
            samples=(driven.x[vehicle] - start).astype(np.float32),
            leader_rear=np.where(np.abs(rear) < FAR, rear - start, np.nan),
            follower_front=np.where(np.abs(front) < FAR, front - start, np.nan),
            length=situation.length[vehicle],
            merge_step=merge_step,
            gap=gap,
            counts=counts,
        )


def fit_scene_forecaster(
    scenes: MergeScenes,
    truth: Float[np.ndarray, "scene step"],
    leader_truth: Float[np.ndarray, "scene step"],
    *,
    change_time: Float[np.ndarray, "scene"],
    seen_for: Float[np.ndarray, "scene"],
    group: Shaped[np.ndarray, "scene"],
    t0: Float[np.ndarray, "scene"],
    seed: int = 1,
    spec: CalibratedSpec = SPEC,
) -> SceneForecaster:
    """Returns the forecaster that the training vehicles teach; see `learning.Training`."""
    situation = situation_of_scenes(scenes)
    training = Training(
        situation, situation.first[:-1], scenes, truth, leader_truth, change_time, seen_for, group, t0
    )  # fmt: skip
    return SceneForecaster(fit_calibrated(training, seed=seed, spec=spec))
