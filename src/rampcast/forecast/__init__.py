"""Forecasts: all vehicles around driven into the future together."""
