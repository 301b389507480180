"""Samples moved to where they are calibrated, all at once, so that they stay one possible future of the whole traffic.

Each vehicle's samples are moved by a map that keeps their order (`shifts`). Moved alone they could overlap, reverse or
leave a lane that has ended, so `project` drives all vehicles of a sample again, from downstream to upstream, each as
near to its moved place as its leader, the end of its lane and what a vehicle can drive allow. A lane change waits for
room, and whoever is beside waits for it.
"""

from typing import Any, no_type_check

import numba
import numpy as np
from jaxtyping import Float
from scipy.ndimage import uniform_filter1d

from rampcast.forecast.roll_out_arrays import NOBODY
from rampcast.forecast.roll_out_kernel import FAST, sorted_by_place
from rampcast.horizon import FUTURE, STEP
from rampcast.models.correction import KNOTS, LEVELS
from rampcast.models.driver_loops import HARDEST, able_to_stop

ANCHORS = np.array([4, 24, 49, 74, 94])  # of `LEVELS`: 5, 25, 50, 75 and 95 %, between which samples move alike
MIDDLE = 2  # of these: the median
SAME = 0.02  # [m] by which samples are drawn apart that lie in one place, as those of a standing vehicle do
ROUNDING = 1e-9  # a weight below this is none
SMOOTHING = 5  # steps over which moves are averaged: what a hundred samples' quantiles jump by is no acceleration
STRONGEST = 5.0  # [m/s^2] that a car accelerates with at most


def _over_time() -> Float[np.ndarray, "step knot"]:
    """Returns how much of the move at each knot a move at each step is: straight between knots, averaged over 1 s."""
    place = np.concatenate([[-1], KNOTS])
    weight = np.stack([np.interp(np.arange(FUTURE), place, one) for one in np.eye(len(place))[1:]], axis=1)
    smooth = uniform_filter1d(weight, SMOOTHING, axis=0, mode="nearest")
    return np.where(smooth > ROUNDING, smooth, 0.0)


OVER_TIME = _over_time()
NEAR = np.argmax(OVER_TIME > ROUNDING, axis=1)  # first of the knots that count at each step
TOGETHER = int((OVER_TIME > ROUNDING).sum(axis=1).max())  # knots that count at a step: the others' weights are 0


@numba.njit(cache=True, nogil=True)
@no_type_check
def shifts(x: Any, counts: Any, wanted: Any, out: Any) -> None:
    """Fills out with what moves the samples to the wanted quantiles.

    Args:
        x: places of samples [m], by row, sample and knot.
        counts: whether a sample counts for its row's quantiles at a knot, likewise; all are moved.
        wanted: quantiles at `ANCHORS`, by row, knot and anchor [m].
        out: moves [m], likewise by row, sample and knot.
    """
    samples, anchors = x.shape[1], wanted.shape[2]
    own = np.empty(anchors)
    for row in range(x.shape[0]):
        for knot in range(x.shape[2]):
            number = 0
            sorted_ = np.empty(samples)
            for s in range(samples):
                if counts[row, s, knot]:
                    sorted_[number] = x[row, s, knot] + SAME * (s + 0.5) / samples
                    number += 1
            sorted_[:number].sort()
            for j in range(anchors):
                place = LEVELS[ANCHORS[j]] * (number + 1) - 1.0  # as `Forecast.quantiles`
                left = min(max(int(place), 0), max(number - 2, 0))
                share = min(max(place - left, 0.0), 1.0)
                own[j] = sorted_[left] * (1.0 - share) + sorted_[min(left + 1, number - 1)] * share
            for s in range(samples):
                here = x[row, s, knot] + SAME * (s + 0.5) / samples
                moved = wanted[row, knot, 0] + min(here - own[0], 0.0) + max(here - own[anchors - 1], 0.0)
                for j in range(anchors - 1):
                    width = max(own[j + 1] - own[j], SAME / samples)
                    part = min(max((here - own[j]) / width, 0.0), 1.0)
                    moved += part * (wanted[row, knot, j + 1] - wanted[row, knot, j])
                out[row, s, knot] = moved - x[row, s, knot]


@numba.njit(cache=True, nogil=True, fastmath=FAST)
@no_type_check
def _change(i: int, to: int, x: Any, lane: Any, length: Any, beside: Any) -> None:
    """Moves a vehicle to a lane if there is room; else it, and who is behind it there, yield."""
    ahead = behind = NOBODY
    for n in range(len(x)):
        if n == i or lane[n] != to:
            continue
        if x[n] > x[i] and (ahead == NOBODY or x[n] < x[ahead]):
            ahead = n
        elif x[n] <= x[i] and (behind == NOBODY or x[n] > x[behind]):
            behind = n
    room = ahead == NOBODY or x[ahead] - length[ahead] >= x[i]
    room = room and (behind == NOBODY or x[i] - length[i] >= x[behind])
    if room:
        lane[i] = to
        return
    beside[i] = ahead
    if behind != NOBODY:
        beside[behind] = i


@numba.njit(cache=True, nogil=True, fastmath=FAST)
@no_type_check
def _drive(
    order: Any, place: Any, speed: Any, wanted: Any, fastest: Any, lane: Any, length: Any, end: Any, beside: Any,
    last: Any, moved: Any,
) -> None:  # fmt: skip
    """Drives all vehicles of a moment for 0.2 s, each as near to where it is wanted as may be."""
    last[:] = NOBODY
    for j in range(len(order) - 1, -1, -1):
        i = order[j]
        slow, fast = max(speed[i] - HARDEST * STEP, 0.0), min(speed[i] + STRONGEST * STEP, fastest[i])
        at = min(max(wanted[i], place[i] + slow * STEP), place[i] + fast * STEP)
        at = able_to_stop(at, place[i], end[lane[i]], 0.0)
        for other in (last[lane[i]], beside[i]):
            if other != NOBODY:
                at = able_to_stop(at, place[i], moved[other] - length[other], (moved[other] - place[other]) / STEP)
        moved[i] = max(at, place[i])
        last[lane[i]] = i
    for i in range(len(place)):
        speed[i] = (moved[i] - place[i]) / STEP
        place[i] = moved[i]


@numba.njit(cache=True, nogil=True, fastmath=FAST)
@no_type_check
def project(
    start: Any, fastest: Any, shift: Any, over_time: Any, near: Any, moments: Any, samples: Any, x: Any, lanes: Any
) -> None:
    """Moves the samples of the vehicles of some moments, in place.

    Args:
        start: see `roll_out_kernel.Start`.
        fastest: speed that each vehicle does not exceed [m/s].
        shift: moves at the knots, by vehicle, sample and knot [m].
        over_time, near: see `OVER_TIME` and `NEAR`.
        moments, samples: first and stop of each.
        x, lanes: fronts [m] and lanes of the roll-outs, by vehicle, sample and step.
    """
    for m in range(moments[0], moments[1]):
        first, stop = start.first[m], start.first[m + 1]
        n, length, end = stop - first, start.length[first:stop], start.end[m]
        last, beside = np.empty(end.shape[0], np.int64), np.empty(n, np.int64)
        wanted, moved = np.empty(n), np.empty(n)
        for s in range(samples[0], samples[1]):
            order, lane = start.order[first:stop].copy(), start.lane[first:stop].copy()
            place, speed = start.x[first:stop].copy(), start.v[first:stop].copy()
            for k in range(FUTURE):
                beside[:] = NOBODY
                for i in order[::-1]:
                    if lanes[first + i, s, k] != lane[i]:
                        _change(i, lanes[first + i, s, k], place, lane, length, beside)
                for i in range(n):
                    wanted[i] = x[first + i, s, k]
                    for knot in range(near[k], min(near[k] + TOGETHER, over_time.shape[1])):
                        wanted[i] += over_time[k, knot] * shift[first + i, s, knot]
                _drive(order, place, speed, wanted, fastest[first:stop], lane, length, end, beside, last, moved)
                for i in range(n):
                    x[first + i, s, k], lanes[first + i, s, k] = place[i], lane[i]
                sorted_by_place(order, place)
