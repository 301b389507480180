"""What is seen of a platoon or a merge scene at t = 0, as tables for trees. Missing is NaN, which they split by."""

from enum import IntEnum

import numpy as np
from jaxtyping import Float, Int

from rampcast.horizon import STEP
from rampcast.models.merging import LONGEST_READY, LOOKAHEAD, MOVING
from rampcast.traffic.merge_scenes import BEHIND, MergeScenes
from rampcast.traffic.platoons import Platoons, known_lengths

LEADERS_SEEN = 5  # whose states are features; few cases have more
FREE_SPEED = 15.0  # [m/s] mean speed of a platoon that is not in congestion; half the limit of both NGSIM sites
WAVE = 2.5  # [m/s] by which somebody ahead is slower: braking a car of 11 m/s notices, and twice the noise of a speed
TARGET_LEADERS_SEEN = 3  # of the target lane, likewise
ALIKE = 0.05  # [m/s] between speeds: the noise of a good recording
FAR_GAP = 100.0  # [m]; a gap beyond this is as good as none behind it
SLOWEST = 20.0  # [s] to the lane line; who takes longer does not go there


class Regime(IntEnum):
    """Traffic around a vehicle."""

    FREE = 0
    CONGESTED = 1
    WAVE = 2


def platoon_table(platoons: Platoons) -> Float[np.ndarray, "platoon feature"]:
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
    # the nearest of those that are about as slow: which of several that stand is the slowest hangs on rounding errors
    row, slowest = np.arange(len(v)), np.nanargmin(np.round(v / ALIKE), axis=1)
    history = np.where(platoons.valid, platoons.v, -np.inf).max(axis=(1, 2))
    head = np.maximum(platoons.depth, 1)
    columns += [
        v[row, slowest],
        slowest.astype(float),
        ahead[row, slowest],
        platoons.depth / np.maximum(ahead[row, head], 1.0),  # [1/m]; abreast there is no density
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


def merge_columns(scenes: MergeScenes) -> Float[np.ndarray, "scene feature"]:
    """Returns what tells when and where a vehicle will merge.

    That is: its speed, its acceleration, and its leader; gaps and relative speeds in the target lane; the gap beside,
    how tight it is now and foreseen to be, and for how long it has been there; the mean speed of the lane; the end of
    the own one; and place and speed across the lane.
    """
    target, own = scenes.target, scenes.own
    v = np.where(target.present, target.v[:, :, -1], np.nan)
    speed = own.v[:, :1, -1]
    seen = slice(0, BEHIND + TARGET_LEADERS_SEEN)
    gap = target_gaps(scenes)[:, :, -1]
    relative = v - speed
    lead, lag = (np.where(np.isnan(gap[:, one]), FAR_GAP, gap[:, one]) for one in (BEHIND, BEHIND - 1))
    opening, closed = np.nan_to_num(relative[:, BEHIND]), np.nan_to_num(relative[:, BEHIND - 1])
    known = np.maximum(target.present.sum(axis=1), 1)
    mean = np.where(target.present.any(axis=1), np.nansum(relative, axis=1) / known, np.nan)
    ahead = np.where(own.present[:, 1], own.x[:, 1, -1] - own.x[:, 0, -1] - known_lengths(own)[:, 1], np.nan)
    moves = scenes.approach > MOVING
    to_line = np.minimum(np.where(moves, scenes.offset / np.where(moves, scenes.approach, 1.0), SLOWEST), SLOWEST)
    return np.column_stack(
        [
            *(speed, own.a[:, 0, -1], ahead, own.v[:, 1, -1] - speed[:, 0], own.depth),
            *(np.minimum(gap[:, seen], FAR_GAP), relative[:, seen], mean),
            *(np.minimum(lead, lag), np.minimum(lead + LOOKAHEAD * opening, lag - LOOKAHEAD * closed), lead + lag),
            *(time_with_room(scenes), np.where(np.isfinite(scenes.to_end), scenes.to_end, np.nan)),
            *(
                scenes.offset,
                scenes.approach,
                np.where(np.isnan(scenes.approach), np.nan, np.minimum(to_line, SLOWEST)),
            ),
        ]
    )


def target_gaps(scenes: MergeScenes) -> Float[np.ndarray, "scene place past"]:
    """Returns the net gaps to the vehicles of the target lane over the history [m], negative where abreast.

    Those behind at t = 0 count from the own rear to their fronts, those ahead from the own front to their rears.
    """
    target, own = scenes.target, scenes.own
    ahead = target.x - known_lengths(target)[:, :, None] - own.x[:, :1]
    behind = own.x[:, :1] - known_lengths(own)[:, :1, None] - target.x
    return np.where((np.arange(target.x.shape[1]) < BEHIND)[:, None], behind, ahead)


def time_with_room(scenes: MergeScenes) -> Float[np.ndarray, "scene"]:
    """Returns for how long there has been room for the central vehicle between the vehicles beside it at t = 0 [s]."""
    gap = target_gaps(scenes)[:, BEHIND - 1 : BEHIND + 1]
    # comparisons with NaN are false: where nobody is seen there is room
    room = scenes.own.valid[:, 0] & ~(gap <= 0.0).any(axis=1)
    steps = np.logical_and.accumulate(room[:, ::-1], axis=1).sum(axis=1)
    return np.minimum(np.maximum(steps - 1, 0) * STEP, LONGEST_READY)
