"""What is known of a parameter of a car-following law before any fit: its range and the values in print."""

from typing import NamedTuple


class Range(NamedTuple):
    """The range in which a parameter is fitted."""

    name: str
    unit: str
    low: float
    high: float


class Spread(NamedTuple):
    """The spread of a fitted quantity over drivers, as printed; NaN where the source prints none."""

    name: str
    mean: float
    median: float
    standard_deviation: float
