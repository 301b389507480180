"""rampcast forecasts where every vehicle on a highway on-ramp will be, and when it will change lane."""

__version__ = "0.1.0"
