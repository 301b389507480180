"""How a film looks: the colours of the live page on its dark ground, those of `rampcast.looks` a little lighter."""

from typing import Any, Final

GROUND, PANEL, EDGE = "#0D1217", "#151C23", "#26303A"
INK, DIM, FAINT = "#E9EEF2", "#9FADB9", "#5D6B77"
ASPHALT, ASPHALT_RAMP, LINE, BARRIER, GRID = "#222B33", "#2B3036", "#55626E", "#B9C4CD", "#222C35"
RAMP, TARGET, OTHER = "#F0A818", "#56B4E9", "#77848F"
TRUTH, CHOSEN, COMING = "#35D09C", "#FFFFFF", "#19222A"

DPI: Final = 100
RC: Final[dict[Any, Any]] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "text.color": INK,
    "axes.edgecolor": EDGE,
    "axes.labelcolor": DIM,
    "xtick.color": DIM,
    "ytick.color": DIM,
    "axes.facecolor": PANEL,
    "figure.facecolor": GROUND,
    "savefig.facecolor": GROUND,
    "lines.solid_capstyle": "butt",
    "hatch.linewidth": 0.9,
}
