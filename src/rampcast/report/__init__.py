"""Figures, tables and the html report, drawn from tidy tables only. The one home of matplotlib: import it late."""

from rampcast.report.benchmark_figures import (
    band_coverage,
    error_over_horizon,
    reliability_of_merges,
    reliability_of_places,
)
from rampcast.report.drawings import framework, neighbour_geometry, site_geometry
from rampcast.report.drawings_of_models import forest_decision, lstm_cell
from rampcast.report.forecast_pictures import arriving_wave, forecast_fan, merge_densities
from rampcast.report.lane_change import base_rate, feature_importance, lane_change_metrics
from rampcast.report.longitudinal import (
    forecast_accuracy,
    forecast_bias,
    forecast_error,
    forecast_within,
    neighbour_accuracy,
    neighbour_error,
    scenes_per_horizon,
)
from rampcast.report.report import read_tables, write_report
from rampcast.report.site_picture import site_picture, write_site_picture
from rampcast.report.tracks import plot_forecast, scene_tracks, space_time

__all__ = [
    "arriving_wave",
    "band_coverage",
    "base_rate",
    "error_over_horizon",
    "feature_importance",
    "forecast_accuracy",
    "forecast_bias",
    "forecast_error",
    "forecast_fan",
    "forecast_within",
    "forest_decision",
    "framework",
    "lane_change_metrics",
    "lstm_cell",
    "merge_densities",
    "neighbour_accuracy",
    "neighbour_error",
    "neighbour_geometry",
    "plot_forecast",
    "read_tables",
    "reliability_of_merges",
    "reliability_of_places",
    "scene_tracks",
    "scenes_per_horizon",
    "site_geometry",
    "site_picture",
    "space_time",
    "write_report",
    "write_site_picture",
]
