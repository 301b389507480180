"""The safe-speed model of Gipps 1981, as an acceleration."""

from typing import NamedTuple

from jax.typing import ArrayLike
from jaxtyping import Array, Float

from rampcast.compute import jnp
from rampcast.physics.minimums import MINIMUM_GAP
from rampcast.physics.parameters import Range, Scale, Spread


class Parameters(NamedTuple):
    """Parameters of the model of Gipps.

    Attributes:
        maximum_acceleration: a_n [m/s^2].
        braking: -b_n, the hardest braking that the driver wishes to undertake, positive [m/s^2].
        desired_speed: V_n [m/s].
        reaction_time: tau [s].
        leader_braking: -b hat, the hardest braking that the driver expects of the leader, positive [m/s^2].
        standing_gap: s_n less the leader's length, gap at standstill [m].
    """

    maximum_acceleration: Float[ArrayLike, "*#scene"]
    braking: Float[ArrayLike, "*#scene"]
    desired_speed: Float[ArrayLike, "*#scene"]
    reaction_time: Float[ArrayLike, "*#scene"]
    leader_braking: Float[ArrayLike, "*#scene"]
    standing_gap: Float[ArrayLike, "*#scene"]


# Accelerations and desired speed: the ranges that the paper gives the IDM. Reaction time: 0.3 s to 3 s holds
# Gipps' 2/3 s and the 1 to 2 s of Newell 2002. Standing gap: from below Gipps' 2 m (s_n = 6.5 m less a car of 4.5 m)
# to the 30 m of the paper, which holds a gap front to front.
BOUNDS = (
    Range("maximum_acceleration", "m/s^2", 0.5, 5.0, Scale.LOGARITHM),
    Range("braking", "m/s^2", 0.5, 5.0, Scale.LOGARITHM),
    Range("desired_speed", "m/s", 5.0, 35.0, Scale.LOGARITHM),
    Range("reaction_time", "s", 0.3, 3.0, Scale.LOGARITHM),
    Range("leader_braking", "m/s^2", 0.5, 5.0, Scale.LOGARITHM),
    Range("standing_gap", "m", 0.5, 30.0),
)
# Source: Gipps 1981, section 4: a ~ N(1.7, 0.3^2), b = -2 a, V ~ N(20.0, 3.2^2), s ~ N(6.5, 0.3^2), tau = 2/3 s,
# b hat = min(-3.0, (b - 3.0) / 2), here at the mean b.
_NAN = float("nan")
PUBLISHED = (
    Spread("maximum_acceleration", 1.7, 1.7, 0.3),
    Spread("braking", 3.4, 3.4, 0.6),
    Spread("desired_speed", 20.0, 20.0, 3.2),
    Spread("reaction_time", 2.0 / 3.0, 2.0 / 3.0, 0.0),
    Spread("leader_braking", 3.2, 3.2, _NAN),
    Spread("standing_gap", 2.0, 2.0, 0.3),
)
FALLBACK = (1.7, 3.4, 20.0, 2.0 / 3.0, 3.2, 2.0)  # for a driver who cannot be fitted: Gipps' own means


def free_speed(parameters: Parameters, *, speed: Float[ArrayLike, "*#scene"]) -> Float[Array, "*#scene"]:
    """Returns v + 2.5 a tau (1 - v/V) sqrt(0.025 + v/V) [m/s], the speed after tau on a free road.

    Source: Gipps 1981, eq. 2.

    Args:
        parameters: see `Parameters`.
        speed: v [m/s].
    """
    relative = jnp.asarray(speed) / jnp.asarray(parameters.desired_speed)
    gain = jnp.asarray(parameters.maximum_acceleration) * jnp.asarray(parameters.reaction_time)
    return jnp.asarray(speed) + 2.5 * gain * (1.0 - relative) * jnp.sqrt(0.025 + jnp.maximum(relative, 0.0))


def safe_speed(
    parameters: Parameters,
    *,
    speed: Float[ArrayLike, "*#scene"],
    leader_speed: Float[ArrayLike, "*#scene"],
    gap: Float[ArrayLike, "*#scene"],
) -> Float[Array, "*#scene"]:
    """Returns -B tau + sqrt(B^2 tau^2 + B [2 (s - s_0) - v tau + v_m^2 / B hat]) [m/s], at least 0.

    From this speed the driver can still stop behind a leader who brakes with B hat. Where the root's argument is
    negative no speed is safe: 0. Source: Gipps 1981, eq. 10 and 11, with positive B = -b and B hat = -b hat.

    Args:
        parameters: see `Parameters`.
        speed: v [m/s].
        leader_speed: v_m [m/s].
        gap: s, net [m], finite.
    """
    braking, tau = jnp.asarray(parameters.braking), jnp.asarray(parameters.reaction_time)
    room = 2.0 * (jnp.asarray(gap) - jnp.asarray(parameters.standing_gap)) - jnp.asarray(speed) * tau
    radicand = (braking * tau) ** 2 + braking * (
        room + jnp.asarray(leader_speed) ** 2 / jnp.asarray(parameters.leader_braking)
    )
    reachable = radicand > 0.0
    root = jnp.sqrt(jnp.where(reachable, radicand, 1.0))  # the inner choice keeps the derivative finite
    return jnp.where(reachable, jnp.maximum(root - braking * tau, 0.0), 0.0)


def acceleration(
    parameters: Parameters,
    *,
    speed: Float[ArrayLike, "*#scene"],
    leader_speed: Float[ArrayLike, "*#scene"],
    gap: Float[ArrayLike, "*#scene"],
) -> Float[Array, "*#scene"]:
    """Returns (min(free speed, safe speed) - v) / tau [m/s^2].

    Gipps gives the speed after one reaction time; this is the constant acceleration that leads there.
    Source: Gipps 1981, eq. 12.

    Args:
        parameters: see `Parameters`.
        speed: v [m/s].
        leader_speed: v_m [m/s]; any number where the gap is infinite.
        gap: s [m]; infinite for free driving; below `MINIMUM_GAP` it counts as `MINIMUM_GAP`.
    """
    alone = jnp.isinf(gap)
    followed = jnp.where(alone, MINIMUM_GAP, jnp.maximum(gap, MINIMUM_GAP))
    free = free_speed(parameters, speed=speed)
    safe = safe_speed(parameters, speed=speed, leader_speed=leader_speed, gap=followed)
    following = jnp.where(alone, free, jnp.minimum(free, safe))
    return (following - jnp.asarray(speed)) / jnp.asarray(parameters.reaction_time)


def limits(parameters: Parameters) -> tuple[Float[Array, "*#scene"], Float[Array, "*#scene"]]:
    """Returns the lowest and highest acceleration of a roll-out, -B and a [m/s^2]. Source: the paper, algorithm 1.

    Args:
        parameters: see `Parameters`.
    """
    return -jnp.asarray(parameters.braking), jnp.asarray(parameters.maximum_acceleration)
