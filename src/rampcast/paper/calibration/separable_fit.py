"""Fit of the laws of Gazis-Herman-Rothery type, a = alpha base^beta factor / s^gamma, which are linear in alpha.

For given beta and gamma the best alpha has a closed form. A grid in these two finds the start of a search, which first
moves them alone, with alpha eliminated (variable projection), and then all three: the eliminated cost has a kink where
alpha comes to the end of its range, and many best fits lie on that kink.

Base and gap are taken relative to their geometric means over the history, b and g, and alpha with them: alpha' = alpha
b^beta / g^gamma. Without that, tenth powers of gaps of 100 m would leave single precision.
"""

from functools import partial
from typing import NamedTuple

from jaxtyping import Array, Float

from rampcast.compute import jnp
from rampcast.paper.calibration.least_squares import Vector, search
from rampcast.paper.calibration.states import Bounds, States, residual
from rampcast.paper.calibration.unit_cube import from_cube, to_cube
from rampcast.paper.laws.laws import Law
from rampcast.physics.parameters import Range

GRID = 21  # values of beta and of gamma in the first look: steps of 0.5
ITERATIONS = 6  # of each of the two searches
LAST_DAMPING = 1e-3
SMALLEST_SQUARE = 1e-30  # keeps alpha finite where the leader is never faster nor slower


class Samples(NamedTuple):
    """A separable law at the states of each vehicle, relative to the geometric means of its history.

    Attributes:
        factor: what is raised neither to beta nor to gamma; 0 where the weight is 0.
        base: logarithm of base / b.
        gap: logarithm of s / g.
        observed: acceleration [m/s^2]; 0 where the weight is 0.
        mean_base: logarithm of b.
        mean_gap: logarithm of g.
    """

    factor: Float[Array, "past vehicle"]
    base: Float[Array, "past vehicle"]
    gap: Float[Array, "past vehicle"]
    observed: Float[Array, "past vehicle"]
    mean_base: Float[Array, "vehicle"]
    mean_gap: Float[Array, "vehicle"]


def fit_separable(law: Law, bounds: Bounds, states: States) -> tuple[Vector, Array]:
    """Returns the best alpha, beta and gamma and their sum of squares [m^2/s^4].

    Args:
        law: a law with `factors`.
        bounds: range of each parameter.
        states: see `States`.
    """
    samples, exponents = _samples(law, states), bounds[1:]

    def eliminated(point: Vector) -> Float[Array, "past vehicle"]:
        shape = _shape(samples, *from_cube(exponents, point))
        return _relative_alpha(bounds[0], samples, *from_cube(exponents, point)) * shape - samples.observed

    start = to_cube(exponents, _first_look(bounds, samples))
    point, _ = search(eliminated, start, iterations=ITERATIONS)
    beta, gamma = from_cube(exponents, point)
    alpha = _relative_alpha(bounds[0], samples, beta, gamma) / _scale(samples, beta, gamma)
    whole = partial(residual, law, bounds, states=states)
    point, cost = search(whole, to_cube(bounds, [alpha, beta, gamma]), iterations=ITERATIONS, damping=LAST_DAMPING)
    return from_cube(bounds, point), cost


def _samples(law: Law, states: States) -> Samples:
    assert law.factors is not None
    factors = law.factors(speed=states.speed, leader_speed=states.leader_speed, gap=states.gap)
    count = jnp.maximum(jnp.sum(states.weight, axis=0), 1.0)
    mean_base = jnp.sum(factors.log_base * states.weight, axis=0) / count
    mean_gap = jnp.sum(factors.log_gap * states.weight, axis=0) / count
    return Samples(
        factor=factors.factor * states.weight,
        base=(factors.log_base - mean_base) * states.weight,
        gap=(factors.log_gap - mean_gap) * states.weight,
        observed=states.acceleration * states.weight,
        mean_base=mean_base,
        mean_gap=mean_gap,
    )


def _shape(samples: Samples, beta: Array, gamma: Array) -> Float[Array, "past vehicle"]:
    """Returns the acceleration at alpha' = 1."""
    return samples.factor * jnp.exp(beta * samples.base - gamma * samples.gap)


def _scale(samples: Samples, beta: Array, gamma: Array) -> Float[Array, "vehicle"]:
    """Returns alpha' / alpha."""
    return jnp.exp(beta * samples.mean_base - gamma * samples.mean_gap)


def _relative_alpha(bound: Range, samples: Samples, beta: Array, gamma: Array) -> Float[Array, "vehicle"]:
    """Returns alpha' that fits best at given exponents, within the range of alpha."""
    shape, scale = _shape(samples, beta, gamma), _scale(samples, beta, gamma)
    best = jnp.sum(samples.observed * shape, axis=0) / jnp.maximum(jnp.sum(shape * shape, axis=0), SMALLEST_SQUARE)
    return jnp.clip(best, bound.low * scale, bound.high * scale)


def _first_look(bounds: Bounds, samples: Samples) -> Vector:
    """Returns the best (beta, gamma) of a grid: two matrix products a vehicle rate all of it."""
    alpha_range, beta_range, gamma_range = bounds
    grid = jnp.linspace(0.0, 1.0, GRID, dtype=jnp.float32)
    betas = beta_range.low + (beta_range.high - beta_range.low) * grid
    gammas = gamma_range.low + (gamma_range.high - gamma_range.low) * grid
    factor, base, gap, observed, mean_base, mean_gap = (values.T.astype(jnp.float32) for values in samples)
    of_beta = jnp.exp(betas[:, None] * base[:, None, :]) * factor[:, None, :]
    of_gamma = jnp.exp(-gammas * gap[:, :, None])
    match = jnp.einsum("vbp,vpg->vbg", of_beta * observed[:, None, :], of_gamma)
    square = jnp.einsum("vbp,vpg->vbg", of_beta**2, of_gamma**2)
    scale = jnp.exp(mean_base[:, None] * betas)[:, :, None] * jnp.exp(-mean_gap[:, None] * gammas)[:, None, :]
    alpha = jnp.clip(match / jnp.maximum(square, SMALLEST_SQUARE), alpha_range.low * scale, alpha_range.high * scale)
    gain = alpha * (2.0 * match - alpha * square)
    best = jnp.argmax(gain.reshape(len(gain), -1), axis=1)
    return [betas[best // GRID].astype(float), gammas[best % GRID].astype(float)]
