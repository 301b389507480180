"""The road from above in a film: lanes, vehicles to scale, ghosts and bands of what is forecast, what came true."""

from typing import Any

import numpy as np
import polars as pl
from jaxtyping import Float
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.patches import Rectangle

from rampcast.forecast import Forecast
from rampcast.horizon import STEPS_PER_SECOND
from rampcast.plots.film import look
from rampcast.plots.film.story import Story
from rampcast.plots.style import figure_of
from rampcast.sites.site import LANE_WIDTH
from rampcast.traffic import Traffic

GHOSTS = (5, 10)  # [s]
LEVELS = (0.05, 0.25, 0.5, 0.75, 0.95)
TAPER = 0.75  # of the way from gore to end the ramp lane keeps its width; the site file of I-80 says so of its twin
SHOWN_SHARE = 0.08  # of the futures, below which a ghost is not drawn
UNKNOWN = (4.5, 1.8)  # [m] length and width of a drawn vehicle whose own are not known


def draw_ground(ax: Axes, story: Story) -> None:
    """Draws what stays: lanes, lines, the ramp."""
    site = story.site
    ys = []
    for number in story.lanes:
        if number in site.ramp_lanes:
            continue
        centre = site.lane_centre(number)
        low, high = centre - LANE_WIDTH / 2, centre + LANE_WIDTH / 2
        ax.fill_between([0.0, site.length], low, high, color=look.ASPHALT, linewidth=0)
        ys += [low, high]
    for y in sorted({round(y, 1) for y in ys}):
        ax.plot([0.0, site.length], [y, y], color=look.LINE, linewidth=0.8, dashes=(4, 12), zorder=1)
    if site.has_ramp:
        _draw_ramp(ax, story)


def _draw_ramp(ax: Axes, story: Story) -> None:
    site = story.site
    half = LANE_WIDTH / 2
    end = min(site.ramp_end, site.length)
    taper = end if site.ramp_goes_on else site.gore + TAPER * (end - site.gore)
    x = np.append(np.arange(0.0, site.gore, 10.0), [site.gore, taper, end])
    line = float(site.lane_line_y(np.array([site.gore]))[0])
    middle = np.interp(x, *story.ramp_path)
    upper = np.where(x < site.gore, np.minimum(middle + half, line), line)
    lower = np.where(x < end, middle - half, middle - half if site.ramp_goes_on else line)
    ax.fill_between(x, lower, upper, color=look.ASPHALT_RAMP, linewidth=0, zorder=0.5)
    ax.plot(x, lower, color=look.BARRIER, linewidth=1.1, zorder=1)
    before = x <= site.gore
    ax.plot(x[before], upper[before], color=look.BARRIER, linewidth=1.1, zorder=1)
    for bounds, style in (((0.0, site.gore), "-"), ((site.gore, end), (0, (4, 4))), ((end, site.length), "-")):
        ax.plot(bounds, (line, line), color=look.BARRIER, linewidth=1.1, linestyle=style, zorder=1.1)


class RoadPanel:
    """The panel; what moves in it is drawn anew for each frame."""

    def __init__(self, ax: Axes, story: Story, view: tuple[float, float]) -> None:
        self.ax, self.story = ax, story
        site = story.site
        low = min(lane.centre for lane in site.lanes)
        low = min(low, float(story.ramp_path[1].min())) if site.has_ramp else low
        ax.set_xlim(*view)
        ax.set_ylim(low - LANE_WIDTH, max(site.lane_centre(number) for number in story.lanes) + LANE_WIDTH / 2)
        draw_ground(ax, story)
        self._mark_places(view)
        box, (width, height) = ax.get_position(), figure_of(ax).get_size_inches()
        across = (ax.get_ylim()[1] - ax.get_ylim()[0]) / (box.height * height)
        self.stretch = across / ((view[1] - view[0]) / (box.width * width))  # so that vehicles keep their shape

    def _mark_places(self, view: tuple[float, float]) -> None:
        site, ax = self.story.site, self.ax
        marks = [(site.gore, f"gore {site.gore:.0f} m")] if site.has_ramp else []
        if site.has_ramp and not site.ramp_goes_on:
            marks.append((site.ramp_end, f"ramp ends {site.ramp_end:.0f} m"))
        ticks = [x for x in np.arange(0.0, site.length + 1.0, 50.0) if all(abs(x - mark) > 22.0 for mark, _ in marks)]
        inside = [(x, text) for x, text in [*((x, f"{x:.0f} m") for x in ticks), *marks] if view[0] <= x <= view[1]]
        ax.set_xticks([x for x, _ in inside], [text for _, text in inside])
        ax.set_yticks([])
        ax.tick_params(length=3)
        for side in ax.spines.values():
            side.set_visible(False)

    def draw(self, traffic: Traffic, forecast: Forecast, shown: list[int], chosen: int | None) -> list[Artist]:
        """Draws a moment and returns what it drew.

        Args:
            traffic: who is there.
            forecast: of them.
            shown: places in the forecast of those whose bands and ghosts are drawn.
            chosen: the place of the one that is marked; None for nobody.
        """
        drawn: list[Artist] = []
        if shown:
            quantiles = forecast.quantiles(LEVELS)
            for row in shown:
                drawn += self._gap(traffic, forecast, row)
                for ahead in reversed(GHOSTS):
                    step = ahead * STEPS_PER_SECOND - 1
                    drawn += self._ghosts(forecast, row, step, quantiles[row, step], named=row == chosen)
                    drawn += self._truth(forecast, row, ahead)
        return [*drawn, *self._vehicles(traffic, None if chosen is None else forecast.vehicle[chosen])]

    def _vehicles(self, traffic: Traffic, chosen: object) -> list[Artist]:
        length = np.where(np.isfinite(traffic.length), traffic.length, UNKNOWN[0])
        width = np.where(np.isfinite(traffic.width), traffic.width, UNKNOWN[1]) * self.stretch
        x, y = traffic.x[:, -1], traffic.y[:, -1]
        colours = [self._colour(lane) for lane in traffic.lane.tolist()]
        edges = [look.CHOSEN if one == chosen else "none" for one in traffic.vehicle.tolist()]
        drawn = [
            self._boxes(x, y, length, width, facecolors=colours, edgecolors=edges, linewidths=1.6, zorder=4),
            self._boxes(
                x - 0.2 * length, y, 0.14 * length, 0.8 * width, facecolors=look.ASPHALT, alpha=0.6, zorder=4.1
            ),
        ]
        for row in np.flatnonzero(traffic.vehicle == chosen):
            place = (x[row] - length[row] / 2, y[row] - width[row] / 2 - 0.5)
            drawn.append(self.ax.text(*place, str(chosen), ha="center", va="top", fontsize=8.5, fontweight="bold"))
        return drawn

    def _boxes(self, front: Any, y: Any, length: Any, width: Any, **looks: Any) -> Artist:
        """Draws rectangles, whose fronts are given."""
        corners = rectangles(np.atleast_1d(front), np.atleast_1d(y), np.atleast_1d(length), np.atleast_1d(width))
        return self.ax.add_collection(PolyCollection(list(corners), **looks))

    def _colour(self, lane: int) -> str:
        site = self.story.site
        return look.RAMP if lane in site.ramp_lanes else look.TARGET if lane == site.target_lane else look.OTHER

    def _ghosts(
        self, forecast: Forecast, row: int, step: int, levels: Float[np.ndarray, "level"], *, named: bool
    ) -> list[Artist]:
        """Draws where a vehicle may be at the end of a step, in each lane as strongly as it is likely."""
        site = self.story.site
        colour = self._colour(int(forecast.start_lane[row]))
        length = forecast.length[row] if np.isfinite(forecast.length[row]) else UNKNOWN[0]
        width = UNKNOWN[1] * self.stretch
        style: Any = "-" if step < GHOSTS[0] * STEPS_PER_SECOND else (0, (2, 1.4))
        outline: dict[str, Any] = {"edgecolors": colour, "linewidths": 1.4, "linestyles": [style], "zorder": 3}
        drawn: list[Artist] = []
        for y, share in self._branches(forecast, row, step, float(levels[2])):
            strength = 0.25 + 0.75 * share
            last = site.ramp_end if y != site.lane_centre(site.target_lane) else np.inf
            for (low, high), thick, alpha in ((levels[[0, 4]], 1.3, 1.0), (levels[[1, 3]], 6.0, 0.5)):
                bar: dict[str, Any] = {"color": colour, "linewidth": thick, "alpha": alpha * strength, "zorder": 2}
                drawn += self.ax.plot([low, min(high, last)], [y, y], **bar)
            drawn.append(self._boxes(levels[2], y, length, width, facecolors=look.ASPHALT, alpha=strength, **outline))
            if named and share >= 0.5:
                place = (levels[2] - length / 2, y + width / 2 + 0.5)
                words = f"+{(step + 1) // STEPS_PER_SECOND} s"
                drawn.append(self.ax.text(*place, words, ha="center", va="bottom", fontsize=8, zorder=5))
        return drawn

    def _gap(self, traffic: Traffic, forecast: Forecast, row: int) -> list[Artist]:
        """Shades, in the target lane, what lies now between those between whom it most likely merges."""
        gaps = forecast.gap.filter(pl.col("vehicle") == forecast.vehicle[row])
        if not len(gaps):
            return []
        site, there = self.story.site, {one: place for place, one in enumerate(traffic.vehicle.tolist())}
        ahead, behind = (there.get(gaps[side][0]) for side in ("ahead", "behind"))
        low = 0.0 if behind is None else float(traffic.x[behind, -1])
        high = site.length if ahead is None else float(traffic.x[ahead, -1] - traffic.length[ahead])
        if not high > low:
            return []
        y = site.lane_centre(site.target_lane) - 0.45 * LANE_WIDTH
        strength = 0.2 + 0.6 * float(gaps["p"][0])
        kind: dict[str, Any] = {"facecolor": "none", "edgecolor": look.RAMP, "hatch": "////", "linewidth": 0.0}
        return [
            self.ax.add_patch(Rectangle((low, y), high - low, 0.9 * LANE_WIDTH, **kind, alpha=strength, zorder=1.5))
        ]

    def _branches(self, forecast: Forecast, row: int, step: int, x: float) -> list[tuple[float, float]]:
        """Returns the lateral places that it may be at, each with its share of the futures."""
        site = self.story.site
        if not forecast.on_ramp[row]:
            lane = int(forecast.start_lane[row])
            return [(site.lane_centre(lane), 1.0)] if lane in {one.number for one in site.lanes} else []
        p = float(forecast.p_merged[row, step])
        found = [(site.lane_centre(site.target_lane), p)]
        if x < site.ramp_end:
            found.append((float(np.interp(x, *self.story.ramp_path)), 1.0 - p))
        return [(y, share) for y, share in found if share > SHOWN_SHARE]

    def _truth(self, forecast: Forecast, row: int, ahead: int) -> list[Artist]:
        came = self.story.came(forecast.vehicle[row], forecast.t0 + ahead)
        if came is None:
            return []
        x, lane = came
        site = self.story.site
        y = float(np.interp(x, *self.story.ramp_path)) if lane in site.ramp_lanes else site.lane_centre(lane)
        mark: dict[str, Any] = {
            "marker": "D",
            "s": 30,
            "facecolors": "none",
            "edgecolors": look.TRUTH,
            "linewidths": 1.6,
        }
        return [self.ax.scatter([x], [y], **mark, zorder=5)]


def rectangles(
    front: Float[np.ndarray, "vehicle"],
    y: Float[np.ndarray, "vehicle"],
    length: Float[np.ndarray, "vehicle"],
    width: Float[np.ndarray, "vehicle"],
) -> Float[np.ndarray, "vehicle 4 2"]:
    """Returns the corners of vehicles, whose fronts are given."""
    back, low, high = front - length, y - width / 2, y + width / 2
    return np.stack(
        [np.stack(corner, axis=-1) for corner in ((back, low), (front, low), (front, high), (back, high))], 1
    )
