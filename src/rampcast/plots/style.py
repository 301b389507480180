"""How every figure looks: palette, line styles, sizes, and the checks and files that all figures share.

Figures are made with matplotlib's object interface; pyplot and its global state are never touched.
"""

import io
import itertools
from collections.abc import Callable, Sequence
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import matplotlib as mpl
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from rampcast.errors import RampcastError
from rampcast.forecasters import FORECASTERS
from rampcast.forecasters import in_order as in_order
from rampcast.forecasters import label as label
from rampcast.looks import BLACK as BLACK
from rampcast.looks import BLUE as BLUE
from rampcast.looks import GREEN as GREEN
from rampcast.looks import GREY as GREY
from rampcast.looks import INDIGO as INDIGO
from rampcast.looks import ORANGE as ORANGE
from rampcast.looks import PURPLE as PURPLE
from rampcast.looks import SKY as SKY
from rampcast.looks import VERMILLION as VERMILLION
from rampcast.looks import Look as Look

PANEL_WIDTH = 4.8  # [inch] two fit side by side on a page of 1,000 px, one fills a phone
PANEL_HEIGHT = 2.75  # [inch] of the axes with their labels; title and legend come on top
LEGEND_ROW = 0.19  # [inch] height of one row of a legend
LETTER, HANDLE = 0.063, 0.62  # [inch] mean width of a letter of a legend, and of a handle with its spaces
TITLE_HEIGHT = 0.25  # [inch]
LEFT, RIGHT, BELOW, ABOVE = 0.68, 0.16, 0.5, 0.1  # [inch] margins around the axes of a panel
OWN_FIGURE = "panel"  # label of axes that have their figure to themselves

RC: dict[Any, Any] = {
    "font.family": "DejaVu Sans",  # ships with matplotlib: the same picture on every machine
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "legend.handlelength": 3.2,
    "legend.columnspacing": 1.4,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#E3E3E3",
    "grid.linewidth": 0.7,
    "lines.linewidth": 1.5,
    "lines.markersize": 4.0,
    "svg.fonttype": "path",
    "svg.hashsalt": "rampcast",  # the same table gives the same bytes
    "mathtext.fontset": "dejavusans",
}

P = ParamSpec("P")
R = TypeVar("R")


OTHER_LOOKS = tuple(
    Look(color, marker, dash)
    for marker, dash in (("<", (0, (1, 1))), (">", (0, (4, 2, 1, 2))), ("*", (0, (8, 2))), ("p", "--"))
    for color in (GREY, SKY, PURPLE, GREEN, BLUE)
)
MODE_TITLES = {"paper": "paper mode", "corrected": "corrected mode"}
MODES = ("paper", "corrected")


def styled(draw: Callable[P, R]) -> Callable[P, R]:
    """Returns a function that draws with the house style, whatever the caller's settings are."""

    @wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> R:
        with mpl.rc_context(RC):
            return draw(*args, **kwargs)

    return drawn


def new_axes(width: float = PANEL_WIDTH, height: float = PANEL_HEIGHT) -> Axes:
    """Returns empty axes on a figure of its own, with the same margins in every panel; sizes in [inch]."""
    figure = Figure(figsize=(width, height))
    place = (LEFT / width, BELOW / height, 1.0 - (LEFT + RIGHT) / width, 1.0 - (BELOW + ABOVE) / height)
    return figure.add_axes(place, label=OWN_FIGURE)


def figure_of(ax: Axes) -> Figure:
    """Returns the figure that the axes belong to."""
    figure = ax.get_figure(root=True)
    if figure is None:
        raise RampcastError("these axes belong to no figure; make them with Figure().add_subplot()")
    return figure


def svg_of(figure: Figure) -> bytes:
    """Returns a figure as an svg in which nothing tells when and by what it was made."""
    buffer = io.BytesIO()
    with mpl.rc_context(RC):
        figure.savefig(buffer, format="svg", metadata=dict.fromkeys(("Creator", "Date", "Format", "Type")))
    return buffer.getvalue()


def looks(names: Sequence[str]) -> dict[str, Look]:
    """Returns the look of each model, in order: its own, or the next free one for a model that has none."""
    free = itertools.cycle(OTHER_LOOKS)
    own = {name: FORECASTERS[name].look if name in FORECASTERS else None for name in in_order(names)}
    return {name: look or next(free) for name, look in own.items()}


def require(table: pl.DataFrame, columns: Sequence[str], *, name: str) -> None:
    """Checks that a tidy table has the columns a figure draws from.

    Raises:
        RampcastError: some are missing.
    """
    missing = [column for column in columns if column not in table.columns]
    if missing:
        raise RampcastError(f"the table '{name}' lacks the columns {missing}; it has {table.columns}")


def single(table: pl.DataFrame, column: str, *, name: str) -> str | None:
    """Returns the one value of a column that a panel may hold only once (None for a table without rows).

    Raises:
        RampcastError: the column holds several values.
    """
    values = table[column].unique().sort().to_list()
    if len(values) > 1:
        raise RampcastError(f"one panel draws one {column}, the table '{name}' holds {values}; filter it first")
    return str(values[0]) if values else None


def legend_below(ax: Axes, *, columns: int = 3) -> None:
    """Puts the legend under the axes; a figure that holds nothing else grows by what the legend needs."""
    handles, labels = ax.get_legend_handles_labels()
    if not handles:
        ax.text(0.5, 0.5, "no data", transform=ax.transAxes, ha="center", va="center", color=GREY)
        return
    columns = _columns_that_fit(labels, min(columns, len(handles)), figure_of(ax).get_size_inches()[0])
    if ax.get_label() == OWN_FIGURE:
        grow(ax, below=LEGEND_ROW * -(-len(handles) // columns) + 0.1)
        figure_of(ax).legend(handles, labels, loc="lower center", ncols=columns, borderaxespad=0.1)
    else:
        ax.legend(handles, labels, loc="upper left", bbox_to_anchor=(0.0, -0.22), ncols=columns, borderaxespad=0.0)


def _columns_that_fit(labels: Sequence[str], columns: int, width: float) -> int:
    """Returns how many columns of a legend fit into a width [inch], at most `columns`."""
    while columns > 1:
        rows = -(-len(labels) // columns)
        longest = [max(map(len, labels[first : first + rows])) for first in range(0, len(labels), rows)]
        if sum(LETTER * letters + HANDLE for letters in longest) <= width:
            break
        columns -= 1
    return columns


def add_title(ax: Axes, text: str) -> None:
    """Puts a title above axes that have their figure to themselves, which grows by what the title needs."""
    grow(ax, above=TITLE_HEIGHT)
    ax.set_title(text)


def grow(ax: Axes, *, below: float = 0.0, above: float = 0.0) -> None:
    """Makes the figure higher [inch] and leaves the axes in it as they are."""
    figure = figure_of(ax)
    width, height = figure.get_size_inches()
    taller = height + below + above
    place = ax.get_position()
    figure.set_size_inches(width, taller)
    ax.set_position((place.x0, (place.y0 * height + below) / taller, place.width, place.height * height / taller))


def seconds_axis(ax: Axes, text: str, *, last: float = 15.0, first: float = 1.0) -> None:
    """Labels the horizontal axis as a time [s] from `first` to `last`, with ticks at whole seconds."""
    ax.set_xlabel(text)
    ax.set_xlim(first - 0.5, last + 0.5)
    ax.set_xticks(range(round(first), round(last) + 1, 2 if first else 3))


def percent_axis(ax: Axes, text: str) -> None:
    """Labels the vertical axis as a percentage from 0 to 100."""
    ax.set_ylabel(text)
    ax.set_ylim(-3, 103)
    ax.set_yticks(range(0, 101, 20))


def from_zero(ax: Axes) -> None:
    """Starts the vertical axis at 0 (or below, where data lie there) and leaves air above."""
    low, high = ax.dataLim.y0, ax.dataLim.y1
    if low <= high < float("inf"):
        ax.set_ylim(min(0.0, low * 1.06), high * 1.06 if high > 0 else 1.0)
    ax.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))


def share_height(axes: Sequence[Axes]) -> None:
    """Gives panels that are read against each other the same vertical range."""
    if axes:
        low = min(ax.get_ylim()[0] for ax in axes)
        high = max(ax.get_ylim()[1] for ax in axes)
        for ax in axes:
            ax.set_ylim(low, high)
