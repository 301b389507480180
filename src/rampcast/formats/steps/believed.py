"""Columns of what every source has of vehicles, in SI units, and what is believed of it: numbers beyond are faults."""

import polars as pl

from rampcast.formats.tables.columns import Column
from rampcast.recording import columns as c

FASTEST = 150.0  # [m/s] 540 km/h
HARDEST = 1000.0  # [m/s^2] derived from positions in steps of a pixel it may be anything but endless
LONGEST, WIDEST = 100.0, 20.0  # [m]
FARTHEST_UTM = 1e7  # [m] from the equator to a pole
FARTHEST_IN_IMAGE = 10_000.0  # [m] no drone films a longer section


def number(name: str, *spellings: str, optional: bool = False) -> Column:
    """Returns a column of ids or frames."""
    return Column(name, spellings, pl.Int32(), 0, c.LARGEST, optional)


def place(name: str, *spellings: str, farthest: float, optional: bool = False, may_be_blank: bool = False) -> Column:
    """Returns a column of coordinates that are this far from the origin at most, in the source's unit."""
    return Column(name, spellings, pl.Float64(), -farthest, farthest, optional, may_be_blank)


def speed(name: str, *spellings: str, optional: bool = False, may_be_blank: bool = False) -> Column:
    """Returns a column of velocities [m/s]."""
    return Column(name, spellings, pl.Float32(), -FASTEST, FASTEST, optional, may_be_blank)


def acceleration(name: str, *spellings: str, optional: bool = False, may_be_blank: bool = False) -> Column:
    """Returns a column of accelerations [m/s^2]."""
    return Column(name, spellings, pl.Float32(), -HARDEST, HARDEST, optional, may_be_blank)


def length(*spellings: str, optional: bool = False, may_be_blank: bool = False) -> Column:
    """Returns the column of lengths [m]."""
    return Column(c.LENGTH, spellings, pl.Float32(), 0, LONGEST, optional, may_be_blank)


def width(*spellings: str, optional: bool = False, may_be_blank: bool = False) -> Column:
    """Returns the column of widths [m]."""
    return Column(c.WIDTH, spellings, pl.Float32(), 0, WIDEST, optional, may_be_blank)
