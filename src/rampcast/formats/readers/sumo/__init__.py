"""SUMO's floating-car data."""
