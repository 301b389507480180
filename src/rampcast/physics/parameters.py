"""What is known of a parameter of a car-following law before any fit: its range and the values in print."""

from enum import StrEnum
from typing import NamedTuple


class Scale(StrEnum):
    """The function of a parameter in which a law is closest to linear, so that a search takes long steps in it."""

    LINEAR = "linear"
    ROOT = "root"
    INVERSE_ROOT = "inverse root"
    LOGARITHM = "logarithm"


class Range(NamedTuple):
    """The range in which a parameter is fitted, and the scale on which its fit searches."""

    name: str
    unit: str
    low: float
    high: float
    scale: Scale = Scale.LINEAR


class Spread(NamedTuple):
    """The spread of a fitted quantity over drivers, as printed; NaN where the source prints none."""

    name: str
    mean: float
    median: float
    standard_deviation: float
