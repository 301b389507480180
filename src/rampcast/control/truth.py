"""The true future: a second simulation that is given the state of the first and runs ahead of it.

It drives in a process of its own, with lights as they are and nobody told anything, and the first one never notices.
SUMO's state holds places and speeds of all vehicles, their drivers and the lights; the inner variables of EIDM's
estimates of others are begun anew, which the tests measure.
"""

import tempfile
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Final

import numpy as np

from rampcast.control.futures import Past, forecast_of
from rampcast.forecast.forecast import Forecast
from rampcast.horizon import FUTURE, STEP
from rampcast.recording import columns as c
from rampcast.simulate.plant import Plant, Scenario, driving

AHEAD: Final = STEP * FUTURE  # [s]
PATIENCE: Final = 120.0  # [s] that a run ahead may take


class Truth:
    """Runs ahead of a plant."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._folder = tempfile.TemporaryDirectory(prefix="rampcast-")
        context = get_context("spawn")
        self._line, theirs = context.Pipe()
        self._process = context.Process(target=run_ahead, args=(plant.scenario, theirs), daemon=True)
        self._process.start()

    def __call__(self, past: Past) -> Forecast:
        """Returns what comes if the lights stay as they are, as the one future of a forecast."""
        state = Path(self._folder.name) / "state.xml"
        self._plant.sumo.simulation.saveState(str(state))
        lights = self._plant.sumo.trafficlight
        shown = {name: lights.getRedYellowGreenState(name) for name in lights.getIDList()}
        self._line.send((str(state), past.time, shown))
        if not self._line.poll(PATIENCE):
            raise TimeoutError("the simulation that runs ahead does not answer")
        return _interpolated(past, self._line.recv())

    def close(self) -> None:
        """Ends the second simulation."""
        self._line.send(None)
        self._process.join(PATIENCE)
        self._folder.cleanup()


def run_ahead(scenario: Scenario, line: Connection) -> None:
    """Answers states with the frames of the next 15 s, until it is told nothing more."""
    with driving(scenario) as plant:
        while (asked := line.recv()) is not None:
            plant.sumo.simulation.loadState(asked[0])
            for name, shown in asked[2].items():
                plant.sumo.trafficlight.setRedYellowGreenState(name, shown)
            frames = []
            for _ in range(int(np.ceil(AHEAD / scenario.step - 1e-9))):
                plant.sumo.simulationStep()
                frames.append((plant.time - asked[1], plant.frame(everywhere=True)))
            line.send(frames)


def _interpolated(past: Past, frames: list[tuple[float, dict[str, np.ndarray]]]) -> Forecast:
    """Returns the frames as a forecast of the vehicles that are in view now; who is lost keeps its speed."""
    now, site = past.newest, past.site
    ahead = STEP * np.arange(1, FUTURE + 1)
    count, steps = len(now[c.VEHICLE]), len(frames)
    place = {vehicle: row for row, vehicle in enumerate(now[c.VEHICLE].tolist())}
    x, lane = np.full((count, steps), np.nan), np.zeros((count, steps), dtype=np.int64)
    for k, (_, frame) in enumerate(frames):
        rows = np.array([place.get(vehicle, -1) for vehicle in frame[c.VEHICLE].tolist()], dtype=np.int64)
        known = rows >= 0
        x[rows[known], k], lane[rows[known], k] = frame[c.X][known], frame[c.LANE][known]
    times = np.array([0.0, *(time for time, _ in frames)])
    samples = np.empty((count, 1, FUTURE), dtype=np.float32)
    for row in range(count):
        track, own = np.append(now[c.X][row], x[row]), np.append(now[c.LANE][row], lane[row])
        seen = np.isfinite(track)
        last = np.flatnonzero(seen)[-1]
        samples[row, 0] = np.interp(ahead, times[seen], track[seen])
        beyond = ahead > times[last]
        samples[row, 0, beyond] += now[c.V][row] * (ahead[beyond] - times[last])
        own[~seen] = own[last] if own[last] not in site.ramp_lanes else site.target_lane
        lane[row] = own[1:]
    later = np.clip(np.searchsorted(times[1:], ahead - 1e-9), 0, steps - 1)
    return forecast_of(past, samples, lane[:, None, later])
