"""What the two laws of Gazis-Herman-Rothery type share: a = alpha base^beta factor / s^gamma, linear in alpha."""

from typing import NamedTuple

from jax.typing import ArrayLike
from jaxtyping import Array, Float

from rampcast.compute import jnp
from rampcast.physics.minimums import MINIMUM_GAP, RECORDED_LIMIT


class Parameters(NamedTuple):
    """Parameters of a law of this type; the paper calls them unit-less, their units depend on the exponents.

    Attributes:
        alpha: sensitivity.
        beta: exponent of the speed, or of the speed difference.
        gamma: exponent of the gap.
    """

    alpha: Float[ArrayLike, "*#scene"]
    beta: Float[ArrayLike, "*#scene"]
    gamma: Float[ArrayLike, "*#scene"]


class Factors(NamedTuple):
    """The three factors of such a law at given states, a = alpha factor exp(beta log_base - gamma log_gap).

    Attributes:
        factor: what is neither raised to beta nor to gamma; 0 where there is no leader.
        log_base: logarithm of what is raised to beta.
        log_gap: logarithm of the gap.
    """

    factor: Float[Array, "*#scene"]
    log_base: Float[Array, "*#scene"]
    log_gap: Float[Array, "*#scene"]


def log_gap(gap: Float[ArrayLike, "*#scene"]) -> Float[Array, "*#scene"]:
    """Returns log s, of `MINIMUM_GAP` where the gap is smaller; 0 where there is no leader.

    Args:
        gap: s [m]; infinite where there is no leader.
    """
    return jnp.log(jnp.where(jnp.isinf(gap), 1.0, jnp.maximum(gap, MINIMUM_GAP)))


def evaluate(parameters: Parameters, factors: Factors) -> Float[Array, "*#scene"]:
    """Returns a = alpha factor exp(beta log_base - gamma log_gap) [m/s^2].

    Args:
        parameters: see `Parameters`.
        factors: see `Factors`.
    """
    exponent = jnp.asarray(parameters.beta) * factors.log_base - jnp.asarray(parameters.gamma) * factors.log_gap
    return jnp.asarray(parameters.alpha) * factors.factor * jnp.exp(exponent)


def limits(parameters: Parameters) -> tuple[Float[Array, "*#scene"], Float[Array, "*#scene"]]:
    """Returns the lowest and highest acceleration of a roll-out [m/s^2].

    The paper's algorithm 1 clamps at fitted limits, which laws of this type lack: that of the recordings stands in.

    Args:
        parameters: see `Parameters`.
    """
    highest = jnp.full_like(jnp.asarray(parameters.alpha), RECORDED_LIMIT)
    return -highest, highest
