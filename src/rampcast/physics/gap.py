"""Distances between a vehicle and its leader."""

from jax.typing import ArrayLike
from jaxtyping import Array, Float

from rampcast.compute import jnp


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
