"""How likely a conflict is, counted in the samples of a forecast: by time to collision, braking, and encroachment.

A conflict is one of the central vehicle with its leader or, once it has merged, of the vehicle behind with it. Speeds
are those between two steps. A front or rear that goes back is another vehicle's, for nobody reverses; its speed is then
that of the step after.
"""

from dataclasses import dataclass

import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from rampcast.compute import jax, jnp, over_blocks, program
from rampcast.horizon import STEP
from rampcast.physics.safety import (
    LEAST_POST_ENCROACHMENT,
    LEAST_TIME_TO_COLLISION,
    MOST_DECELERATION,
    deceleration_to_avoid_crash,
    post_encroachment_time,
    time_to_collision,
)

BLOCKS = (8, 64)  # rows that programs are compiled for: 64 x 100 samples x 75 steps are a few MB an array
SLOW = 1e-3  # [m/s]; who is slower stands
LOOK_ON = round(LEAST_POST_ENCROACHMENT / STEP) + 1  # steps after the last in which a follower goes on at its speed


@dataclass(frozen=True)
class Conflicts:
    """Probabilities of conflicts.

    Attributes:
        time_to_collision: that it has fallen below 3 s by the end of each step.
        deceleration: that the deceleration to avoid a crash has risen above 3 m/s^2 by then.
        encroachment: that it merges within the forecast, and the post-encroachment time to the vehicle ahead or behind
            is below 2 s.
    """

    time_to_collision: Float[np.ndarray, "scene step"]
    deceleration: Float[np.ndarray, "scene step"]
    encroachment: Float[np.ndarray, "scene"]


def conflicts(
    x: Float[np.ndarray, "scene sample step"],
    *,
    leader_rear: Float[np.ndarray, "scene sample step"],
    follower_front: Float[np.ndarray, "scene sample step"],
    length: Float[np.ndarray, "scene"],
    merge_step: Int[np.ndarray, "scene sample"],
) -> Conflicts:
    """Returns the share of the samples in which there is a conflict.

    Args:
        x: displacement of the central vehicle at 0.2, 0.4 ... s [m].
        leader_rear: rear of its leader then, from the same origin [m]; NaN where there is none.
        follower_front: front of the vehicle behind it in the target lane once it has merged [m]; NaN before, or where
            there is none.
        length: of the central vehicle [m].
        merge_step: step in which it merges; the number of steps where it does not.
    """
    rows = (x, leader_rear, follower_front, length, merge_step)
    if not len(x):
        return Conflicts(np.zeros((0, x.shape[2])), np.zeros((0, x.shape[2])), np.zeros(0))
    return Conflicts(*over_blocks(_shares, rows, sizes=BLOCKS))


@program
def _shares(
    x: Float[ArrayLike, "row sample step"],
    rear: Float[ArrayLike, "row sample step"],
    front: Float[ArrayLike, "row sample step"],
    length: Float[ArrayLike, "row"],
    merge_step: Int[ArrayLike, "row sample"],
) -> tuple[Float[Array, "row step"], Float[Array, "row step"], Float[Array, "row"]]:
    x, rear, front = jnp.asarray(x), jnp.asarray(rear), jnp.asarray(front)
    merge_step = jnp.asarray(merge_step)
    own_rear = x - jnp.asarray(length, x.dtype)[:, None, None]
    changed = jnp.arange(x.shape[2]) == merge_step[:, :, None]  # the leader is another from this step on
    speed = jnp.diff(x, axis=2, prepend=jnp.zeros_like(x[..., :1])) / STEP
    leader, follower = (_speeds_of_others(place, changed, speed[..., -1:]) for place in (rear, front))
    led, followed = ~jnp.isnan(rear), ~jnp.isnan(front)
    near, hard = _beyond(rear - x, speed, leader, led)
    near_behind, hard_behind = _beyond(own_rear - front, follower, speed, followed)
    merged = merge_step < x.shape[2]
    at = jnp.minimum(merge_step, x.shape[2] - 1)[:, :, None]
    ahead = jnp.where(led, (rear - x) / jnp.maximum(leader, SLOW), jnp.inf)  # since it was where the vehicle merges
    behind = _arrival(front, follower, followed, jnp.take_along_axis(own_rear, at, axis=2), at[..., 0])
    least = jnp.minimum(jnp.take_along_axis(ahead, at, axis=2)[..., 0], behind)
    encroaches = merged & (least < LEAST_POST_ENCROACHMENT)
    return _by_then(near | near_behind), _by_then(hard | hard_behind), encroaches.mean(axis=1)


def _speeds_of_others(
    place: Float[Array, "row sample step"], changed: Bool[Array, "row sample step"], own: Float[Array, "row sample 1"]
) -> Float[Array, "row sample step"]:
    """Returns the speed of whoever is there at each step; of one who comes in the last step, the own one."""
    speed = jnp.diff(place, axis=2) / STEP
    before = jnp.concatenate([speed[..., :1], speed], axis=2)  # of the place at t = 0 nothing is known
    after = jnp.concatenate([speed, own], axis=2)
    return jnp.maximum(jnp.where(changed | ~(before >= 0.0), after, before), 0.0)


def _beyond(
    gap: Float[Array, "row sample step"],
    speed: Float[Array, "row sample step"],
    leader_speed: Float[Array, "row sample step"],
    there: Bool[Array, "row sample step"],
) -> tuple[Bool[Array, "row sample step"], Bool[Array, "row sample step"]]:
    """Returns whether time to collision and deceleration to avoid a crash are beyond their thresholds."""
    time = time_to_collision(gap, speed=speed, leader_speed=leader_speed)
    needed = deceleration_to_avoid_crash(gap, speed=speed, leader_speed=leader_speed)
    return there & (time < LEAST_TIME_TO_COLLISION), there & (needed > MOST_DECELERATION)


def _arrival(
    front: Float[Array, "row sample step"],
    speed: Float[Array, "row sample step"],
    there: Bool[Array, "row sample step"],
    place: Float[Array, "row sample 1"],
    step: Int[Array, "row sample"],
) -> Float[Array, "row sample"]:
    """Returns how long after a step the follower is at a place [s]; after the last step it keeps its speed."""
    fronts = jnp.concatenate([front, front[..., -1:] + speed[..., -1:] * STEP * jnp.arange(1, LOOK_ON + 1)], axis=2)
    there, speed = (jnp.concatenate([part, jnp.repeat(part[..., -1:], LOOK_ON, axis=2)], axis=2)
                    for part in (there, speed))  # fmt: skip
    reached = there & (fronts >= place) & (jnp.arange(fronts.shape[2]) >= step[..., None])
    first = jnp.argmax(reached, axis=2)[..., None]
    beyond = jnp.take_along_axis((fronts - place) / jnp.maximum(speed, SLOW), first, axis=2)  # [s]
    arrived = jnp.where(reached.any(axis=2), (STEP * first - beyond)[..., 0], jnp.inf)
    return post_encroachment_time(STEP * step, arrived)


def _by_then(conflict: Bool[Array, "row sample step"]) -> Float[Array, "row step"]:
    return jax.lax.cummax(conflict.astype(jnp.float32), axis=2).mean(axis=1)
