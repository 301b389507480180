"""A run of 42 minutes in the closed loop with a forecast every simulated second: ours beside the plain way.

python benchmarks/closed_loop.py [MODEL]

Ours forecasts who is in the target lane or on the ramp, in 20 futures; the plain way everybody in view, in 100, as
`rampcast forecast` does. Times are of the processor, and of the clock.
"""

import os
import sys
import time
from dataclasses import replace

import rampcast as rc
from rampcast.control.controller import Controller
from rampcast.control.futures import Model
from rampcast.control.loop import Loop
from rampcast.control.plan import Job, read_plan
from rampcast.simulate.plant import driving
from rampcast.threads import choosing_threads

TINY = bool(os.environ.get("RAMPCAST_TINY"))
MINUTES = 1.0 if TINY else 42.0


def driven(model: Model | None, *, minutes: float = MINUTES) -> tuple[float, float, int]:
    """Returns processor time [s], time [s] and forecasts of a run in which nobody is told anything."""
    rule = Controller("none") if model is None else Controller("gap_advice", knows="model", penetration=0.0)
    rule = replace(rule, values={"target": 13.0}) if model else rule
    plan = replace(read_plan("full"), minutes=minutes)
    job = Job(plan.demands[1], rule, 1, plan)
    asked: set[float] = set()
    with driving(job.scenario) as plant:
        began = time.process_time(), time.perf_counter()
        for moment in Loop(plant, rule, model, seed=1):
            asked |= {moment.forecast.t0} if moment.forecast else set()
        return time.process_time() - began[0], time.perf_counter() - began[1], len(asked)


def main(name: str = "pretrained") -> None:
    """Prints the three runs."""
    forecaster = rc.load(name)
    ways = {
        "no forecasts": None,
        "ours: near the ramp, 20 futures": Model(forecaster, 20, near=True),
        "plain: all in view, 100 futures": Model(forecaster, 100),
    }
    found = {}
    print(f"{MINUTES:g} simulated minutes, one thread, model {name}")
    with choosing_threads(1):
        driven(Model(forecaster, 20), minutes=1.0)  # loops are compiled, or read from the cache, before the clock runs
        for way, model in ways.items():
            found[way], clock, asked = driven(model)
            print(f"{way:34s} {found[way]:6.1f} s of the processor, {clock:6.1f} s, {asked} forecasts")
    ours, plain = (found[way] for way in list(ways)[1:])
    print(f"ratio: processor time, ours / plain: {ours / plain:.2f}")


if __name__ == "__main__":
    main(*sys.argv[1:])
