"""Traffic: all vehicles of a site that are known at one moment, from the past alone; and what became of them."""

from rampcast.traffic.anchors import find_anchors, need_ramp
from rampcast.traffic.moments import Traffic, moments, traffic
from rampcast.traffic.neighbours import find_neighbours, on_ramp_vehicles
from rampcast.traffic.stream import Stream

__all__ = [
    "Stream",
    "Traffic",
    "find_anchors",
    "find_neighbours",
    "moments",
    "need_ramp",
    "on_ramp_vehicles",
    "traffic",
]
