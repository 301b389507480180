"""Starting points for a fit of the IDM, from a grid that covers all six parameters at little cost.

The law falls apart into a free part F = 1 - (v / v_d)^delta and an interaction part I = (s_d / s)^2, which depends on A
and B through A B alone. Given both, a = A (F - I) has the best A in closed form, and the sums of squares of all pairs
need only products of the table of F with that of I: one matrix product per vehicle rates thousands of points.
"""

from itertools import product
from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Float

from rampcast.compute import jax, jnp
from rampcast.paper.calibration.least_squares import Vector
from rampcast.paper.calibration.states import Bounds, States
from rampcast.paper.calibration.unit_cube import to_cube
from rampcast.physics.minimums import MINIMUM_GAP, MINIMUM_SPEED

Best = tuple[Array, Array, Array]  # for each I: gain, which F, and A

# Values of the grid, denser where the fits of real drivers lie. Those beyond a range come to its end.
DESIRED_SPEEDS = (5.0, 6.0, 7.5, 9.5, 12.0, 18.0, 35.0)  # [m/s]
EXPONENTS = ((0.1, 0.4, 1.0), (2.5, 5.0, 10.0))  # [1]; each of these groups with each of softnesses gives a start
STANDING_GAPS = (0.0, 0.03, 0.08, 0.14, 0.24, 0.4, 0.64, 1.0)  # share of the range
TIME_HEADWAYS = (0.5, 0.6, 0.8, 1.2, 2.0, 4.0, 6.0)  # [s]
SOFTNESSES = ((0.5, 0.7, 1.0), (1.5, 2.2, 3.5, 5.0))  # sqrt(A B) [m/s^2]
SMALLEST_SQUARE = 1e-12  # [1]; keeps A finite where F equals I at every step


class Pair(NamedTuple):
    """Which F and which I fit each vehicle best together, and their A [m/s^2]."""

    free: Array
    interaction: Array
    acceleration: Array


def idm_starts(bounds: Bounds, states: States) -> list[Vector]:
    """Returns the best points of four parts of the grid, as points of the unit cube.

    Args:
        bounds: range of each parameter of the IDM.
        states: see `States`.
    """
    gaps = [bounds[0].low + share * (bounds[0].high - bounds[0].low) for share in STANDING_GAPS]
    starts = []
    for softnesses in SOFTNESSES:
        interactions = np.array(list(product(gaps, TIME_HEADWAYS, softnesses)))
        table = _interaction(interactions, states)
        for exponents in EXPONENTS:
            frees = np.array(list(product(DESIRED_SPEEDS, exponents)))
            pair = _best_pair(_free(frees, states), table, interactions[:, 2], bounds, states)
            desired_speed, exponent = jnp.asarray(frees)[pair.free].T
            gap, headway, softness = jnp.asarray(interactions)[pair.interaction].T
            found = [gap, headway, pair.acceleration, softness**2 / pair.acceleration, desired_speed, exponent]
            starts.append(to_cube(bounds, found))
    return starts


def _interaction(grid: np.ndarray, states: States) -> Float[Array, "vehicle past interaction"]:
    """Returns I at every point of the grid, 0 where the weight is 0; single precision is enough to choose."""
    gap, headway, softness = jnp.asarray(grid.T)
    speed, leader_speed, room = (row.T[..., None] for row in (states.speed, states.leader_speed, states.gap))
    wished = gap + headway * speed + speed * (speed - leader_speed) / (2.0 * softness)
    return ((wished / jnp.maximum(room, MINIMUM_GAP)) ** 2 * states.weight.T[..., None]).astype(jnp.float32)


def _free(grid: np.ndarray, states: States) -> Float[Array, "vehicle free past"]:
    """Returns F at every point of the grid, 0 where the weight is 0."""
    desired_speed, exponent = jnp.asarray(grid.T)[..., None]
    relative = jnp.log(jnp.maximum(states.speed.T[:, None, :], MINIMUM_SPEED) / desired_speed)
    return ((1.0 - jnp.exp(exponent * relative)) * states.weight.T[:, None, :]).astype(jnp.float32)


def _best_pair(
    free: Float[Array, "vehicle free past"],
    interaction: Float[Array, "vehicle past interaction"],
    softness: np.ndarray,
    bounds: Bounds,
    states: States,
) -> Pair:
    """Returns which F and which I together fit each vehicle best, and their A [m/s^2].

    The loop over F keeps the best F of every I, and only the last lines ask for a place among many: a maximum that
    keeps its place is twenty times as slow as the rest.
    """
    observed = (states.acceleration * states.weight).T.astype(jnp.float32)
    across = jnp.einsum("vfp,vpi->vfi", free, interaction)
    interaction_square = jnp.sum(interaction**2, axis=1)
    interaction_match = jnp.einsum("vpi,vp->vi", interaction, observed)
    lowest = np.maximum(bounds[2].low, softness**2 / bounds[3].high).astype(np.float32)
    highest = np.minimum(bounds[2].high, softness**2 / bounds[3].low).astype(np.float32)

    def better(best: Best, row: tuple[Array, ...]) -> tuple[Best, None]:
        f, square, match = row
        square = square[:, None] - 2.0 * across[:, f] + interaction_square
        match = match[:, None] - interaction_match
        a = jnp.clip(match / jnp.maximum(square, SMALLEST_SQUARE), lowest, highest)
        gain = a * (2.0 * match - a * square)
        wins = gain > best[0]
        return (jnp.where(wins, gain, best[0]), jnp.where(wins, f, best[1]), jnp.where(wins, a, best[2])), None

    nothing = jnp.zeros_like(interaction_match)
    numbers = jnp.arange(free.shape[1], dtype=jnp.int32)
    rows = (numbers, jnp.sum(free**2, axis=2).T, jnp.einsum("vfp,vp->fv", free, observed))
    start = (nothing - jnp.inf, nothing.astype(jnp.int32), nothing)
    (gain, best_free, a), _ = jax.lax.scan(better, start, rows)
    best = jnp.argmax(gain, axis=1)
    best_free, a = (jnp.take_along_axis(table, best[:, None], axis=1)[:, 0] for table in (best_free, a))
    return Pair(best_free, best, a.astype(float))
