"""Fit of the laws of Gazis-Herman-Rothery type, a = alpha base^beta factor / s^gamma, which are linear in alpha."""

from jaxtyping import Array

from rampcast.models.least_squares import Bounds, States, Vector, search
from rampcast.physics.engine import jnp
from rampcast.physics.laws import Law

GRID = 11  # values of beta and of gamma in the first look
ITERATIONS = 20


def fit_separable(law: Law, bounds: Bounds, states: States) -> tuple[Vector, Array]:
    """Returns the best point on the unit cube and its sum of squares [m^2/s^4].

    A grid in (beta, gamma), with alpha in closed form and clipped to its range, gives the start of a search.

    Args:
        law: a law with `factors`.
        bounds: range of each parameter.
        states: see `States`.
    """
    assert law.factors is not None
    factors = law.factors(speed=states.speed, leader_speed=states.leader_speed, gap=states.gap)
    alpha_range, beta_range, gamma_range = bounds
    grid = jnp.linspace(0.0, 1.0, GRID)
    betas = beta_range.low + (beta_range.high - beta_range.low) * grid
    gammas = gamma_range.low + (gamma_range.high - gamma_range.low) * grid
    factor = factors.factor * states.weight
    of_beta = jnp.exp(betas[:, None, None] * factors.log_base)
    of_gamma = jnp.exp(-gammas[:, None, None] * factors.log_gap)
    product = jnp.einsum("bpv,gpv->bgv", of_beta * (factor * states.acceleration), of_gamma)
    square = jnp.einsum("bpv,gpv->bgv", (of_beta * factor) ** 2, of_gamma**2)
    alpha = jnp.clip(product / jnp.maximum(square, 1e-300), alpha_range.low, alpha_range.high)
    gain = alpha * (2.0 * product - alpha * square)
    best = jnp.argmax(gain.reshape(GRID * GRID, -1), axis=0)
    chosen = jnp.take_along_axis(alpha.reshape(GRID * GRID, -1), best[None], axis=0)[0]
    start = [(chosen - alpha_range.low) / (alpha_range.high - alpha_range.low), grid[best // GRID], grid[best % GRID]]
    return search(law, bounds, start, states, iterations=ITERATIONS)
