"""One IDM for all drivers: a platoon driven along as a chain, and the fit of its parameters to positions."""

from collections.abc import Callable
from functools import partial

import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float
from scipy.optimize import least_squares

from rampcast.compute import jax, jnp, over_blocks, program
from rampcast.horizon import FUTURE, STEP, WHOLE_SECONDS
from rampcast.physics import idm
from rampcast.physics.gap import net_gap
from rampcast.traffic.platoons import Platoons, known_lengths

START = (2.0, 1.2, 1.0, 2.0, 20.0, 4.0)  # about the values of Treiber, Hennecke and Helbing 2000
LEAST_CASES = 20  # a fit to fewer says more of them than of drivers: `START` is taken then
MOST_CASES = 1500  # six parameters need no more, and the time of a fit grows with them
TYPICAL_ERROR = 1.0  # [m]; beyond it a residual counts by its size, not by its square


def roll_chain(
    parameters: Float[np.ndarray, "param"], platoons: Platoons, *, leaders: int
) -> Float[np.ndarray, "platoon step"]:
    """Returns the displacement [m] of each central vehicle after each of 75 steps of 0.2 s.

    Each vehicle follows the one ahead by the IDM, with the steps of the paper's algorithm 1; the last that
    counts keeps its speed, as a vehicle without a leader does.

    Args:
        parameters: the IDM's, the same for all.
        platoons: at least one.
        leaders: how many of the vehicles ahead count.
    """
    rows = [np.ascontiguousarray(values) for values in _states_now(platoons, leaders)]
    (displacement,) = over_blocks(partial(_rolled, parameters), rows)
    return displacement


def fit_pooled_driver(
    platoons: Platoons,
    truth: Float[np.ndarray, "platoon step"],
    *,
    leader_truth: Float[np.ndarray, "platoon step"] | None = None,
    leaders: int = 1,
) -> Float[np.ndarray, "param"]:
    """Returns the parameters that bring all central vehicles nearest to where they really went.

    Args:
        platoons: of the training cases.
        truth: their displacements [m]; NaN where not seen.
        leader_truth: makes them follow their leaders' true futures, counted from the same places [m].
        leaders: how many vehicles ahead count where no true futures are given.
    """
    seen = np.isfinite(truth)
    if leader_truth is not None:
        seen &= np.logical_and.accumulate(np.isfinite(leader_truth), axis=1)
    rows = np.flatnonzero((platoons.depth > 0) & seen.any(axis=1))
    if len(rows) < LEAST_CASES:
        return np.array(START)
    rows = rows[:: -(-len(rows) // MOST_CASES)]
    states = _states_now(platoons.select(rows), leaders)
    ahead = None if leader_truth is None else true_leader(platoons.select(rows), leader_truth[rows])
    return _least_squares(partial(_displacements, states=states, ahead=ahead), truth[rows], seen[rows])


def true_leader(
    platoons: Platoons, leader_truth: Float[np.ndarray, "platoon step"]
) -> tuple[Float[np.ndarray, "platoon step"], Float[np.ndarray, "platoon step"]]:
    """Returns positions [m] and speeds [m/s] of the leaders at t = 0, 0.2 ... 14.8 s, the true ones after t = 0.

    Positions are counted from the central vehicle's at t = 0. Beyond what was seen, the last speed is kept.
    """
    now = platoons.x[:, 1, -1] - platoons.x[:, 0, -1]
    x = np.column_stack([now, leader_truth])
    v = np.diff(x, axis=1) / STEP
    last = np.maximum.accumulate(np.where(np.isfinite(v), np.arange(v.shape[1]), 0), axis=1)
    v = np.take_along_axis(v, last, axis=1)
    v = np.where(np.isfinite(v), v, platoons.v[:, 1, -1, None])
    v = np.column_stack([platoons.v[:, 1, -1], v])[:, :FUTURE]
    x = now[:, None] + np.column_stack([np.zeros(len(x)), np.cumsum(v[:, 1:] * STEP, axis=1)])
    return x, np.maximum(v, 0.0)


def _states_now(platoons: Platoons, leaders: int) -> tuple[np.ndarray, ...]:
    """Returns x, v, length and presence at t = 0 of the vehicles that count, x from the central vehicle's place."""
    some = slice(0, leaders + 1)
    present = platoons.present[:, some]
    x = np.where(present, platoons.x[:, some, -1] - platoons.x[:, :1, -1], 0.0)
    v = np.where(present, np.maximum(platoons.v[:, some, -1], 0.0), 0.0)
    return x, v, known_lengths(platoons)[:, some], present


@program
def _rolled(
    parameters: Float[ArrayLike, "param"],
    x: Float[ArrayLike, "platoon place"],
    v: Float[ArrayLike, "platoon place"],
    length: Float[ArrayLike, "platoon place"],
    present: Bool[ArrayLike, "platoon place"],
) -> tuple[Float[Array, "platoon step"]]:
    """Returns the displacement of the vehicle in place 0 after each step."""
    record = idm.Parameters(*jnp.asarray(parameters))
    lowest, highest = idm.limits(record)
    lengths = jnp.asarray(length).T[1:]
    led = jnp.asarray(present).T[1:]

    def step(state: tuple[Array, Array], _: None) -> tuple[tuple[Array, Array], Array]:
        x, v = state
        gap = net_gap(x[:-1], x[1:], lengths)
        a = idm.acceleration(record, speed=v[:-1], leader_speed=v[1:], gap=gap)
        a = jnp.where(led, jnp.clip(a, lowest, highest), 0.0)
        v = jnp.concatenate([jnp.maximum(v[:-1] + a * STEP, 0.0), v[-1:]])
        x = x + v * STEP
        return (x, v), x[0]

    start = (jnp.asarray(x, dtype=float).T, jnp.asarray(v, dtype=float).T)
    _, xs = jax.lax.scan(step, start, None, length=FUTURE)
    return (xs.T,)


@program
def _follow(
    parameters: Float[ArrayLike, "param"],
    v: Float[ArrayLike, "platoon"],
    length: Float[ArrayLike, "platoon"],
    leader_x: Float[ArrayLike, "platoon step"],
    leader_v: Float[ArrayLike, "platoon step"],
) -> tuple[Float[Array, "platoon step"]]:
    """Returns the displacement of a follower behind a given leader after each step."""
    record = idm.Parameters(*jnp.asarray(parameters))
    lowest, highest = idm.limits(record)

    def step(state: tuple[Array, Array], ahead: tuple[Array, Array]) -> tuple[tuple[Array, Array], Array]:
        x, v = state
        a = idm.acceleration(record, speed=v, leader_speed=ahead[1], gap=net_gap(x, ahead[0], length))
        v = jnp.maximum(v + jnp.clip(a, lowest, highest) * STEP, 0.0)
        x = x + v * STEP
        return (x, v), x

    speed = jnp.asarray(v, dtype=float)
    _, xs = jax.lax.scan(step, (jnp.zeros_like(speed), speed), (jnp.asarray(leader_x).T, jnp.asarray(leader_v).T))
    return (xs.T,)


def follow_true_leader(
    parameters: Float[np.ndarray, "param"], platoons: Platoons, leader_truth: Float[np.ndarray, "platoon step"]
) -> Float[np.ndarray, "platoon step"]:
    """Returns the displacement [m] of each central vehicle behind its leader's true future; NaN once that is not known.

    Args:
        parameters: the IDM's, the same for all.
        platoons: at least one.
        leader_truth: front of the leader, counted from the central vehicle's place at t = 0 [m]; NaN where not seen.
    """
    leader_x, leader_v = true_leader(platoons, leader_truth)
    _, v, length, present = _states_now(platoons, 1)
    whole = present[:, 1]
    leader_x, leader_v = np.where(whole[:, None], leader_x, 0.0), np.where(whole[:, None], leader_v, 0.0)
    rows = (v[:, 0], length[:, 1], leader_x, leader_v)
    (displacement,) = over_blocks(partial(_follow, parameters), rows)
    known = whole[:, None] & np.logical_and.accumulate(np.isfinite(leader_truth), axis=1)
    return np.where(known, displacement, np.nan)


def _displacements(
    parameters: Array,
    *,
    states: tuple[np.ndarray, ...],
    ahead: tuple[np.ndarray, np.ndarray] | None,
) -> Float[Array, "platoon step"]:
    if ahead is None:
        return _rolled(parameters, *states)[0]
    return _follow(parameters, states[1][:, 0], states[2][:, 1], *ahead)[0]


def _least_squares(
    displacements: Callable[[Array], Array],
    truth: Float[np.ndarray, "platoon step"],
    seen: Bool[np.ndarray, "platoon step"],
) -> Float[np.ndarray, "param"]:
    # at whole seconds, as the scores are
    seen, truth = seen[:, WHOLE_SECONDS], np.where(seen, truth, 0.0)[:, WHOLE_SECONDS]

    @program
    def residual(parameters: Array) -> Array:
        return jnp.where(seen, displacements(parameters)[:, WHOLE_SECONDS] - truth, 0.0).ravel()

    slope = program(jax.jacfwd(residual))
    low, high = np.array([(bound.low, bound.high) for bound in idm.NET_BOUNDS]).T
    fit = least_squares(
        lambda p: np.asarray(residual(p)),
        np.array(START),
        jac=lambda p: np.asarray(slope(p)),
        bounds=(low, high),
        x_scale=high - low,
        loss="soft_l1",
        f_scale=TYPICAL_ERROR,
        max_nfev=40,
    )
    return np.asarray(fit.x)
