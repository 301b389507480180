"""When a vehicle on the ramp merges: a discrete-time hazard of the state of its surroundings.

The probability to change lane within the next 0.2 s is logistic in what a driver may look at: the gap beside, how fast
it opens or closes and for how long it has been there, how far the lane has gone and still goes, and, near t = 0, how
the vehicle lies and moves in its lane. It is learned from what the roll-outs say of the surroundings at each step, not
from what they really became: so it counts on as much as can be known. Vehicles that leave the recording before they
merge count up to then. Upstream of where the first training vehicle merged nobody merges.

Source: Cox 1972 and Allison 1982 for hazards in discrete time; Ahmed 1999 for the choice of what drivers look at.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from sklearn.linear_model import LogisticRegression

from rampcast.errors import ModelError
from rampcast.horizon import FUTURE, STEP

NEAREST, FARTHEST = 1.0, 60.0  # [m] within which a gap matters
LANE_GOES_ON = 300.0  # [m]; an end farther away than this, or none, urges nobody
SOON = 60.0  # [m] within which the end of the lane urges
FRESH = 15.0  # [m] in which a vehicle that may merge now gets ready to
LONGEST = 20.0  # [s] to the end of the lane
LOOKAHEAD = 1.5  # [s] by which drivers foresee a gap: about half a lane change
WELL = 10.0  # [m]; a gap that leaves this much room ahead and behind is as good as any
LONGEST_READY = 3.0  # [s]; a gap that has been beside for longer is no better
HARDEST = 4.0  # [m/s^2]; beyond this all decelerations are too hard
MOVING = 0.15  # [m/s] lateral speed by which a vehicle is on its way; twice its noise
INTENT = 2.0  # [s] for which the place in the lane at t = 0 tells something
ARRIVAL = 0.6  # [s] about which a vehicle crosses the line that goes on as it moves
UNKNOWN_OFFSET = 1.8  # [m] half a lane: of a vehicle whose place in its lane is not known, or in its middle
FEATURES = 19
STRENGTH = 0.1  # inverse of the ridge penalty on scaled weights
LEAST_EVENTS = 10  # of fewer merges nothing is learned but how often they are
RARE = -6.0  # logit of a hazard of which nothing is known: a merge in 80 s
MARGIN = 5.0  # [m] upstream of the first merge of the training vehicles, and downstream of the last


class Periods(NamedTuple):
    """Steps in which training vehicles might have merged, in all samples.

    Attributes:
        features: see `merge_loops.merge_features`.
        merged: whether they did.
        scene: which training vehicle each is of.
        samples: how many there are.
    """

    features: Float[np.ndarray, "period feature"]
    merged: Bool[np.ndarray, "period"]
    scene: Int[np.ndarray, "period"]
    samples: int


@dataclass(frozen=True)
class MergeHazard:
    """A fitted hazard.

    Attributes:
        weights: of the features; see `merge_loops.merge_features`.
        constant: logit where all features are zero.
        first, last: distances to the end of the lane between which vehicles merge [m].
        unknown: standard deviation of the logarithm by which all hazards of the site may be off, as it is known; 0 for
            that of a site that taught it.
    """

    weights: Float[np.ndarray, "feature"]
    constant: float
    first: float = LANE_GOES_ON
    last: float = 0.0
    unknown: float = 0.0

    def __post_init__(self) -> None:
        if len(self.weights) != FEATURES:  # the compiled loops do not look
            raise ModelError(f"expected {FEATURES} weights of the hazard, got {len(self.weights)}")


NEVER = MergeHazard(np.zeros(FEATURES), RARE)


def merge_zone(
    to_end: Float[np.ndarray, "scene"], truth: Float[np.ndarray, "scene step"], change_time: Float[np.ndarray, "scene"]
) -> tuple[float, float]:
    """Returns the distances to the end of the lane at the first and at the last merge of the training vehicles [m].

    Args:
        to_end: distance of each to the end of its lane at t = 0 [m]; infinite where it does not end.
        truth: displacements at 0.2, 0.4 ... s [m]; NaN where not seen.
        change_time: time to the lane change [s]; NaN where none was seen.
    """
    step = np.nan_to_num(np.rint(change_time / STEP), nan=0.0).astype(np.int64)
    moved = np.column_stack([np.zeros(len(truth)), truth])
    known = np.isfinite(change_time) & np.isfinite(to_end) & (change_time >= 0.0) & (step < moved.shape[1])
    left = to_end[known] - moved[np.flatnonzero(known), step[known]]
    left = left[np.isfinite(left)]
    if not len(left):
        return LANE_GOES_ON, 0.0
    return float(min(left.max() + MARGIN, LANE_GOES_ON)), float(max(left.min() - MARGIN, 0.0))


def merge_periods(
    features: Float[np.ndarray, "scene sample step feature"],
    change_time: Float[np.ndarray, "scene"],
    seen_for: Float[np.ndarray, "scene"],
    *,
    may: Bool[np.ndarray, "scene sample step"] | None = None,
) -> Periods:
    """Returns when the training vehicles might have merged.

    Args:
        features: of each training vehicle at each step of 0.2 s after t = 0, in some samples of its roll-out, had it
            not merged before.
        change_time: time to the lane change [s]; NaN where none was seen.
        seen_for: time for which the vehicle was seen [s].
        may: whether it might have merged at that step; default: always.
    """
    at_risk, event = person_periods(change_time, seen_for, steps=features.shape[2])
    rows = np.broadcast_to(at_risk[:, None], features.shape[:3])
    rows = rows if may is None else rows & (may | event[:, None])
    merged = np.broadcast_to(event[:, None], features.shape[:3])[rows]
    return Periods(features[rows], merged, np.nonzero(rows)[0], features.shape[1])


def fit_merge_hazard(
    periods: Periods,
    change_time: Float[np.ndarray, "scene"],
    seen_for: Float[np.ndarray, "scene"],
    *,
    zone: tuple[float, float] = (LANE_GOES_ON, 0.0),
) -> MergeHazard:
    """Returns the hazard under which the lane changes of the training vehicles are likeliest.

    Args:
        periods: see `merge_periods`.
        change_time: time to the lane change [s]; NaN where none was seen.
        seen_for: time for which the vehicle was seen [s].
        zone: see `merge_zone`.
    """
    at_risk, event = person_periods(change_time, seen_for, steps=FUTURE)
    if event.sum() < LEAST_EVENTS:
        return MergeHazard(NEVER.weights, _usual(int(event.sum()), int(at_risk.sum())), *zone)
    middle, scale = usual_features(periods)
    fit = LogisticRegression(C=STRENGTH * periods.samples, max_iter=500).fit(
        (periods.features - middle) / scale,
        periods.merged,
        sample_weight=np.full(len(periods.merged), 1.0 / periods.samples),
    )
    weights = fit.coef_[0] / scale
    return MergeHazard(weights, float(fit.intercept_[0] - weights @ middle), *zone)


def usual_features(periods: Periods) -> tuple[Float[np.ndarray, "feature"], Float[np.ndarray, "feature"]]:
    """Returns the means of the features, and their standard deviations."""
    return periods.features.mean(axis=0), np.maximum(periods.features.std(axis=0), 1e-3)


def _usual(merges: int, periods: int) -> float:
    """Returns the logit of merges a step; of none, that of `RARE`."""
    return float(np.log(merges / max(periods - merges, 1))) if merges else RARE


def person_periods(
    change_time: Float[np.ndarray, "scene"], seen_for: Float[np.ndarray, "scene"], *, steps: int
) -> tuple[Bool[np.ndarray, "scene step"], Bool[np.ndarray, "scene step"]]:
    """Returns at which steps each vehicle was seen and might have merged, and at which of them it did."""
    step = np.arange(steps)
    merged = np.isfinite(change_time)
    last = np.where(merged, np.ceil(np.nan_to_num(change_time) / STEP - 1e-6) - 1, np.floor(seen_for / STEP + 1e-6) - 1)
    at_risk = (step <= last[:, None]) & ~(np.nan_to_num(change_time, nan=1.0) <= 0.0)[:, None]
    return at_risk, at_risk & merged[:, None] & (step == last[:, None])
