"""The paper's position models: each turns `Inputs` into positions of the central vehicle; see `forecasters`."""

import numpy as np
from jaxtyping import Float

from rampcast.horizon import STEP
from rampcast.paper.algorithm_1 import Neighbours, roll_out
from rampcast.paper.inputs import Inputs
from rampcast.paper.laws.laws import LAWS
from rampcast.paper.neighbours.predict import NeighbourForecast, continue_at_constant_speed
from rampcast.paper.scenes.scenes import CENTRAL, FOLLOWER, LEADER, TARGET_SLOTS
from rampcast.traffic.anchors import V, X


def constant_velocity(inputs: Inputs) -> Float[np.ndarray, "scene future"]:
    """Returns x + v t."""
    return continue_at_constant_speed(inputs.scenes, steps=inputs.steps).x[:, CENTRAL, 1:]


def lstm_alone(inputs: Inputs) -> Float[np.ndarray, "scene future"]:
    """Returns what the ramp lane's neighbour model predicts for the central vehicle itself: the paper's baseline."""
    return inputs.predicted.x[:, CENTRAL, 1:]


def constant_speed_leader(inputs: Inputs) -> Float[np.ndarray, "scene future"]:
    """Returns IDM's forecast behind neighbours that keep their speed."""
    return _drive("idm", inputs, continue_at_constant_speed(inputs.scenes, steps=inputs.steps))


def car_following(inputs: Inputs, *, law: str) -> Float[np.ndarray, "scene future"]:
    """Returns the forecast of a car-following law behind the predicted neighbours: the paper's framework."""
    return _drive(law, inputs, inputs.predicted)


def _drive(law: str, inputs: Inputs, neighbours: NeighbourForecast) -> Float[np.ndarray, "scene future"]:
    scenes = inputs.scenes

    def at(slots: list[int]) -> Neighbours:
        return Neighbours(
            neighbours.x[:, slots], neighbours.v[:, slots], scenes.length[:, slots], ~scenes.virtual[:, slots]
        )

    motion = roll_out(
        LAWS[law],
        inputs.calibration(law).parameters,
        x=scenes.past[:, CENTRAL, -1, X],
        v=scenes.past[:, CENTRAL, -1, V],
        ramp=at([LEADER, FOLLOWER]),
        target=at(list(TARGET_SLOTS)),
        ramp_end=scenes.site.ramp_end,
        v_max=scenes.site.speed_limit,
        mode=inputs.mode,
        time_step=STEP,
    )
    return motion.x
