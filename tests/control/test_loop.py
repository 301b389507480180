"""The loop with SUMO in it: what is asked of the future, what is done to lights, and that the truth is true.

Each test drives in a process of its own, as experiments do.
"""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from rampcast.control.controller import Controller
from rampcast.control.futures import Past, constant_speeds
from rampcast.control.loop import Loop
from rampcast.control.plan import Demand, Job, read_plan
from rampcast.control.truth import Truth
from rampcast.recording import columns as c
from rampcast.simulate.corridor import Corridor
from rampcast.simulate.plant import driving

pytestmark = [pytest.mark.sumo, pytest.mark.slow]


def job(controller: Controller, *, ramps: int = 1, minutes: float = 1.5) -> Job:
    """Returns a short run."""
    plan = replace(read_plan("tiny"), minutes=minutes, corridor=Corridor(approach=300.0, ramps=ramps, spacing=900.0))
    return Job(Demand("busy", 4000.0, ramp_share=0.16 / ramps), controller, 3, plan)


def truth() -> None:
    """Compares 10 s of the truth, and of constant speeds, with what came."""
    with driving(job(Controller("none")).scenario) as plant:
        past, ahead = Past(plant.scenario.corridor.site), Truth(plant)
        while plant.time < 50.0:
            plant.step()
        past.add(plant.time, plant.frame())
        told, plain, start = ahead(past), constant_speeds(past), plant.frame()
        ahead.close()
        assert told.vehicle.tolist() == start[c.VEHICLE].tolist()
        while plant.time < 60.0:
            plant.step()
        came = plant.frame(everywhere=True)
    place = dict(zip(came[c.VEHICLE].tolist(), came[c.X].tolist(), strict=True))
    known = [row for row, vehicle in enumerate(told.vehicle.tolist()) if vehicle in place]
    true = np.array([place[told.vehicle[row]] for row in known])
    errors = [float(np.abs(one.samples[known, 0, 49] - true).mean()) for one in (told, plain)]
    assert len(known) > 10
    assert errors[0] < 0.5 * errors[1]


def gap_release() -> None:
    """Looks at what a rule that waits for gaps does to the light."""
    held, asked = [], []
    controller = Controller("gap_release", values={"target": 12.0}, knows="constant", chance=0.9, patience=6.0)
    with driving(job(controller).scenario) as plant:
        for moment in Loop(plant, controller, constant_speeds):
            held.append(moment.held)
            assert plant.meters[0].ready <= 6.0 + 2.0  # patience, and until the next look
            if moment.forecast is not None and moment.forecast.t0 == moment.time:
                asked.append(moment.time)
    assert len(held) == 180
    assert any(held)
    assert not all(held)
    assert 10 < len(asked) < 90  # of 90 s: only where somebody can be let go
    assert np.diff(asked).min() >= 1.0


def advice() -> None:
    """Looks at whom advice reaches, and that it reaches nobody without a device."""
    for penetration in (1.0, 0.0):
        controller = Controller(
            "speed_advice", values={"target": 12.0}, knows="constant", penetration=penetration, below=27.0, delay=0.2
        )
        with driving(job(controller).scenario) as plant:
            told = [one for moment in Loop(plant, controller, constant_speeds) for one in moment.told]
        assert bool(told) is (penetration > 0.0)


def hero() -> None:
    """Lets three ramps work together."""
    controller = Controller("hero", values={"target": 6.0}, period=10.0)
    with driving(job(controller, ramps=3, minutes=2.0).scenario) as plant:
        rates = [moment.rates for moment in Loop(plant, controller)]
    assert {len(one) for one in rates} == {3}
    assert any(rate is not None for one in rates for rate in one)


CASES = {"truth": truth, "gap_release": gap_release, "advice": advice, "hero": hero}


@pytest.mark.parametrize("case", CASES)
def test_a_run_does_what_it_should(case):
    pytest.importorskip("libsumo", reason="needs the extra [sumo]")
    done = subprocess.run(
        [sys.executable, "-m", "tests.control.test_loop", case], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


if __name__ == "__main__":
    CASES[sys.argv[1]]()
