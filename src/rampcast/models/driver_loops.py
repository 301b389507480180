"""The compiled loops of the drivers: a law driven behind a leader, for many vehicles and many drivers.

One definition of the IDM for all compiled loops; a test holds it equal to `physics.idm`.
"""

from typing import Any, no_type_check

import numba
import numpy as np
from jaxtyping import Float

from rampcast.horizon import STEP
from rampcast.physics.minimums import MINIMUM_GAP, MINIMUM_SPEED

FINE = 0.25  # [m/s] between the speeds of a table
SPEEDS = FINE * np.arange(241)
HARDEST = 8.0  # [m/s^2] about what a car can brake on a dry road
LEAST_FREE = 0.05  # of the free term: near the desired speed the gap that keeps a speed is infinite
NARROWEST, WIDEST = (
    0.2,
    5.0,
)  # of the law's gaps: beyond them it is no habit but an approach, or a lane change just made


@numba.njit(cache=True, nogil=True)
@no_type_check
def free(highest: float, desired: float, exponent: float, v: float) -> float:
    """Returns the acceleration of the IDM behind nobody [m/s^2]; see `physics.idm.acceleration`."""
    return highest * (1.0 - np.exp(exponent * np.log(max(v, MINIMUM_SPEED) / desired)))


def free_table(drivers: Float[np.ndarray, "driver param_and_habit"]) -> Float[np.ndarray, "driver speed"]:
    """Returns the acceleration of each driver behind nobody at speeds of 0, 0.25 ... 60 m/s [m/s^2]; see `freely`."""
    highest, desired, exponent = drivers[:, [2]], drivers[:, [4]], drivers[:, [5]]
    return highest * (1.0 - (np.maximum(SPEEDS, MINIMUM_SPEED) / desired) ** exponent)


@numba.njit(cache=True, nogil=True)
@no_type_check
def freely(table: Any, v: float) -> float:
    """Returns a driver's `free` acceleration, straight between the speeds of `free_table`: in a fifth of the time.

    It is off by less than 0.005 m/s^2 for A = 3 m/s^2, v_d = 15 m/s and delta = 8; beyond 60 m/s it goes on straight.
    """
    place = v / FINE
    left = min(int(place), len(table) - 2)
    return table[left] + (table[left + 1] - table[left]) * (place - left)


@numba.njit(cache=True, nogil=True)
@no_type_check
def law(
    standing: float, headway: float, highest: float, softness: float, freely: float, v: float, leader_v: float,
    gap: float,
) -> float:  # fmt: skip
    """Returns the IDM's acceleration [m/s^2]; see `physics.idm.acceleration`.

    Args:
        standing, headway, highest: s_0 [m], h_d [s], A [m/s^2].
        softness: 2 sqrt(A B) [m/s^2].
        freely: acceleration behind nobody; see `free`.
        v, leader_v, gap: speeds [m/s] and net gap [m].
    """
    interaction = (standing + headway * v + v * (v - leader_v) / softness) / max(gap, MINIMUM_GAP)
    return freely - highest * interaction * interaction


@numba.njit(cache=True, nogil=True)
@no_type_check
def clip(value: float, low: float, high: float) -> float:
    """Returns the number between low and high that is nearest to the value."""
    return min(max(value, low), high)


@numba.njit(cache=True, nogil=True)
@no_type_check
def own_gap(
    habit: float, standing: float, headway: float, desired: float, exponent: float, v: float, gap: float
) -> float:  # fmt: skip
    """Returns by what a driver's gaps are multiplied, who is about content with the gap of now.

    That is (gap / gap at which the law would keep the speed) ** habit: drivers differ more in the gaps that they keep
    than in anything else, and what one keeps is seen. A habit of 0 leaves the law as it is.

    Args:
        habit: from 0 to 1.
        standing, headway, desired, exponent: s_0 [m], h_d [s], v_d [m/s], delta [1].
        v, gap: speed [m/s] and net gap now [m]; infinite behind nobody.
    """
    if habit <= 0.0 or not gap < np.inf:
        return 1.0
    freely = 1.0 - np.exp(exponent * np.log(max(v, MINIMUM_SPEED) / desired))
    kept = (standing + headway * v) / np.sqrt(max(freely, LEAST_FREE))
    return clip((max(gap, MINIMUM_GAP) / kept) ** habit, NARROWEST, WIDEST)


@numba.njit(cache=True, nogil=True)
@no_type_check
def stopping(x: float, rear: float, leader_v: float) -> float:
    """Returns how far a vehicle may be in 0.2 s, to be able to stop behind a place that moves and may stop [m].

    Source: Gipps 1981, eq. 3, with one deceleration for both and no reaction time.

    Args:
        x: where it is [m].
        rear: what is to be kept free, where it will be in 0.2 s [m].
        leader_v: speed of that [m/s].
    """
    room = rear - x
    if room <= 0.0:
        return x
    lost = HARDEST * STEP  # [m/s] by which it can still brake in a step
    return min(rear, x + STEP * (np.sqrt(lost * lost / 4.0 + leader_v * leader_v + 2.0 * HARDEST * room) - lost / 2.0))


@numba.njit(cache=True, nogil=True)
@no_type_check
def able_to_stop(place: float, x: float, rear: float, leader_v: float) -> float:
    """Returns a place, or where a vehicle may be in 0.2 s if that is less; see `stopping`.

    Most vehicles are far from it, which is told without the root.
    """
    lost = HARDEST * STEP
    fast = (place - x) / STEP + lost / 2.0
    if place <= rear and fast * fast <= lost * lost / 4.0 + leader_v * leader_v + 2.0 * HARDEST * (rear - x):
        return place
    return min(place, stopping(x, rear, leader_v))


@numba.njit(cache=True, nogil=True)
@no_type_check
def likelihood(
    drivers: Any, free: Any, x: Any, v: Any, leader_x: Any, leader_v: Any, seen: Any, length: Any, size: Any, out: Any
) -> None:
    """Fills out with minus the time integral of the closed-loop errors, each over the size usual after so long a drive.

    A drive begins, and begins anew after a hole, at the first moment at which follower and leader are seen.

    Args:
        drivers: parameters of the IDM, and the habit; see `own_gap`.
        free: their accelerations behind nobody; see `free_table`.
        x, v, leader_x, leader_v, seen: of vehicles (rows) over their histories [m, m/s]; anything where not seen.
        length: of the leaders [m].
        size: usual error at the beginning [m], and what it grows by [m/s].
        out: a number for each vehicle and driver.
    """
    for row in range(x.shape[0]):
        for d in range(drivers.shape[0]):
            standing, headway, highest, braking = drivers[d, 0], drivers[d, 1], drivers[d, 2], drivers[d, 3]
            desired, exponent, softness = drivers[d, 4], drivers[d, 5], 2.0 * np.sqrt(highest * braking)
            now = leader_x[row, -1] - length[row] - x[row, -1] if seen[row, -1] else np.inf
            factor = own_gap(drivers[d, 6], standing, headway, desired, exponent, v[row, -1], now)
            standing, headway = standing * factor, headway * factor
            place = speed = driven = total = 0.0
            for k in range(x.shape[1]):
                if not seen[row, k]:
                    driven = 0.0
                    continue
                if driven > 0.0:
                    total += abs(place - x[row, k]) / (size[0] + size[1] * driven)
                else:
                    place, speed = x[row, k], v[row, k]
                gap = leader_x[row, k] - length[row] - place
                unled = freely(free[d], speed)
                a = law(standing, headway, highest, softness, unled, speed, leader_v[row, k], gap)
                speed = max(speed + clip(a, -braking, highest) * STEP, 0.0)
                place += speed * STEP
                driven += STEP
            out[row, d] = -STEP * total


@numba.njit(cache=True, nogil=True)
@no_type_check
def behind(drivers: Any, free: Any, v: Any, length: Any, leader_x: Any, leader_v: Any, out: Any) -> None:
    """Fills out with displacements [m] behind a leader's given future.

    Args:
        drivers: parameters of the IDM, and the habit; see `own_gap`.
        free: their accelerations behind nobody; see `free_table`.
        v: speeds at t = 0 [m/s].
        length: of the leaders [m].
        leader_x, leader_v: their fronts, counted from the vehicles' at t = 0, and speeds at each step [m, m/s].
        out: for each vehicle, driver and step.
    """
    for row in range(len(v)):
        for d in range(drivers.shape[0]):
            standing, headway, highest, braking = drivers[d, 0], drivers[d, 1], drivers[d, 2], drivers[d, 3]
            desired, exponent, softness = drivers[d, 4], drivers[d, 5], 2.0 * np.sqrt(highest * braking)
            factor = own_gap(
                drivers[d, 6], standing, headway, desired, exponent, v[row], leader_x[row, 0] - length[row]
            )
            standing, headway = standing * factor, headway * factor
            place, speed = 0.0, v[row]
            for k in range(leader_x.shape[1]):
                gap = leader_x[row, k] - length[row] - place
                unled = freely(free[d], speed)
                a = law(standing, headway, highest, softness, unled, speed, leader_v[row, k], gap)
                speed = max(speed + clip(a, -braking, highest) * STEP, 0.0)
                place += speed * STEP
                out[row, d, k] = place


@numba.njit(cache=True, nogil=True)
@no_type_check
def chain(driver: Any, x: Any, v: Any, length: Any, present: Any, out: Any) -> None:
    """Fills out with displacements [m] of the first of each platoon, each behind the next, the last at its speed.

    Args:
        driver: parameters of the IDM, the same for all.
        x, v, length, present: of the vehicles of each platoon (row) at t = 0 [m, m/s, m].
        out: for each platoon and step.
    """
    standing, headway, highest, braking = driver[0], driver[1], driver[2], driver[3]
    desired, exponent, softness = driver[4], driver[5], 2.0 * np.sqrt(highest * braking)
    places = x.shape[1]
    for row in range(x.shape[0]):
        place, speed = x[row].copy(), v[row].copy()
        start = place[0]
        for k in range(out.shape[1]):
            for i in range(places):  # from upstream, so that who is ahead is still where it was
                if i + 1 < places and present[row, i + 1]:
                    freely = free(highest, desired, exponent, speed[i])
                    gap = place[i + 1] - length[row, i + 1] - place[i]
                    a = law(standing, headway, highest, softness, freely, speed[i], speed[i + 1], gap)
                    speed[i] = max(speed[i] + clip(a, -braking, highest) * STEP, 0.0)
                place[i] += speed[i] * STEP
            out[row, k] = place[0] - start


@numba.njit(cache=True, nogil=True)
@no_type_check
def residuals(drivers: Any, v: Any, leader_v: Any, gap: Any, a: Any, led: Any, out: Any) -> None:
    """Fills out with the accelerations beyond the law's [m/s^2], both within the law's limits; 0 behind no leader.

    Args:
        drivers: parameters of the IDM, and the habit, of each vehicle.
        v, leader_v, gap, a: speeds [m/s], net gap [m] and acceleration [m/s^2]; anything where not `led`.
        led: whether there is a leader.
        out: a number for each vehicle.
    """
    for row in range(len(v)):
        out[row] = 0.0
        if led[row]:
            highest, braking = drivers[row, 2], drivers[row, 3]
            speed = max(v[row], 0.0)
            freely, softness = free(highest, drivers[row, 4], drivers[row, 5], speed), 2.0 * np.sqrt(highest * braking)
            standing, headway = drivers[row, 0], drivers[row, 1]
            factor = own_gap(drivers[row, 6], standing, headway, drivers[row, 4], drivers[row, 5], speed, gap[row])
            lawful = law(standing * factor, headway * factor, highest, softness, freely, speed, leader_v[row], gap[row])
            out[row] = clip(a[row], -braking, highest) - clip(lawful, -braking, highest)
