"""Colours and line styles as plain data; `plots.style` says how figures use them."""

from dataclasses import dataclass

# Source: Okabe and Ito (2008), "Color universal design"; its yellow is left out, too pale for lines on white.
BLACK = "#000000"
ORANGE = "#E69F00"
SKY = "#56B4E9"
GREEN = "#009E73"
BLUE = "#0072B2"
VERMILLION = "#D55E00"
PURPLE = "#CC79A7"
GREY = "#767676"
INDIGO = "#4B2E83"  # darker than all of the palette: told from it by lightness too


@dataclass(frozen=True)
class Look:
    """Colour, marker and dash pattern of one line; no two lines of a figure share all three."""

    color: str
    marker: str
    dash: str | tuple[int, tuple[int, ...]] = "-"
