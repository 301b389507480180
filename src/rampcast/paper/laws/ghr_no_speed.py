"""The law that the paper prints as "Gipps'", repaired: a GHR law without the own-speed term.

It is not the model of Gipps 1981 (see `paper.laws.gipps` for that one). As printed, (x_i - x_m)^gamma is a real
power of a negative number, and so is (v_m - v_i)^beta whenever the leader is slower: the law is undefined on every
sample (errata 2). The repair takes the gap and the size of the speed difference, and puts the sign in front.
"""

from jax.typing import ArrayLike
from jaxtyping import Array, Float

from rampcast.compute import jnp
from rampcast.paper.laws import separable
from rampcast.paper.laws.separable import Factors, Parameters, limits
from rampcast.physics.minimums import MINIMUM_SPEED_DIFFERENCE
from rampcast.physics.parameters import Range, Spread

__all__ = ["BOUNDS", "FALLBACK", "PUBLISHED", "Parameters", "acceleration", "factors", "limits"]

# Source: the paper, table 3 "Gipps' Model Parameters Distribution".
BOUNDS = (Range("alpha", "1", -10.0, 10.0), Range("beta", "1", -5.0, 5.0), Range("gamma", "1", -5.0, 5.0))
PUBLISHED = (
    Spread("alpha", 2.26, 0.0, 5.62),
    Spread("beta", 0.76, 0.70, 2.42),
    Spread("gamma", -1.42, -0.95, 3.09),
    Spread("mse", 0.18, 0.06, 0.29),
)
FALLBACK = (0.0, 0.70, -0.95)  # for a driver who cannot be fitted: the medians in print, which keep the speed


def factors(
    *,
    speed: Float[ArrayLike, "*#scene"],
    leader_speed: Float[ArrayLike, "*#scene"],
    gap: Float[ArrayLike, "*#scene"],
) -> Factors:
    """Returns the factors of the law: sign(v_m - v_i), log |v_m - v_i| and log s.

    Args:
        speed: v_i [m/s].
        leader_speed: v_m [m/s].
        gap: s [m]; infinite where there is no leader.
    """
    difference = jnp.where(jnp.isinf(gap), 0.0, jnp.asarray(leader_speed) - jnp.asarray(speed))
    size = jnp.maximum(jnp.abs(difference), MINIMUM_SPEED_DIFFERENCE)
    return Factors(jnp.sign(difference), jnp.log(size), separable.log_gap(gap))


def acceleration(
    parameters: Parameters,
    *,
    speed: Float[ArrayLike, "*#scene"],
    leader_speed: Float[ArrayLike, "*#scene"],
    gap: Float[ArrayLike, "*#scene"],
) -> Float[Array, "*#scene"]:
    """Returns a = alpha sign(v_m - v_i) |v_m - v_i|^beta / s^gamma [m/s^2]; 0 where there is no leader.

    Source: the paper, eq. 3, with the repair that the module names.

    Args:
        parameters: see `Parameters`.
        speed: v_i [m/s].
        leader_speed: v_m [m/s]; a difference under `MINIMUM_SPEED_DIFFERENCE` counts as that, with its sign.
        gap: s [m]; infinite for free driving; below `MINIMUM_GAP` it counts as `MINIMUM_GAP`.
    """
    return separable.evaluate(parameters, factors(speed=speed, leader_speed=leader_speed, gap=gap))
