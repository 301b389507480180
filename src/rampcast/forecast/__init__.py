"""Forecasts: a `Forecaster` is fitted to a recording, forecasts scenes, and is kept in a folder."""

from rampcast.forecast.forecaster import Forecaster, TrainingSpec, fit_forecaster
from rampcast.forecast.longitudinal import MODELS
from rampcast.forecast.result import Forecast
from rampcast.forecast.storage import load, save
from rampcast.models.lstm import LstmSpec
from rampcast.physics.mode import Mode

__all__ = ["MODELS", "Forecast", "Forecaster", "LstmSpec", "Mode", "TrainingSpec", "fit_forecaster", "load", "save"]
