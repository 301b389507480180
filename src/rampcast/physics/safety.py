"""How near vehicles come to a crash: time to collision, deceleration to avoid a crash, post-encroachment time."""

from typing import Final

from jax.typing import ArrayLike
from jaxtyping import Array, Float

from rampcast.compute import jnp

# A conflict lies beyond these. Source: SUMO's surrogate safety device (SSM), default thresholds.
LEAST_TIME_TO_COLLISION: Final = 3.0  # [s]
MOST_DECELERATION: Final = 3.0  # [m/s^2]
LEAST_POST_ENCROACHMENT: Final = 2.0  # [s]


def time_to_collision(
    gap: Float[ArrayLike, "*#scene"],
    *,
    speed: Float[ArrayLike, "*#scene"],
    leader_speed: Float[ArrayLike, "*#scene"],
) -> Float[Array, "*#scene"]:
    """Returns TTC = s / (v - v_m) [s]: after that time both touch if neither changes speed.

    Infinite behind a leader that is not slower; 0 where they touch already and it is.

    Source: Hayward 1972, "Near-miss determination through use of a scale of danger".

    Args:
        gap: s, from front to the leader's rear [m].
        speed: v [m/s].
        leader_speed: v_m [m/s].
    """
    gap, closing = jnp.asarray(gap), jnp.asarray(speed) - jnp.asarray(leader_speed)
    left = jnp.maximum(gap, 0.0) / jnp.where(closing > 0.0, closing, 1.0)
    return jnp.where(closing > 0.0, left, jnp.inf)


def deceleration_to_avoid_crash(
    gap: Float[ArrayLike, "*#scene"],
    *,
    speed: Float[ArrayLike, "*#scene"],
    leader_speed: Float[ArrayLike, "*#scene"],
) -> Float[Array, "*#scene"]:
    """Returns DRAC = (v - v_m)^2 / (2 s) [m/s^2]: braking by less, behind a leader that keeps its speed, is a crash.

    0 behind a leader that is not slower; infinite where they touch already and it is.

    Source: Cooper and Ferguson 1976, "Traffic studies at T-junctions: a conflict simulation model"; in this form
    Almqvist, Hyden and Risser 1991.

    Args:
        gap: s, from front to the leader's rear [m].
        speed: v [m/s].
        leader_speed: v_m [m/s].
    """
    gap, closing = jnp.asarray(gap), jnp.asarray(speed) - jnp.asarray(leader_speed)
    needed = jnp.where(gap > 0.0, closing**2 / (2.0 * jnp.where(gap > 0.0, gap, 1.0)), jnp.inf)
    return jnp.where(closing > 0.0, needed, 0.0)


def post_encroachment_time(
    left: Float[ArrayLike, "*#scene"], arrived: Float[ArrayLike, "*#scene"]
) -> Float[Array, "*#scene"]:
    """Returns PET [s]: from the moment the first leaves a place with its rear until the second enters it.

    Infinite if the second never does; negative where both are there at once.

    Source: Allen, Shin and Cooper 1978, "Analysis of traffic conflicts and collisions".

    Args:
        left: when the rear of the first has left the place [s].
        arrived: when the front of the second enters it [s]; infinite if it does not.
    """
    return jnp.asarray(arrived) - jnp.asarray(left)
