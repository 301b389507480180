"""Who is ahead of whom in the samples of a forecast, and between whom a vehicle merges."""

from typing import Any, Final, no_type_check

import numba
import numpy as np
from jaxtyping import Bool, Float, Int

from rampcast.sites.site import NO_LANE

NOBODY: Final = -1  # in an array of places in `Forecast.vehicle`: there is no such vehicle


def leaders(
    samples: Float[np.ndarray, "vehicle sample step"], lane: Int[np.ndarray, "vehicle sample step"]
) -> Int[np.ndarray, "vehicle sample step"]:
    """Returns who is next ahead of each vehicle in its lane, in each sample at each step; `NOBODY` where nobody is.

    Of two that are abreast in one lane either may be the leader of the other. In `NO_LANE` nobody leads.

    Args:
        samples: front positions [m].
        lane: numbers of the lanes then.
    """
    found = np.full(samples.shape, NOBODY, dtype=np.int32)
    _fill_leaders(samples, lane, found)
    return found


def merge_gaps(
    samples: Float[np.ndarray, "vehicle sample step"],
    lane: Int[np.ndarray, "vehicle sample step"],
    *,
    start: Float[np.ndarray, "vehicle"],
    in_target: Bool[np.ndarray, "vehicle"],
    merge_step: Int[np.ndarray, "vehicle sample"],
) -> tuple[Int[np.ndarray, "vehicle sample"], Int[np.ndarray, "vehicle sample"], Int[np.ndarray, "vehicle sample"]]:
    """Returns who is ahead and behind in the lane that a vehicle merges into, and the number of that gap.

    The number counts the vehicles of the target lane that were ahead at t0 and are behind at the merge, less those that
    were behind and are ahead: 0 is the gap beside the vehicle at t0. `NOBODY` and 0 where it does not merge.

    Args:
        samples: front positions [m].
        lane: numbers of the lanes then.
        start: front positions at t0 [m]; abreast counts as ahead.
        in_target: who is in the target lane at t0.
        merge_step: step in which it merges; the number of steps where it does not.
    """
    ahead, behind = (np.full(merge_step.shape, NOBODY, dtype=np.int32) for _ in range(2))
    number = np.zeros(merge_step.shape, dtype=np.int32)
    _fill_gaps(samples, lane, start, in_target, merge_step, (ahead, behind, number))
    return ahead, behind, number


@numba.njit(cache=True, nogil=True)
@no_type_check
def _fill_leaders(samples: Any, lane: Any, found: Any) -> None:
    """Sorts the vehicles by lane and place; from one step to the next hardly anybody changes places."""
    vehicles, count, steps = samples.shape
    order = np.arange(vehicles)
    for sample in range(count):
        for step in range(steps):
            for here in range(1, vehicles):
                one, at = order[here], here
                own_lane, own_x = lane[one, sample, step], samples[one, sample, step]
                while at > 0:
                    before = order[at - 1]
                    lane_before = lane[before, sample, step]
                    if lane_before < own_lane or (lane_before == own_lane and samples[before, sample, step] <= own_x):
                        break
                    order[at] = before
                    at -= 1
                order[at] = one
            for here in range(1, vehicles):
                behind, ahead = order[here - 1], order[here]
                own_lane = lane[behind, sample, step]
                if own_lane != NO_LANE and own_lane == lane[ahead, sample, step]:
                    found[behind, sample, step] = ahead


@numba.njit(cache=True, nogil=True)
@no_type_check
def _fill_gaps(samples: Any, lane: Any, start: Any, in_target: Any, merge_step: Any, found: Any) -> None:
    vehicles, count, steps = samples.shape
    ahead, behind, number = found
    for one in range(vehicles):
        for sample in range(count):
            step = merge_step[one, sample]
            if step >= steps:
                continue
            x = samples[one, sample, step]
            least, most = np.inf, -np.inf
            for other in range(vehicles):
                place = samples[other, sample, step]
                if in_target[other]:
                    number[one, sample] += (start[other] >= start[one]) - (place >= x)
                if other == one or lane[other, sample, step] != lane[one, sample, step]:
                    continue
                if place >= x and place < least:
                    ahead[one, sample], least = other, place
                if place < x and place > most:
                    behind[one, sample], most = other, place
