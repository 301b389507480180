"""A controlled ramp to look at: SUMO under a rule, and beside it the same traffic without, as frames to the service.

python -m rampcast.control.showing RULE SPEED SEED MODEL

Both are driven by the same seed, each in a process of its own: libsumo holds one simulation a process. A frame is a
line of JSON, with `control`: the rule, its light, its rate, and what has come of it so far with and without.
"""

import contextlib
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import IO, Any, Final, TextIO

from rampcast.control.advice import LONGEST
from rampcast.control.controller import LOOKS_AHEAD, Controller, checked
from rampcast.control.loop import Loop, Moment
from rampcast.control.plan import Job, Plan, read_plan, with_values
from rampcast.control.run import futures_of
from rampcast.forecast.storage import load
from rampcast.recording import columns as c
from rampcast.recording.columns import KINDS
from rampcast.simulate.plant import Plant, driving
from rampcast.simulate.running import output_alone

PLAN: Final = "full"  # whose drivers, demand and first values of each rule are shown
DEMAND: Final = "beyond"
UNSEEN: Final = 120.0  # [s] driven before the first frame: the road fills
ALONE: Final = "none"  # the rule of the twin
SITE: Final = "corridor"


@dataclass
class Shown:
    """One of the two simulations.

    Attributes:
        job: what is driven.
        model: name or folder of the forecaster of a rule that looks ahead.
        told: the advice that vehicles have: until when, and the speed [m/s].
    """

    job: Job
    model: str
    told: dict[int, tuple[float, float]] = field(default_factory=dict)

    def steps(self) -> Iterator[tuple[Plant, Moment]]:
        """Yields each step after the road has filled."""
        plan, controller, seed = self.job.plan, self.job.controller, self.job.seed
        with driving(self.job.scenario) as plant:
            futures = futures_of(controller, lambda: load(self.model), samples=plan.samples, seed=seed, plant=plant)
            for moment in Loop(plant, controller, futures, seed=seed):
                self.told |= {one.vehicle: (moment.time + LONGEST, one.speed) for one in moment.told}
                if moment.time > UNSEEN:
                    yield plant, moment

    def objects(self, moment: Moment) -> list[dict[str, Any]]:
        """Returns the vehicles of a frame."""
        names = (c.VEHICLE, c.X, c.Y, c.LANE, c.LENGTH, c.WIDTH, c.KIND)
        rows = zip(*(moment.frame[name].tolist() for name in names), strict=True)
        seed = self.job.seed
        return [
            {
                "id": f"{seed}-{vehicle}", "x": round(x, 2), "y": round(y, 2), "lane": lane, "length": length,
                "width": width, "class": KINDS[kind], **self.advice(vehicle, moment.time),
            }
            for vehicle, x, y, lane, length, width, kind in rows
        ]  # fmt: skip

    def advice(self, vehicle: int, now: float) -> dict[str, str]:
        """Returns the advice that a vehicle has."""
        until, speed = self.told.get(vehicle, (0.0, 0.0))
        return {"advice": f"{3.6 * speed:.0f} km/h"} if until > now else {}


def outcome(plant: Plant, moment: Moment) -> dict[str, str]:
    """Returns what has come of it so far, in words."""
    queue = len(plant.waiting(0))
    speeds = moment.frame[c.V]
    return {
        "time spent": f"{plant.spent / 3600.0:.1f} veh h",
        "mean speed": f"{3.6 * float(speeds.mean()):.0f} km/h" if len(speeds) else "-",
        "ramp queue": f"{queue} veh",
        "outside": f"{plant.backlog} veh",
    }


def controlled(plant: Plant, moment: Moment, job: Job, without: dict[str, str]) -> dict[str, Any]:
    """Returns what a frame tells of the controller."""
    light = plant.sumo.trafficlight.getRedYellowGreenState("line_0")
    rate = moment.rates[0]
    return {
        "rule": job.controller.name,
        "signal": "red" if light == "r" else "green",
        "rate": "not metered" if rate is None else f"{rate:.0f} veh/h",
        "of the run": f"{moment.time / 60.0:.1f} of {job.plan.minutes:g} min",
        "with": outcome(plant, moment),
        "without": without,
    }


def job_of(rule: str, seed: int) -> Job:
    """Returns what a rule is shown with: the values that the shipped plan tries first, and its demand.

    Raises:
        RampcastError: there is no such rule.
    """
    plan: Plan = read_plan(PLAN)
    first = {name: several[0] for name, several in plan.tune.items() if several}
    controller = Controller(rule, knows="model" if rule in LOOKS_AHEAD else "nothing")
    known = [one for one in plan.controllers if (one.rule, one.knows) == (rule, controller.knows)]
    controller = checked(with_values([*known, controller][0], first))
    demand = next(one for one in plan.demands if one.name == DEMAND)
    return Job(demand, controller, seed, plan)


def show(rule: str, speed: float, seed: int, model: str, out: TextIO) -> None:
    """Drives for ever, or until nobody reads any longer."""
    number, begun = 0, time.monotonic()
    while True:
        shown = Shown(job_of(rule, seed), model)
        with twin(seed) as other:
            for plant, moment in shown.steps():
                number += 1
                without = json.loads(other.readline() or "{}")
                wait = begun + number * plant.scenario.step / speed - time.monotonic()
                if wait > 0:
                    time.sleep(wait)
                frame = {"v": 1, "site": SITE, "seq": number, "t_ms": round(1e3 * plant.scenario.step * number)}
                control = controlled(plant, moment, shown.job, without)
                print(json.dumps(frame | {"objects": shown.objects(moment), "control": control}), file=out, flush=True)
        seed += 1


def show_twin(seed: int, out: TextIO) -> None:
    """Tells what comes of the same traffic without control, a line for each step."""
    for plant, moment in Shown(job_of(ALONE, seed), "").steps():
        print(json.dumps(outcome(plant, moment)), file=out, flush=True)


@contextlib.contextmanager
def twin(seed: int) -> Iterator[IO[str]]:
    """Gives the lines of the simulation without control."""
    command = [sys.executable, "-m", "rampcast.control.showing", ALONE, str(seed)]
    with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield process.stdout
        finally:
            process.kill()


if __name__ == "__main__":
    with contextlib.suppress(BrokenPipeError):  # nobody reads any longer, and nothing is left to be said
        if len(sys.argv) == 3:
            show_twin(int(sys.argv[2]), output_alone())
        else:
            show(sys.argv[1], float(sys.argv[2]), int(sys.argv[3]), sys.argv[4], output_alone())
