"""Parameters as points of the unit cube: each on its own scale, its range stretched to 0..1."""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Array, Float

from rampcast.compute import jax, jnp
from rampcast.physics.parameters import Range, Scale

# Each scale as a rising function and its inverse.
_SCALES: dict[Scale, tuple[Callable[[Array], Array], Callable[[Array], Array]]] = {
    Scale.LINEAR: (lambda value: value, lambda scaled: scaled),
    Scale.ROOT: (jnp.sqrt, lambda scaled: scaled * scaled),
    Scale.INVERSE_ROOT: (lambda value: -1.0 / jnp.sqrt(value), lambda scaled: 1.0 / (scaled * scaled)),
    Scale.LOGARITHM: (jnp.log, jnp.exp),
}


def _ends(bound: Range) -> tuple[float, float]:
    scale = _SCALES[bound.scale][0]
    with jax.ensure_compile_time_eval():  # plain numbers take the precision of the arrays they meet
        return float(scale(jnp.asarray(bound.low))), float(scale(jnp.asarray(bound.high)))


def from_cube(bounds: Sequence[Range], point: Sequence[Array]) -> list[Array]:
    """Returns the parameters at a point of the cube.

    Args:
        bounds: range of each parameter.
        point: coordinates, each in [0, 1].
    """
    result = []
    for bound, value in zip(bounds, point, strict=True):
        low, high = _ends(bound)
        result.append(_SCALES[bound.scale][1](low + (high - low) * value))
    return result


def to_cube(bounds: Sequence[Range], parameters: Sequence[Array]) -> list[Array]:
    """Returns the point of the cube where the parameters are; what lies outside its range comes to the cube's side.

    Args:
        bounds: range of each parameter.
        parameters: their values.
    """
    result = []
    for bound, value in zip(bounds, parameters, strict=True):
        low, high = _ends(bound)
        result.append((_SCALES[bound.scale][0](jnp.clip(value, bound.low, bound.high)) - low) / (high - low))
    return result


def spread_points(count: int, dimensions: int) -> Float[np.ndarray, "point param"]:
    """Returns the first points of an additive recurrence that fills the unit cube evenly.

    Its steps are 1/phi^k with phi^(d+1) = phi + 1. Source: Roberts 2018, "The unreasonable effectiveness of quasirandom
    sequences".

    Args:
        count: number of points.
        dimensions: d.
    """
    phi = 2.0
    for _ in range(64):
        phi = (1.0 + phi) ** (1.0 / (dimensions + 1))
    result: np.ndarray = (0.5 + np.arange(1, count + 1)[:, None] * phi ** -np.arange(1.0, dimensions + 1)) % 1.0
    return result
