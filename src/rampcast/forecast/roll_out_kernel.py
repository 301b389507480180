"""The compiled loops of the joint roll-out: every vehicle of a site driven 0.2 s at a time, sample by sample.

Who leads whom is found anew at every step, from downstream to upstream, so a vehicle that has merged is the leader of
whoever is behind it by then. Plain loops: see docs/decisions/roll_out.md for what was measured.
"""

from typing import Any, no_type_check

import numba
import numpy as np

from rampcast.forecast.roll_out_arrays import NOBODY, Draws, Law, Start
from rampcast.horizon import FUTURE, STEP
from rampcast.models.driver_loops import HARDEST as BRAKING
from rampcast.models.driver_loops import able_to_stop, clip, freely, law, own_gap
from rampcast.models.merge_loops import merge_features
from rampcast.models.merging import LANE_GOES_ON, LONGEST_READY
from rampcast.physics.minimums import MINIMUM_GAP

STOPPING = 3.4  # [m/s^2]; who would have to brake harder for the end of the lane brakes (AASHTO 2018: most drivers do)
# [m/s^2]; after a lane change both who changed and who is behind it get back their gaps with no more than this, beside
# what it takes to avoid a collision (Laval and Leclercq 2008; Duret, Ahn and Buisson 2011)
REGAINING = 0.3
RELAXED = round(10.0 / STEP)  # steps until a fresh gap is as any other
SAFE_GAP, SAFE_TIME = 2.0, 1.5  # [m], [s] of closing speed that a lane change between main lanes leaves
WANTING = round(5.0 / STEP)  # steps for which a vehicle waits for such room, and then stays
CHANCES = 2.0**40  # whole parts of a probability: their sum is the same in any order, so whatever the threads
FAST = {"contract", "arcp", "nsz"}  # what is not exact to the last bit, but keeps infinity and NaN


@numba.njit(cache=True, nogil=True, fastmath=FAST)
@no_type_check
def _see(order: Any, lane: Any, target: Any, source: Any, last: Any, leader: Any, lead: Any, lag: Any) -> None:
    """Fills in the leader of each vehicle, the next ahead beside it (in its target lane, or in the lane that merges
    into its own), and the next behind in its target lane."""
    last[:] = NOBODY
    for j in range(len(order) - 1, -1, -1):
        i = order[j]
        here = lane[i]
        leader[i] = last[here]
        beside = target[here] if target[here] != NOBODY else source[here]
        lead[i] = last[beside] if beside != NOBODY else NOBODY
        last[here] = i
    last[:] = NOBODY
    for i in order:
        here = lane[i]
        lag[i] = last[target[here]] if target[here] != NOBODY else NOBODY
        last[here] = i


@numba.njit(cache=True, nogil=True, fastmath=FAST)
@no_type_check
def sorted_by_place(order: Any, x: Any) -> bool:
    """Puts vehicles that are nearly in order from upstream to downstream; returns whether any was not."""
    new = False
    for j in range(1, len(order)):
        i, place = order[j], j
        while place > 0 and x[order[place - 1]] > x[i]:
            order[place] = order[place - 1]
            place -= 1
        if place < j:
            order[place], new = i, True
    return new


@numba.njit(cache=True, nogil=True, fastmath=FAST)
@no_type_check
def _room(i: int, x: Any, length: Any, lead: int, lag: int) -> Any:
    """Returns the net gaps ahead and behind [m]; infinite where there is nobody."""
    ahead = x[lead] - length[lead] - x[i] if lead != NOBODY else np.inf
    behind = x[i] - length[i] - x[lag] if lag != NOBODY else np.inf
    return ahead, behind


@numba.njit(cache=True, nogil=True, fastmath=FAST)
@no_type_check
def _integrated(hazard: Any, seen: Any) -> float:
    """Returns the hazard of a step, integrated: minus the logarithm of the probability not to merge in it."""
    logit = hazard[-3]
    for f in range(len(seen)):
        logit += hazard[f] * seen[f]
    return np.log1p(np.exp(min(logit, 30.0)))


@numba.njit(cache=True, nogil=True, fastmath=FAST)
@no_type_check
def _merges(
    k: int, order: Any, x: Any, v: Any, lane: Any, length: Any, offset: Any, approach: Any, ready: Any, gathered: Any,
    since: Any, leader: Any, lead: Any, lag: Any, threshold: Any, rate: Any, pace: float, may: Any, end: Any,
    begin: Any, target: Any, hazard: Any, out: Any, chance: Any, seen: Any, can_merge: Any,
) -> bool:  # fmt: skip
    """Moves who merges now, keeps what hazards saw where that is asked for; returns whether anybody merged."""
    newest = NOBODY
    for j in range(len(order) - 1, -1, -1):
        i = order[j]
        here = lane[i]
        if target[here] == NOBODY:
            continue
        ahead = lead[i]
        if newest != NOBODY and lane[newest] == target[here] and (ahead == NOBODY or x[newest] < x[ahead]):
            ahead = newest
        lead_gap, lag_gap = _room(i, x, length, ahead, lag[i])
        room = lead_gap > 0.0 and lag_gap > 0.0
        # where the gore is not known, vehicles may merge from where the first of the training vehicles did
        into = x[i] - begin[here] if begin[here] > -np.inf else hazard[-2] - min(end[here] - x[i], LANE_GOES_ON)
        can, watched, waited = room and into >= 0.0, can_merge.shape[1] > 0 and not may[i], ready[i] if room else 0.0
        ready[i] = min(waited + STEP, LONGEST_READY)
        if not (can or watched):
            continue
        lead_v, lag_v = v[ahead] if ahead != NOBODY else v[i], v[lag[i]] if lag[i] != NOBODY else v[i]
        merge_features(
            out, v[i], lead_gap, lead_v, lag_gap, lag_v, waited, into,
            end[here] - x[i] - hazard[-1], offset[i], approach[i], STEP * k,
        )  # fmt: skip
        if watched:
            seen[i, k], can_merge[i, k] = out, can
        if not can:
            continue
        adds = _integrated(hazard, out) * rate[i, k] * pace
        gathered[i], chance[i, k] = gathered[i] + adds, chance[i, k] - np.int64(CHANCES * np.expm1(-adds))
        if may[i] and gathered[i] >= threshold[i]:
            lane[i], leader[i], since[i] = target[here], ahead, 0
            if lag[i] != NOBODY:
                leader[lag[i]], since[lag[i]] = i, 0
            newest = i
    return newest != NOBODY


@numba.njit(cache=True, nogil=True, fastmath=FAST)
@no_type_check
def _changes(
    k: int, x: Any, v: Any, lane: Any, length: Any, since: Any, leader: Any, change: Any, left: Any, right: Any
) -> bool:  # fmt: skip
    """Moves those to the main lane beside theirs who want to by now (`change` is the step), and find room.

    Returns whether any did.
    """
    new = False
    for i in range(len(x)):
        if not change[i] <= k < change[i] + WANTING:
            continue
        side, other = (left, right) if int(1e4 * change[i]) % 2 else (right, left)
        to = side[lane[i]] if side[lane[i]] != NOBODY else other[lane[i]]
        if to == NOBODY or since[i] <= WANTING:
            continue
        ahead = behind = NOBODY
        for n in range(len(x)):
            if lane[n] == to and x[n] > x[i] and (ahead == NOBODY or x[n] < x[ahead]):
                ahead = n
            elif lane[n] == to and x[n] <= x[i] and (behind == NOBODY or x[n] > x[behind]):
                behind = n
        lead_gap, lag_gap = _room(i, x, length, ahead, behind)
        closing = max(v[i] - v[ahead], 0.0) if ahead != NOBODY else 0.0
        closed = max(v[behind] - v[i], 0.0) if behind != NOBODY else 0.0
        if lead_gap > SAFE_GAP + SAFE_TIME * closing and lag_gap > SAFE_GAP + SAFE_TIME * closed:
            lane[i], leader[i], since[i], new = to, ahead, 0, True
            if behind != NOBODY:
                leader[behind], since[behind] = i, 0
    return new


@numba.njit(cache=True, nogil=True, fastmath=FAST)
@no_type_check
def _braked(a: float, speed: float, left: float) -> float:
    """Returns the acceleration of a vehicle whose lane goes on for so far, which may be for ever [m/s^2]."""
    needed = min(speed * speed / (2.0 * max(left, 0.1)), BRAKING)
    return min(a, -needed) if needed > STOPPING else a


@numba.njit(cache=True, nogil=True, fastmath=FAST)
@no_type_check
def _forward(
    k: int, order: Any, x: Any, v: Any, extra: Any, lane: Any, since: Any, leader: Any, lead: Any, length: Any,
    own: Any, who: Any, free: Any, around: Any, fastest: Any, noise: Any, numbers: Any, end: Any, begin: Any,
    target: Any, moved: Any,
) -> None:  # fmt: skip
    """Drives all vehicles for 0.2 s, downstream ones first; `own`, `who`: their drivers, and their rows in `free`."""
    for j in range(len(order) - 1, -1, -1):
        i = order[j]
        ahead, beside, here, speed = leader[i], lead[i], lane[i], v[i]
        standing, headway, highest, braking, softness = own[i, 0], own[i, 1], own[i, 2], own[i, 3], own[i, 6]
        unled = freely(free[who[i]], speed)
        extra[i] = numbers[0] * extra[i] + numbers[1] * noise[i, k]
        if ahead < 0:
            a = (around[i] - speed) * numbers[2] + numbers[4] * unled + noise[i, k] * numbers[3] / STEP
        else:
            gap = x[ahead] - length[ahead] - x[i]
            a = clip(law(standing, headway, highest, softness, unled, speed, v[ahead], gap), -braking, highest)
        merging = target[here] != NOBODY
        if beside >= 0 and since[i] >= RELAXED and lane[beside] != here:
            waits = i if merging else beside  # the one that has yet to merge
            if x[waits] >= begin[lane[waits]]:
                gap_beside = x[beside] - length[beside] - x[i]
                b = law(standing, headway, highest, softness, unled, speed, v[beside], gap_beside)
                a -= (numbers[5] if merging else numbers[6]) * max(a - max(b, -braking), 0.0)
        if ahead >= 0:
            a = clip(a + extra[i], -2.0 * braking, 2.0 * highest)
            if since[i] < RELAXED:
                closing = max(speed - v[ahead], 0.0)
                a = max(a, -REGAINING - closing * closing / (2.0 * max(gap, MINIMUM_GAP)))
        if merging:
            a = _braked(a, speed, end[here] - x[i])
        place = min(x[i] + clip(speed + a * STEP, 0.0, fastest[i]) * STEP, end[here])
        if ahead >= 0:
            place = able_to_stop(place, x[i], moved[ahead] - length[ahead], (moved[ahead] - x[ahead]) / STEP)
        moved[i] = max(place, x[i])
        since[i] += 1
    for i in range(len(x)):
        v[i] = (moved[i] - x[i]) / STEP
        x[i] = moved[i]


@numba.njit(cache=True, nogil=True, fastmath=FAST)
@no_type_check
def _draw(
    start: Any, learned: Any, draws: Any, here: Any, s: int, driver: Any, own: Any, noise: Any, threshold: Any,
    change: Any, fastest: Any,
) -> None:  # fmt: skip
    """Fills in the drivers' parameters, with softness, and the random numbers of the vehicles in a sample."""
    for i in range(here.stop - here.start):
        draw, who = start.draw[here.start + i], driver[i, s]
        v, gap = start.v[here.start + i], start.gap[here.start + i]
        threshold[i] = draws.threshold[draw, s]
        change[i] = draws.change[draw, s] / max(learned.numbers[7], 1e-9) / STEP
        fastest[i] = max(learned.numbers[8], v)
        for p in range(6):
            own[i, p] = learned.drivers[who, p]
        factor = own_gap(learned.drivers[who, 6], own[i, 0], own[i, 1], own[i, 4], own[i, 5], v, gap)
        own[i, 0], own[i, 1] = own[i, 0] * factor, own[i, 1] * factor
        own[i, 6] = 2.0 * np.sqrt(own[i, 2] * own[i, 3])
        for k in range(FUTURE):
            noise[i, k] = draws.noise[draw, s, k]


@numba.njit(cache=True, nogil=True, fastmath=FAST)
@no_type_check
def _sample(
    m: int, s: int, start: Any, learned: Any, here: Any, own: Any, who: Any, noise: Any, threshold: Any, change: Any,
    fastest: Any, rates: Any, pace: float, may: Any, rows: Any, out_x: Any, out_lane: Any, chance: Any, seen: Any,
    can: Any,
) -> None:  # fmt: skip
    """Drives the vehicles of a moment in one sample; what it fills in is as for `drive`."""
    n, numbers = here.stop - here.start, learned.numbers
    order, lane, ready = start.order[here].copy(), start.lane[here].copy(), start.ready[here].copy()
    x, v, extra = start.x[here].copy(), start.v[here].copy(), start.residual[here].copy()
    length, around = start.length[here], start.around[here]
    offset, approach = start.offset[here], start.approach[here]
    end, begin, target, source = start.end[m], start.begin[m], start.target[m], start.source[m]
    leader, lead, lag, last = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n, np.int64), np.empty_like(target)
    gathered, since, moved, out = np.zeros(n), np.full(n, RELAXED), np.empty(n), np.empty(len(learned.hazard) - 3)
    new = True  # order of the vehicles, or lane of one: else everybody sees whom they saw
    for k in range(FUTURE):
        if new:
            _see(order, lane, target, source, last, leader, lead, lag)
        new = _merges(
            k, order, x, v, lane, length, offset, approach, ready, gathered, since, leader, lead, lag, threshold, rates,
            pace, may, end, begin, target, learned.hazard, out, chance, seen, can,
        )  # fmt: skip
        if numbers[7] > 0.0:
            new |= _changes(k, x, v, lane, length, since, leader, change, start.left[m], start.right[m])
        _forward(
            k, order, x, v, extra, lane, since, leader, lead, length, own, who, learned.free, around, fastest, noise,
            numbers, end, begin, target, moved,
        )  # fmt: skip
        new |= sorted_by_place(order, x)
        for i in range(n):
            if rows[i] >= 0:
                out_x[rows[i], s, k], out_lane[rows[i], s, k] = x[i], lane[i]


@numba.njit(cache=True, nogil=True, fastmath=FAST)
@no_type_check
def drive(
    start: Start, learned: Law, draws: Draws, driver: Any, rate: Any, may: Any, row: Any, moments: Any, samples: Any,
    out_x: Any, out_lane: Any, out_chance: Any, out_seen: Any, out_can: Any,
) -> None:  # fmt: skip
    """Drives the vehicles of some moments in some samples.

    Args:
        start, learned, draws: see there.
        driver: index into the drivers, of each vehicle in each sample.
        rate: by what the hazard of each vehicle is multiplied in each step.
        may: whether each vehicle may merge; who may not is looked at, if there is room for what is seen.
        row: of each vehicle in what is filled; negative where it is not wanted.
        moments, samples: first and stop of each.
        out_x, out_lane: fronts [m] and lanes, filled.
        out_chance: of a merge, by vehicle and step, in whole parts of 1/`CHANCES`, summed over the samples; filled.
        out_seen, out_can: features of the hazard, and whether it could merge; filled where they have room.
    """
    watched = out_can.shape[2]
    for m in range(moments[0], moments[1]):
        here = slice(start.first[m], start.first[m + 1])
        n, rows = here.stop - here.start, row[here]
        own, noise = np.empty((n, 7)), np.empty((n, FUTURE), np.float32)
        threshold, change, fastest = np.empty(n), np.empty(n), np.empty(n)
        seen, can = np.empty((n, watched, len(learned.hazard) - 3)), np.zeros((n, watched), np.bool_)
        for s in range(samples[0], samples[1]):
            _draw(start, learned, draws, here, s, driver[here], own, noise, threshold, change, fastest)
            _sample(
                m, s, start, learned, here, own, driver[here, s], noise, threshold, change, fastest, rate[here],
                draws.pace[s], may[here], rows, out_x, out_lane, out_chance[here], seen, can,
            )  # fmt: skip
            for i in range(n if watched else 0):
                if rows[i] >= 0:
                    out_seen[rows[i], s], out_can[rows[i], s] = seen[i], can[i]


@numba.njit(cache=True, nogil=True, fastmath=FAST)
@no_type_check
def beside_first(
    start: Start, x: Any, lanes: Any, far: float, rear: Any, front: Any, merge_step: Any, gap: Any
) -> None:
    """Fills in what is beside the first vehicle of each moment: who leads it, who is behind it once it has merged.

    Args:
        start: see there.
        x, lanes: fronts [m] and lanes, by vehicle, sample and step.
        far: what `rear` and `front` are, this much ahead or behind, where nobody is [m].
        rear, front: of its leader, and of the vehicle behind it in its target lane [m]; by moment, sample and step.
        merge_step: step in which it is in its target lane first; `FUTURE` if it is not.
        gap: vehicles of the target lane that were ahead of it at t0 and are behind it then, less those the other way.
    """
    for m in range(len(start.first) - 1):
        first, stop = start.first[m], start.first[m + 1]
        target = start.target[m, start.lane[first]]
        for s in range(x.shape[1]):
            merge_step[m, s] = FUTURE
            gap[m, s] = 0
            for k in range(FUTURE):
                own, mine = lanes[first, s, k], x[first, s, k]
                merged = own == target
                ahead, behind = far, -far
                for i in range(first + 1, stop):
                    if lanes[i, s, k] == own and x[i, s, k] > mine:
                        ahead = min(ahead, x[i, s, k] - start.length[i])
                    elif lanes[i, s, k] == own and merged:
                        behind = max(behind, x[i, s, k])
                rear[m, s, k], front[m, s, k] = ahead, behind
                if merged and merge_step[m, s] == FUTURE:
                    merge_step[m, s] = k
                    for i in range(first + 1, stop):
                        if start.lane[i] == target:
                            gap[m, s] += int(start.x[i] >= start.x[first] and x[i, s, k] <= mine)
                            gap[m, s] -= int(start.x[i] < start.x[first] and x[i, s, k] > mine)
