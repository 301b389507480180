"""A film of forecasts: for each moment a picture of the traffic, of what is forecast of it, and of what came true."""

from collections.abc import Hashable
from typing import Any

import matplotlib as mpl
import numpy as np
from jaxtyping import UInt8
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from rampcast.forecast import Forecast
from rampcast.plots.film import look
from rampcast.plots.film.panels import MergePanel, SpaceTimePanel, first_time
from rampcast.plots.film.road import RoadPanel
from rampcast.plots.film.story import Story
from rampcast.recording import Recording
from rampcast.traffic import Traffic

SIZE = (960, 540)  # pixels
SHOWN = 3  # ramp vehicles whose bands are drawn
UPSTREAM, VIEW = 0.4, 260.0  # of the view that lies before the gore; [m] of road that it shows


class Film:
    """Draws moments of a recording, one after the other, on the same figure."""

    def __init__(
        self, recording: Recording, *, vehicle: Hashable | None = None, size: tuple[int, int] = SIZE, model: str = ""
    ) -> None:
        """Prepares the figure.

        Args:
            recording: raw, of one window; what came true is taken from it.
            vehicle: that is marked and whose bands are drawn; None for the one that merges next.
            size: of a picture [pixels]; even numbers.
            model: its name, for the title.
        """
        self.story, self.vehicle, self._kept = Story(recording), vehicle, None
        self._model = model
        scale = size[1] / SIZE[1]
        with mpl.rc_context(look.RC):
            self.figure = Figure(
                figsize=(SIZE[0] / look.DPI * size[0] / size[1] * SIZE[1] / SIZE[0], SIZE[1] / look.DPI)
            )
            self.figure.set_dpi(look.DPI * scale)
            self.canvas = FigureCanvasAgg(self.figure)
            self._build()

    def _build(self) -> None:
        site = self.story.site
        add = self.figure.add_axes
        left = max(site.gore - UPSTREAM * VIEW, 0.0) if site.has_ramp else 0.0
        self.road = RoadPanel(add((0.012, 0.565, 0.976, 0.315)), self.story, (left, min(left + VIEW, site.length)))
        self.times = SpaceTimePanel(add((0.06, 0.065, 0.335, 0.39)), add((0.40, 0.065, 0.235, 0.39)), self.story)
        self.merges = MergePanel(add((0.66, 0.065, 0.328, 0.39)))
        words = self.figure.text
        self.title = words(0.012, 0.968, site.title, fontsize=12, fontweight="bold", va="top")
        self.clock = words(0.988, 0.968, "", fontsize=10.5, va="top", ha="right", color=look.DIM)
        words(0.06, 0.475, "Place over time: seen", fontsize=9, fontweight="bold", va="bottom")
        words(0.40, 0.475, "and forecast", fontsize=9, fontweight="bold", va="bottom")
        words(0.66, 0.475, "Probability to have merged", fontsize=9, fontweight="bold", va="bottom")
        self._legend()

    def _legend(self) -> None:
        marks: dict[str, dict[str, Any]] = {
            "on the ramp": {"marker": "s", "color": look.RAMP},
            "target lane": {"marker": "s", "color": look.TARGET},
            "median at +5 s, +10 s": {"marker": "s", "markerfacecolor": "none", "color": look.RAMP},
            "50 % and 90 % band": {"linestyle": "-", "color": look.RAMP, "linewidth": 2.2},
            "likeliest gap, hatched": {"marker": "$////$", "color": look.RAMP},
            "what came true": {"marker": "D", "markerfacecolor": "none", "color": look.TRUTH},
        }
        plain: dict[str, Any] = {"linestyle": "none", "markersize": 6}
        handles = [Line2D([], [], **(plain | kind), label=name) for name, kind in marks.items()]
        place: dict[str, Any] = {
            "loc": "upper left",
            "bbox_to_anchor": (0.006, 0.93),
            "ncols": len(handles),
            "frameon": False,
        }
        self.figure.legend(
            handles=handles, **place, fontsize=8, labelcolor=look.DIM, handletextpad=0.4, columnspacing=1.4
        )

    def draw(self, traffic: Traffic, forecast: Forecast) -> UInt8[np.ndarray, "height width 3"]:
        """Returns the picture of a moment: red, green and blue of each pixel."""
        order = self._order(forecast)
        chosen = self._chosen(forecast, order)
        shown = list(dict.fromkeys([*([] if chosen is None else [chosen]), *order[:SHOWN]]))
        with mpl.rc_context(look.RC):
            drawn: list[Artist] = self.road.draw(
                traffic, forecast, shown if self.vehicle is None else shown[:1], chosen
            )
            drawn += self.times.draw(forecast, chosen)
            drawn += self.merges.draw(forecast, order)
            minutes, seconds = divmod(round(forecast.t0, 1), 60.0)
            self.clock.set_text(f"{self._model}{int(minutes)}:{seconds:04.1f}")
            self.canvas.draw()  # type: ignore[no-untyped-call]
        picture = np.asarray(self.canvas.buffer_rgba())[:, :, :3].copy()  # type: ignore[no-untyped-call]
        for one in drawn:
            one.remove()
        return picture

    def _order(self, forecast: Forecast) -> list[int]:
        """Returns the places of the ramp vehicles, those first who merge first."""
        last = forecast.p_merged[:, -1]
        times = {
            int(row): first_time(np.append(0.0, forecast.p_merged[row])) for row in np.flatnonzero(forecast.on_ramp)
        }
        return sorted(
            times, key=lambda row: (99.0 - last[row] if times[row] is None else times[row], -forecast.start[row])
        )

    def _chosen(self, forecast: Forecast, order: list[int]) -> int | None:
        """Returns the place of the vehicle that is marked: who was told, or who merges next, until it is gone."""
        known = {vehicle: row for row, vehicle in enumerate(forecast.vehicle.tolist())}
        if self.vehicle is not None:
            return known.get(self.vehicle)
        kept = known.get(self._kept)
        if kept is None or not forecast.on_ramp[kept]:
            self._kept = forecast.vehicle[order[0]].item() if order else None
        return known.get(self._kept)
