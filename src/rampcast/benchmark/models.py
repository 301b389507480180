"""The benchmark's longitudinal models. To add one: a `fit`, here or elsewhere, and a line in `forecasters`.

A `fit` is given the training cases, futures and all, and returns a `predict`, which is given scenes and nothing else.
The oracle alone is told the leader's future, as an argument of its own.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import minimize_scalar

from rampcast.benchmark.cases import TIME, Cases
from rampcast.benchmark.paper_rows import SPEED_LIMIT, Kept, PaperRows, fit_paper_rows, lane_parameters
from rampcast.forecast.calibrated import CalibratedSpec
from rampcast.forecast.scene_forecaster import SceneForecaster, fit_scene_forecaster
from rampcast.horizon import FUTURE, STEP, STEPS_PER_SECOND
from rampcast.models.pooled_driver import fit_pooled_driver, follow_true_leader, roll_chain
from rampcast.paper.algorithm_1 import follow
from rampcast.paper.laws.laws import LAWS
from rampcast.paper.laws.mode import Mode
from rampcast.traffic.merge_scenes import MergeScenes
from rampcast.traffic.platoons import Platoons, known_lengths

SECONDS: np.ndarray = np.arange(STEPS_PER_SECOND - 1, FUTURE, STEPS_PER_SECOND)  # steps that are scored
LEVELS = (0.05, 0.25, 0.5, 0.75, 0.95)
LONGEST_RELAXATION = 60.0  # [s]; the search for the time constant ends here
LEAST_ERRORS = 20  # a 5 % quantile of fewer errors is not known
FORECASTER = CalibratedSpec()
TOUCH = 0.01  # [m]; samples are kept in single precision, and overlap when they are farther into another vehicle


@dataclass(frozen=True)
class Forecasts:
    """What a model forecasts for each case.

    Attributes:
        x: displacement from the place at t = 0, at 0.2, 0.4 ... 15 s [m].
        quantiles: of it, at `LEVELS` [m]; None for a model that gives a number only.
        overlaps: how many samples of each case overlap another vehicle at that step or before; None for a model that
            does not sample.
        samples: of x at whole seconds [m]; None likewise, and where not all of them count.
        gaps: of the net gap to the leader that it has at t = 0, in the same samples [m]; NaN where it has none or may
            leave it. None likewise.
    """

    x: Float[np.ndarray, "case step"]
    quantiles: Float[np.ndarray, "case step quantile"] | None = None
    overlaps: Int[np.ndarray, "case step"] | None = None
    samples: Float[np.ndarray, "case sample second"] | None = None
    gaps: Float[np.ndarray, "case sample second"] | None = None


@dataclass(frozen=True)
class Training:
    """Training cases, with the fits that several models share.

    Attributes:
        cases: see `Cases`.
        shared: gives the paper's framework where it is trained for several data sets at once; None to train it here.
        kept: what several models found out about the same scenes.
    """

    cases: Cases
    shared: Callable[[], dict[Mode, PaperRows]] | None = None
    kept: Kept = field(default_factory=Kept)

    @cached_property
    def longitudinal(self) -> Cases:
        """Returns the cases that ask where the vehicle will be."""
        return self.cases.select(self.cases.longitudinal)

    @cached_property
    def driver(self) -> Float[np.ndarray, "param"]:
        """Returns the IDM of the average driver: fitted behind the true futures of the leaders."""
        cases = self.longitudinal
        return fit_pooled_driver(cases.platoons, cases.truth, leader_truth=cases.leader_truth)

    @cached_property
    def merging(self) -> Cases:
        """Returns the cases that ask when the vehicle will merge."""
        return self.cases.select(self.cases.merging)

    @cached_property
    def paper(self) -> dict[Mode, PaperRows]:
        """Returns the paper's framework in both modes."""
        return self.shared() if self.shared else fit_paper_rows(self.longitudinal)

    @cached_property
    def scene_forecaster(self) -> SceneForecaster:
        """Returns rampcast's own forecaster."""
        cases = self.cases
        return fit_scene_forecaster(
            cases.scenes,
            cases.truth,
            cases.leader_truth,
            change_time=cases.change_time,
            seen_for=cases.seen_for,
            group=cases.group,
            t0=cases.t0,
            spec=FORECASTER,
        )


Predict = Callable[[MergeScenes], Forecasts]
Fit = Callable[[Training], Predict]
OraclePredict = Callable[[MergeScenes, Float[np.ndarray, "case step"]], Forecasts]


def constant_velocity(training: Training) -> Predict:
    """Returns x = v t."""
    del training
    return lambda scenes: Forecasts(_speed(scenes.own)[:, None] * TIME)


def relax_to_leader(training: Training) -> Predict:
    """Returns the forecast of a vehicle whose speed goes to its leader's exponentially; one time constant for all."""
    cases = training.longitudinal

    def error(relaxation: float) -> float:
        sizes = np.abs(_relaxed(cases.platoons, relaxation) - cases.truth)
        return float(np.nanmean(sizes))

    best = minimize_scalar(error, bounds=(STEP, LONGEST_RELAXATION), method="bounded").x
    return lambda scenes: Forecasts(_relaxed(scenes.own, float(best)))


def pooled_idm(training: Training) -> Predict:
    """Returns the forecast of one IDM behind a leader that keeps its speed, fitted in just this use."""
    parameters = fit_pooled_driver(training.longitudinal.platoons, training.longitudinal.truth)
    return lambda scenes: Forecasts(roll_chain(parameters, scenes.own, leaders=1))


def chain(training: Training, *, leaders: int) -> Predict:
    """Returns the forecast of the average driver's IDM in a chain of so many leaders, the first at constant speed."""
    parameters = training.driver
    return lambda scenes: Forecasts(roll_chain(parameters, scenes.own, leaders=leaders))


def car_following(training: Training, *, law: str) -> Predict:
    """Returns the forecast of a law of the paper, fitted to the 4 s of each case, behind a leader that keeps its speed.

    A vehicle without a leader keeps its speed.
    """
    return lambda scenes: Forecasts(_behind_constant_speed(law, scenes, training.kept))


def lstm(training: Training, *, mode: str) -> Predict:
    """Returns the forecast of the paper's LSTM for the vehicle itself."""
    rows = training.paper[Mode(mode)]
    return lambda scenes: Forecasts(rows.alone(scenes, training.kept))


def framework(training: Training, *, law: str, mode: str) -> Predict:
    """Returns the forecast of the paper's whole framework: algorithm 1 behind neighbours that its LSTMs predict."""
    rows = training.paper[Mode(mode)]
    return lambda scenes: Forecasts(rows.behind(law, scenes, training.kept))


def scene_forecaster(training: Training) -> Predict:
    """Returns the forecast of rampcast's own forecaster: its median, and its own quantiles."""
    return partial(_scene_forecast, training.scene_forecaster)


def roll_outs_alone(training: Training) -> Predict:
    """Returns the same without the learned correction: the samples' own median and quantiles."""
    model = training.scene_forecaster.model
    return partial(_scene_forecast, SceneForecaster(replace(model, in_lane=None, merging=None)))


def oracle(training: Training) -> OraclePredict:
    """Returns the forecast of the average driver's IDM behind the leader's true future; NaN once that is not known."""
    parameters = training.driver
    return lambda scenes, leader_truth: Forecasts(follow_true_leader(parameters, scenes.own, leader_truth))


PLAINEST = "constant_velocity"  # what every model is compared with
ORACLE = "oracle"
REFERENCE = "chain_1"  # one leader at constant speed; it closes none of the gap to the oracle, by definition


def with_bands(forecasts: Forecasts, training: Forecasts, truth: Float[np.ndarray, "train step"]) -> Forecasts:
    """Returns forecasts with the quantiles of the model's errors on the training cases, where it gives none itself.

    No quantile reverses. They are NaN at a step where fewer than `LEAST_ERRORS` errors are known.

    Args:
        forecasts: of the test cases.
        training: of the same model, of the training cases.
        truth: of the training cases [m].
    """
    if forecasts.quantiles is not None:
        return forecasts
    errors = truth - training.x
    enough = np.isfinite(errors).sum(axis=0) >= LEAST_ERRORS
    spread = np.full((errors.shape[1], len(LEVELS)), np.nan)
    if enough.any():
        spread[enough] = np.nanquantile(errors[:, enough], LEVELS, axis=0).T
    quantiles = np.maximum(forecasts.x[..., None] + spread, 0.0)
    return replace(forecasts, quantiles=quantiles)


def overlaps(
    samples: Float[np.ndarray, "case sample step"],
    *,
    leader_rear: Float[np.ndarray, "case sample step"],
    follower_front: Float[np.ndarray, "case sample step"],
    length: Float[np.ndarray, "case"],
) -> Int[np.ndarray, "case step"]:
    """Returns how many samples of each case overlap the vehicle ahead, or that behind, at each step or before.

    Args:
        samples: front of the vehicle [m].
        leader_rear: rear of the vehicle ahead [m].
        follower_front: front of the vehicle behind [m].
        length: of the vehicle itself [m].
    """
    inside = (samples > leader_rear + TOUCH) | (follower_front > samples - length[:, None, None] + TOUCH)
    return np.logical_or.accumulate(inside, axis=2).sum(axis=1)


def _scene_forecast(model: SceneForecaster, scenes: MergeScenes) -> Forecasts:
    found = model.predict(scenes)
    counts = overlaps(
        found.samples, leader_rear=found.leader_rear, follower_front=found.follower_front, length=found.length
    )
    samples = found.samples[:, :, SECONDS].astype(float)
    gaps = found.leader_rear[:, :, SECONDS].astype(float) - samples
    stays = scenes.own.present[:, 1] & ~scenes.may_merge
    return Forecasts(
        x=found.median.astype(float),
        quantiles=found.quantiles_at(*LEVELS).astype(float),
        overlaps=counts,
        samples=samples if found.counts.all() else None,
        gaps=np.where(stays[:, None, None], gaps, np.nan),
    )


def _speed(platoons: Platoons) -> Float[np.ndarray, "case"]:
    return np.maximum(platoons.v[:, 0, -1], 0.0)


def _relaxed(platoons: Platoons, relaxation: float) -> Float[np.ndarray, "case step"]:
    """Returns v_l t + (v - v_l) T (1 - exp(-t / T)), T the relaxation [s]; without a leader v t."""
    own = _speed(platoons)[:, None]
    leader = np.where(platoons.present[:, 1, None], np.maximum(platoons.v[:, 1, -1, None], 0.0), own)
    return leader * TIME + (own - leader) * relaxation * (1.0 - np.exp(-TIME / relaxation))


def _behind_constant_speed(law: str, scenes: MergeScenes, kept: Kept) -> Float[np.ndarray, "case step"]:
    platoons = scenes.own
    led = platoons.present[:, 1]
    ahead = np.where(led, platoons.x[:, 1, -1] - platoons.x[:, 0, -1], 0.0)
    speed = np.where(led, np.maximum(platoons.v[:, 1, -1], 0.0), 0.0)
    time = np.arange(FUTURE + 1) * STEP
    motion = follow(
        LAWS[law],
        lane_parameters(law, scenes, Mode.CORRECTED, kept),
        x=np.zeros(len(platoons)),
        v=_speed(platoons),
        leader_x=ahead[:, None] + speed[:, None] * time,
        leader_v=np.repeat(speed[:, None], FUTURE + 1, axis=1),
        leader_length=known_lengths(platoons)[:, 1],
        v_max=SPEED_LIMIT,
    )
    return np.where(led[:, None], motion.x, _speed(platoons)[:, None] * TIME)
