"""Merge scenes driven into the future together, many times over, and who merges when and where on the way.

Every vehicle of the ramp lane and of the target lane follows whoever is ahead of it in its lane by then, with a driver
drawn from its own posterior and a residual acceleration of its own, as in `platoon_roll_out`. A vehicle on the ramp
brakes for the end of its lane, and changes lane when its hazard (`models.merging`) has added up to a threshold
drawn beforehand; never into a vehicle. From then on it has the leader that is there, and the vehicle behind follows
it. So time, place and gap of the merge and the places of all vehicles come from the same samples.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Bool, Float, Int

from rampcast.compute import jnp, over_blocks
from rampcast.forecast.merge_program import merging, waiting
from rampcast.forecast.platoon_roll_out import FAR, RollOut, drawn_drivers, numbers_of
from rampcast.horizon import FUTURE
from rampcast.models.disturbance import residual_now
from rampcast.models.drivers import posteriors
from rampcast.models.merge_features import time_with_room
from rampcast.models.merging import UNKNOWN_OFFSET, MergeHazard
from rampcast.models.platoon_head import mean_speed
from rampcast.traffic.merge_scenes import TARGET_PLACES, MergeScenes
from rampcast.traffic.platoons import PLACES, Platoons, known_lengths

DEPTHS = (2, PLACES - 1)  # numbers of vehicles ahead on the ramp that programs are compiled for
BLOCKS = (4, 16)  # rows likewise
FEW = 32  # rows up to which small blocks are faster: they keep all processor cores busy
MAY_MERGE = 3  # the central vehicle and the nearest ahead of it; those farther ahead stay on the ramp
PLACES_OF_DRAWS = PLACES + TARGET_PLACES


@dataclass(frozen=True)
class MergeRollOut:
    """All that is learned for driving a merge scene along.

    Attributes:
        roll_out: drivers, disturbance, heads and the limit, as for platoons.
        hazard: when vehicles on the ramp merge.
    """

    roll_out: RollOut
    hazard: MergeHazard


class MergeSamples(NamedTuple):
    """Sampled futures at 0.2, 0.4 ... 15 s; lengths in m, counted from the central vehicle's front at t = 0.

    Attributes:
        x: displacement of the central vehicle.
        leader_rear: rear of the vehicle that is its leader then; NaN where there is none.
        follower_front: front of the vehicle behind it in the target lane once it has merged; NaN before, or where
            there is none.
        merge_step: step at which it changes lane; `FUTURE` where it does not.
        gap: vehicles of the target lane that were ahead at t = 0 and are behind at the merge, less those the other way.
        chance: probability to change lane in each step, the mean over the samples of what their hazard gives. Its sum
            is the share that has merged, with less noise.
    """

    x: Float[np.ndarray, "scene sample step"]
    leader_rear: Float[np.ndarray, "scene sample step"]
    follower_front: Float[np.ndarray, "scene sample step"]
    merge_step: Int[np.ndarray, "scene sample"]
    gap: Int[np.ndarray, "scene sample"]
    chance: Float[np.ndarray, "scene step"]


class Waiting(NamedTuple):
    """Sampled futures in which the central vehicle does not merge.

    Attributes:
        features: of its hazard.
        can: whether it might merge: there is room, and it is where vehicles merge.
        x: its displacement [m] at the beginning of the step.
    """

    features: Float[np.ndarray, "scene sample step feature"]
    can: Bool[np.ndarray, "scene sample step"]
    x: Float[np.ndarray, "scene sample step"]


def sample_merges(
    model: MergeRollOut,
    scenes: MergeScenes,
    *,
    samples: int,
    seed: int,
    rate: Float[np.ndarray, "scene step"] | None = None,
) -> MergeSamples:
    """Returns sampled futures of the central vehicles.

    All scenes share one set of random numbers, so that a scene's forecast does not depend on its company.

    Args:
        model: see `MergeRollOut`.
        scenes: at least one; each with a lane to merge into.
        samples: how many futures of each.
        seed: of the random numbers.
        rate: by what the hazard of the central vehicle is multiplied in each step; default: 1.
    """
    rate = np.ones((len(scenes), FUTURE)) if rate is None else rate
    x, rear, front, merged, gap, chance = _driven(model, scenes, merging, rate, samples=samples, seed=seed)
    rear, front = (np.where(np.abs(place) < FAR / 2.0, place, np.nan) for place in (rear, front))
    return MergeSamples(x, rear, front, merged.astype(np.int64), gap.astype(np.int64), chance)


def waiting_features(model: MergeRollOut, scenes: MergeScenes, *, samples: int, seed: int) -> Waiting:
    """Returns what the central vehicle sees at each step of futures in which it does not merge; see `sample_merges`."""
    rate = np.ones((len(scenes), FUTURE))
    return Waiting(*_driven(model, scenes, waiting, rate, samples=samples, seed=seed))


def _driven(
    model: MergeRollOut,
    scenes: MergeScenes,
    driven: Callable[..., tuple[Array, ...]],
    rate: Float[np.ndarray, "scene step"],
    *,
    samples: int,
    seed: int,
) -> tuple[np.ndarray, ...]:
    draws, hazard = _draws(samples, seed), model.hazard
    depth = np.maximum(scenes.own.depth, 1)
    parts, order = [], []
    for low, high in zip((0, *DEPTHS), DEPTHS, strict=False):
        rows = np.flatnonzero((depth > low) & (depth <= high))
        if not len(rows):
            continue
        slots = np.concatenate([np.arange(high + 1), np.arange(PLACES, PLACES_OF_DRAWS)])
        states = _states(model.roll_out, scenes.select(rows), slots, draws.order[slots])
        program = partial(
            driven,
            jnp.asarray(draws.noise[:, slots], jnp.float32),
            jnp.asarray(draws.threshold[: min(high + 1, MAY_MERGE)], jnp.float32),
            jnp.asarray(model.roll_out.prior.drivers, jnp.float32),
            numbers_of(model.roll_out),
            jnp.asarray([*hazard.weights, hazard.constant, hazard.first, hazard.last], jnp.float32),
        )
        sizes = BLOCKS[:1] if len(rows) <= FEW else BLOCKS
        parts.append(over_blocks(program, (rate[rows].astype(np.float32), *states), sizes=sizes))
        order.append(rows)
    back = np.argsort(np.concatenate(order), kind="stable")
    return tuple(np.concatenate(values)[back] for values in zip(*parts, strict=True))


class _Draws(NamedTuple):
    """Random numbers that all scenes share."""

    noise: Float[np.ndarray, "step slot sample"]
    threshold: Float[np.ndarray, "own sample"]
    order: Int[np.ndarray, "slot sample"]


def _draws(samples: int, seed: int) -> _Draws:
    """Returns noise with mean zero over the samples, stratified thresholds (unit exponential) and orders of drivers."""
    chance = np.random.default_rng(seed)
    noise = chance.standard_normal((FUTURE, PLACES_OF_DRAWS, samples))
    share = (np.arange(samples) + 0.5) / samples
    threshold = np.stack([-np.log(chance.permutation(share)) for _ in range(PLACES)])
    order = np.stack([chance.permutation(samples) for _ in range(PLACES_OF_DRAWS)])
    return _Draws(noise - noise.mean(axis=2, keepdims=True), threshold, order)


def _states(
    model: RollOut, scenes: MergeScenes, slots: Int[np.ndarray, "slot"], order: Int[np.ndarray, "slot sample"]
) -> tuple[np.ndarray, ...]:
    """Returns what is known at t = 0 of the vehicles in the slots, and the driver of each in each sample."""
    origin = scenes.own.x[:, :1, -1]
    lanes = (scenes.own, scenes.target)
    present = np.concatenate([lane.present for lane in lanes], axis=1)[:, slots]
    x = np.concatenate([lane.x[:, :, -1] - origin for lane in lanes], axis=1)[:, slots]
    v = np.concatenate([np.maximum(lane.v[:, :, -1], 0.0) for lane in lanes], axis=1)[:, slots]
    length = np.concatenate([_lengths(lane) for lane in lanes], axis=1)[:, slots]
    weights, residual = zip(*(_drivers(model, lane) for lane in lanes), strict=True)
    around = np.concatenate([_mean_speeds(lane) for lane in lanes], axis=1)
    numbers = (
        np.where(present, x, FAR),
        np.where(present, v, 0.0),
        length,
        np.concatenate(residual, axis=1)[:, slots],
        around[:, slots],
        np.maximum(model.limit, np.where(present, v, 0.0).max(axis=1)),
        np.minimum(scenes.to_end, FAR),
        np.where(np.isfinite(scenes.offset), scenes.offset, UNKNOWN_OFFSET),
        np.where(np.isfinite(scenes.approach), scenes.approach, 0.0),
        time_with_room(scenes),
    )
    drivers = drawn_drivers(np.concatenate(weights, axis=1)[:, slots], order)
    return (*(values.astype(np.float32) for values in numbers), present, drivers)


def _lengths(lane: Platoons) -> Float[np.ndarray, "scene place"]:
    """Returns the lengths [m]; of vehicles that overlap the one behind at t = 0 (noise), no more than there is room."""
    length = known_lengths(lane)
    room = np.diff(lane.x[:, :, -1], axis=1)
    behind = np.where(np.isfinite(room), np.maximum(room, 0.0), np.inf)
    return np.column_stack([length[:, :1], np.minimum(length[:, 1:], behind)])


def _mean_speeds(lane: Platoons) -> Float[np.ndarray, "scene place"]:
    """Returns the mean speed of a lane for each of its places [m/s]; 0 where nobody is in it."""
    found, there = np.zeros(lane.present.shape), np.flatnonzero(lane.present.any(axis=1))
    if len(there):
        found[there] = mean_speed(lane.select(there))[:, None]
    return found


def _drivers(
    model: RollOut, lane: Platoons
) -> tuple[Float[np.ndarray, "scene place driver"], Float[np.ndarray, "scene place"]]:
    """Returns the weight of each driver for the vehicle in each place, and its residual acceleration at t = 0."""
    weights = posteriors(model.prior, lane)
    residual = model.disturbance.trust * residual_now(model.prior, lane, weights, followers=weights.shape[1])
    last = np.full((len(lane), 1, weights.shape[2]), 1.0 / weights.shape[2])
    return np.concatenate([weights, last], axis=1), np.column_stack([residual, np.zeros(len(lane))])
