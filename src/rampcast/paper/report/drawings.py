"""Drawings of the setting: the neighbours (Figure 1), the framework (Figure 2)."""

from matplotlib.axes import Axes
from matplotlib.patches import Circle, FancyArrowPatch, FancyBboxPatch, Polygon, Rectangle

from rampcast.plots import style

SEEN = "#CFE6F5"  # a pale sky blue: observed
PREDICTED = "#FBE3B0"  # a pale orange: predicted for neighbours
RESULT = "#BFE5D8"  # a pale green: results
PLAIN = "#F1F1F1"
ROAD = "#EFEFEF"
CAR = (0.72, 0.32)  # length and width in the drawing's units

NEIGHBOURS = (
    ("f2", 1.0, 1.0, "second follower"),
    ("f1", 3.0, 1.0, "first follower"),
    ("l1", 5.6, 1.0, "first leader"),
    ("l2", 7.6, 1.0, "second leader"),
    ("f", 1.9, 0.0, "follower"),
    ("i", 4.3, 0.0, "central vehicle"),
    ("l", 6.6, 0.0, "leader"),
)


@style.styled
def neighbour_geometry(*, ax: Axes | None = None) -> Axes:
    """Draws a central vehicle, its six neighbours and its actual leader (Figure 1) and returns the axes."""
    ax = ax or style.drawing_axes(7.4, x=(-0.35, 9.6), y=(-1.25, 1.95))
    ax.add_patch(Rectangle((0.2, -0.5), 9.0, 2.0, facecolor=ROAD, edgecolor="none"))
    ax.add_patch(Polygon([(8.2, -0.5), (9.2, 0.5), (9.2, -0.5)], facecolor="white", edgecolor="none"))
    ax.plot([0.2, 9.2], [1.5, 1.5], color=style.GREY, linewidth=1.4)
    ax.plot([0.2, 8.2, 9.2], [-0.5, -0.5, 0.5], color=style.GREY, linewidth=1.4)
    ax.plot([0.2, 9.2], [0.5, 0.5], color=style.GREY, linewidth=1.2, linestyle=(0, (6, 5)))
    for symbol, x, lane, text in NEIGHBOURS:
        central = symbol == "i"
        _car(ax, x, lane, symbol, color=style.VERMILLION if central else style.BLUE)
        ax.text(x, lane + (0.28 if lane else -0.28), text, ha="center", va="bottom" if lane else "top", fontsize=8)
    between = (0.5 * (5.6 + 6.6), 0.5)
    ax.plot([5.6, 6.6], [0.84, 0.16], color=style.BLACK, linewidth=0.9, linestyle=":")
    ax.add_patch(Circle(between, 0.17, facecolor="white", edgecolor=style.BLACK, linewidth=1.4, zorder=5))
    ax.text(*between, "m", ha="center", va="center", fontsize=9, zorder=6)
    ax.text(6.42, 0.53, "actual leader", ha="left", va="bottom", fontsize=8)
    ax.text(0.3, 1.56, "target lane (adjacent lane)", fontsize=8.5, color="#444444", va="bottom")
    ax.text(0.3, -0.56, "ramp lane", fontsize=8.5, color="#444444", va="top")
    ax.text(9.2, -0.56, r"ramp ends, $x_\mathrm{end}$", fontsize=8.5, color="#444444", va="top", ha="right")
    _arrow(ax, (3.2, -1.02), (6.0, -1.02))
    ax.text(6.1, -1.02, "travel, x grows [m]", va="center", fontsize=8.5)
    _arrow(ax, (-0.08, 0.0), (-0.08, 1.4))
    ax.text(-0.22, 0.7, "y grows [m]", rotation=90, ha="center", va="center", fontsize=8.5)
    return ax


@style.styled
def framework(*, ax: Axes | None = None) -> Axes:
    """Draws how the parts of the method feed each other (Figure 2) and returns the axes."""
    ax = ax or style.drawing_axes(7.4, x=(0.0, 10.2), y=(-0.75, 5.0))
    _box(ax, (0.1, 3.1, 2.1, 1.5), "Last 4 s of\nthe neighbours\n20 steps of 0.2 s", SEEN)
    _box(ax, (0.1, 0.9, 2.1, 1.5), "Last 4 s of the\ncentral vehicle\n20 steps of 0.2 s", SEEN)
    _box(ax, (2.9, 3.95, 2.0, 0.85), "LSTM for\nthe ramp lane", PLAIN)
    _box(ax, (2.9, 2.9, 2.0, 0.85), "LSTM for\nthe target lane", PLAIN)
    _box(ax, (5.5, 3.1, 1.9, 1.5), "Neighbours'\nnext 15 s", PREDICTED)
    _box(ax, (2.9, 1.25, 2.0, 0.95), "Car-following law\nfitted to the driver", PLAIN)
    _box(ax, (5.5, 1.25, 1.9, 0.95), "Roll-out behind\nthe actual leader", PLAIN)
    _box(ax, (8.0, 1.25, 2.1, 0.95), "x of the next 15 s", RESULT)
    _box(ax, (2.9, -0.55, 4.5, 0.85), "32 random forests on the state at t = 0 (42 features)", PLAIN)
    _box(ax, (8.0, -0.55, 2.1, 0.85), "Lane change within t\nor at t, 0 to 15 s", RESULT)
    for y in (4.37, 3.32):
        _arrow(ax, (2.2, 3.85), (2.9, y))
        _arrow(ax, (4.9, y), (5.5, 3.85))
    _arrow(ax, (2.2, 3.2), (2.9, 2.05))
    _arrow(ax, (2.2, 1.7), (2.9, 1.7))
    _arrow(ax, (4.9, 1.7), (5.5, 1.7))
    _arrow(ax, (6.45, 3.1), (6.45, 2.2))
    _arrow(ax, (7.4, 1.7), (8.0, 1.7))
    _arrow(ax, (1.15, 0.9), (2.9, -0.1))
    _arrow(ax, (2.1, 3.1), (3.2, 0.3))
    _arrow(ax, (7.4, -0.1), (8.0, -0.1))
    for i, (text, color) in enumerate((("observed", SEEN), ("predicted", PREDICTED), ("result", RESULT))):
        ax.add_patch(Rectangle((8.0, 4.5 - 0.42 * i), 0.3, 0.26, facecolor=color, edgecolor=style.GREY, linewidth=0.8))
        ax.text(8.45, 4.63 - 0.42 * i, text, fontsize=8.5, va="center")
    return ax


def _car(ax: Axes, x: float, y: float, symbol: str, *, color: str) -> None:
    corner = (x - CAR[0] / 2, y - CAR[1] / 2)
    box = FancyBboxPatch(
        corner, *CAR, boxstyle="round,pad=0,rounding_size=0.1", facecolor=color, edgecolor="none", zorder=4
    )
    ax.add_patch(box)
    ax.text(x, y, symbol, color="white", ha="center", va="center", fontsize=9.5, fontweight="bold", zorder=5)


def _box(ax: Axes, place: tuple[float, float, float, float], text: str, color: str) -> None:
    x, y, width, height = place
    shape = "round,pad=0,rounding_size=0.12"
    patch = FancyBboxPatch((x, y), width, height, boxstyle=shape, facecolor=color, edgecolor=style.GREY, linewidth=1.0)
    ax.add_patch(patch)
    ax.text(x + width / 2, y + height / 2, text, ha="center", va="center", fontsize=8.5, linespacing=1.35)


def _arrow(ax: Axes, start: tuple[float, float], end: tuple[float, float]) -> None:
    arrow = FancyArrowPatch(start, end, arrowstyle="-|>", mutation_scale=10, color="#333333", linewidth=1.2)
    arrow.shrinkA = arrow.shrinkB = 0.0
    ax.add_patch(arrow)
