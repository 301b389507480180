"""The forecaster of merge scenes: where each vehicle will be, when and where it will merge, and into which gap.

Vehicles that have a lane to merge into are rolled out with the traffic of both lanes, all others with the platoon ahead
of them. Both are corrected and calibrated in the same way, and both forecasts are samples that agree with each other in
place, time and gap.
"""

from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Float, Int, Shaped

from rampcast.forecast.merge_roll_out import MergeRollOut, MergeSamples, sample_merges, waiting_features
from rampcast.forecast.platoon_forecaster import (
    FORECASTER,
    MIDDLE,
    PlatoonForecaster,
    PlatoonForecasterSpec,
    fit_platoon_forecaster,
    mapped,
)
from rampcast.forecast.platoon_roll_out import fit_roll_out
from rampcast.horizon import FUTURE, STEP
from rampcast.models.correction import KNOTS, LEVELS, Correction, Rolled, fit_correction, over_time
from rampcast.models.folds import time_folds
from rampcast.models.merge_features import merge_columns, merge_table, regimes
from rampcast.models.merge_forest import MergeForest, fit_merge_forest, rate_of
from rampcast.models.merging import NEVER, fit_merge_hazard, merge_zone
from rampcast.models.pooled_driver import roll_chain
from rampcast.traffic.merge_scenes import AHEAD, BEHIND, MergeScenes
from rampcast.traffic.platoons import HISTORY, known_lengths

CHUNK = 256  # scenes at a time: a few arrays of 100 samples of them are 100 MB
PASSES = 2  # of learning the hazard: the second with those ahead merging by the first
FEW_SAMPLES = 25  # futures by which a scene's hazard is compared with the forest
LEARNING_SAMPLES = 4  # futures of each training vehicle that the hazard is learned from
GAPS = np.arange(-BEHIND, AHEAD + 1)  # that a vehicle may merge into; see `SceneForecast.gap`
TIME = np.arange(1, FUTURE + 1) * STEP
SPREAD = np.array([0.1, 0.5, 0.9])  # levels of the median, and of the quantiles whose distance is the spread
MEDIAN = np.array([0.5])
ALL_STEPS = np.arange(FUTURE)
FEWEST_UNMERGED = 5  # samples of which quantiles are taken


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
        chance: probability of a lane change in each step, as the hazards of the samples give it; over 0.2 s it is the
            density of the merge time. It adds up to the share of samples that change lane, but for the luck of the
            draw.
        mean: displacement.
        quantiles: of the displacement, at `correction.LEVELS`.
    """

    samples: Float[np.ndarray, "scene sample step"]
    leader_rear: Float[np.ndarray, "scene sample step"]
    follower_front: Float[np.ndarray, "scene sample step"]
    length: Float[np.ndarray, "scene"]
    merge_step: Int[np.ndarray, "scene sample"]
    gap: Int[np.ndarray, "scene sample"]
    chance: Float[np.ndarray, "scene step"]
    mean: Float[np.ndarray, "scene step"]
    quantiles: Float[np.ndarray, "scene step level"]

    def __len__(self) -> int:
        return len(self.samples)

    @property
    def median(self) -> Float[np.ndarray, "scene step"]:
        """Returns the displacement that is as likely exceeded as not [m]."""
        return self.quantiles[:, :, MIDDLE]

    def quantiles_at(self, *levels: float) -> Float[np.ndarray, "scene step asked"]:
        """Returns the displacements at those of `LEVELS` that are nearest to the levels asked for [m]."""
        return self.quantiles[:, :, [int(np.abs(LEVELS - level).argmin()) for level in levels]]

    @property
    def p_within(self) -> Float[np.ndarray, "scene step"]:
        """Returns the probability of a lane change by each step: the share of the samples that have merged."""
        count = np.stack([(self.merge_step <= step).sum(axis=1) for step in range(FUTURE)], axis=1)
        return count / self.merge_step.shape[1]

    @property
    def p_at(self) -> Float[np.ndarray, "scene step"]:
        """Returns the share of the samples that change lane in each step; `chance` is the same with less noise."""
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


def nothing() -> SceneForecast:
    """Returns the forecast of no scene."""
    steps, whole = np.zeros((0, FUTURE)), np.zeros((0, 1), dtype=np.int64)
    samples = np.zeros((0, 1, FUTURE))
    return SceneForecast(
        samples=samples,
        leader_rear=samples,
        follower_front=samples,
        length=np.zeros(0),
        merge_step=whole,
        gap=whole,
        chance=steps,
        mean=steps,
        quantiles=np.zeros((0, FUTURE, len(LEVELS))),
    )


@dataclass(frozen=True)
class MergeForecaster:
    """A fitted forecaster of vehicles that have a lane to merge into.

    Attributes:
        spec: what was chosen.
        roll_out: drivers, disturbances, heads and hazard.
        forest: how likely vehicles like each merge by each moment.
        beyond: whether training vehicles were seen after they merged. If not, nothing is known of where they go then,
            and places are forecast of vehicles that have not merged yet.
        correction: of the roll-outs; None without.
        seed: of the samples.
    """

    spec: PlatoonForecasterSpec
    roll_out: MergeRollOut
    forest: MergeForest
    beyond: bool
    correction: Correction | None
    seed: int

    def predict(self, scenes: MergeScenes) -> SceneForecast:
        """Returns the forecast of each scene, whatever the others are; each has a lane to merge into."""
        drawn = _drawn(self.roll_out, self.forest, scenes, samples=self.spec.samples, seed=self.seed)
        return _forecast(drawn, scenes, self._quantiles(scenes, drawn), self._limit(scenes))

    def _quantiles(self, scenes: MergeScenes, drawn: MergeSamples) -> Float[np.ndarray, "scene step level"]:
        if self.correction is None:
            return np.maximum.accumulate(sample_quantiles(drawn, LEVELS, beyond=self.beyond), axis=1)
        rolled = rolled_merges(self.roll_out, scenes, drawn, beyond=self.beyond)
        return over_time(
            self.correction.quantiles(rolled), sample_quantiles(drawn, MEDIAN, beyond=self.beyond)[:, :, 0]
        )

    def _limit(self, scenes: MergeScenes) -> Float[np.ndarray, "scene"]:
        fastest = np.where(scenes.own.valid[:, 0], scenes.own.v[:, 0], 0.0).max(axis=1)
        return np.maximum(self.roll_out.roll_out.limit, fastest)


@dataclass(frozen=True)
class SceneForecaster:
    """A fitted forecaster of vehicles with and without a lane to merge into.

    Attributes:
        platoons: for those without.
        merges: for those with one; None if no such vehicle was in training: then they are forecast as if they had none.
    """

    platoons: PlatoonForecaster
    merges: MergeForecaster | None

    def predict(self, scenes: MergeScenes) -> SceneForecast:
        """Returns the forecast of each scene, whatever the others are.

        Args:
            scenes: at least one.
        """
        parts, order = [], []
        may_merge = scenes.may_merge if self.merges is not None else np.zeros(len(scenes), dtype=bool)
        for merging in (False, True):
            rows = np.flatnonzero(may_merge == merging)
            for first in range(0, len(rows), CHUNK):
                some = scenes.select(rows[first : first + CHUNK])
                parts.append(self.merges.predict(some) if merging and self.merges else self._in_lane(some))
            order.append(rows)
        back = np.argsort(np.concatenate(order), kind="stable")
        names = [field.name for field in fields(SceneForecast)]
        return SceneForecast(**{name: np.concatenate([getattr(part, name) for part in parts])[back] for name in names})

    def _in_lane(self, scenes: MergeScenes) -> SceneForecast:
        found = self.platoons.predict(scenes.own)
        never = np.full(found.samples.shape[:2], FUTURE)
        length = known_lengths(scenes.own)
        return SceneForecast(
            samples=found.samples,
            leader_rear=(found.leader_samples - length[:, 1, None, None]).astype(np.float32),
            follower_front=np.full_like(found.samples, np.nan),
            length=length[:, 0],
            merge_step=never,
            gap=np.zeros_like(never),
            chance=np.zeros((len(scenes), FUTURE)),
            mean=found.mean,
            quantiles=found.quantiles,
        )


@dataclass(frozen=True)
class _Training:
    """The training vehicles: their scenes and what became of them; see `fit_scene_forecaster`."""

    scenes: MergeScenes
    truth: Float[np.ndarray, "scene step"]
    leader_truth: Float[np.ndarray, "scene step"]
    change_time: Float[np.ndarray, "scene"]
    seen_for: Float[np.ndarray, "scene"]
    group: Shaped[np.ndarray, "scene"]
    t0: Float[np.ndarray, "scene"]

    @property
    def in_lane(self) -> Float[np.ndarray, "scene step"]:
        """Returns the displacements until the lane change: after it a vehicle follows its leader of t = 0 no longer."""
        until = np.where(np.isfinite(self.change_time), self.change_time, np.inf)
        return np.where(TIME <= until[:, None], self.truth, np.nan)

    def select(self, rows: Int[np.ndarray, "row"]) -> "_Training":
        arrays = {one.name: getattr(self, one.name)[rows] for one in fields(self) if one.name != "scenes"}
        return _Training(scenes=self.scenes.select(rows), **arrays)


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
    spec: PlatoonForecasterSpec = FORECASTER,
) -> SceneForecaster:
    """Returns the forecaster that the training vehicles teach.

    Args:
        scenes: of the training vehicles.
        truth: their displacements [m]; NaN where not seen.
        leader_truth: front of the leaders that they have in their lane at t = 0, counted from the same places [m]; NaN
            where not seen.
        change_time: time to the lane change [s]; NaN where none was seen.
        seen_for: time for which each was seen [s].
        group: name of the vehicle, which begins with the number of its window; see `time_folds`.
        t0: the moment in its window's clock [s]; NaN without a clock.
        seed: of samples and trees.
        spec: what may be chosen.
    """
    training = _Training(scenes, truth, leader_truth, change_time, seen_for, group, t0)
    merging = np.flatnonzero(scenes.may_merge & ~(change_time <= 0.0))
    merges = _fit_merges(training.select(merging), seed=seed, spec=spec) if len(merging) else None
    return SceneForecaster(_fit_platoons(training, seed=seed, spec=spec), merges)


def _fit_platoons(training: _Training, *, seed: int, spec: PlatoonForecasterSpec) -> PlatoonForecaster:
    """Returns the forecaster of those without a lane to merge into; if all have one, of all, without a correction."""
    others = np.flatnonzero(~training.scenes.may_merge)
    some = training.select(others) if len(others) else training
    return fit_platoon_forecaster(
        some.scenes.own,
        some.in_lane,
        some.leader_truth,
        group=some.group,
        t0=some.t0,
        seed=seed,
        spec=spec if len(others) else replace(spec, correction=None),
    )


def _fit_merges(training: _Training, *, seed: int, spec: PlatoonForecasterSpec) -> MergeForecaster:
    scenes, truth, group = training.scenes, training.truth, training.group
    seen_for, change_time = training.seen_for, training.change_time
    zone = merge_zone(scenes.to_end, truth, change_time)
    never = replace(NEVER, first=zone[0], last=zone[1])
    model = MergeRollOut(fit_roll_out(scenes.own, training.in_lane, training.leader_truth), never)
    for _ in range(PASSES):
        seen = waiting_features(model, scenes, samples=LEARNING_SAMPLES, seed=seed)
        hazard = fit_merge_hazard(seen.features, change_time, seen_for, may=seen.can, zone=zone)
        model = replace(model, hazard=hazard)
    begin, end = training.t0 - (HISTORY - 1) * STEP, training.t0 + FUTURE * STEP
    folds = time_folds(group, begin, end, count=min(spec.folds, len(set(group.tolist()))))
    forest = fit_merge_forest(
        merge_columns(scenes),
        _first_look(model, scenes, seed),
        change_time=change_time,
        seen_for=seen_for,
        group=group,
        folds=folds,
        seed=seed,
    )
    beyond = bool((seen_for > change_time + STEP / 2.0).any())
    if spec.correction is None:
        return MergeForecaster(spec, model, forest, beyond, None, seed)
    drawn = _drawn(model, forest, scenes, samples=spec.samples, seed=seed)
    rolled = rolled_merges(model, scenes, drawn, beyond=beyond)
    correction = fit_correction(rolled, truth[:, KNOTS], group=group, folds=folds, seed=seed, spec=spec.correction)
    return MergeForecaster(spec, model, forest, beyond, correction, seed)


def _first_look(model: MergeRollOut, scenes: MergeScenes, seed: int) -> Float[np.ndarray, "scene step"]:
    """Returns the probability to have merged by each step, of a few roll-outs."""
    drawn = sample_merges(model, scenes, samples=FEW_SAMPLES, seed=seed)
    return np.minimum(np.cumsum(drawn.chance.astype(float), axis=1), 1.0)


def _drawn(model: MergeRollOut, forest: MergeForest, scenes: MergeScenes, *, samples: int, seed: int) -> MergeSamples:
    """Returns roll-outs whose hazards are those of the model, times what brings a few of them to the forest's curve."""
    if forest.trees is None:
        return sample_merges(model, scenes, samples=samples, seed=seed)
    rolled = _first_look(model, scenes, seed)
    rate = rate_of(forest.curves(merge_columns(scenes), rolled), rolled)
    return sample_merges(model, scenes, samples=samples, seed=seed, rate=rate)


def rolled_merges(model: MergeRollOut, scenes: MergeScenes, drawn: MergeSamples, *, beyond: bool) -> Rolled:
    """Returns the roll-outs of merge scenes, as the correction sees them; for `beyond` see `MergeForecaster`."""
    low, median, high = np.moveaxis(sample_quantiles(drawn, SPREAD, beyond=beyond, steps=KNOTS), -1, 0)
    chain = roll_chain(model.roll_out.prior.centre, scenes.own, leaders=scenes.own.x.shape[1] - 1)
    merged = np.stack([(drawn.merge_step <= step).mean(axis=1) for step in KNOTS], axis=1)
    return Rolled(
        features=np.column_stack([merge_table(scenes), merged]),
        chains=chain[:, KNOTS, None],
        median=median,
        spread=high - low,
        regime=regimes(scenes.own),
    )


def sample_quantiles(
    drawn: MergeSamples,
    levels: Float[np.ndarray, "level"],
    *,
    beyond: bool,
    steps: Int[np.ndarray, "step"] = ALL_STEPS,
) -> Float[np.ndarray, "scene step level"]:
    """Returns quantiles of the samples' displacements [m], of those that have not merged yet unless `beyond`."""
    x = drawn.x[:, :, steps] if beyond else _unmerged(drawn, steps)
    ordered = np.sort(np.ascontiguousarray(x.swapaxes(1, 2)), axis=2)
    count = np.isfinite(ordered).sum(axis=2)[:, :, None]
    # infinite ones are the last; as np.quantile, linear between the ranks
    rank = levels * (count - 1)
    left = np.minimum(rank.astype(np.int64), count - 1)
    low, high = (np.take_along_axis(ordered, np.minimum(left + n, count - 1), axis=2) for n in (0, 1))
    return low + (high - low) * (rank - left)


def _unmerged(drawn: MergeSamples, steps: Int[np.ndarray, "step"]) -> Float[np.ndarray, "scene sample step"]:
    """Returns the displacements, infinite for samples that have merged; where too few have not, they all count."""
    merged = drawn.merge_step[:, :, None] < steps
    few = (~merged).sum(axis=1, keepdims=True) < FEWEST_UNMERGED
    return np.where(merged & ~few, np.inf, drawn.x[:, :, steps])


def _forecast(
    drawn: MergeSamples,
    scenes: MergeScenes,
    quantiles: Float[np.ndarray, "scene step level"],
    limit: Float[np.ndarray, "scene"],
) -> SceneForecast:
    """Returns the samples moved to the quantiles, leaders and followers along with them."""
    x = mapped(drawn.x, quantiles, limit)
    shift = x - drawn.x
    return SceneForecast(
        samples=x,
        leader_rear=drawn.leader_rear + shift,
        follower_front=drawn.follower_front + shift,
        length=known_lengths(scenes.own)[:, 0],
        merge_step=drawn.merge_step,
        gap=drawn.gap,
        chance=drawn.chance.astype(float),
        mean=x.mean(axis=1),
        quantiles=quantiles,
    )
