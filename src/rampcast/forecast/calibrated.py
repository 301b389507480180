"""Joint roll-outs, corrected and calibrated: every vehicle's samples moved to where vehicles like it really were.

What a band is learned from comes from models (drivers, hazard, forest, correction) that saw neither the vehicle nor its
minutes. The moves keep the order of a vehicle's samples, and `projection` keeps the traffic one that is possible.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from rampcast.errors import ModelError
from rampcast.forecast.learning import Base, Training, fit_base, merge_rates
from rampcast.forecast.roll_out import Beginning, Driven, begin, drive, drive_average, sharing
from rampcast.forecast.stages import Stages
from rampcast.horizon import STEP
from rampcast.models.correction import KNOTS, LEVELS, Correction, CorrectionSpec, Rolled, fit_correction
from rampcast.models.merge_features import merge_columns, platoon_table, regimes
from rampcast.models.plain_data import MAY_BE_MISSING
from rampcast.threads import shared_out
from rampcast.traffic.around import joined
from rampcast.traffic.merge_scenes import MergeScenes
from rampcast.traffic.situation import NOBODY, Situation

SPREAD = (0.1, 0.5, 0.9)  # levels of the median, and of the quantiles whose distance is the spread
FEWEST_UNMERGED = 5  # samples of which quantiles are taken
MOST_SAMPLES = 10_000  # of a vehicle: those of 1,000 vehicles take 3 GB
CHUNK = 1500  # vehicles at a time: 100 samples of them are 45 MB
CORRECTION = CorrectionSpec()
Tell = Callable[[int, int], None]  # stages done, stages in all
NOT_KEPT = Stages(None, {})


def tell_nobody(done: int, total: int) -> None:
    """Is told of stages where nobody wants to know."""


@dataclass(frozen=True)
class CalibratedSpec:
    """What may be chosen.

    Attributes:
        samples: futures of each vehicle.
        folds: of the cross-fits.
        correction: sizes of its trees; None leaves the roll-outs as they are.
    """

    samples: int = 100
    folds: int = 5
    correction: CorrectionSpec | None = CORRECTION

    def __post_init__(self) -> None:
        if not 1 <= self.samples <= MOST_SAMPLES:
            raise ModelError(f"samples: expected 1 to {MOST_SAMPLES:,}, got {self.samples}")


SPEC: Final[CalibratedSpec] = CalibratedSpec()


@dataclass(frozen=True)
class Calibrated:
    """Fitted roll-outs with their corrections.

    Attributes:
        spec: what was chosen.
        base: the roll-out.
        in_lane, merging: corrections of vehicles without and with a lane to merge into; None without.
        beyond: whether training vehicles were seen after they merged. If not, nothing is known of where they go then,
            and the places of vehicles with a lane to merge into are those of samples that have not merged yet.
    """

    spec: CalibratedSpec
    base: Base
    in_lane: Correction | None
    merging: Correction | None
    beyond: bool

    def futures(
        self,
        situation: Situation,
        scenes: MergeScenes,
        vehicle: Int[np.ndarray, "row"],
        follow: Int[np.ndarray, "vehicle"],
        *,
        samples: int | None = None,
        scale: Float[np.ndarray, "knot"] | None = None,
    ) -> tuple[Beginning, Driven]:
        """Returns sampled futures of all vehicles of a situation, moved to where they are calibrated.

        Args:
            situation: of one or more moments.
            scenes: of the vehicles that are corrected.
            vehicle: place of each of these in the situation.
            follow: which of these (a row) each vehicle of the situation is moved like; `NOBODY` for one that is not.
            samples: how many; None for those of the spec.
            scale: by how much farther apart the quantiles are to be than learned, at each of `KNOTS`; None for 1.
        """
        samples = samples or self.spec.samples
        beginning = begin(self.base.roll_out, situation)
        columns = merge_columns(scenes)
        rate = merge_rates(self.base, beginning, scenes, vehicle, columns)
        driven = drive(self.base.roll_out, beginning, samples=samples, seed=self.base.seed, rate=rate)
        if self.in_lane is None and self.merging is None and scale is None:
            return beginning, driven
        at_knots, lane = (np.take(values, KNOTS, axis=2)[vehicle] for values in (driven.x, driven.lane))
        counts = self._counts(situation, vehicle, lane)
        rolled = rolled_of(self.base, beginning, scenes, vehicle, columns, at_knots, lane, counts)
        moves = self._moves(rolled, scenes, at_knots, counts, beginning.start.x[vehicle], scale)
        shift = np.concatenate([moves, np.zeros((1, *moves.shape[1:]), np.float32)])[follow]
        self._project(beginning, shift, driven)
        return beginning, driven

    def quantiles(self, training: Training, levels: tuple[float, ...]) -> tuple[Float[np.ndarray, "row knot"], ...]:
        """Returns quantiles of the final samples' displacements at the knots [m], of vehicles of whole moments.

        Args:
            training: whose futures are not looked at. Vehicles of its moments that are not asked for are moved like
                the one next to them in the situation that is.
            levels: of the quantiles.
        """
        parts = []
        for some in _chunks(training):
            asked = np.argsort(some.vehicle, kind="stable")
            place = np.searchsorted(some.vehicle[asked], np.arange(some.situation.first[-1]))
            follow = asked[np.minimum(place, len(asked) - 1)]
            beginning, driven = self.futures(some.situation, some.scenes, some.vehicle, follow)
            lane, x = (values[some.vehicle][:, :, KNOTS] for values in (driven.lane, driven.x))
            counts = self._counts(some.situation, some.vehicle, lane)
            x = x - beginning.start.x[some.vehicle][:, None, None]
            parts.append(np.stack(counted_quantiles(x, counts, levels)))
        return tuple(np.concatenate(parts, axis=1))

    def _counts(
        self, situation: Situation, vehicle: Int[np.ndarray, "row"], lane: Int[np.ndarray, "row sample knot"]
    ) -> Bool[np.ndarray, "row sample knot"]:
        if self.beyond:
            return np.ones(lane.shape, dtype=bool)
        return unmerged(situation, vehicle, lane)

    def _moves(
        self,
        rolled: "RolledRows",
        scenes: MergeScenes,
        x: Float[np.ndarray, "row sample knot"],
        counts: Bool[np.ndarray, "row sample knot"],
        start: Float[np.ndarray, "row"],
        scale: Float[np.ndarray, "knot"] | None,
    ) -> Float[np.ndarray, "row sample knot"]:
        from rampcast.forecast.projection import ANCHORS, shifts  # numba: only who forecasts waits for it

        moves = np.zeros(x.shape, np.float32)
        for correction, merging in ((self.in_lane, False), (self.merging, True)):
            rows = np.flatnonzero(scenes.may_merge == merging)
            if not len(rows) or (correction is None and scale is None):
                continue
            if correction is None:
                own = counted_quantiles(x[rows], counts[rows], tuple(LEVELS[ANCHORS]))
                wanted = np.stack(own, axis=-1) - start[rows, None, None]
            else:
                wanted = correction.quantiles(rolled.of(rows, merging=merging))[:, :, ANCHORS]
            wanted = wanted if scale is None else _spread(wanted, scale)
            wanted = np.maximum.accumulate(np.maximum(wanted, 0.0), axis=1) + start[rows, None, None]
            part = np.empty((len(rows), *x.shape[1:]), np.float32)
            _in_shares(shifts, (x[rows], counts[rows], np.ascontiguousarray(wanted), part))  # one layout, compiled once
            moves[rows] = part
        return moves

    def _project(self, beginning: Beginning, shift: Float[np.ndarray, "vehicle sample knot"], driven: Driven) -> None:
        from rampcast.forecast.projection import NEAR, OVER_TIME, project

        fastest = np.maximum(self.base.roll_out.limit, beginning.start.v)
        start = beginning.start

        def work(task: tuple[int, int, int, int]) -> None:
            project(start, fastest, shift, OVER_TIME, NEAR, task[:2], task[2:], driven.x, driven.lane)

        sharing(work, len(start.first) - 1, driven.x.shape[1])


def _spread(
    wanted: Float[np.ndarray, "row knot anchor"], scale: Float[np.ndarray, "knot"]
) -> Float[np.ndarray, "row knot anchor"]:
    """Returns quantiles as much farther from their median."""
    from rampcast.forecast.projection import MIDDLE

    median = wanted[:, :, [MIDDLE]]
    return median + scale[:, None] * (wanted - median)


def _in_shares(loops: Callable[..., None], arrays: Sequence[np.ndarray]) -> None:
    shared_out(lambda rows: loops(*(values[rows] for values in arrays)), len(arrays[0]))


@dataclass(frozen=True)
class RolledRows:
    """Roll-outs of some vehicles, as the corrections see them; see `models.correction.Rolled`.

    Attributes:
        platoons, merges: features of each as one of a lane, and as one that merges.
        average, steady: displacement at the knots of the average driver, and at constant speed [m].
        median, spread: of the samples' displacements at the knots [m].
        merged: share of them that has merged by then.
        regime: see `merge_features.Regime`.
    """

    platoons: Float[np.ndarray, "row lane_feature"] = field(metadata=MAY_BE_MISSING)
    merges: Float[np.ndarray, "row merge_feature"] = field(metadata=MAY_BE_MISSING)
    average: Float[np.ndarray, "row knot"]
    steady: Float[np.ndarray, "row knot"]
    median: Float[np.ndarray, "row knot"]
    spread: Float[np.ndarray, "row knot"]
    merged: Float[np.ndarray, "row knot"]
    regime: Int[np.ndarray, "row"]

    def of(self, rows: Int[np.ndarray, "chosen"], *, merging: bool) -> Rolled:
        """Returns those rows as a correction sees them."""
        features = np.column_stack([self.merges, self.merged]) if merging else self.platoons
        return Rolled(
            features=features[rows],
            chains=np.stack([self.average[rows], self.steady[rows]], axis=-1),
            median=self.median[rows],
            spread=self.spread[rows],
            regime=self.regime[rows],
        )


def fit_calibrated(
    training: Training,
    *,
    seed: int = 1,
    spec: CalibratedSpec = SPEC,
    start: Calibrated | None = None,
    stages: Stages = NOT_KEPT,
    tell: Tell = tell_nobody,
) -> Calibrated:
    """Returns what the training vehicles teach.

    Args:
        training: see there.
        seed: of samples and trees.
        spec: what may be chosen.
        start: whose parts are taken where there is too little to learn from; None for none.
        stages: keeps what takes long.
        tell: called when a stage is done.
    """
    folds = training.folds(spec.folds) if spec.correction is not None else []
    total = len(folds) + (3 if folds else 1)
    before = None if start is None else start.base
    tell(0, total)
    base = stages.kept("base-all", lambda: fit_base(training, seed=seed, start=before))
    plain = Calibrated(spec, base, None, None, beyond=_seen_after_merges(training))
    tell(1, total)
    parts: list[RolledRows] = []
    for number, (train, test) in enumerate(folds):
        parts.append(stages.kept(f"rolled-{number}", _Unseen(plain, training, train, test, seed, before).rolled))
        tell(2 + number, total)
    if not parts:
        return plain
    rolled = _in_order(joined(parts), np.concatenate([test for _, test in folds]))
    in_lane = _corrected(training, rolled, np.flatnonzero(~training.scenes.may_merge), False, seed, spec)
    tell(total - 1, total)
    merging = _corrected(training, rolled, np.flatnonzero(training.merging), True, seed, spec)
    tell(total, total)
    if start is None:
        return replace(plain, in_lane=in_lane, merging=merging)
    return replace(plain, in_lane=in_lane or start.in_lane, merging=merging or start.merging)


def _seen_after_merges(training: Training) -> bool:
    return bool((training.seen_for > training.change_time + STEP / 2.0).any())


@dataclass(frozen=True)
class _Unseen:
    """A block of vehicles and time, and models that see neither."""

    model: Calibrated
    training: Training
    train: Int[np.ndarray, "train"]
    test: Int[np.ndarray, "test"]
    seed: int
    start: Base | None

    def rolled(self) -> "RolledRows":
        """Returns the roll-outs of the block by what all others teach."""
        others = self.training.select(self.train) if len(self.train) else None
        base = self.model.base if others is None else fit_base(others, seed=self.seed, start=self.start)
        return rolled_rows(replace(self.model, base=base), self.training.select(self.test))


def _in_order(rolled: "RolledRows", order: Int[np.ndarray, "row"]) -> "RolledRows":
    back = np.argsort(order, kind="stable")
    return RolledRows(**{one.name: getattr(rolled, one.name)[back] for one in fields(RolledRows)})


def _corrected(
    training: Training,
    rolled: "RolledRows",
    rows: Int[np.ndarray, "chosen"],
    merging: bool,
    seed: int,
    spec: CalibratedSpec,
) -> Correction | None:
    """Returns the correction of those vehicles; None of too few."""
    if spec.correction is None or len(rows) < spec.correction.least_cases:
        return None
    some = training.select(rows)
    return fit_correction(
        rolled.of(rows, merging=merging),
        some.truth[:, KNOTS],
        group=some.group,
        folds=some.folds(spec.folds),
        seed=seed,
        spec=spec.correction,
    )


def rolled_rows(model: Calibrated, training: Training) -> RolledRows:
    """Returns the roll-outs of the training vehicles, a few moments at a time."""
    parts = []
    for some in _chunks(training):
        situation, vehicle, base = some.situation, some.vehicle, model.base
        beginning = begin(base.roll_out, situation)
        columns = merge_columns(some.scenes)
        rate = merge_rates(base, beginning, some.scenes, vehicle, columns)
        wanted = np.zeros(situation.first[-1], dtype=bool)
        wanted[vehicle] = True
        place = np.cumsum(wanted)[vehicle] - 1
        driven = drive(base.roll_out, beginning, samples=model.spec.samples, seed=base.seed, rate=rate, wanted=wanted)
        lane = driven.lane[place][:, :, KNOTS]
        counts = np.ones(lane.shape, dtype=bool) if model.beyond else unmerged(situation, vehicle, lane)
        at_knots = driven.x[place][:, :, KNOTS]
        parts.append(rolled_of(base, beginning, some.scenes, vehicle, columns, at_knots, lane, counts))
    return joined(parts)


def _chunks(training: Training) -> Iterator[Training]:
    """Yields the training vehicles of a few moments at a time, in their order."""
    moment = training.situation.moment[training.vehicle]
    size = np.diff(training.situation.first)[moment]
    new = np.append(True, np.diff(moment) != 0)
    number = np.cumsum(np.where(new, size, 0)) // CHUNK
    for edge in np.unique(number):
        yield training.select(np.flatnonzero(number == edge))


def unmerged(
    situation: Situation, vehicle: Int[np.ndarray, "row"], lane: Int[np.ndarray, "row sample knot"]
) -> Bool[np.ndarray, "row sample knot"]:
    """Returns which samples have not merged; where too few have not, all."""
    target = situation.target[situation.moment[vehicle], situation.lane[vehicle]]
    still = (target == NOBODY)[:, None, None] | (lane != target[:, None, None])
    few = still.sum(axis=1, keepdims=True) < FEWEST_UNMERGED
    return still | few


def rolled_of(
    base: Base,
    beginning: Beginning,
    scenes: MergeScenes,
    vehicle: Int[np.ndarray, "row"],
    columns: Float[np.ndarray, "row column"],
    x: Float[np.ndarray, "row sample knot"],
    lane: Int[np.ndarray, "row sample knot"],
    counts: Bool[np.ndarray, "row sample knot"],
) -> RolledRows:
    """Returns roll-outs as the corrections see them."""
    situation = beginning.situation
    start = beginning.start.x[vehicle]
    target = situation.target[situation.moment[vehicle], situation.lane[vehicle]]
    low, median, high = counted_quantiles(x, counts, SPREAD)
    average = drive_average(base.roll_out, beginning)[vehicle][:, KNOTS] - start[:, None]
    platoons = platoon_table(scenes.own)
    return RolledRows(
        platoons=platoons,
        merges=np.column_stack([platoons, columns]),
        average=average,
        steady=beginning.start.v[vehicle][:, None] * (STEP * (KNOTS + 1)),
        median=median - start[:, None],
        spread=high - low,
        merged=((target != NOBODY)[:, None, None] & (lane == target[:, None, None])).mean(axis=1),
        regime=regimes(scenes.own),
    )


def counted_quantiles(
    x: Float[np.ndarray, "row sample knot"], counts: Bool[np.ndarray, "row sample knot"], levels: tuple[float, ...]
) -> tuple[Float[np.ndarray, "row knot"], ...]:
    """Returns quantiles over the samples that count; see `Forecast.quantiles`."""
    ordered = np.sort(np.where(counts, x, np.inf).astype(float), axis=1)
    count = counts.sum(axis=1, keepdims=True)
    found = []
    for level in levels:
        place = np.clip(level * (count + 1) - 1.0, 0.0, count - 1)
        left = place.astype(np.int64)
        low, high = (np.take_along_axis(ordered, np.minimum(left + n, count - 1), axis=1)[:, 0] for n in (0, 1))
        found.append(low + (high - low) * (place - left)[:, 0])
    return tuple(found)
