"""What the paper's framework forecasts for scenes, and the tables that it is written as."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import polars as pl
from jaxtyping import Float, Int

from rampcast.forecast.tables import lane_change_table, position_table
from rampcast.paper.calibration.calibration import Calibration
from rampcast.paper.inputs import Inputs
from rampcast.paper.lane_change.forests import FORESTS
from rampcast.paper.neighbours.predict import NeighbourForecast
from rampcast.paper.scenes.scenes import CENTRAL
from rampcast.traffic.anchors import X


@dataclass(frozen=True)
class PaperForecast:
    """What is forecast for each scene; what was not asked for is made when it is looked at.

    Attributes:
        x: by model, front position of the central vehicle at 0.2, 0.4, ... s after t0 [m].
        inputs: what the models were given: scenes, predicted neighbours, drivers, lane changes.
    """

    x: dict[str, Float[np.ndarray, "scene future"]]
    inputs: Inputs

    def __len__(self) -> int:
        return len(self.t0)

    @property
    def recording(self) -> np.ndarray:
        """Returns the name of the window of each scene."""
        return self.inputs.scenes.recording

    @property
    def vehicle(self) -> Int[np.ndarray, "scene"]:
        """Returns the central vehicle of each scene."""
        return self.inputs.scenes.vehicle[:, CENTRAL]

    @property
    def t0(self) -> Float[np.ndarray, "scene"]:
        """Returns the moment of each scene [s]."""
        return self.inputs.scenes.t0

    @property
    def lane(self) -> Int[np.ndarray, "scene"]:
        """Returns the lane of the central vehicle at t0."""
        return self.inputs.scenes.lane

    @property
    def start(self) -> Float[np.ndarray, "scene"]:
        """Returns the front of the central vehicle at t0 [m]."""
        return self.inputs.scenes.past[:, CENTRAL, -1, X]

    @property
    def bands(self) -> dict[str, Float[np.ndarray, "scene future band"]]:
        """Returns nothing: the paper's models give no quantiles."""
        return {}

    @property
    def neighbours(self) -> NeighbourForecast:
        """Returns the predicted neighbours."""
        return self.inputs.predicted

    @property
    def calibrations(self) -> dict[str, Calibration]:
        """Returns the drivers fitted to the history, by car-following law, of the laws that were asked for."""
        return self.inputs.calibrations

    @property
    def p_within(self) -> Float[np.ndarray, "scene 16"]:
        """Returns the probability of a lane change within 0, 1, ..., 15 s."""
        return self.inputs.lane_changes[0]

    @property
    def p_at(self) -> Float[np.ndarray, "scene 16"]:
        """Returns the probability of a lane change at 0, 1, ..., 15 s."""
        return self.inputs.lane_changes[1]

    @cached_property
    def lane_changes(self) -> dict[str, tuple[Float[np.ndarray, "scene 16"], Float[np.ndarray, "scene 16"]]]:
        """Returns the probabilities of a lane change within, and at, 0, 1 ... 15 s."""
        return {FORESTS: self.inputs.lane_changes}

    def tables(self) -> dict[str, pl.DataFrame]:
        """Returns the tables that a forecast is written as, by name of the file."""
        return {"forecast": self.position_table(), "lane_change": self.lane_change_table()}

    def position_table(self) -> pl.DataFrame:
        """Returns the columns recording, vehicle, t0 [s], lane, horizon [s], x [m], model, and quantiles (null)."""
        return position_table(self)

    def lane_change_table(self) -> pl.DataFrame:
        """Returns the columns recording, vehicle, t0 [s], t [s], p_within, p_at, model."""
        return lane_change_table(self)
