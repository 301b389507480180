"""Scenes: an on-ramp vehicle, its six neighbours, their past and future, as dense arrays with masks."""

from rampcast.paper.scenes.build import build_scenes, build_scenes_at
from rampcast.paper.scenes.from_past import scenes_from_past
from rampcast.paper.scenes.scenes import SLOTS, Scenes

__all__ = ["SLOTS", "Scenes", "build_scenes", "build_scenes_at", "scenes_from_past"]
