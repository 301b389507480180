"""The front door's picture: of whatever is given."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from rampcast.errors import RampcastError
from rampcast.plots import style
from rampcast.plots.site_geometry import site_geometry
from rampcast.plots.site_picture import site_picture
from rampcast.plots.tracks import space_time
from rampcast.recording import Recording
from rampcast.sites import Site


@style.styled
def plot(what: Recording | Site, *, lane: int | Sequence[int] | None = None, window: str | None = None) -> Figure:
    """Returns the picture that shows what is given.

    A site: its lanes and its ramp. A raw recording: its site with tracks over it. A smoothed recording: position over
    time, coloured by speed, in which a stop-and-go wave is a dark band.

    Args:
        what: to draw.
        lane: of a smoothed recording, the lane or lanes to draw; None for the target lane, or all without a ramp.
        window: of a smoothed recording, the window to draw; None for the first.

    Raises:
        RampcastError: it is none of these, or has no such window.
    """
    if isinstance(what, Site):
        lanes = site_geometry(what)
        style.add_title(lanes, what.title)
        return style.figure_of(lanes)
    if not isinstance(what, Recording):
        raise RampcastError(f"plot: expected a Recording, a Site or a Forecast, got a {type(what).__name__}")
    if not what.is_smoothed:
        return site_picture(what)
    return _space_time(what, lane, window or what.names[0])


def _space_time(recording: Recording, lane: int | Sequence[int] | None, window: str) -> Figure:
    site = recording.site
    if lane is None:
        lane = site.target_lane if site.has_ramp else [one.number for one in site.lanes]
    drawn = space_time(recording.window(window).tracks, lane=lane, time_step=recording.time_step)
    lanes = lane if isinstance(lane, int) else ", ".join(map(str, lane))
    drawn.set_title(f"{site.title}, {window}, lane {lanes}")
    return style.figure_of(drawn)
