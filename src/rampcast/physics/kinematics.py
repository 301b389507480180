"""Differences of positions in time, and distances between a vehicle and its leader."""

from jax.typing import ArrayLike
from jaxtyping import Array, Float

from rampcast.physics.engine import jnp


def velocity(x: Float[ArrayLike, "*scene step"], *, time_step: float) -> Float[Array, "*scene step"]:
    """Returns the time derivative of `x`: central differences, one-sided at the ends, all of second order.

    v_k = (x_{k+1} - x_{k-1}) / (2 T), v_0 = (-3 x_0 + 4 x_1 - x_2) / (2 T). Source: Fornberg 1988, table 1 and 3.

    Args:
        x: positions [m], at least 3 steps.
        time_step: T [s].
    """
    x = jnp.asarray(x)
    first = -3.0 * x[..., :1] + 4.0 * x[..., 1:2] - x[..., 2:3]
    middle = x[..., 2:] - x[..., :-2]
    last = 3.0 * x[..., -1:] - 4.0 * x[..., -2:-1] + x[..., -3:-2]
    return jnp.concatenate([first, middle, last], axis=-1) / (2.0 * time_step)


def acceleration(x: Float[ArrayLike, "*scene step"], *, time_step: float) -> Float[Array, "*scene step"]:
    """Returns the second time derivative of `x`: central differences, one-sided at the ends, all of second order.

    a_k = (x_{k+1} - 2 x_k + x_{k-1}) / T^2, a_0 = (2 x_0 - 5 x_1 + 4 x_2 - x_3) / T^2.
    Source: Fornberg 1988, table 1 and 3.

    Args:
        x: positions [m], at least 4 steps.
        time_step: T [s].
    """
    x = jnp.asarray(x)
    first = 2.0 * x[..., :1] - 5.0 * x[..., 1:2] + 4.0 * x[..., 2:3] - x[..., 3:4]
    middle = x[..., 2:] - 2.0 * x[..., 1:-1] + x[..., :-2]
    last = 2.0 * x[..., -1:] - 5.0 * x[..., -2:-1] + 4.0 * x[..., -3:-2] - x[..., -4:-3]
    return jnp.concatenate([first, middle, last], axis=-1) / time_step**2


def front_gap(x: Float[ArrayLike, "*#scene"], leader_x: Float[ArrayLike, "*#scene"]) -> Float[Array, "*#scene"]:
    """Returns the distance [m] from front to front, as the paper has it; negative once the leader is behind.

    Args:
        x: front of the vehicle [m].
        leader_x: front of its leader [m].
    """
    return jnp.asarray(leader_x) - jnp.asarray(x)


def net_gap(
    x: Float[ArrayLike, "*#scene"], leader_x: Float[ArrayLike, "*#scene"], leader_length: Float[ArrayLike, "*#scene"]
) -> Float[Array, "*#scene"]:
    """Returns the distance [m] from the vehicle's front to its leader's rear bumper; negative where they overlap.

    Args:
        x: front of the vehicle [m].
        leader_x: front of its leader [m].
        leader_length: length of its leader [m].
    """
    return front_gap(x, leader_x) - jnp.asarray(leader_length)


def time_to_collision(
    gap: Float[ArrayLike, "*#scene"], speed: Float[ArrayLike, "*#scene"], leader_speed: Float[ArrayLike, "*#scene"]
) -> Float[Array, "*#scene"]:
    """Returns gap / (v_i - v_m) [s]; infinite where the vehicle does not close in on its leader. Source: Hayward 1972.

    Args:
        gap: net gap [m].
        speed: v_i [m/s].
        leader_speed: v_m [m/s].
    """
    closing = jnp.asarray(speed) - jnp.asarray(leader_speed)
    return jnp.where(closing > 0.0, jnp.asarray(gap) / jnp.where(closing > 0.0, closing, 1.0), jnp.inf)
