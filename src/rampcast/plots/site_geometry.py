"""The drawing of a site in its own coordinates: its lanes, the ramp and the merge zone (the paper's Figure 5)."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from rampcast.plots import style
from rampcast.sites import Lane, Site
from rampcast.sites.site import LANE_WIDTH

RAMP, TARGET, ROAD, EXIT, SHOULDER = "#CFE6F5", "#DCDCDC", "#EFEFEF", "#F1F1F1", "#FAFAFA"
WIDEST = 5.0  # [m] of a lane in a drawing


@style.styled
def site_geometry(site: Site, *, ax: Axes | None = None) -> Axes:
    """Draws the lanes, the ramp and the merge zone of a site in its own coordinates (Figure 5) and returns the axes.

    Of a site without a ramp these are the lanes.
    """
    ax = ax or style.new_axes(width=7.4, height=3.1)
    edges = _edges(site)
    for lane in site.lanes:
        start, end = _extent(site, lane)
        low, high = edges[lane.number]
        fill = {"ramp": RAMP, "exit": EXIT, "shoulder": SHOULDER}.get(lane.role, ROAD)
        fill = TARGET if lane.number == site.target_lane else fill
        ax.add_patch(Rectangle((start, low), end - start, high - low, facecolor=fill, edgecolor="white", linewidth=1.2))
        ax.text(site.length * 0.006 + start, lane.centre, _lane_text(site, lane), fontsize=7.5, va="center")
    bottom, top = min(low for low, _ in edges.values()), max(high for _, high in edges.values())
    if site.has_ramp:
        _mark_ramp(ax, site, bottom, top)
    ax.set_xlim(-0.01 * site.length, 1.01 * site.length)
    ax.set_ylim(bottom - 1.0, top + (0.27 * (top - bottom) if site.has_ramp else 1.0))
    ax.set(xlabel="position x along the road, travel to the right [m]", ylabel="lateral position y [m]")
    ax.grid(visible=False)
    return ax


def _mark_ramp(ax: Axes, site: Site, bottom: float, top: float) -> None:
    end = min(site.ramp_end, site.length)
    before, beside = (np.linspace(*bounds, 50) for bounds in ((_known_from(site), site.gore), (site.gore, end)))
    ax.plot(before, site.lane_line_y(before), color=style.BLACK, linewidth=1.6, label="may not be crossed")
    ax.plot(beside, site.lane_line_y(beside), color=style.BLACK, linewidth=1.6, linestyle=(0, (4, 3)), label="merging")
    if not np.isnan(site.merge_zone[0]):
        _mark_merge_zone(ax, site.merge_zone, bottom, top)
    end_text = ("ramp lane goes on", "right") if site.ramp_goes_on else (f" ramp ends {site.ramp_end:.0f} m", "left")
    is_near = site.gore < 0.12 * site.length  # no room for its name on the left
    gore_text = (f" gore {site.gore:.0f} m", "left") if is_near else (f"gore {site.gore:.0f} m ", "right")
    for x, text, side in ((site.gore, *gore_text), (end, *end_text)):
        if x < site.length:
            ax.plot([x, x], [bottom, top], color=style.VERMILLION, linewidth=1.2, linestyle=(0, (1, 1.5)))
        ax.text(x, top + 0.02 * (top - bottom), text, fontsize=8, ha=side, va="bottom", color="#8A3B00")


def _mark_merge_zone(ax: Axes, zone: tuple[float, float], bottom: float, top: float) -> None:
    start, end = zone
    ax.add_patch(Rectangle((start, bottom), end - start, top - bottom, facecolor=style.ORANGE, alpha=0.18))
    high = top + 0.13 * (top - bottom)
    ax.annotate(
        "", (start, high), (end, high), arrowprops={"arrowstyle": "<->", "color": style.ORANGE, "linewidth": 1.4}
    )
    text = f"merge zone {start:.0f} to {end:.0f} m"
    ax.text(0.5 * (start + end), high + 0.03 * (top - bottom), text, fontsize=8.5, ha="center", va="bottom")


def _edges(site: Site) -> dict[int, tuple[float, float]]:
    centres = sorted({lane.centre for lane in site.lanes})
    widths = np.minimum(np.diff(centres), WIDEST)  # lanes that are farther apart have something between them
    first, last = (widths[0], widths[-1]) if len(widths) else (LANE_WIDTH, LANE_WIDTH)
    sides = zip(centres, [first, *widths], [*widths, last], strict=True)
    bounds = {centre: (centre - below / 2, centre + above / 2) for centre, below, above in sides}
    return {lane.number: bounds[lane.centre] for lane in site.lanes}


def _extent(site: Site, lane: Lane) -> tuple[float, float]:
    """Returns where a lane begins and ends [m]: a site file gives these for the ramp only, the rest is schematic."""
    if not site.has_ramp:
        return (0.0, site.length)
    beside = min(
        (n for n in site.lanes if n.role == "ramp"), key=lambda n: abs(n.centre - site.lane_centre(site.target_lane))
    )
    shares_place = any(n.centre == lane.centre and n.number != lane.number for n in site.lanes)
    if lane.role == "ramp":
        return (_known_from(site), min(site.ramp_end, site.length)) if lane == beside else (0.0, site.gore)
    if lane.role == "exit" or (lane.role == "shoulder" and shares_place):
        return (min(site.ramp_end, site.length), site.length)
    return (0.0, site.length)


def _known_from(site: Site) -> float:
    """Returns from where on it is known how the ramp runs [m]: upstream of that it comes from elsewhere."""
    first = site.lane_line[0][0] if site.lane_line else 0.0
    return min(max(first, 0.0), site.gore)


def _lane_text(site: Site, lane: Lane) -> str:
    roles = {"ramp": "on-ramp", "exit": "off-ramp", "shoulder": "shoulder"}
    role = "target lane" if lane.number == site.target_lane else roles.get(lane.role, "")
    return f"{lane.number}  {role}".rstrip()
