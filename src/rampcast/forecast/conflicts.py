"""How likely a conflict is, counted in the samples of a forecast: by time to collision, braking, and encroachment.

A conflict is one of a vehicle with its leader or, once it has merged, of the vehicle behind with it. Speeds are those
between two steps.
"""

from dataclasses import dataclass
from typing import Any, no_type_check

import numba
import numpy as np
from jaxtyping import Float, Int

from rampcast.forecast.leaders import NOBODY, leaders
from rampcast.horizon import STEP
from rampcast.physics.safety import LEAST_POST_ENCROACHMENT, LEAST_TIME_TO_COLLISION, MOST_DECELERATION

SLOW = 1e-3  # [m/s]; who is slower stands
LOOK_ON = round(LEAST_POST_ENCROACHMENT / STEP) + 1  # steps after a merge within which the vehicle behind may be there


@dataclass(frozen=True)
class Conflicts:
    """Probabilities of conflicts.

    Attributes:
        time_to_collision: that it has fallen below 3 s by the end of each step.
        deceleration: that the deceleration to avoid a crash has risen above 3 m/s^2 by then.
        encroachment: that it merges within the forecast, and the post-encroachment time to the vehicle ahead or behind
            is below 2 s.
    """

    time_to_collision: Float[np.ndarray, "vehicle step"]
    deceleration: Float[np.ndarray, "vehicle step"]
    encroachment: Float[np.ndarray, "vehicle"]


def conflicts(
    samples: Float[np.ndarray, "vehicle sample step"],
    lane: Int[np.ndarray, "vehicle sample step"],
    *,
    speeds: Float[np.ndarray, "vehicle sample step"],
    length: Float[np.ndarray, "vehicle"],
    merge_step: Int[np.ndarray, "vehicle sample"],
    ahead: Int[np.ndarray, "vehicle sample"],
    behind: Int[np.ndarray, "vehicle sample"],
) -> Conflicts:
    """Returns the share of the samples in which each vehicle has a conflict.

    Args:
        samples: front positions at 0.2, 0.4 ... s [m].
        lane: numbers of the lanes then.
        speeds: over the step that ends then [m/s].
        length: of the vehicles [m].
        merge_step: step in which it merges; the number of steps where it does not.
        ahead, behind: who is there then; see `leaders.merge_gaps`.
    """
    steps = samples.shape[2]
    close, hard = (np.full(merge_step.shape, steps, dtype=np.int32) for _ in range(2))
    _fill_first_steps(samples, speeds, leaders(samples, lane), length, merge_step, (close, hard))
    encroaches = np.zeros(merge_step.shape, dtype=np.bool_)
    _fill_encroachments(samples, speeds, length, merge_step, (ahead, behind), encroaches)
    return Conflicts(shares_by(close, steps), shares_by(hard, steps), encroaches.mean(axis=1))


def shares_by(first: Int[np.ndarray, "vehicle sample"], steps: int) -> Float[np.ndarray, "vehicle step"]:
    """Returns the share of the samples in which something has happened by the end of each step.

    Args:
        first: step in which it happens; the number of steps where it does not.
        steps: their number.
    """
    vehicles, count = first.shape
    places = np.arange(vehicles)[:, None] * (steps + 1) + first
    found = np.bincount(places.ravel(), minlength=vehicles * (steps + 1)).reshape(vehicles, steps + 1)
    return np.cumsum(found, axis=1)[:, :steps] / count


@numba.njit(cache=True, nogil=True)
@no_type_check
def _fill_first_steps(samples: Any, speeds: Any, leader: Any, length: Any, merge_step: Any, found: Any) -> None:
    """Fills in the first step beyond each threshold; the laws are those of `physics.safety`, without a division."""
    close, hard = found
    vehicles, count, steps = samples.shape
    for one in range(vehicles):
        for sample in range(count):
            for step in range(steps):
                ahead = leader[one, sample, step]
                closing = speeds[one, sample, step] - speeds[ahead, sample, step]
                if ahead == NOBODY or closing <= 0.0:
                    continue
                gap = max(samples[ahead, sample, step] - length[ahead] - samples[one, sample, step], 0.0)
                merged = merge_step[ahead, sample] <= step
                if gap < LEAST_TIME_TO_COLLISION * closing:
                    close[one, sample] = min(close[one, sample], step)
                    if merged:
                        close[ahead, sample] = min(close[ahead, sample], step)
                if closing**2 > 2.0 * MOST_DECELERATION * gap:
                    hard[one, sample] = min(hard[one, sample], step)
                    if merged:
                        hard[ahead, sample] = min(hard[ahead, sample], step)


@numba.njit(cache=True, nogil=True)
@no_type_check
def _fill_encroachments(samples: Any, speeds: Any, length: Any, merge_step: Any, gap: Any, found: Any) -> None:
    vehicles, count, steps = samples.shape
    for one in range(vehicles):
        for sample in range(count):
            step, ahead, behind = merge_step[one, sample], gap[0][one, sample], gap[1][one, sample]
            if step >= steps:
                continue
            x = samples[one, sample, step]
            if ahead != NOBODY:  # since its rear was where the vehicle merges
                since = (samples[ahead, sample, step] - length[ahead] - x) / max(speeds[ahead, sample, step], SLOW)
                found[one, sample] |= since < LEAST_POST_ENCROACHMENT
            if behind != NOBODY:
                until = _arrival(samples[behind, sample], speeds[behind, sample], x - length[one], step)
                found[one, sample] |= until < LEAST_POST_ENCROACHMENT


@numba.njit(cache=True, nogil=True)
@no_type_check
def _arrival(front: Any, speed: Any, place: float, step: int) -> float:
    """Returns how long after a step a vehicle is at a place [s]; after the last step it keeps its speed."""
    for later in range(step, step + LOOK_ON + 1):
        last = min(later, len(front) - 1)
        x = front[last] + speed[last] * STEP * (later - last)
        if x >= place:
            return STEP * (later - step) - (x - place) / max(speed[last], SLOW)
    return np.inf
