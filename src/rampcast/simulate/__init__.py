"""Simulated recordings: SUMO drives a site's traffic, and what it did is a recording like any other.

Reading the shipped sample needs no SUMO; making a recording does (``pip install "rampcast[sumo]"``).
"""

from rampcast.simulate.noise import add_position_noise
from rampcast.simulate.realism import realism, space_time, wave_speed
from rampcast.simulate.sample import make_sample
from rampcast.simulate.shipped import shipped_sample
from rampcast.simulate.simulation import simulate

__all__ = ["add_position_noise", "make_sample", "realism", "shipped_sample", "simulate", "space_time", "wave_speed"]
