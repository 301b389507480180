"""The paper's algorithm 1, for all scenes and any car-following law at once."""

from collections.abc import Callable
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
    """Neighbours of one lane as the central vehicle meets them.

    Attributes:
        x: positions of their fronts at t = 0, T, ... [m].
        v: their speeds [m/s].
        length: their lengths [m]; zero makes the gap front to front.
        present: False for virtual ones.
    """

    x: Float[np.ndarray, "scene slot step"]
    v: Float[np.ndarray, "scene slot step"]
    length: Float[np.ndarray, "scene slot"]
    present: Bool[np.ndarray, "scene slot"]


def roll_out(
    law: Law,
    parameters: Float[np.ndarray, "scene param"],
    *,
    x: Float[np.ndarray, "scene"],
    v: Float[np.ndarray, "scene"],
    ramp: Neighbours,
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
        ramp: l, f.
        target: l1, l2, f1, f2.
        ramp_end: where the ramp lane ends [m]; infinite where it goes on.
        v_max: speed limit [m/s].
        mode: which reading of the paper.
        time_step: T [s].
    """
    if len(x) == 0:
        nothing = np.empty((0, ramp.x.shape[-1] - 1))
        return Motion(nothing, nothing)
    program = partial(_algorithm_1, law, mode, ramp_end, v_max, time_step)
    return Motion(*over_blocks(program, (parameters, x, v, *ramp, *target)))


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

    A leader that the forecast has passed stays the leader: the gap is then negative, which every law takes for the
    smallest gap.

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
    program = partial(_follow, law, v_max, time_step)
    return Motion(*over_blocks(program, (parameters, x, v, leader_x, leader_v, leader_length)))


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
    ramp_x: Float[ArrayLike, "scene ramp step"],
    ramp_v: Float[ArrayLike, "scene ramp step"],
    ramp_length: Float[ArrayLike, "scene ramp"],
    ramp_present: Bool[ArrayLike, "scene ramp"],
    target_x: Float[ArrayLike, "scene target step"],
    target_v: Float[ArrayLike, "scene target step"],
    target_length: Float[ArrayLike, "scene target"],
    target_present: Bool[ArrayLike, "scene target"],
) -> tuple[Float[Array, "scene future"], Float[Array, "scene future"]]:
    """Returns positions and speeds after each step; see `roll_out`."""
    sizes = [
        (jnp.asarray(length).T, jnp.asarray(present).T)
        for length, present in ((ramp_length, ramp_present), (target_length, target_present))
    ]

    def lead(x: Array, now: tuple[Array, ...]) -> Vehicle:
        lanes = (now[:2], now[2:])
        ramp, target = (tuple(map(Vehicle, *lane, *size)) for lane, size in zip(lanes, sizes, strict=True))
        return actual_leader(x, ramp=ramp, target=target, ramp_end=ramp_end, mode=mode)

    neighbours = tuple(map(_by_step, map(jnp.asarray, (ramp_x, ramp_v, target_x, target_v))))
    return _driven(law, mode, v_max, time_step, (parameters, x, v), lead, neighbours)


@partial(program, static_argnums=0)
def _follow(
    law: Law,
    v_max: Float[ArrayLike, ""],
    time_step: Float[ArrayLike, ""],
    parameters: Float[ArrayLike, "scene param"],
    x: Float[ArrayLike, "scene"],
    v: Float[ArrayLike, "scene"],
    leader_x: Float[ArrayLike, "scene step"],
    leader_v: Float[ArrayLike, "scene step"],
    leader_length: Float[ArrayLike, "scene"],
) -> tuple[Float[Array, "scene future"], Float[Array, "scene future"]]:
    """Returns positions and speeds after each step; see `follow`."""

    def lead(_: Array, now: tuple[Array, ...]) -> Vehicle:
        leader_x, leader_v = now
        return Vehicle(leader_x, leader_v, leader_length, True)

    leaders = (_by_step(jnp.asarray(leader_x)), _by_step(jnp.asarray(leader_v)))
    return _driven(law, Mode.CORRECTED, v_max, time_step, (parameters, x, v), lead, leaders)


def _driven(
    law: Law,
    mode: Mode,
    v_max: Float[ArrayLike, ""],
    time_step: Float[ArrayLike, ""],
    start: tuple[ArrayLike, ArrayLike, ArrayLike],
    lead: Callable[[Array, tuple[Array, ...]], Vehicle],
    neighbours: tuple[Array, ...],
) -> tuple[Float[Array, "scene future"], Float[Array, "scene future"]]:
    """Returns positions and speeds after each step, behind the leader that `lead` names at each of them.

    Args:
        law, mode, v_max, time_step: see `roll_out`.
        start: parameters, positions [m] and speeds [m/s].
        lead: gives the leader, from positions and what the neighbours are at that step.
        neighbours: arrays over steps.
    """
    parameters, x, v = (jnp.asarray(values, dtype=float) for values in start)
    record = law.parameters(*parameters.T)
    lowest, highest = law.limits(record)

    def step(state: tuple[Array, Array], now: tuple[Array, ...]) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        x, v = state
        leader = lead(x, now)
        a = law.acceleration(record, speed=v, leader_speed=leader.v, gap=gap_to(x, leader, mode=mode))
        v = jnp.clip(v + jnp.clip(a, lowest, highest) * time_step, 0.0, v_max)
        x = x + v * time_step
        return (x, v), (x, v)

    _, (xs, vs) = jax.lax.scan(step, (x, v), neighbours)
    return xs.T, vs.T
