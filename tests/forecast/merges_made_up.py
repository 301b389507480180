"""Made-up merges: vehicles at constant speeds beside a lane of others, who merge where there is room, by chance."""

from typing import NamedTuple

import numpy as np

from rampcast.horizon import FUTURE, STEP
from rampcast.traffic.merge_scenes import BEHIND, TARGET_PLACES, MergeScenes
from rampcast.traffic.platoons import CAR, HISTORY, PLACES, Platoons, no_traffic

LENGTH = 4.6  # [m]
CHANCE = 0.06  # to merge in a step in which there is room
ROOM = 4.0  # [m] ahead and behind, net
BACK = np.arange(1 - HISTORY, 1) * STEP
AHEAD = np.arange(FUTURE + 1) * STEP


class Merges(NamedTuple):
    """Merge scenes, and what became of the central vehicles and of their leaders."""

    scenes: MergeScenes
    truth: np.ndarray
    leader_truth: np.ndarray
    change_time: np.ndarray
    seen_for: np.ndarray
    group: np.ndarray
    t0: np.ndarray


def merges(count: int, *, seed: int = 0) -> Merges:
    """Returns scenes of which each third is another vehicle's; the lane ends 80 to 250 m ahead."""
    rng = np.random.default_rng(seed)
    own_v, target_v = rng.uniform(8.0, 14.0, (2, count))
    ahead = 18.0 * np.arange(PLACES) + rng.uniform(0.0, 5.0, (count, PLACES)) + 4.0
    ahead[:, 0] = 0.0
    present = np.arange(PLACES) <= rng.integers(0, 3, count)[:, None]
    spacing = rng.uniform(12.0, 40.0, (count, TARGET_PLACES))
    target = np.cumsum(spacing, axis=1)
    target += (rng.uniform(0.0, 1.0, count) * spacing[:, BEHIND] - target[:, BEHIND])[:, None]
    seen = np.arange(TARGET_PLACES) < rng.integers(BEHIND, TARGET_PLACES + 1, count)[:, None]
    change = _changes(rng, target, seen, target_v - own_v)
    unknown = np.full(count, np.nan)
    return Merges(
        scenes=MergeScenes(
            own=_platoons(ahead, own_v, present),
            target=_platoons(target, target_v, seen),
            to_end=rng.uniform(80.0, 250.0, count),
            offset=unknown,
            approach=unknown,
        ),
        truth=own_v[:, None] * AHEAD[1:],
        leader_truth=np.where(present[:, 1, None], ahead[:, 1, None] + own_v[:, None] * AHEAD[1:], np.nan),
        change_time=change,
        seen_for=np.full(count, 15.0),
        group=np.array([f"{row % 2 + 1}-{row // 3}" for row in range(count)]),
        t0=unknown,
    )


def _changes(rng: np.random.Generator, x: np.ndarray, seen: np.ndarray, faster: np.ndarray) -> np.ndarray:
    """Returns the time of each change [s]; NaN for none within 15 s."""
    there = np.where(seen[:, :, None], x[:, :, None] + faster[:, None, None] * AHEAD[:-1], np.inf)
    blocked = (there > -LENGTH - ROOM) & (there < LENGTH + ROOM)
    merges = ~blocked.any(axis=1) & (rng.random((len(x), FUTURE)) < CHANCE)
    return np.where(merges.any(axis=1), (merges.argmax(axis=1) + 1) * STEP, np.nan)


def _platoons(now: np.ndarray, speed: np.ndarray, present: np.ndarray) -> Platoons:
    valid = np.broadcast_to(present[:, :, None], (*now.shape, HISTORY))
    v = np.broadcast_to(speed[:, None, None], valid.shape)
    x = now[:, :, None] + v * BACK
    return Platoons(
        *(np.where(valid, values, np.nan) for values in (x, v, np.zeros(valid.shape))),
        valid=valid.copy(),
        length=np.where(present, LENGTH, np.nan),
        kind=np.full(now.shape, CAR),
        traffic=no_traffic(len(now)),
    )
