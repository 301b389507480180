"""The front door's picture: of whatever is given."""

from collections.abc import Hashable, Sequence

import numpy as np
import polars as pl
from matplotlib.figure import Figure

from rampcast.errors import RampcastError
from rampcast.forecast import Forecast, Forecasts
from rampcast.plots import style
from rampcast.plots.forecast_pictures import forecast_fan
from rampcast.plots.site_geometry import site_geometry
from rampcast.plots.site_picture import site_picture
from rampcast.plots.tracks import space_time
from rampcast.plots.traffic_pictures import traffic_fan
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.sites import Site

DIGITS = 1  # of times in tables [s]


@style.styled
def plot(
    what: Forecast | Forecasts | Recording | Site,
    *,
    vehicle: Hashable | Sequence[Hashable] | None = None,
    t0: float | None = None,
    truth: Recording | None = None,
    lane: int | Sequence[int] | None = None,
    window: str | None = None,
) -> Figure:
    """Returns the picture that shows what is given.

    A site: its lanes and its ramp. A raw recording: its site with tracks over it. A smoothed recording: position over
    time, coloured by speed, in which a stop-and-go wave is a dark band. A forecast of one moment: the medians of all
    vehicles by lane, and the 50 % and 90 % bands of those that are asked for. Forecasts of many moments: one vehicle at
    one of them, with the probability to have merged below.

    Args:
        what: to draw.
        vehicle: of a forecast of one moment, the vehicle or vehicles to draw bands of; of forecasts of many the one to
            draw, None for the first.
        t0: moment of forecasts of many [s]; None for the vehicle's first.
        truth: recording that holds what the vehicles of a forecast did; None draws no truth.
        lane: of a smoothed recording, the lane or lanes to draw; None for the target lane, or all without a ramp.
        window: of forecasts, their truth, or a smoothed recording; None for the first.

    Raises:
        RampcastError: it is none of these, or has no such window, vehicle or moment.
    """
    if isinstance(what, Forecast):
        return _traffic(what, vehicle, window, truth)
    if isinstance(what, Forecasts):
        return _fan(what, vehicle, t0, window, truth)
    if isinstance(what, Site):
        lanes = site_geometry(what)
        style.add_title(lanes, what.title)
        return style.figure_of(lanes)
    if not isinstance(what, Recording):
        raise RampcastError(f"plot: expected a Recording, a Site or a Forecast, got a {type(what).__name__}")
    return _space_time(what, lane, window or what.names[0]) if what.is_smoothed else site_picture(what)


def _space_time(recording: Recording, lane: int | Sequence[int] | None, window: str) -> Figure:
    site = recording.site
    if lane is None:
        lane = site.target_lane if site.has_ramp else [one.number for one in site.lanes]
    for number in [lane] if isinstance(lane, int) else lane:
        site.lane_centre(number)  # a lane that the site does not have is told with those that it has
    drawn = space_time(recording.window(window).tracks, lane=lane, time_step=recording.time_step)
    lanes = lane if isinstance(lane, int) else ", ".join(map(str, lane))
    drawn.set_title(f"{site.title}, {window}, lane {lanes}")
    return style.figure_of(drawn)


def _traffic(
    forecast: Forecast, asked: Hashable | Sequence[Hashable] | None, window: str | None, truth: Recording | None
) -> Figure:
    vehicles = () if asked is None else asked if isinstance(asked, list | tuple) else (asked,)
    forecast.places(vehicles)  # one that is not there is told with those that are
    table, site = forecast.to_polars(), forecast.site
    if truth is not None:
        seen = _seen(truth.window(window or truth.names[0]), forecast.t0)
        table = table.join(seen, on=["vehicle", "horizon"], how="left")
    ax = traffic_fan(table, site, vehicles=vehicles)
    style.add_title(ax, f"{site.title} at {forecast.t0:g} s: {len(forecast)} vehicles")
    return style.figure_of(ax)


def _seen(truth: Recording, t0: float) -> pl.DataFrame:
    """Returns the columns vehicle, horizon [s] after t0, x_true [m] of a window."""
    time = (pl.col(c.FRAME) * truth.time_step - t0).round(DIGITS)
    return truth.tracks.select(c.VEHICLE, horizon=time, x_true=c.X).unique(["vehicle", "horizon"], maintain_order=True)


def _fan(forecast: Forecasts, vehicle: object, t0: float | None, window: str | None, truth: Recording | None) -> Figure:
    if isinstance(vehicle, list | tuple):
        raise RampcastError(f"plot: of many moments one vehicle is drawn at a time, got {vehicle!r}")
    scene = _scene(forecast, vehicle, t0, window)
    name, own, moment = str(forecast.recording[scene]), forecast.vehicle[scene], float(forecast.t0[scene])
    table = forecast.select(np.array([scene])).position_table()
    table = table.with_columns(p_within=pl.Series(forecast.p_merged[scene]))
    seen = pl.DataFrame(schema={"horizon": pl.Float64, "x_true": pl.Float64})
    if truth is not None and name in truth.names:
        seen = _seen(truth.window(name), moment).filter(pl.col("vehicle") == own).drop("vehicle")
    places = pl.col("^x(_.*)?$") - float(forecast.start[scene])
    fan = forecast_fan(table.join(seen, on="horizon", how="left").with_columns(places))
    style.add_title(fan, f"Vehicle {own} of {name} at {moment:g} s")
    return style.figure_of(fan)


def _scene(forecast: Forecasts, vehicle: object, t0: float | None, window: str | None) -> int:
    """Returns the place in the forecast of the first scene that is asked for."""
    asked = np.ones(len(forecast), dtype=bool)
    asked &= (window is None) | (forecast.recording == window)
    asked &= (vehicle is None) | (forecast.vehicle == vehicle)
    asked &= (t0 is None) | (np.abs(forecast.t0 - (t0 or 0.0)) < 0.5 * 10.0**-DIGITS)
    if not asked.any():
        raise RampcastError(
            f"there is no forecast of vehicle {vehicle} at t0 = {t0} s in window {window} (None: any); "
            f"there are {len(forecast)}, the first of vehicle {forecast.vehicle[0]} at {forecast.t0[0]:.1f} s"
            if len(forecast)
            else "there is nothing in this forecast"
        )
    return int(np.flatnonzero(asked)[0])
