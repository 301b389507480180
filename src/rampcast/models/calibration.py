"""Calibration: the parameters of a car-following law that fit each vehicle's accelerations in the history."""

from dataclasses import dataclass
from enum import IntEnum
from functools import partial

import numpy as np
from jaxtyping import Array, Bool, Float, Int

from rampcast.models.least_squares import States, Vector, search, spread_points
from rampcast.models.separable_fit import fit_separable
from rampcast.physics.engine import blocks, jax, jnp, padded
from rampcast.physics.laws import Law

STARTS = 4
BLOCK = 512  # one size only: searches that end in different minima by a rounding must not depend on the batch
FIRST_ITERATIONS, LAST_ITERATIONS = 15, 30


class Outcome(IntEnum):
    """What became of a vehicle's fit.

    CONVERGED: the parameters lie inside their ranges. AT_BOUND: at least one lies at an end of its range.
    NO_LEADER: there was no leader at any valid step. TOO_FEW_POINTS: fewer valid steps with a leader than parameters.
    The last two get the law's fallback parameters.
    """

    CONVERGED = 0
    AT_BOUND = 1
    NO_LEADER = 2
    TOO_FEW_POINTS = 3


@dataclass(frozen=True)
class Calibration:
    """Fitted parameters, one row per vehicle.

    Attributes:
        parameters: in the order of `law.bounds`.
        mse: mean squared error of the acceleration [m^2/s^4]; NaN where nothing was fitted.
        outcome: codes of `Outcome`.
    """

    parameters: Float[np.ndarray, "scene param"]
    mse: Float[np.ndarray, "scene"]
    outcome: Int[np.ndarray, "scene"]


def calibrate(
    law: Law,
    *,
    speed: Float[np.ndarray, "scene past"],
    leader_speed: Float[np.ndarray, "scene past"],
    gap: Float[np.ndarray, "scene past"],
    acceleration: Float[np.ndarray, "scene past"],
    valid: Bool[np.ndarray, "scene past"],
    starts: int = STARTS,
) -> Calibration:
    """Returns the parameters within `law.bounds` with the least mean squared error of the acceleration.

    Args:
        law: which car-following law.
        speed: v [m/s].
        leader_speed: v_m [m/s]; any number where the gap is infinite.
        gap: s [m]; infinite where there is no leader.
        acceleration: observed [m/s^2].
        valid: steps to fit; what the other arrays hold elsewhere does not matter.
        starts: number of starting points, for a law that is not linear in a parameter.
    """
    scenes = len(speed)
    parameters, mse = np.empty((scenes, len(law.bounds))), np.empty(scenes)
    rows = (speed, leader_speed, gap, acceleration, valid)
    for block in blocks(scenes, sizes=(BLOCK,)):
        fitted, error = _fit(law, starts, *(padded(row, block) for row in rows))
        keep = block.stop - block.start
        parameters[block.start : block.stop] = np.asarray(fitted)[:keep]
        mse[block.start : block.stop] = np.asarray(error)[:keep]
    low, high = np.array([(bound.low, bound.high) for bound in law.bounds]).T
    outcome = np.where(((parameters <= low) | (parameters >= high)).any(axis=1), Outcome.AT_BOUND, Outcome.CONVERGED)
    led = (valid & np.isfinite(gap)).sum(axis=1)
    outcome = np.where(led < len(law.bounds), Outcome.TOO_FEW_POINTS, outcome)
    outcome = np.where(led == 0, Outcome.NO_LEADER, outcome).astype(np.int8)
    fitted_at_all = outcome <= Outcome.AT_BOUND
    return Calibration(
        parameters=np.where(fitted_at_all[:, None], parameters, np.array(law.fallback)),
        mse=np.where(fitted_at_all, mse, np.nan),
        outcome=outcome,
    )


@partial(jax.jit, static_argnums=(0, 1))
def _fit(
    law: Law,
    starts: int,
    speed: Float[Array, "scene past"],
    leader_speed: Float[Array, "scene past"],
    gap: Float[Array, "scene past"],
    acceleration: Float[Array, "scene past"],
    valid: Bool[Array, "scene past"],
) -> tuple[Float[Array, "scene param"], Float[Array, "scene"]]:
    """Returns parameters and mean squared error."""
    rows = (jnp.asarray(row, dtype=float).T for row in (speed, leader_speed, gap, acceleration))
    kept = jnp.asarray(valid).T
    states = States(*(jnp.where(kept, row, 1.0) for row in rows), weight=kept.astype(float))
    point, cost = fit_separable(law, states) if law.factors else fit_from_starts(law, states, starts=starts)
    low, high = np.array([(bound.low, bound.high) for bound in law.bounds]).T
    parameters = jnp.clip(low + (high - low) * jnp.stack(point, axis=-1), low, high)
    return parameters, cost / jnp.maximum(kept.sum(axis=0), 1)


def fit_from_starts(law: Law, states: States, *, starts: int) -> tuple[Vector, Array]:
    """Returns the best point on the unit cube and its sum of squares, of searches from several points.

    Every start is followed for some steps, and the best of them to the end.

    Args:
        law: which car-following law.
        states: see `States`.
        starts: number of starting points.
    """
    points = jnp.asarray(spread_points(starts, len(law.bounds)))

    def follow_start(best: tuple[Vector, Array], start: Array) -> tuple[tuple[Vector, Array], None]:
        begin = [jnp.full_like(best[1], z) for z in start]
        found = search(law, begin, states, iterations=FIRST_ITERATIONS)
        better = found[1] < best[1]
        return jax.tree.map(partial(jnp.where, better), found, best), None

    nothing = jnp.zeros_like(states.speed[0])
    worst = ([nothing] * len(law.bounds), nothing + jnp.inf)
    (point, _), _ = jax.lax.scan(follow_start, worst, points)
    return search(law, point, states, iterations=LAST_ITERATIONS)
