"""The lower panels of a film: place over time with what comes, and when those who are next merge."""

from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from rampcast.forecast import Forecast
from rampcast.horizon import STEP
from rampcast.plots.film import look
from rampcast.plots.film.road import LEVELS
from rampcast.plots.film.story import Story

PAST = 60.0  # [s]
COMES = 15.0  # [s]
ROWS = 4  # ramp vehicles whose probability is drawn
HORIZON = STEP * np.arange(0, round(COMES / STEP) + 1)


class SpaceTimePanel:
    """Place over time: on the left what was seen, on the right, on a scale of its own, what is forecast."""

    def __init__(self, past: Axes, coming: Axes, story: Story) -> None:
        self.past, self.coming, self.story = past, coming, story
        past.set_xlim(-PAST, 0.0)
        coming.set_xlim(0.0, COMES)
        coming.set_facecolor(look.COMING)
        past.set_xticks([-60, -45, -30, -15, 0], ["−60 s", "−45 s", "−30 s", "−15 s", "now"])
        coming.set_xticks([5, 10, 15], ["+5 s", "+10 s", "+15 s"])
        coming.get_xticklabels()[-1].set_horizontalalignment("right")
        coming.set_yticks([])
        past.set_yticks(np.arange(0.0, story.site.length + 1.0, 100.0))
        past.set_ylabel("place [m]", labelpad=2)
        for ax in (past, coming):
            ax.set_ylim(0.0, story.site.length)
            ax.tick_params(length=2)
            ax.grid(visible=True, color=look.GRID, linewidth=0.6)
            for mark in (story.site.gore, story.site.ramp_end) if story.site.has_ramp else ():
                ax.axhline(mark, color=look.FAINT, linewidth=0.8, linestyle=(0, (4, 3)))

    def draw(self, forecast: Forecast, chosen: int | None) -> list[Artist]:
        """Draws a moment and returns what it drew."""
        return [*self._draw_past(forecast.t0), *self._draw_coming(forecast, chosen)]

    def _draw_past(self, t0: float) -> list[Artist]:
        site = self.story.site
        lines: dict[str, list[Float[np.ndarray, "point 2"]]] = {look.TARGET: [], look.RAMP: []}
        for track in self.story.tracks.values():
            first, last = np.searchsorted(track.t, (t0 - PAST, t0 + 1e-6))
            if last - first < 2:
                continue
            rows = slice(first, last, 5) if last - first > 10 else slice(first, last)
            points = np.column_stack([track.t[rows] - t0, track.x[rows]])
            on_ramp = site.on_ramp(track.lane[rows])
            lines[look.RAMP].append(np.where(on_ramp[:, None], points, np.nan))
            in_target = track.lane[rows] == site.target_lane
            lines[look.TARGET].append(np.where(in_target[:, None], points, np.nan))
        drawn: list[Artist] = [
            self.past.add_collection(LineCollection(some, colors=colour, linewidths=0.8, alpha=0.75))
            for colour, some in lines.items()
        ]
        merges = np.array([(t - t0, x) for t, x in self.story.merges if t0 - PAST < t <= t0]).reshape(-1, 2)
        mark: dict[str, Any] = {"s": 14, "color": look.RAMP, "edgecolors": look.INK, "linewidths": 0.8, "zorder": 4}
        return [*drawn, self.past.scatter(*merges.T, **mark)]

    def _draw_coming(self, forecast: Forecast, chosen: int | None) -> list[Artist]:
        in_target = forecast.start_lane == self.story.site.target_lane
        drawn: list[Artist] = []
        for rows, colour in ((in_target, look.TARGET), (forecast.on_ramp, look.RAMP)):
            medians = np.column_stack([forecast.start[rows], forecast.median[rows]])
            lines = [np.column_stack([HORIZON, line]) for line in medians]
            drawn.append(self.coming.add_collection(LineCollection(lines, colors=colour, linewidths=0.8, alpha=0.75)))
        if chosen is not None:
            drawn += self._draw_chosen(forecast, chosen)
        return drawn

    def _draw_chosen(self, forecast: Forecast, row: int) -> list[Artist]:
        start = np.repeat(forecast.start[row], len(LEVELS))
        bands = np.vstack([start, forecast.quantiles(LEVELS)[row]])
        colour = look.RAMP if forecast.on_ramp[row] else look.TARGET
        drawn: list[Artist] = [
            self.coming.fill_between(HORIZON, bands[:, low], bands[:, high], color=colour, alpha=alpha, linewidth=0)
            for low, high, alpha in ((0, 4, 0.22), (1, 3, 0.4))
        ]
        drawn += self.coming.plot(HORIZON, bands[:, 2], color=look.CHOSEN, linewidth=1.8)
        track = self.story.tracks.get(forecast.vehicle[row])
        if track is not None:
            rows = (track.t >= forecast.t0) & (track.t <= forecast.t0 + COMES)
            dashes: dict[str, Any] = {"color": look.TRUTH, "linewidth": 1.8, "linestyle": (0, (3, 1.5))}
            drawn += self.coming.plot(track.t[rows] - forecast.t0, track.x[rows], **dashes)
        return drawn


class MergePanel:
    """Of those who merge next: when, and with which probability by then."""

    def __init__(self, ax: Axes) -> None:
        self.ax = ax
        ax.set_xlim(0.0, COMES)
        ax.set_ylim(-ROWS, 0.12)
        ax.set_yticks([])
        ax.set_xticks([0, 5, 10, 15], ["now", "+5 s", "+10 s", "+15 s"])
        sides: tuple[tuple[int, Literal["left", "right"]], ...] = ((0, "left"), (-1, "right"))
        for tick, side in sides:
            ax.get_xticklabels()[tick].set_horizontalalignment(side)
        ax.tick_params(length=2)
        for row in range(ROWS):
            ax.axhline(-row - 1, color=look.EDGE, linewidth=0.8)

    def draw(self, forecast: Forecast, order: list[int]) -> list[Artist]:
        """Draws a moment and returns what it drew; `order` are the places in the forecast of those who merge next."""
        drawn: list[Artist] = []
        for place, row in enumerate(order[:ROWS]):
            p = np.append(0.0, forecast.p_merged[row])
            base = -place - 1.0
            drawn.append(self.ax.fill_between(HORIZON, base, base + 0.72 * p, color=look.RAMP, alpha=0.25, linewidth=0))
            drawn += self.ax.plot(HORIZON, base + 0.72 * p, color=look.RAMP, linewidth=1.4)
            when = first_time(p)
            words = "not within 15 s" if when is None else f"in {when:.1f} s"
            if when is not None:
                drawn += self.ax.plot([when], [base + 0.36], "o", ms=4, color=look.RAMP, markeredgecolor=look.INK)
            kind: dict[str, Any] = {"fontsize": 8.5, "va": "center"}
            drawn.append(self.ax.text(0.25, base + 0.72, f"{forecast.vehicle[row]}", fontweight="bold", **kind))
            drawn.append(self.ax.text(2.4, base + 0.72, words, color=look.DIM if when is None else look.INK, **kind))
        return drawn


def first_time(p: Float[np.ndarray, "step"]) -> float | None:
    """Returns when a probability, told at `HORIZON`, reaches one half [s]; None where it does not."""
    reached = np.flatnonzero(p >= 0.5)
    return float(HORIZON[reached[0]]) if len(reached) else None
