"""Metrics of forecasts of the time of a lane change as plain functions; some changes were not seen.

A case has a time: to its lane change where that was seen (`ended`), else to its last row.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from rampcast.evaluate.survival import SAME_TIME, kaplan_meier
from rampcast.horizon import FUTURE, STEP

HORIZON = FUTURE * STEP  # [s]
BINS = 10  # of the calibration error
BLOCK = 512  # cases compared with all others at a time: 20 MB


def crps_of_times(
    p_within: Float[np.ndarray, "case step"], time: Float[np.ndarray, "case"], ended: Bool[np.ndarray, "case"]
) -> Float[np.ndarray, "case"]:
    """Returns the integral of (F(t) - 1{T <= t})^2 over 0 to 15 s of each case [s]; F is linear between the steps.

    A case whose change was not seen counts as long as it was seen: integral of F^2 up to then. Source: Avati et al.
    2020, eq. 5 (survival-CRPS), cut off at 15 s.
    """
    case = np.arange(len(p_within))
    curve = np.column_stack([np.zeros(len(p_within)), p_within])
    until = np.clip(time, 0.0, HORIZON)
    step = np.minimum((until / STEP + SAME_TIME).astype(np.int64), FUTURE - 1)
    share = until / STEP - step
    low, high = curve[case, step], curve[case, step + 1]
    there = low + share * (high - low)
    squared, missing = (_squares(values[:, :-1], values[:, 1:]) * STEP for values in (curve, 1.0 - curve))
    before = np.column_stack([np.zeros(len(case)), np.cumsum(squared, axis=1)])[case, step]
    before += _squares(low, there) * share * STEP
    after = np.column_stack([np.cumsum(missing[:, ::-1], axis=1)[:, ::-1], np.zeros(len(case))])[case, step + 1]
    after += _squares(1.0 - there, 1.0 - high) * (1.0 - share) * STEP
    return before + np.where(ended & (time <= HORIZON), after, 0.0)


def concordance(
    predicted: Float[np.ndarray, "case"],
    time: Float[np.ndarray, "case"],
    ended: Bool[np.ndarray, "case"],
    group: Int[np.ndarray, "case"],
) -> tuple[Float[np.ndarray, "group group"], Float[np.ndarray, "group group"]]:
    """Returns how many pairs of cases are ordered rightly, and how many can be compared, by the groups of the two.

    A pair can be compared when the earlier of its times is that of a change. It counts one where the earlier was
    predicted earlier, a half where both were predicted alike. Changes after 15 s count as not seen by then. The sum of
    the one over that of the other is Harrell's C: 1 for the right order, 0.5 for chance. Source: Harrell et al. 1982.

    Args:
        predicted: time of the change, or anything that grows with it.
        time: see the module.
        ended: likewise.
        group: number of the vehicle of each case.
    """
    ended = ended & (time <= HORIZON + SAME_TIME)
    time = np.minimum(time, HORIZON)
    groups = int(group.max()) + 1
    right, comparable = np.zeros((groups, groups)), np.zeros((groups, groups))
    columns = np.eye(groups)[group]
    for first in range(0, len(time), BLOCK):
        rows = slice(first, first + BLOCK)
        longer = (time > time[rows, None] + SAME_TIME) | ((np.abs(time - time[rows, None]) <= SAME_TIME) & ~ended)
        pairs = longer & ended[rows, None]
        score = np.where(predicted > predicted[rows, None], 1.0, np.where(predicted == predicted[rows, None], 0.5, 0.0))
        np.add.at(right, group[rows], (pairs * score) @ columns)
        np.add.at(comparable, group[rows], pairs.astype(np.float64) @ columns)
    return right, comparable


def c_index(right: Float[np.ndarray, "group group"], comparable: Float[np.ndarray, "group group"]) -> float:
    """Returns Harrell's C of what `concordance` counted; NaN where no pair can be compared."""
    return float(right.sum() / comparable.sum()) if comparable.any() else float("nan")


def c_index_draws(
    right: Float[np.ndarray, "group group"],
    comparable: Float[np.ndarray, "group group"],
    draws: Int[np.ndarray, "draw group"],
) -> Float[np.ndarray, "drawn"]:
    """Returns Harrell's C of each draw of whole groups; see `evaluate.bootstrap`."""
    ordered, pairs = (np.einsum("dg,dg->d", draws @ counts, draws) for counts in (right, comparable))
    return ordered[pairs > 0] / pairs[pairs > 0]


def known_outcomes(
    at: float, time: Float[np.ndarray, "case"], ended: Bool[np.ndarray, "case"]
) -> tuple[Bool[np.ndarray, "case"], Float[np.ndarray, "case"]]:
    """Returns whether each case had changed lane by a time [s], and the weight with which it counts.

    A case that was lost sight of before, its change not seen, has weight 0; the others stand for these too: they are
    weighted with the inverse of the probability to be seen that long. Source: Graf et al. 1999, section 3.

    Args:
        at: the time [s].
        time: see the module.
        ended: likewise.
    """
    # who changes lane is not lost sight of at the same time: of the two the change is first
    seen = kaplan_meier(time - np.where(ended, 2.0 * SAME_TIME, 0.0), ~ended)
    changed = ended & (time <= at + SAME_TIME)
    still = time > at + SAME_TIME
    share = np.where(changed, seen.before(time), seen.at(np.full(len(time), at)))
    weight = np.where(changed | still, 1.0 / np.where(share > 0.0, share, np.inf), 0.0)
    return changed, weight


def brier_terms(
    probability: Float[np.ndarray, "case"], changed: Bool[np.ndarray, "case"], weight: Float[np.ndarray, "case"]
) -> Float[np.ndarray, "case"]:
    """Returns what each case gives to the Brier score: their mean over all cases is the score. See `known_outcomes`."""
    return weight * (probability - changed) ** 2


def calibration_error(
    probability: Float[np.ndarray, "case"], changed: Bool[np.ndarray, "case"], weight: Float[np.ndarray, "case"]
) -> float:
    """Returns how far probabilities and shares of changes are apart, on average over ten bins of equal width.

    Source: Naeini et al. 2015, eq. 2 (expected calibration error).
    """
    bins = np.minimum((probability * BINS + SAME_TIME).astype(np.int64), BINS - 1)
    said, became = (np.bincount(bins, weights=weight * values, minlength=BINS) for values in (probability, changed))
    return float(np.abs(said - became).sum() / weight.sum()) if weight.any() else float("nan")


def whole_steps(time: Float[np.ndarray, "case"]) -> Float[np.ndarray, "case"]:
    """Returns the number of steps of 0.2 s at whose end each time [s] has come; NaN stays."""
    return np.ceil(time / STEP - SAME_TIME)


def exact_outcomes(
    second: int, time: Float[np.ndarray, "case"], ended: Bool[np.ndarray, "case"]
) -> tuple[Bool[np.ndarray, "case"], Bool[np.ndarray, "case"]]:
    """Returns which cases change lane in just the step of 0.2 s that ends at that second, and which later.

    So are the sets of the paper's forests; see `rampcast.paper.lane_change.sets`. Source: method page, section 8.
    """
    step, asked = whole_steps(time), round(second / STEP)
    return ended & (step == asked), step > asked


def one_per_vehicle(mask: Bool[np.ndarray, "case"], group: Int[np.ndarray, "case"]) -> Float[np.ndarray, "case"]:
    """Returns weights by which the cases of a mask count as one per vehicle, and in all as 1: a random draw's mean."""
    count = np.bincount(group[mask], minlength=int(group.max()) + 1)
    return np.where(mask, 1.0 / np.maximum(count[group], 1) / max(int((count > 0).sum()), 1), 0.0)


def _squares(one: Float[np.ndarray, "*many"], other: Float[np.ndarray, "*many"]) -> Float[np.ndarray, "*many"]:
    """Returns the mean of the square of a line between two values."""
    return (one**2 + one * other + other**2) / 3.0
