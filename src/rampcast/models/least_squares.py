"""Bounded nonlinear least squares for many vehicles at once: Levenberg-Marquardt on the unit cube.

Every quantity is a plain elementwise expression in arrays whose last axis is the vehicle: the small matrices are lists of
such arrays, so that a compiler turns a step of all vehicles into a few long loops. A call to a linear algebra library for
each vehicle's six by six system would cost more than the whole step.
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Float

from rampcast.physics.engine import jax, jnp
from rampcast.physics.laws import Law

Vector = list[Array]  # one array of vehicles per parameter
Matrix = list[list[Array]]  # its lower triangle

FIRST_DAMPING = 1e-3  # a small first damping takes nearly the Gauss-Newton step, which is good far from a bound
RAISE, LOWER = 4.0, 0.2  # factors on the damping after a step that failed, that lowered the cost
SMALLEST_DAMPING, LARGEST_DAMPING = 1e-9, 1e9
RIDGE = 1e-14  # keeps the matrix positive definite where a parameter has no effect at all
BOUND_ROUNDS = (
    2  # solutions of the damped system in a step; in each, parameters that left the cube are held at its side
)
SMALLEST_PIVOT = 1e-30


class States(NamedTuple):
    """What the law is given and what it should return; weight 0 leaves a sample out.

    Attributes:
        speed: v [m/s].
        leader_speed: v_m [m/s].
        gap: s [m].
        acceleration: observed [m/s^2].
        weight: 0 or 1.
    """

    speed: Float[Array, "past vehicle"]
    leader_speed: Float[Array, "past vehicle"]
    gap: Float[Array, "past vehicle"]
    acceleration: Float[Array, "past vehicle"]
    weight: Float[Array, "past vehicle"]


class Quadratic(NamedTuple):
    """The Gauss-Newton model of the cost around a point: cost, half its gradient, half its second derivative."""

    cost: Array
    gradient: Vector
    hessian: Matrix


class Search(NamedTuple):
    """State of the search: the best point so far, the model around it, and the damping."""

    point: Vector
    model: Quadratic
    damping: Array


def spread_points(count: int, dimensions: int) -> Float[np.ndarray, "point param"]:
    """Returns the first points of an additive recurrence that fills the unit cube evenly.

    Source: Roberts 2018, "The unreasonable effectiveness of quasirandom sequences": steps 1/phi^k with phi^(d+1) = phi + 1.

    Args:
        count: number of points.
        dimensions: d.
    """
    phi = 2.0
    for _ in range(64):
        phi = (1.0 + phi) ** (1.0 / (dimensions + 1))
    result: np.ndarray = (0.5 + np.arange(1, count + 1)[:, None] * phi ** -np.arange(1.0, dimensions + 1)) % 1.0
    return result


def solve(matrix: Matrix, right: Vector) -> Vector:
    """Returns d with matrix d = right, by Cholesky's method written out.

    Args:
        matrix: lower triangles of positive definite matrices.
        right: right sides.
    """
    size = len(right)
    lower: Matrix = []
    inverse: Vector = []
    for i in range(size):
        row: Vector = []
        for j in range(i):
            row.append((matrix[i][j] - sum(row[k] * lower[j][k] for k in range(j))) * inverse[j])
        lower.append(row)
        inverse.append(jax.lax.rsqrt(jnp.maximum(matrix[i][i] - sum(x * x for x in row), SMALLEST_PIVOT)))
    half: Vector = []
    for i in range(size):
        half.append((right[i] - sum(lower[i][k] * half[k] for k in range(i))) * inverse[i])
    result: Vector = [half[0]] * size
    for i in reversed(range(size)):
        result[i] = (half[i] - sum(lower[k][i] * result[k] for k in range(i + 1, size))) * inverse[i]
    return result


def residual(law: Law, point: Sequence[Array], states: States) -> Float[Array, "past vehicle"]:
    """Returns forecast minus observed acceleration [m/s^2], 0 where the weight is 0.

    Args:
        law: which car-following law.
        point: parameters on the unit cube.
        states: see `States`.
    """
    parameters = (bound.low + (bound.high - bound.low) * value for bound, value in zip(law.bounds, point, strict=True))
    law_says = law.acceleration(
        law.parameters(*parameters), speed=states.speed, leader_speed=states.leader_speed, gap=states.gap
    )
    return (law_says - states.acceleration) * states.weight


def quadratic(law: Law, point: Vector, states: States) -> Quadratic:
    """Returns the Gauss-Newton model of the sum of squares at `point`.

    Each column of the Jacobian is a forward derivative by one parameter alone: what does not depend on it is not computed.

    Args:
        law: which car-following law.
        point: parameters on the unit cube.
        states: see `States`.
    """
    columns = []
    for k, value in enumerate(point):

        def along(moved: Array, k: int = k) -> Array:
            return residual(law, [*point[:k], moved, *point[k + 1 :]], states)

        error, column = jax.jvp(along, (value,), (jnp.ones_like(value),))
        columns.append(column)
    columns, error = jax.lax.optimization_barrier((columns, error))  # else each product below computes them again
    return Quadratic(
        cost=jnp.sum(error * error, axis=0),
        gradient=[jnp.sum(column * error, axis=0) for column in columns],
        hessian=[[jnp.sum(columns[i] * columns[j], axis=0) for j in range(i + 1)] for i in range(len(columns))],
    )


def _bounded_step(point: Vector, model: Quadratic, damping: Array) -> Vector:
    """Returns the point that the damped model prefers on the cube, holding parameters at the sides they run into."""
    size = len(point)
    matrix = [list(row) for row in model.hessian]
    for i in range(size):
        matrix[i][i] = matrix[i][i] * (1.0 + damping) + RIDGE
    held = [
        ((z <= 0.0) & (slope > 0.0)) | ((z >= 1.0) & (slope < 0.0))
        for z, slope in zip(point, model.gradient, strict=True)
    ]
    def round_of(_: Array | int, now: tuple[Vector, Vector]) -> tuple[Vector, Vector]:
        held, step = now
        pinned = [jnp.where(h, d, 0.0) for h, d in zip(held, step, strict=True)]
        right = [
            jnp.where(
                held[i],
                pinned[i],
                -model.gradient[i] - sum(matrix[max(i, k)][min(i, k)] * pinned[k] for k in range(size) if k != i),
            )
            for i in range(size)
        ]
        free = [[jnp.where(held[i] | held[j], float(i == j), matrix[i][j]) for j in range(i + 1)] for i in range(size)]
        step = solve(free, right)
        held = [h | (z + d < 0.0) | (z + d > 1.0) for h, z, d in zip(held, point, step, strict=True)]
        return held, [jnp.clip(z + d, 0.0, 1.0) - z for z, d in zip(point, step, strict=True)]

    _, step = jax.lax.fori_loop(0, BOUND_ROUNDS, round_of, (held, [jnp.zeros_like(z) for z in point]))
    return [jnp.clip(z + d, 0.0, 1.0) for z, d in zip(point, step, strict=True)]


def search(law: Law, start: Vector, states: States, *, iterations: int) -> tuple[Vector, Array]:
    """Returns the point reached from `start` and its sum of squares [m^2/s^4].

    Args:
        law: which car-following law.
        start: parameters on the unit cube.
        states: see `States`.
        iterations: number of evaluations.
    """

    def improve(_: Array | int, now: Search) -> Search:
        point = jax.lax.optimization_barrier(_bounded_step(now.point, now.model, now.damping))
        model = quadratic(law, point, states)
        better = model.cost < now.model.cost
        point, model = jax.tree.map(partial(jnp.where, better), (point, model), (now.point, now.model))
        damping = jnp.clip(now.damping * jnp.where(better, LOWER, RAISE), SMALLEST_DAMPING, LARGEST_DAMPING)
        return Search(point, model, damping)

    first = quadratic(law, start, states)
    begin = Search(start, first, jnp.full_like(first.cost, FIRST_DAMPING))
    end = jax.lax.fori_loop(0, iterations, improve, begin)
    return end.point, end.model.cost
