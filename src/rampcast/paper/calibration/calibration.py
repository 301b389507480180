"""Calibration: the parameters of a car-following law that fit each vehicle's accelerations in the history."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from functools import partial

import numpy as np
from jaxtyping import Array, Bool, Float, Int

from rampcast.compute import jax, jnp, over_blocks, program
from rampcast.paper.calibration.idm_starts import idm_starts
from rampcast.paper.calibration.least_squares import Vector, search
from rampcast.paper.calibration.separable_fit import fit_separable
from rampcast.paper.calibration.states import Bounds, States, residual
from rampcast.paper.calibration.unit_cube import from_cube, spread_points
from rampcast.paper.laws.laws import Law
from rampcast.paper.laws.mode import Mode
from rampcast.physics.minimums import MINIMUM_GAP

STARTS = 4
BLOCK = 512  # one size only: searches that end in different minima by a rounding must not depend on the batch
GROUP = 32  # points rated for each start
FIRST_ITERATIONS, LAST_ITERATIONS = 20, 40
LAST_DAMPING = 1e-3
ROUNDING = 1e-9  # share of a range; on a scale and back, an end of it comes out a few roundings inside


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
        abreast: whether the actual leader was abreast at a valid step: a gap at the floor (erratum 10).
    """

    parameters: Float[np.ndarray, "scene param"]
    mse: Float[np.ndarray, "scene"]
    outcome: Int[np.ndarray, "scene"]
    abreast: Bool[np.ndarray, "scene"]


def calibrate(
    law: Law,
    *,
    speed: Float[np.ndarray, "scene past"],
    leader_speed: Float[np.ndarray, "scene past"],
    gap: Float[np.ndarray, "scene past"],
    acceleration: Float[np.ndarray, "scene past"],
    valid: Bool[np.ndarray, "scene past"],
    mode: Mode = Mode.CORRECTED,
) -> Calibration:
    """Returns the parameters within their ranges with the least mean squared error of the acceleration.

    Args:
        law: which car-following law.
        speed: v [m/s].
        leader_speed: v_m [m/s]; any number where the gap is infinite.
        gap: s [m]; infinite where there is no leader.
        acceleration: observed [m/s^2].
        valid: steps to fit; what the other arrays hold elsewhere does not matter.
        mode: whose ranges: paper mode takes those in print, corrected mode those for a net gap.
    """
    if len(speed) == 0:
        none = np.empty(0)
        return Calibration(np.empty((0, len(law.bounds))), none, none.astype(np.int8), none.astype(bool))
    rows = (speed, leader_speed, gap, acceleration, valid)
    parameters, mse = over_blocks(partial(_fit, law, mode), rows, sizes=(BLOCK,))
    low, high = np.array([(bound.low, bound.high) for bound in law.ranges(mode)]).T
    reach = ROUNDING * (high - low)
    parameters = np.where(parameters < low + reach, low, np.where(parameters > high - reach, high, parameters))
    outcome = np.where(((parameters <= low) | (parameters >= high)).any(axis=1), Outcome.AT_BOUND, Outcome.CONVERGED)
    led = (valid & np.isfinite(gap)).sum(axis=1)
    outcome = np.where(led < len(law.bounds), Outcome.TOO_FEW_POINTS, outcome)
    outcome = np.where(led == 0, Outcome.NO_LEADER, outcome).astype(np.int8)
    fitted_at_all = outcome <= Outcome.AT_BOUND
    return Calibration(
        parameters=np.where(fitted_at_all[:, None], parameters, np.array(law.fallback)),
        mse=np.where(fitted_at_all, mse, np.nan),
        outcome=outcome,
        abreast=np.asarray((valid & (gap <= MINIMUM_GAP)).any(axis=1)),
    )


@partial(program, static_argnums=(0, 1))
def _fit(
    law: Law,
    mode: Mode,
    speed: Float[Array, "scene past"],
    leader_speed: Float[Array, "scene past"],
    gap: Float[Array, "scene past"],
    acceleration: Float[Array, "scene past"],
    valid: Bool[Array, "scene past"],
) -> tuple[Float[Array, "scene param"], Float[Array, "scene"]]:
    """Returns parameters and mean squared error."""
    kept = jnp.asarray(valid).T
    leader_speed = jnp.where(jnp.isinf(gap), speed, leader_speed)  # what it holds without a leader does not matter
    rows = [jnp.where(kept, jnp.asarray(row, dtype=float).T, 1.0) for row in (speed, leader_speed, gap, acceleration)]
    states = States(rows[0], rows[1], rows[2], rows[3], weight=kept.astype(float))
    bounds = law.ranges(mode)
    parameters, cost = (fit_separable if law.factors else fit_from_starts)(law, bounds, states)
    low, high = np.array([(bound.low, bound.high) for bound in bounds]).T
    return jnp.clip(jnp.stack(parameters, axis=-1), low, high), cost / jnp.maximum(kept.sum(axis=0), 1)


def fit_from_starts(law: Law, bounds: Bounds, states: States) -> tuple[Vector, Array]:
    """Returns the best parameters and their sum of squares [m^2/s^4], of searches from several points.

    Every start is followed for some steps in single precision, at half the cost, and the best of them to the end.

    Args:
        law: which car-following law.
        bounds: range of each parameter.
        states: see `States`.
    """
    starts = jax.tree.map(
        lambda *each: jnp.stack(each), *FIRST_GUESSES.get(law.name, partial(spread_starts, law))(bounds, states)
    )

    coarse, starts = jax.tree.map(lambda values: values.astype(jnp.float32), (states, starts))

    def follow_start(best: tuple[Vector, Array], start: Vector) -> tuple[tuple[Vector, Array], None]:
        found = search(partial(residual, law, bounds, states=coarse), start, iterations=FIRST_ITERATIONS)
        return jax.tree.map(partial(jnp.where, found[1] < best[1]), found, best), None

    worst = ([jnp.zeros_like(start[0]) for start in starts], jnp.full_like(starts[0][0], jnp.inf))
    (point, _), _ = jax.lax.scan(follow_start, worst, starts)
    point = [values.astype(float) for values in point]
    error = partial(residual, law, bounds, states=states)
    point, cost = search(error, point, iterations=LAST_ITERATIONS, damping=LAST_DAMPING)
    return from_cube(bounds, point), cost


def spread_starts(law: Law, bounds: Bounds, states: States) -> list[Vector]:
    """Returns, for each of `STARTS` groups of points that fill the unit cube, the one that fits best.

    Args:
        law: which car-following law.
        bounds: range of each parameter.
        states: see `States`.
    """
    groups = jnp.asarray(spread_points(STARTS * GROUP, len(bounds)).reshape(GROUP, STARTS, -1))

    def better(best: tuple[Array, Array], points: Array) -> tuple[tuple[Array, Array], None]:
        costs = jnp.stack([jnp.sum(residual(law, bounds, list(point), states) ** 2, axis=0) for point in points])
        wins = costs < best[1]
        return (jnp.where(wins[:, None], points[..., None], best[0]), jnp.where(wins, costs, best[1])), None

    nothing = jnp.zeros((STARTS, len(bounds), states.speed.shape[1]))
    (points, _), _ = jax.lax.scan(better, (nothing, nothing[:, 0] + jnp.inf), groups)
    return [list(point) for point in points]


FIRST_GUESSES: dict[str, Callable[[Bounds, States], list[Vector]]] = {"idm": idm_starts}
