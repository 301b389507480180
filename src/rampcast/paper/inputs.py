"""What the paper's models are given: scenes at once, and all else when the first model asks for it."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float

from rampcast.compute import computing
from rampcast.paper.calibration.calibration import Calibration, calibrate
from rampcast.paper.laws.laws import LAWS, Law
from rampcast.paper.laws.leader import Vehicle, actual_leader, gap_to
from rampcast.paper.laws.mode import Mode
from rampcast.paper.neighbours.predict import NeighbourForecast
from rampcast.paper.scenes.scenes import CENTRAL, LEADER, TARGET_SLOTS, Scenes
from rampcast.traffic.anchors import A, V, X


@dataclass(frozen=True)
class Inputs:
    """What a model may look at.

    Attributes:
        scenes: without their futures.
        mode: which reading of the paper.
        steps: how many steps of 0.2 s to forecast.
        predict_neighbours: gives `predicted`.
        predict_lane_changes: gives `lane_changes`.
        calibrations: the drivers fitted to the history so far, by name of the car-following law; see `calibration`.
    """

    scenes: Scenes
    mode: Mode
    steps: int
    predict_neighbours: Callable[[], NeighbourForecast]
    predict_lane_changes: Callable[[], tuple[Float[np.ndarray, "scene 16"], Float[np.ndarray, "scene 16"]]]
    calibrations: dict[str, Calibration] = field(default_factory=dict)

    @cached_property
    def predicted(self) -> NeighbourForecast:
        """Returns the neighbours as the neighbour models see them, from t = 0 on."""
        return self.predict_neighbours()

    @cached_property
    def lane_changes(self) -> tuple[Float[np.ndarray, "scene 16"], Float[np.ndarray, "scene 16"]]:
        """Returns the probabilities of a lane change within, and at, 0, 1 ... 15 s, by the forests."""
        return self.predict_lane_changes()

    def calibration(self, law: str) -> Calibration:
        """Returns the drivers fitted to the history, by name of the car-following law."""
        if law not in self.calibrations:
            self.calibrations[law] = calibrate_scenes(LAWS[law], self.scenes, self.mode)
        return self.calibrations[law]


@computing()
def calibrate_scenes(law: Law, scenes: Scenes, mode: Mode) -> Calibration:
    """Returns the law fitted to the 20 accelerations of each central vehicle's history.

    The neighbours are those that filled the slots at each step (method page, sections 4 and 6).
    """
    central = scenes.past[:, CENTRAL]
    leader = actual_leader(
        central[..., X],
        ramp=(_past_vehicle(scenes, LEADER),),
        target=tuple(_past_vehicle(scenes, slot) for slot in TARGET_SLOTS),
        ramp_end=scenes.site.ramp_end,
        mode=mode,
    )
    return calibrate(
        law,
        speed=central[..., V],
        leader_speed=np.asarray(leader.v),
        gap=np.asarray(gap_to(central[..., X], leader, mode=mode)),
        acceleration=central[..., A],
        valid=np.asarray(leader.present),
        mode=mode,
    )


def _past_vehicle(scenes: Scenes, slot: int) -> Vehicle:
    states = scenes.role_past[:, slot]
    return Vehicle(
        x=states[..., X], v=states[..., V], length=scenes.role_length[:, slot], present=~scenes.role_virtual[:, slot]
    )
