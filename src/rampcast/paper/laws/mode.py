"""The two readings of the paper."""

from enum import StrEnum


class Mode(StrEnum):
    """PAPER does what the paper prints, with the smallest repair; CORRECTED does what it should have done."""

    PAPER = "paper"
    CORRECTED = "corrected"
