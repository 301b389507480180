"""Checks of what a reader of a picture would see: nothing clipped, nothing on top of something else."""

import itertools

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text
from matplotlib.transforms import Bbox

SLACK = 1.5  # [pixel] boxes of text have some air


def draw(ax: Axes) -> None:
    """Draws the figure of the axes, so that all boxes are known."""
    FigureCanvasAgg(ax.get_figure(root=True)).draw()


def texts(ax: Axes) -> list[Text]:
    """Returns the texts of a drawn figure that can be seen."""
    figure = ax.get_figure(root=True)
    return [text for text in figure.findobj(Text) if text.get_visible() and text.get_text().strip()]


def legend_labels(ax: Axes) -> list[str]:
    """Returns the entries of the figure's or the axes' legend."""
    figure = ax.get_figure(root=True)
    legends = [*figure.legends, *([ax.get_legend()] if ax.get_legend() else [])]
    return [text.get_text() for legend in legends for text in legend.get_texts()]


def assert_readable(ax: Axes) -> None:
    """Asserts that no text is clipped by the figure's edge and that no two texts overlap."""
    draw(ax)
    figure = ax.get_figure(root=True)
    shown = [text for text in texts(ax) if not _is_hidden_tick(figure.axes, text)]
    for text in shown:
        box = text.get_window_extent()
        inside = box.x0 > -SLACK and box.y0 > -SLACK
        inside = inside and box.x1 < figure.bbox.x1 + SLACK and box.y1 < figure.bbox.y1 + SLACK
        assert inside, f"'{text.get_text()}' reaches beyond the figure: {box} in {figure.bbox}"
    for one, other in itertools.combinations(shown, 2):
        overlap = Bbox.intersection(one.get_window_extent(), other.get_window_extent())
        area = 0.0 if overlap is None else max(overlap.width - SLACK, 0.0) * max(overlap.height - SLACK, 0.0)
        assert area == 0.0, f"'{one.get_text()}' and '{other.get_text()}' overlap"


def _is_hidden_tick(axes: list[Axes], text: Text) -> bool:
    x, y = text.get_position()
    for ax in axes:
        for axis, (low, high), place in ((ax.xaxis, sorted(ax.get_xlim()), x), (ax.yaxis, sorted(ax.get_ylim()), y)):
            if text in [label for tick in axis.get_major_ticks() for label in (tick.label1, tick.label2)]:
                return not low <= place <= high
    return False
