"""Models: the neighbour LSTM, the calibration of car-following laws, and the lane-change forests; one file each."""

from rampcast.models.calibration import Calibration, Outcome, calibrate
from rampcast.models.forest_sets import Reading, Sampling
from rampcast.models.forests import ForestSpec, LaneChangeForests
from rampcast.models.lstm import LstmSpec, NeighbourLstm, fit_lstm

__all__ = [
    "Calibration",
    "ForestSpec",
    "LaneChangeForests",
    "LstmSpec",
    "NeighbourLstm",
    "Outcome",
    "Reading",
    "Sampling",
    "calibrate",
    "fit_lstm",
]
