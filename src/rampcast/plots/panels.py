"""Several panels in one figure, with one legend for all of them."""

from collections.abc import Callable, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rampcast.plots import style

COLUMNS = 3
WIDTH = 3.15  # [inch] of the axes of a panel
ABOVE, BETWEEN = 0.3, 0.12  # [inch] for the title of a panel, and below its labels
Draw = Callable[[Axes], object]


@style.styled
def panels(draws: Sequence[tuple[str, Draw]], *, height: float = 2.1) -> Figure:
    """Returns a figure of panels in rows of three; the legend stands in free cells if there are some, or below.

    Args:
        draws: title of each panel, and what draws into its axes.
        height: of the axes [inch].
    """
    columns = max(min(COLUMNS, len(draws)), 1)
    rows = max(-(-len(draws) // columns), 1)
    figure = Figure()
    axes: list[Axes] = []
    handles: dict[str, Any] = {}
    for title, draw in draws:
        ax = figure.add_axes((0.0, 0.0, 1.0, 1.0), label=title)
        draw(ax)
        ax.set_title(title)
        handles |= _taken_legend(ax)
        axes.append(ax)
    free = rows * columns - len(draws)
    cell = style.LEFT + WIDTH + style.RIGHT, ABOVE + height + style.BELOW + BETWEEN
    legend_columns = 1 if free == 1 else columns
    legend = 0.0 if free else 0.1 + style.LEGEND_ROW * -(-len(handles) // legend_columns)
    wide, high = columns * cell[0], rows * cell[1] + legend
    figure.set_size_inches(wide, high)
    for number, ax in enumerate(axes):
        row, column = divmod(number, columns)
        x, y = column * cell[0] + style.LEFT, high - (row + 1) * cell[1] + style.BELOW + BETWEEN
        ax.set_position((x / wide, y / high, WIDTH / wide, height / high))
    if handles:
        _draw_legend(figure, handles, free=free, columns=columns, place=(cell[0] / wide, cell[1] / high))
    return figure


def _taken_legend(ax: Axes) -> dict[str, Any]:
    """Returns what the legend of a panel says, and takes it away."""
    handles, labels = ax.get_legend_handles_labels()
    if (legend := ax.get_legend()) is not None:
        legend.remove()
    return dict(zip(labels, handles, strict=True))


def _draw_legend(
    figure: Figure, handles: dict[str, Any], *, free: int, columns: int, place: tuple[float, float]
) -> None:
    """Draws the legend into the last free cells of the last row, or below; `place` is the size of a cell."""
    entries = (list(handles.values()), list(handles))
    if free:
        corner = ((columns - free) * place[0], place[1])
        figure.legend(*entries, loc="upper left", bbox_to_anchor=corner, ncols=min(free, 2), borderaxespad=1.5)
    else:
        figure.legend(*entries, loc="lower center", ncols=columns, borderaxespad=0.2)
