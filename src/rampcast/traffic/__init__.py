"""Traffic: who is around a vehicle at a moment, the states of all of them, and what became of them."""

from rampcast.traffic.anchors import find_anchors, need_ramp
from rampcast.traffic.neighbours import find_neighbours, on_ramp_vehicles

__all__ = ["find_anchors", "find_neighbours", "need_ramp", "on_ramp_vehicles"]
