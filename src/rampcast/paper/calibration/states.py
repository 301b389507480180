"""What a fit is given of each vehicle, and how far a law is from it."""

from collections.abc import Sequence
from typing import NamedTuple

from jaxtyping import Array, Float

from rampcast.paper.calibration.unit_cube import from_cube
from rampcast.paper.laws.laws import Law
from rampcast.physics.parameters import Range

Bounds = tuple[Range, ...]


class States(NamedTuple):
    """What the law is given and what it should return; weight 0 leaves a sample out.

    Attributes:
        speed: v [m/s].
        leader_speed: v_m [m/s].
        gap: s [m].
        acceleration: observed [m/s^2].
        weight: 0 or 1.
    """

    speed: Float[Array, "past vehicle"]
    leader_speed: Float[Array, "past vehicle"]
    gap: Float[Array, "past vehicle"]
    acceleration: Float[Array, "past vehicle"]
    weight: Float[Array, "past vehicle"]


def residual(law: Law, bounds: Bounds, point: Sequence[Array], states: States) -> Float[Array, "past vehicle"]:
    """Returns forecast minus observed acceleration [m/s^2], 0 where the weight is 0.

    Args:
        law: which car-following law.
        bounds: range of each parameter.
        point: parameters on the unit cube.
        states: see `States`.
    """
    parameters = law.parameters(*from_cube(bounds, point))
    forecast = law.acceleration(parameters, speed=states.speed, leader_speed=states.leader_speed, gap=states.gap)
    return (forecast - states.acceleration) * states.weight
