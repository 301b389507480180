"""Bounded nonlinear least squares for many vehicles at once: Levenberg-Marquardt on the unit cube.

Every quantity is a plain elementwise expression in arrays whose last axis is the vehicle: the small matrices are lists
of such arrays, so that a compiler turns a step of all vehicles into a few long loops. Calling a linear algebra library
for each vehicle's six by six system would cost more than the whole step.
"""

from collections.abc import Callable
from functools import partial, reduce
from typing import NamedTuple

from jaxtyping import Array, Float

from rampcast.compute import jax, jnp

Vector = list[Array]  # one array over vehicles for each parameter
Matrix = list[list[Array]]  # lower triangles, row by row
Residual = Callable[[Vector], Float[Array, "sample vehicle"]]

FIRST_DAMPING = 1e-2
RAISE, LOWER = 3.0, 0.33  # factors on the damping after a step that failed, that lowered the cost
SMALLEST_DAMPING, LARGEST_DAMPING = 1e-12, 1e9
DAMPED_SHARE = 1e-3  # a parameter of little effect is damped as if it had this share of the effect of the strongest
RIDGE = 1e-14  # keeps the matrix positive definite where no parameter has any effect
LONGEST_STEP = 0.5  # of the cube's side; longer ones run into corners where a parameter has no effect, and stay there
LONGEST_BEND = 2.0  # largest curvature correction, as a share of the step; Transtrum & Sethna 2012 take 0.75 to 2
BOUND_ROUNDS = (
    2  # solutions of the damped system in a step; in each, parameters that left their box are held at its side
)
SMALLEST_PIVOT = 1e-30


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


def quadratic(residual: Residual, point: Vector) -> Quadratic:
    """Returns the Gauss-Newton model of the sum of squares at `point`.

    Each column of the Jacobian is a forward derivative by one parameter, so what does not depend on it costs nothing.

    Args:
        residual: gives the errors of every sample at a point.
        point: parameters on the unit cube.
    """
    columns = []
    for k, value in enumerate(point):

        def along(moved: Array, k: int = k) -> Array:
            return residual([*point[:k], moved, *point[k + 1 :]])

        error, column = jax.jvp(along, (value,), (jnp.ones_like(value),))
        columns.append(column)
    return Quadratic(
        cost=jnp.sum(error * error, axis=0),
        gradient=[jnp.sum(column * error, axis=0) for column in columns],
        hessian=[[jnp.sum(columns[i] * columns[j], axis=0) for j in range(i + 1)] for i in range(len(columns))],
    )


def _damped(hessian: Matrix, damping: Array) -> Matrix:
    """Returns the matrix with its diagonal raised, by at least a share of the largest entry for every parameter."""
    diagonal = [row[-1] for row in hessian]
    largest = reduce(jnp.maximum, diagonal)
    raised = [d + damping * jnp.maximum(d, DAMPED_SHARE * largest) + RIDGE for d in diagonal]
    return [[*row[:-1], value] for row, value in zip(hessian, raised, strict=True)]


def _free(matrix: Matrix, held: Vector) -> Matrix:
    """Returns the matrix with the rows and columns of held parameters replaced by those of the identity."""
    return [[jnp.where(held[i] | held[j], float(i == j), matrix[i][j]) for j in range(i + 1)] for i in range(len(held))]


def _boxed_step(point: Vector, model: Quadratic, damping: Array) -> tuple[Vector, Vector]:
    """Returns the step that the damped model prefers in the cube and `LONGEST_STEP`, and which parameters are held."""
    size = len(point)
    matrix = _damped(model.hessian, damping)
    lowest = [jnp.maximum(-z, -LONGEST_STEP) for z in point]
    highest = [jnp.minimum(1.0 - z, LONGEST_STEP) for z in point]
    held = [
        ((z <= 0.0) & (slope > 0.0)) | ((z >= 1.0) & (slope < 0.0))
        for z, slope in zip(point, model.gradient, strict=True)
    ]

    def improve(_: Array, now: tuple[Vector, Vector]) -> tuple[Vector, Vector]:
        step, held = now
        pinned = [jnp.where(h, d, 0.0) for h, d in zip(held, step, strict=True)]
        pull = [sum(matrix[max(i, k)][min(i, k)] * pinned[k] for k in range(size) if k != i) for i in range(size)]
        right = [jnp.where(held[i], pinned[i], -model.gradient[i] - pull[i]) for i in range(size)]
        wished = solve(_free(matrix, held), right)
        step = [jnp.clip(d, low, high) for d, low, high in zip(wished, lowest, highest, strict=True)]
        return step, [h | (d != wish) for h, d, wish in zip(held, step, wished, strict=True)]

    # A loop, not a list of statements, because the compiler would fold those into each of their many users.
    return jax.lax.fori_loop(0, BOUND_ROUNDS, improve, ([jnp.zeros_like(z) for z in point], held))


def _bend(residual: Residual, now: Search, step: Vector, held: Vector) -> Vector:
    """Returns the correction of a step for the curvature of the residual along it: geodesic acceleration.

    a = -1/2 (J'J + damping)^-1 J' r'', r'' the second derivative of the residual along the step. It lets the search run
    along the curved valleys of six parameters that twenty points cannot tell apart.
    Source: Transtrum and Sethna 2012, arXiv 1201.5885, eq. 13.
    """

    def along(share: Array) -> Array:
        return residual([z + share * d for z, d in zip(now.point, step, strict=True)])

    def slope(share: Array) -> Array:
        return jax.jvp(along, (share,), (jnp.ones_like(share),))[1]

    start = jnp.zeros_like(now.damping)
    curvature = jax.jvp(slope, (start,), (jnp.ones_like(start),))[1]
    _, transposed = jax.vjp(residual, now.point)
    (right,) = transposed(curvature)
    right = [jnp.where(h, 0.0, -0.5 * value) for h, value in zip(held, right, strict=True)]

    def correct(right: Vector) -> Vector:
        bend = solve(_free(_damped(now.model.hessian, now.damping), held), right)
        small = 4.0 * sum(a * a for a in bend) <= (LONGEST_BEND**2) * sum(d * d for d in step)
        return [jnp.where(small, a, 0.0) for a in bend]

    # A branch, for the same reason as the loop above: what it returns is stored, not computed again by each user.
    usable = jnp.any(jnp.isfinite(now.model.cost))
    return jax.lax.cond(usable, correct, lambda right: [jnp.zeros_like(value) for value in right], right)


def search(
    residual: Residual, start: Vector, *, iterations: int, damping: float = FIRST_DAMPING
) -> tuple[Vector, Array]:
    """Returns the point reached from `start` and its sum of squares [m^2/s^4].

    Args:
        residual: gives the errors of every sample at a point.
        start: parameters on the unit cube.
        iterations: number of steps tried.
        damping: of the first step.
    """

    def improve(_: Array, now: Search) -> Search:
        step, held = _boxed_step(now.point, now.model, now.damping)
        bend = _bend(residual, now, step, held)
        point = [
            jnp.clip(z + jnp.clip(d + a, -LONGEST_STEP, LONGEST_STEP), 0.0, 1.0)
            for z, d, a in zip(now.point, step, bend, strict=True)
        ]
        model = quadratic(residual, point)
        better = model.cost < now.model.cost
        point, model = jax.tree.map(partial(jnp.where, better), (point, model), (now.point, now.model))
        damping = jnp.clip(now.damping * jnp.where(better, LOWER, RAISE), SMALLEST_DAMPING, LARGEST_DAMPING)
        return Search(point, model, damping)

    first = quadratic(residual, start)
    end = jax.lax.fori_loop(0, iterations, improve, Search(start, first, jnp.full_like(first.cost, damping)))
    return end.point, end.model.cost
