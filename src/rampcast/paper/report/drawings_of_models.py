"""Drawings of two models: one cell of an LSTM (Figure 3), and how a random forest decides (Figure 4)."""

from matplotlib.axes import Axes
from matplotlib.patches import Circle, FancyArrowPatch, FancyBboxPatch

from rampcast.paper.report.drawings import PLAIN, PREDICTED, RESULT, SEEN
from rampcast.plots import style

GATES = (
    (2.6, r"$\sigma$", "forget"),
    (4.0, r"$\sigma$", "input"),
    (5.4, "tanh", "candidate"),
    (7.2, r"$\sigma$", "output"),
)
TREES = (  # per tree: left edge, depth, turns taken from the root (0 left, 1 right), its vote
    (0.2, 2, (0, 1), "yes"),
    (3.2, 3, (1, 0, 1), "no"),
    (6.9, 2, (1, 1), "yes"),
)
TREE_WIDTH = 2.6


@style.styled
def lstm_cell(*, ax: Axes | None = None) -> Axes:
    """Draws one cell of an LSTM with its three gates (Figure 3) and returns the axes."""
    ax = ax or style.drawing_axes(7.0, x=(-0.3, 10.5), y=(0.0, 4.7))
    ax.add_patch(_rounded(1.5, 0.75, 7.4, 3.75, PLAIN))
    _line(ax, [(0.6, 4.0), (9.75, 4.0)], arrow=True)  # the cell state runs straight through
    _line(ax, [(0.6, 1.1), (7.2, 1.1)])
    for x, text, name in GATES:
        _line(ax, [(x, 1.1), (x, 1.5)], arrow=True)
        ax.add_patch(_rounded(x - 0.45, 1.5, 0.9, 0.5, PREDICTED))
        ax.text(x, 1.75, text, ha="center", va="center", fontsize=10)
        ax.text(x + 0.1, 2.08, name, ha="left", va="bottom", fontsize=8)
    _line(ax, [(2.6, 2.0), (2.6, 3.8)], arrow=True)
    _line(ax, [(4.0, 2.0), (4.0, 2.9), (4.5, 2.9)], arrow=True)
    _line(ax, [(5.4, 2.0), (5.4, 2.9), (4.9, 2.9)], arrow=True)
    _line(ax, [(4.7, 3.1), (4.7, 3.8)], arrow=True)
    _line(ax, [(8.2, 4.0), (8.2, 3.55)], arrow=True)
    _line(ax, [(8.2, 3.05), (8.2, 2.8)], arrow=True)
    _line(ax, [(7.2, 2.0), (7.2, 2.6), (8.0, 2.6)], arrow=True)
    _line(ax, [(8.2, 2.4), (8.2, 1.1), (9.75, 1.1)], arrow=True)
    ax.add_patch(_rounded(7.75, 3.05, 0.9, 0.5, "white"))
    ax.text(8.2, 3.3, "tanh", ha="center", va="center", fontsize=10)
    for x, y, sign in ((2.6, 4.0, "×"), (4.7, 4.0, "+"), (4.7, 2.9, "×"), (8.2, 2.6, "×")):
        ax.add_patch(Circle((x, y), 0.2, facecolor="white", edgecolor=style.BLACK, linewidth=1.1, zorder=4))
        ax.text(x, y - 0.01, sign, ha="center", va="center", fontsize=11, zorder=5)
    _line(ax, [(2.0, 0.2), (2.0, 1.1)])
    ends = ((0.5, 4.0, r"$c_{t-1}$", "right"), (9.85, 4.0, r"$c_t$", "left"))
    for x, y, text, side in (*ends, (0.5, 1.1, r"$h_{t-1}$", "right"), (9.85, 1.1, r"$h_t$", "left")):
        ax.text(x, y, text, ha=side, va="center", fontsize=12)
    ax.text(2.12, 0.28, r"$x_t$: input of this step", fontsize=10, va="center")
    ax.text(1.7, 4.22, "cell state", fontsize=8, va="bottom", color="#444444")
    ax.text(8.95, 0.85, "hidden state", fontsize=8, va="top", color="#444444")
    return ax


@style.styled
def forest_decision(*, ax: Axes | None = None) -> Axes:
    """Draws how the trees of a random forest vote on one input (Figure 4) and returns the axes."""
    ax = ax or style.drawing_axes(7.0, x=(0.0, 9.8), y=(0.4, 6.1))
    _box(ax, (3.25, 5.4, 2.5, 0.55), "42 features at t = 0", SEEN)
    for i, (left, depth, turns, vote) in enumerate(TREES):
        middle = left + TREE_WIDTH / 2
        _line(ax, [(4.5, 5.4), (middle, 5.02)], arrow=True)
        leaf = _tree(ax, left, depth, turns)
        ax.text(left + 0.1, 4.75, f"tree {'N' if i == 2 else i + 1}", fontsize=9, ha="left")
        _line(ax, [(leaf[0], leaf[1] - 0.14), (leaf[0], 1.95)])
        _line(ax, [(leaf[0], 1.72), (leaf[0], 1.66), (4.5, 1.2)], arrow=True)
        ax.text(leaf[0], 1.83, vote, ha="center", va="center", fontsize=9, fontweight="bold")
    ax.text(6.35, 3.9, "· · ·", fontsize=16, ha="center", va="center")
    _box(ax, (2.85, 0.65, 3.3, 0.55), "share of the trees that vote yes", PLAIN)
    _line(ax, [(6.15, 0.92), (6.95, 0.92)], arrow=True)
    _box(ax, (6.95, 0.65, 2.75, 0.55), "changes lane, or does not", RESULT)
    return ax


def _tree(ax: Axes, left: float, depth: int, turns: tuple[int, ...]) -> tuple[float, float]:
    """Draws a tree and the path of the input through it; returns the place of the leaf that it reaches."""
    spots = {(0, 0): (left + TREE_WIDTH / 2, 4.88)}
    path, here = {(0, 0)}, 0
    for level, turn in enumerate(turns):
        here = 2 * here + turn
        path.add((level + 1, here))
    for level in range(1, depth + 1):
        for node in range(2**level):
            if level == 3 and node // 2 not in (2, 3):
                continue  # the deeper tree is deeper on one side only
            spots[level, node] = (left + TREE_WIDTH * (node + 0.5) / 2**level, 4.88 - 0.78 * level)
    for (level, node), (x, y) in spots.items():
        taken = (level, node) in path
        if level:
            start = spots[level - 1, node // 2]
            color, width = (style.VERMILLION, 2.0) if taken else (style.GREY, 0.9)
            ax.plot([start[0], x], [start[1], y], color=color, linewidth=width, zorder=1)
        face = style.VERMILLION if taken else "white"
        ax.add_patch(Circle((x, y), 0.13, facecolor=face, edgecolor="#444444", linewidth=1.0, zorder=3))
    return spots[len(turns), here]


def _rounded(x: float, y: float, width: float, height: float, color: str) -> FancyBboxPatch:
    shape = "round,pad=0,rounding_size=0.12"
    return FancyBboxPatch((x, y), width, height, boxstyle=shape, facecolor=color, edgecolor=style.GREY, linewidth=1.0)


def _box(ax: Axes, place: tuple[float, float, float, float], text: str, color: str) -> None:
    x, y, width, height = place
    ax.add_patch(_rounded(x, y, width, height, color))
    ax.text(x + width / 2, y + height / 2, text, ha="center", va="center", fontsize=9)


def _line(ax: Axes, points: list[tuple[float, float]], *, arrow: bool = False) -> None:
    xs, ys = zip(*(points[:-1] if arrow and len(points) > 2 else points), strict=True)
    if not arrow or len(points) > 2:
        ax.plot(xs, ys, color="#333333", linewidth=1.2, zorder=2)
    if arrow:
        head = FancyArrowPatch(
            points[-2], points[-1], arrowstyle="-|>", mutation_scale=9, color="#333333", linewidth=1.2
        )
        head.shrinkA = head.shrinkB = 0.0
        ax.add_patch(head)
