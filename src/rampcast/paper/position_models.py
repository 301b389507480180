"""The table of longitudinal models: each turns scenes into positions of the central vehicle.

To add one: a function of `Inputs` here or in a file of its own, and a line in `MODELS`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Float

from rampcast.compute import computing
from rampcast.forecast.scene_forecaster import SceneForecast
from rampcast.horizon import STEP
from rampcast.paper.algorithm_1 import roll_out
from rampcast.paper.calibration.calibration import Calibration, calibrate
from rampcast.paper.laws.laws import LAWS, Law
from rampcast.paper.laws.leader import Vehicle, actual_leader, gap_to
from rampcast.paper.laws.mode import Mode
from rampcast.paper.neighbours.predict import NeighbourForecast, continue_at_constant_speed
from rampcast.paper.scenes.scenes import CENTRAL, LEADER, TARGET_SLOTS, Scenes
from rampcast.traffic.anchors import A, V, X


@dataclass(frozen=True)
class Inputs:
    """What a longitudinal model may look at.

    Attributes:
        scenes: without their futures.
        mode: which reading of the paper.
        predicted: the neighbours as the neighbour models see them, from t = 0 on.
        calibrations: the drivers fitted to the history, by name of the car-following law.
        scene: the forecast of the scene forecaster; None where no model asks for it.
    """

    scenes: Scenes
    mode: Mode
    predicted: NeighbourForecast
    calibrations: Mapping[str, Calibration]
    scene: SceneForecast | None


@dataclass(frozen=True, eq=False)
class LongitudinalModel:
    """A row of `MODELS`.

    Attributes:
        label: its name in tables and figures.
        predict: gives x [m] of the central vehicle at each step after t = 0.
        shift_invariant: the modes in which moving all positions, the site's too, moves the forecast by as much.
        modes: the readings of the paper that it belongs to.
    """

    label: str
    predict: Callable[[Inputs], Float[np.ndarray, "scene future"]]
    shift_invariant: frozenset[Mode]
    modes: frozenset[Mode] = frozenset(Mode)


@computing()
def calibrate_scenes(law: Law, scenes: Scenes, mode: Mode) -> Calibration:
    """Returns the law fitted to the 20 accelerations of each central vehicle's history.

    The neighbours are those that filled the slots at each step (method page, sections 4 and 6).
    """
    central = scenes.past[:, CENTRAL]
    leader = actual_leader(
        central[..., X],
        leader=_past_vehicle(scenes, LEADER),
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


def median_of_samples(inputs: Inputs) -> Float[np.ndarray, "scene future"]:
    """Returns the median of the scene forecaster's samples: all vehicles around driven into the future together."""
    assert inputs.scene is not None
    steps = inputs.predicted.x.shape[2] - 1
    return inputs.scenes.past[:, CENTRAL, -1, X, None] + inputs.scene.median[:, :steps]


def constant_velocity(inputs: Inputs) -> Float[np.ndarray, "scene future"]:
    """Returns x + v t."""
    steps = inputs.predicted.x.shape[2] - 1
    return continue_at_constant_speed(inputs.scenes, steps=steps).x[:, CENTRAL, 1:]


def lstm_alone(inputs: Inputs) -> Float[np.ndarray, "scene future"]:
    """Returns what the ramp lane's neighbour model predicts for the central vehicle itself: the paper's baseline."""
    return inputs.predicted.x[:, CENTRAL, 1:]


def constant_speed_leader(inputs: Inputs) -> Float[np.ndarray, "scene future"]:
    """Returns IDM's forecast behind neighbours that keep their speed."""
    steps = inputs.predicted.x.shape[2] - 1
    return _drive("idm", inputs, continue_at_constant_speed(inputs.scenes, steps=steps))


def car_following(inputs: Inputs, *, law: str) -> Float[np.ndarray, "scene future"]:
    """Returns the forecast of a car-following law behind the predicted neighbours: the paper's framework."""
    return _drive(law, inputs, inputs.predicted)


BOTH = frozenset(Mode)
ONLY_CORRECTED = frozenset({Mode.CORRECTED})  # the paper's LSTM and virtual vehicles know absolute positions
MODELS: dict[str, LongitudinalModel] = {
    "rampcast": LongitudinalModel("rampcast", median_of_samples, ONLY_CORRECTED, modes=ONLY_CORRECTED),
    "constant_velocity": LongitudinalModel("Constant velocity", constant_velocity, BOTH),
    "constant_speed_leader": LongitudinalModel(
        "IDM, neighbours at constant speed", constant_speed_leader, ONLY_CORRECTED
    ),
    "lstm_alone": LongitudinalModel("LSTM alone", lstm_alone, ONLY_CORRECTED),
    **{
        name: LongitudinalModel(law.label, partial(car_following, law=name), ONLY_CORRECTED)
        for name, law in LAWS.items()
    },
}


def models_of(mode: Mode) -> tuple[str, ...]:
    """Returns the keys of the models that belong to a reading of the paper."""
    return tuple(name for name, model in MODELS.items() if mode in model.modes)


def _drive(law: str, inputs: Inputs, neighbours: NeighbourForecast) -> Float[np.ndarray, "scene future"]:
    scenes, targets = inputs.scenes, list(TARGET_SLOTS)
    motion = roll_out(
        LAWS[law],
        inputs.calibrations[law].parameters,
        x=scenes.past[:, CENTRAL, -1, X],
        v=scenes.past[:, CENTRAL, -1, V],
        leader_x=neighbours.x[:, LEADER],
        leader_v=neighbours.v[:, LEADER],
        leader_length=scenes.length[:, LEADER],
        leader_present=~scenes.virtual[:, LEADER],
        target_x=neighbours.x[:, targets],
        target_v=neighbours.v[:, targets],
        target_length=scenes.length[:, targets],
        target_present=~scenes.virtual[:, targets],
        ramp_end=scenes.site.ramp_end,
        v_max=scenes.site.speed_limit,
        mode=inputs.mode,
        time_step=STEP,
    )
    return motion.x


def _past_vehicle(scenes: Scenes, slot: int) -> Vehicle:
    states = scenes.role_past[:, slot]
    return Vehicle(
        x=states[..., X], v=states[..., V], length=scenes.role_length[:, slot], present=~scenes.role_virtual[:, slot]
    )
