"""The car-following law of Gazis, Herman and Rothery 1961 (GHR)."""

from jax.typing import ArrayLike
from jaxtyping import Array, Float

from rampcast.compute import jnp
from rampcast.paper.laws import separable
from rampcast.paper.laws.separable import Factors, Parameters, limits
from rampcast.physics.minimums import MINIMUM_SPEED
from rampcast.physics.parameters import Range, Spread

__all__ = ["BOUNDS", "FALLBACK", "PUBLISHED", "Parameters", "acceleration", "factors", "limits"]

# Source: the paper, table 4 "GHR Model Parameters Distribution".
BOUNDS = (Range("alpha", "1", -10.0, 10.0), Range("beta", "1", -5.0, 5.0), Range("gamma", "1", -5.0, 5.0))
PUBLISHED = (
    Spread("alpha", 2.84, 2.14, 4.77),
    Spread("beta", 0.06, -0.16, 3.89),
    Spread("gamma", 0.96, 0.9, 1.62),
    Spread("mse", 0.12, 0.06, 0.22),
)
FALLBACK = (2.14, -0.16, 0.9)  # for a driver who cannot be fitted: the medians in print


def factors(
    *,
    speed: Float[ArrayLike, "*#scene"],
    leader_speed: Float[ArrayLike, "*#scene"],
    gap: Float[ArrayLike, "*#scene"],
) -> Factors:
    """Returns the factors of the law: v_m - v_i, log v_i and log s.

    Args:
        speed: v_i [m/s]; below `MINIMUM_SPEED` the power takes `MINIMUM_SPEED`.
        leader_speed: v_m [m/s].
        gap: s [m]; infinite where there is no leader.
    """
    difference = jnp.where(jnp.isinf(gap), 0.0, jnp.asarray(leader_speed) - jnp.asarray(speed))
    return Factors(difference, jnp.log(jnp.maximum(speed, MINIMUM_SPEED)), separable.log_gap(gap))


def acceleration(
    parameters: Parameters,
    *,
    speed: Float[ArrayLike, "*#scene"],
    leader_speed: Float[ArrayLike, "*#scene"],
    gap: Float[ArrayLike, "*#scene"],
) -> Float[Array, "*#scene"]:
    """Returns a = alpha v_i^beta (v_m - v_i) / s^gamma [m/s^2]; 0 where there is no leader.

    Source: the paper, eq. 4; Gazis, Herman and Rothery 1961, eq. 4 without reaction time.

    Args:
        parameters: see `Parameters`.
        speed: v_i [m/s]; below `MINIMUM_SPEED` the power takes `MINIMUM_SPEED`.
        leader_speed: v_m [m/s]; any number where the gap is infinite.
        gap: s [m]; infinite for free driving; below `MINIMUM_GAP` it counts as `MINIMUM_GAP`.
    """
    return separable.evaluate(parameters, factors(speed=speed, leader_speed=leader_speed, gap=gap))
