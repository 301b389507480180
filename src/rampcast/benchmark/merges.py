"""The benchmark's merge models. To add one: a `fit`, here or elsewhere, and a line in `forecasters`.

A `fit` is given the training cases, futures and all, and returns a `predict`, which is given scenes, and how long each
vehicle has been in the lane that it merges from.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Float

from rampcast.benchmark.cases import TIME, Cases
from rampcast.benchmark.forest_features import forest_features
from rampcast.benchmark.merge_metrics import HORIZON, whole_steps
from rampcast.benchmark.models import Training
from rampcast.evaluate.survival import Survival, kaplan_meier
from rampcast.forecast.scene_forecaster import GAPS, SceneForecaster
from rampcast.forecast.tables import TIMES
from rampcast.horizon import STEP
from rampcast.paper.lane_change import forests
from rampcast.paper.lane_change.sets import Anchors, Reading
from rampcast.paper.laws.mode import Mode
from rampcast.traffic.merge_scenes import MergeScenes

ENDS = np.array([STEP, *TIMES[1:]])  # [s] end of the step that each forest is for, the last of "within t" and that
# of "at t"; at t = 0 the step after it
SEED = 1  # of the forests


@dataclass(frozen=True)
class MergeForecasts:
    """What a model forecasts for each case.

    Attributes:
        p_within: probability to have merged at 0.2, 0.4 ... 15 s; never falls.
        p_at: probability, or a score that grows with it, to merge in just that step.
        median_time: by which the vehicle has as likely merged as not [s]; 15 s where that is not before.
        gap: index of the gap merged into, see `Cases.gap`; None for a model that does not tell.
        place: displacement at the merge [m]; None likewise.
    """

    p_within: Float[np.ndarray, "case step"]
    p_at: Float[np.ndarray, "case step"]
    median_time: Float[np.ndarray, "case"]
    gap: Float[np.ndarray, "case"] | None = None
    place: Float[np.ndarray, "case"] | None = None


MergePredict = Callable[[MergeScenes, Float[np.ndarray, "case"]], MergeForecasts]
MergeFit = Callable[[Training], MergePredict]


def base_rate(training: Training) -> MergePredict:
    """Returns the Kaplan-Meier curve of the training cases' remaining times, the same for all.

    The gap is the most frequent one, and the place that at the present speed by the median time.
    """
    cases = training.merging
    curve = kaplan_meier(_until(cases), np.isfinite(cases.change_time))
    gap = _most_frequent_gap(cases)
    return lambda scenes, since_entry: _of_curve(curve.within(np.zeros(len(scenes)), TIME), scenes, gap)


def time_on_lane(training: Training) -> MergePredict:
    """Returns the Kaplan-Meier curve of the training vehicles' times on the lane, given that each has not merged yet.

    The gap and the place are as in `base_rate`.
    """
    cases = training.merging
    curve, gap = _times_on_lane(cases), _most_frequent_gap(cases)
    return lambda scenes, since_entry: _of_curve(curve.within(since_entry, TIME), scenes, gap)


def forest_sets(training: Training, *, mode: str) -> MergePredict:
    """Returns the forecast of the paper's 32 forests: "within t", made to grow with t, and "at t", linear in between.

    Args:
        training: see `Training`.
        mode: whether they are trained on balanced sets as in the paper, or on all anchors.
    """
    cases = training.merging
    _, vehicle = np.unique(cases.group, return_inverse=True)
    anchors = Anchors(
        features=forest_features(cases.scenes),
        change_time=STEP * whole_steps(cases.change_time),
        seen_for=cases.seen_for,
        vehicle=vehicle.astype(np.int64),
        reading=Reading.CROSSING,
    )
    return partial(_of_forests, forests.fit(anchors, spec=forests.SPECS[Mode(mode)], seed=SEED))


def scene_forecaster(training: Training) -> MergePredict:
    """Returns the forecast of rampcast's own forecaster."""
    return partial(_of_scenes, training.scene_forecaster)


MERGE_REFERENCE = "kaplan_meier"  # to which the errors of times are compared
BASE_RATE = "base_rate"  # to which Brier scores are compared
NATURAL = "forests_natural"  # likewise


def median_time(p_within: Float[np.ndarray, "case step"]) -> Float[np.ndarray, "case"]:
    """Returns the time [s] at which the probability to have merged passes a half, linear in between; 15 s at most."""
    before = np.column_stack([np.zeros(len(p_within)), p_within])
    step = np.argmax(p_within >= 0.5, axis=1)
    case = np.arange(len(p_within))
    low, high = before[case, step], before[case, step + 1]
    share = np.clip((0.5 - low) / np.where(high > low, high - low, 1.0), 0.0, 1.0)
    return np.where(p_within[:, -1] >= 0.5, (step + share) * STEP, HORIZON)


def _until(cases: Cases) -> Float[np.ndarray, "case"]:
    """Returns the time to the merge, or to the last row where none was seen [s]."""
    return np.where(np.isfinite(cases.change_time), cases.change_time, cases.seen_for)


def _times_on_lane(cases: Cases) -> Survival:
    """Returns the survival curve of the time on the lane; a vehicle counts from its first case on."""
    order = np.lexsort((cases.since_entry, cases.group))
    _, first = np.unique(cases.group[order], return_index=True)
    vehicles = cases.select(order[first])
    entered = vehicles.since_entry
    return kaplan_meier(entered + _until(vehicles), np.isfinite(vehicles.change_time), entered=entered)


def _most_frequent_gap(cases: Cases) -> float:
    gaps = cases.gap[np.isfinite(cases.gap) & (np.nan_to_num(cases.change_time) <= HORIZON)]
    found, count = np.unique(gaps, return_counts=True)
    return float(found[count.argmax()]) if len(found) else 0.0


def _at_present_speed(scenes: MergeScenes, time: Float[np.ndarray, "case"]) -> Float[np.ndarray, "case"]:
    return np.maximum(scenes.own.v[:, 0, -1], 0.0) * time


def _of_curve(p_within: Float[np.ndarray, "case step"], scenes: MergeScenes, gap: float) -> MergeForecasts:
    time = median_time(p_within)
    return MergeForecasts(
        p_within=p_within,
        p_at=np.diff(p_within, axis=1, prepend=0.0),
        median_time=time,
        gap=np.full(len(scenes), gap),
        place=_at_present_speed(scenes, time),
    )


def _of_forests(
    model: forests.LaneChangeForests, scenes: MergeScenes, since_entry: Float[np.ndarray, "case"]
) -> MergeForecasts:
    del since_entry
    within, at = (np.nan_to_num(values) for values in forests.predict(model, forest_features(scenes)))
    within = np.maximum.accumulate(within, axis=1)
    p_within, p_at = _between(ENDS, within), _between(ENDS, at)
    time = median_time(p_within)
    return MergeForecasts(p_within, p_at, time, place=_at_present_speed(scenes, time))


def _between(times: Float[np.ndarray, "16"], values: Float[np.ndarray, "case 16"]) -> Float[np.ndarray, "case step"]:
    """Returns values that are known at those times at every step, linear in between and constant beyond."""
    right = np.clip(np.searchsorted(times, TIME - STEP / 2), 1, len(times) - 1)
    share = np.clip((TIME - times[right - 1]) / (times[right] - times[right - 1]), 0.0, 1.0)
    return values[:, right - 1] * (1.0 - share) + values[:, right] * share


def _of_scenes(model: SceneForecaster, scenes: MergeScenes, since_entry: Float[np.ndarray, "case"]) -> MergeForecasts:
    del since_entry
    found = model.predict(scenes)
    place = found.merge_place
    return MergeForecasts(
        p_within=np.clip(found.p_within, 0.0, 1.0),
        p_at=found.p_at,
        median_time=found.median_time,
        gap=GAPS[found.p_gap.argmax(axis=1)].astype(float),
        place=np.where(np.isfinite(place), place, found.median[:, -1]),  # no sample merges: its place at the end
    )
