"""Scenes: an on-ramp vehicle, its neighbours, their past and future, as dense arrays with masks."""

from rampcast.scenes.build import (
    build_neighbour_scenes_at,
    build_scenes,
    build_scenes_at,
    find_anchors,
    need_ramp,
)
from rampcast.scenes.neighbours import find_neighbours, on_ramp_vehicles
from rampcast.scenes.scenes import FEATURES, FUTURE, PAST, SLOTS, STEP, Scenes
from rampcast.scenes.windows import training_windows

__all__ = [
    "FEATURES",
    "FUTURE",
    "PAST",
    "SLOTS",
    "STEP",
    "Scenes",
    "build_neighbour_scenes_at",
    "build_scenes",
    "build_scenes_at",
    "find_anchors",
    "find_neighbours",
    "need_ramp",
    "on_ramp_vehicles",
    "training_windows",
]
