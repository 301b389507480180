"""The paper's algorithm 1, for all scenes and any car-following law at once."""

from functools import partial
from typing import NamedTuple

import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Shaped

from rampcast.compute import jax, jnp, over_blocks, program
from rampcast.paper.laws.laws import Law
from rampcast.paper.laws.leader import Vehicle, actual_leader, gap_to
from rampcast.paper.laws.mode import Mode


class Motion(NamedTuple):
    """Positions and speeds after each step.

    Attributes:
        x: position of the front at T, 2 T, ... [m].
        v: speed then [m/s].
    """

    x: Float[np.ndarray, "scene future"]
    v: Float[np.ndarray, "scene future"]


class Neighbours(NamedTuple):
    """Leaders as the follower meets them: one for each scene, or several in an axis of their own.

    Attributes:
        x: positions of their fronts at t = 0, T, ... [m].
        v: their speeds [m/s].
        length: their lengths [m]; zero makes the gap front to front.
        present: False for virtual ones.
    """

    x: Float[np.ndarray, "scene *slot step"]
    v: Float[np.ndarray, "scene *slot step"]
    length: Float[np.ndarray, "scene *slot"]
    present: Bool[np.ndarray, "scene *slot"]


def roll_out(
    law: Law,
    parameters: Float[np.ndarray, "scene param"],
    *,
    x: Float[np.ndarray, "scene"],
    v: Float[np.ndarray, "scene"],
    leader: Neighbours,
    target: Neighbours,
    ramp_end: float,
    v_max: float,
    mode: Mode,
    time_step: float = 0.2,
) -> Motion:
    """Returns where each central vehicle will be after each step, by following its actual leader.

    Per step: the actual leader m; a = F(v, v_m, s), clamped to the law's limits; v += a T, clamped to [0, v_max];
    x += v T. Source: the paper, algorithm 1, with -B for its B (errata 3); m and s: see `rampcast.paper.laws.leader`.

    A step takes the neighbours as they are when it starts. The step axis therefore begins with the state at t = 0, the
    last one observed, and 1 + 75 steps give a forecast of 75; the last state is not used.

    Args:
        law: which car-following law.
        parameters: of each central vehicle, in the order of `law.bounds`.
        x: position of the central vehicle's front at t = 0 [m].
        v: its speed at t = 0 [m/s].
        leader: the immediate leader.
        target: l1, l2, f1, f2.
        ramp_end: where the ramp lane ends [m]; infinite where it goes on.
        v_max: speed limit [m/s].
        mode: which reading of the paper.
        time_step: T [s].
    """
    if len(x) == 0:
        nothing = np.empty_like(leader.x[:, 1:], dtype=float)
        return Motion(nothing, nothing)
    program = partial(_algorithm_1, law, mode, ramp_end, v_max, time_step)
    return Motion(*over_blocks(program, (parameters, x, v, *leader, *target)))


def follow(
    law: Law,
    parameters: Float[np.ndarray, "scene param"],
    *,
    x: Float[np.ndarray, "scene"],
    v: Float[np.ndarray, "scene"],
    leader_x: Float[np.ndarray, "scene step"],
    leader_v: Float[np.ndarray, "scene step"],
    leader_length: Float[np.ndarray, "scene"],
    v_max: float,
    time_step: float = 0.2,
) -> Motion:
    """Returns where each vehicle will be after each step, by following one given leader: the same roll-out in one lane.

    Args:
        law: which car-following law.
        parameters: of each follower, in the order of `law.bounds`.
        x: position of the follower's front at t = 0 [m].
        v: its speed at t = 0 [m/s].
        leader_x: positions of the leader at t = 0, T, ... [m]; the step axis is as in `roll_out`.
        leader_v: its speeds [m/s].
        leader_length: its length [m]; zero makes the gap front to front.
        v_max: speed limit [m/s].
        time_step: T [s].
    """
    scenes, steps = leader_x.shape
    nobody = np.empty((scenes, 0, steps))
    return roll_out(
        law,
        parameters,
        x=x,
        v=v,
        leader=Neighbours(leader_x, leader_v, leader_length, np.ones(scenes, dtype=bool)),
        target=Neighbours(nobody, nobody, np.empty((scenes, 0)), np.empty((scenes, 0), dtype=bool)),
        ramp_end=np.inf,
        v_max=v_max,
        mode=Mode.CORRECTED,
        time_step=time_step,
    )


def _by_step(states: Shaped[Array, "scene *vehicle step"]) -> Float[Array, "step-1 *vehicle scene"]:
    """Returns the states as the loop reads them: the scene last, so that a step's values lie side by side."""
    return jnp.moveaxis(jnp.moveaxis(states, -1, 0), 1, -1)[:-1].astype(float)


@partial(program, static_argnums=(0, 1))
def _algorithm_1(
    law: Law,
    mode: Mode,
    ramp_end: Float[ArrayLike, ""],
    v_max: Float[ArrayLike, ""],
    time_step: Float[ArrayLike, ""],
    parameters: Float[ArrayLike, "scene param"],
    x: Float[ArrayLike, "scene"],
    v: Float[ArrayLike, "scene"],
    leader_x: Float[ArrayLike, "scene step"],
    leader_v: Float[ArrayLike, "scene step"],
    leader_length: Float[ArrayLike, "scene"],
    leader_present: Bool[ArrayLike, "scene"],
    target_x: Float[ArrayLike, "scene target step"],
    target_v: Float[ArrayLike, "scene target step"],
    target_length: Float[ArrayLike, "scene target"],
    target_present: Bool[ArrayLike, "scene target"],
) -> tuple[Float[Array, "scene future"], Float[Array, "scene future"]]:
    """Returns positions and speeds after each step; see `roll_out`."""
    record = law.parameters(*jnp.asarray(parameters, dtype=float).T)
    lowest, highest = law.limits(record)
    lengths, presences = jnp.asarray(target_length).T, jnp.asarray(target_present).T

    def step(state: tuple[Array, Array], now: tuple[Array, ...]) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        x, v = state
        own_x, own_v, targets_x, targets_v = now
        own = Vehicle(own_x, own_v, leader_length, leader_present)
        targets = tuple(map(Vehicle, targets_x, targets_v, lengths, presences))
        leader = actual_leader(x, leader=own, target=targets, ramp_end=ramp_end, mode=mode)
        a = law.acceleration(record, speed=v, leader_speed=leader.v, gap=gap_to(x, leader, mode=mode))
        v = jnp.clip(v + jnp.clip(a, lowest, highest) * time_step, 0.0, v_max)
        x = x + v * time_step
        return (x, v), (x, v)

    neighbours = tuple(map(_by_step, map(jnp.asarray, (leader_x, leader_v, target_x, target_v))))
    start = (jnp.asarray(x, dtype=float), jnp.asarray(v, dtype=float))
    _, (xs, vs) = jax.lax.scan(step, start, neighbours)
    return xs.T, vs.T
