"""Ramp metering and advice in a closed loop with SUMO: does a forecast make the ramp better?

`rampcast experiment plan.toml --out DIR` runs a plan; docs/control.md says what came out.
"""
