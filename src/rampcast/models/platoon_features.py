"""What is seen of a platoon at t = 0, as a table for trees. Missing is NaN, which they split by."""

from enum import IntEnum

import numpy as np
from jaxtyping import Float, Int

from rampcast.traffic.platoons import Platoons, known_lengths

LEADERS_SEEN = 5  # whose states are features; few cases have more
FREE_SPEED = 15.0  # [m/s] mean speed of a platoon that is not in congestion; half the limit of both NGSIM sites
WAVE = 2.5  # [m/s] by which somebody ahead is slower: braking a car of 11 m/s notices, and twice the noise of a speed


class Regime(IntEnum):
    """Traffic around a vehicle."""

    FREE = 0
    CONGESTED = 1
    WAVE = 2


def features(platoons: Platoons) -> Float[np.ndarray, "platoon feature"]:
    """Returns speeds, accelerations, distances and gaps at t = 0, what tells of a wave, and the traffic around.

    Of a wave: the slowest speed, how many vehicles and how far ahead it is, vehicles per metre, the range of speeds
    over the history, and the speed's change from vehicle to vehicle. Of the traffic: how much faster it is than the
    vehicle, in any lane, behind and up to 400 m ahead, now and 3 s before.
    """
    v, a = (np.where(platoons.present, values[..., -1], np.nan) for values in (platoons.v, platoons.a))
    now = np.where(platoons.present, platoons.x[..., -1], np.nan)
    ahead = now - now[:, :1]
    gap = np.diff(now, axis=1) - known_lengths(platoons)[:, 1:]
    columns = [v[:, 0], a[:, 0], platoons.depth.astype(float), np.nanmean(v, axis=1)]
    for place in range(1, LEADERS_SEEN + 1):
        columns += [ahead[:, place], v[:, place], v[:, place] - v[:, place - 1], a[:, place], gap[:, place - 1]]
    row, slowest = np.arange(len(v)), np.nanargmin(v, axis=1)
    history = np.where(platoons.valid, platoons.v, -np.inf).max(axis=(1, 2))
    head = np.maximum(platoons.depth, 1)
    columns += [
        v[row, slowest],
        slowest.astype(float),
        ahead[row, slowest],
        platoons.depth / ahead[row, head],
        history - v[row, slowest],
        (v[row, head] - v[:, 0]) / head,
    ]
    traffic = platoons.traffic - v[:, :1, None]
    return np.column_stack([*columns, traffic.reshape(len(v), -1)])


def regimes(platoons: Platoons) -> Int[np.ndarray, "platoon"]:
    """Returns the `Regime` of each platoon."""
    v = np.where(platoons.present, platoons.v[..., -1], np.nan)
    slow = np.where(np.nanmean(v, axis=1) < FREE_SPEED, int(Regime.CONGESTED), int(Regime.FREE))
    arriving = np.nanmin(v, axis=1) < v[:, 0] - WAVE
    return np.where(arriving, int(Regime.WAVE), slow)
