"""The intelligent driver model (IDM) of Treiber, Hennecke and Helbing 2000."""

from typing import NamedTuple

from jax.typing import ArrayLike
from jaxtyping import Array, Float

from rampcast.compute import jnp
from rampcast.physics.minimums import MINIMUM_GAP, MINIMUM_SPEED
from rampcast.physics.parameters import Range, Scale, Spread


class Parameters(NamedTuple):
    """Parameters of the IDM.

    Attributes:
        standing_gap: s_0, gap at standstill [m].
        time_headway: h_d, desired time headway [s].
        maximum_acceleration: A [m/s^2].
        comfortable_deceleration: B, positive [m/s^2].
        desired_speed: v_d [m/s].
        exponent: delta [1].
    """

    standing_gap: Float[ArrayLike, "*#scene"]
    time_headway: Float[ArrayLike, "*#scene"]
    maximum_acceleration: Float[ArrayLike, "*#scene"]
    comfortable_deceleration: Float[ArrayLike, "*#scene"]
    desired_speed: Float[ArrayLike, "*#scene"]
    exponent: Float[ArrayLike, "*#scene"]


# Source: the paper, table 2 "IDM Model Parameters Distribution" (v_d is printed in m/s^2: a slip).
BOUNDS = (
    Range("standing_gap", "m", 5.0, 30.0),
    Range("time_headway", "s", 0.5, 6.0),
    Range("maximum_acceleration", "m/s^2", 0.5, 5.0, Scale.LOGARITHM),
    Range("comfortable_deceleration", "m/s^2", 0.5, 5.0, Scale.INVERSE_ROOT),
    Range("desired_speed", "m/s", 5.0, 35.0, Scale.LOGARITHM),
    Range("exponent", "1", 0.0, 10.0, Scale.ROOT),
)
# The paper's s_0 holds the leader's length, as its gap does (errata 4). Net of a car of 4.5 m its range begins at
# 0.5 m: with 5 m no vehicle could stand in a queue, where real net gaps are 1 to 4 m.
NET_BOUNDS = (Range("standing_gap", "m", 0.5, 25.5), *BOUNDS[1:])
PUBLISHED = (
    Spread("standing_gap", 10.68, 6.92, 8.47),
    Spread("time_headway", 1.79, 0.91, 1.88),
    Spread("maximum_acceleration", 3.34, 3.75, 1.64),
    Spread("comfortable_deceleration", 2.63, 1.63, 2.10),
    Spread("desired_speed", 18.19, 7.62, 13.89),
    Spread("exponent", 5.19, 4.48, 4.04),
    Spread("mse", 0.08, 0.02, 0.26),
)
# For a driver who cannot be fitted: the means in print. The median desired speed, 7.62 m/s, is that of a jam.
FALLBACK = (10.68, 1.79, 3.34, 2.63, 18.19, 5.19)


def desired_gap(
    parameters: Parameters, *, speed: Float[ArrayLike, "*#scene"], leader_speed: Float[ArrayLike, "*#scene"]
) -> Float[Array, "*#scene"]:
    """Returns s_d = s_0 + h_d v + v (v - v_m) / (2 sqrt(A B)) [m].

    Source: the paper, eq. 1; Treiber, Hennecke and Helbing 2000, eq. 4 with s_1 = 0.

    Args:
        parameters: see `Parameters`.
        speed: v [m/s].
        leader_speed: v_m [m/s].
    """
    speed = jnp.asarray(speed)
    softness = 2.0 * jnp.sqrt(
        jnp.asarray(parameters.maximum_acceleration) * jnp.asarray(parameters.comfortable_deceleration)
    )
    closing = speed * (speed - jnp.asarray(leader_speed))
    return jnp.asarray(parameters.standing_gap) + jnp.asarray(parameters.time_headway) * speed + closing / softness


def acceleration(
    parameters: Parameters,
    *,
    speed: Float[ArrayLike, "*#scene"],
    leader_speed: Float[ArrayLike, "*#scene"],
    gap: Float[ArrayLike, "*#scene"],
) -> Float[Array, "*#scene"]:
    """Returns a = A (1 - (v / v_d)^delta - (s_d / s)^2) [m/s^2].

    Source: the paper, eq. 2; Treiber, Hennecke and Helbing 2000, eq. 3.

    Args:
        parameters: see `Parameters`.
        speed: v [m/s]; below `MINIMUM_SPEED` the power takes `MINIMUM_SPEED`, as 0^0 has no derivative.
        leader_speed: v_m [m/s]; any finite number where the gap is infinite.
        gap: s [m]; infinite for free driving; below `MINIMUM_GAP` it counts as `MINIMUM_GAP`.
    """
    relative = jnp.maximum(speed, MINIMUM_SPEED) / jnp.asarray(parameters.desired_speed)
    free = jnp.exp(jnp.asarray(parameters.exponent) * jnp.log(relative))
    interaction = desired_gap(parameters, speed=speed, leader_speed=leader_speed) / jnp.maximum(gap, MINIMUM_GAP)
    return jnp.asarray(parameters.maximum_acceleration) * (1.0 - free - interaction**2)


def limits(parameters: Parameters) -> tuple[Float[Array, "*#scene"], Float[Array, "*#scene"]]:
    """Returns the lowest and highest acceleration of a roll-out, -B and A [m/s^2].

    Source: the paper, algorithm 1, lines 12 to 16; it prints B for -B (errata 3), so that no vehicle could brake.

    Args:
        parameters: see `Parameters`.
    """
    return -jnp.asarray(parameters.comfortable_deceleration), jnp.asarray(parameters.maximum_acceleration)
