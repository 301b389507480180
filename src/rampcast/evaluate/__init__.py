"""Evaluation: metrics as plain functions that give tidy tables, and the test protocol that puts them together."""

from rampcast.evaluate.examples import choose_examples, scene_tracks
from rampcast.evaluate.lane_change import lane_change_table
from rampcast.evaluate.longitudinal import central_errors, neighbour_errors, position_errors
from rampcast.evaluate.parameters import outcome_table, parameter_table
from rampcast.evaluate.protocol import Evaluation, evaluate, test_scenes

__all__ = [
    "Evaluation",
    "central_errors",
    "choose_examples",
    "evaluate",
    "lane_change_table",
    "neighbour_errors",
    "outcome_table",
    "parameter_table",
    "position_errors",
    "scene_tracks",
    "test_scenes",
]
