"""The table of car-following laws. To add one: a file beside this one, and an entry here."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from jaxtyping import Array

from rampcast.paper.laws import ghr, ghr_no_speed, gipps
from rampcast.paper.laws.mode import Mode
from rampcast.paper.laws.separable import Factors
from rampcast.physics import idm
from rampcast.physics.parameters import Range, Spread


@dataclass(frozen=True, eq=False)
class Law:
    """A car-following law: its functions and what is known of its parameters.

    Attributes:
        name: its key in `LAWS`.
        parameters: the record that its functions take; the order of its fields is that of the param axis.
        acceleration: (parameters, *, speed, leader_speed, gap) -> acceleration [m/s^2].
        limits: parameters -> lowest and highest acceleration of a roll-out [m/s^2].
        bounds: the range of each parameter in a fit.
        published: mean, median and standard deviation in print, of each parameter and (where printed) of the mean
            squared error, "mse".
        fallback: parameters of a driver who cannot be fitted.
        net_bounds: those ranges for a fit to net gaps, where they differ.
        factors: (*, speed, leader_speed, gap) -> `Factors`, for a law that is linear in its first parameter; else None.
    """

    name: str
    parameters: Callable[..., Any]
    acceleration: Callable[..., Array]
    limits: Callable[[Any], tuple[Array, Array]]
    bounds: tuple[Range, ...]
    published: tuple[Spread, ...]
    fallback: tuple[float, ...]
    factors: Callable[..., Factors] | None = None
    net_bounds: tuple[Range, ...] | None = None

    def ranges(self, mode: Mode) -> tuple[Range, ...]:
        """Returns the range of each parameter in a fit.

        Args:
            mode: which gap the fit is given: front to front in paper mode, net in corrected mode.
        """
        return self.net_bounds if mode is Mode.CORRECTED and self.net_bounds else self.bounds


_TABLE = (
    Law(
        "idm",
        idm.Parameters,
        idm.acceleration,
        idm.limits,
        idm.BOUNDS,
        idm.PUBLISHED,
        idm.FALLBACK,
        net_bounds=idm.NET_BOUNDS,
    ),
    Law(
        "gipps_paper",
        ghr_no_speed.Parameters,
        ghr_no_speed.acceleration,
        ghr_no_speed.limits,
        ghr_no_speed.BOUNDS,
        ghr_no_speed.PUBLISHED,
        ghr_no_speed.FALLBACK,
        ghr_no_speed.factors,
    ),
    Law(
        "ghr",
        ghr.Parameters,
        ghr.acceleration,
        ghr.limits,
        ghr.BOUNDS,
        ghr.PUBLISHED,
        ghr.FALLBACK,
        ghr.factors,
    ),
    Law(
        "gipps",
        gipps.Parameters,
        gipps.acceleration,
        gipps.limits,
        gipps.BOUNDS,
        gipps.PUBLISHED,
        gipps.FALLBACK,
    ),
)
LAWS = {law.name: law for law in _TABLE}
