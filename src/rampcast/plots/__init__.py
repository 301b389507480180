"""Pictures of recordings, sites and forecasts: each a function of a table that gives Axes. Import it late."""

from rampcast.plots.forecast_pictures import arriving_wave, forecast_fan, merge_densities
from rampcast.plots.picture import plot
from rampcast.plots.site_picture import site_picture, write_site_picture
from rampcast.plots.tracks import plot_forecast, scene_tracks, space_time

__all__ = [
    "arriving_wave",
    "forecast_fan",
    "merge_densities",
    "plot",
    "plot_forecast",
    "scene_tracks",
    "site_picture",
    "space_time",
    "write_site_picture",
]
