"""A simulation that goes on while somebody watches: frames as lines of JSON, as quick as the clock on the wall.

python -m rampcast.simulate.running SPEED SEED < {"id": ..., "site": the values of a site file}

SUMO runs inside the process (libsumo), which is why it is one of its own. Its vehicles change lane in one step, and so
they do here.
"""

import contextlib
import json
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Final, TextIO

import numpy as np

from rampcast.errors import MissingExtra
from rampcast.recording import columns as c
from rampcast.simulate.demand import write_sign, write_vehicles
from rampcast.simulate.network import main_lanes, ramp_roads, roads, write_network
from rampcast.simulate.simulation import (
    FLOW_PER_LANE,
    RAMP_FLOW,
    RAMP_SLOPE,
    SHARES,
    SIGN_SPEEDS,
    TIME_STEP,
    Demand,
    vehicles_of,
)
from rampcast.sites import Site
from rampcast.sites.site import site_from_dict

WARM_UP: Final = 90.0  # [s] simulated before the first frame: about a third of that in time of the clock
HOURS: Final = 2.0  # of traffic that are drawn; then it begins anew, with the next seed


def main(speed: float, seed: int, told: dict[str, Any], out: TextIO) -> None:
    """Drives for ever, or until nobody reads any longer."""
    site = site_from_dict(told["site"])
    number, begun = 0, time.monotonic()
    while True:
        for objects in frames(site, seed):
            number += 1
            wait = begun + number * TIME_STEP / speed - time.monotonic()
            if wait > 0:
                time.sleep(wait)
            frame = {"v": 1, "site": told["id"], "seq": number, "t_ms": round(1e3 * TIME_STEP * number)}
            print(json.dumps(frame | {"objects": objects}), file=out, flush=True)
        seed += 1


def frames(site: Site, seed: int) -> Any:
    """Yields the vehicles of the section, step after step, from the end of the warm-up on.

    Raises:
        MissingExtra: libsumo is not installed.
    """
    try:
        import libsumo
    except ImportError as error:
        raise MissingExtra('simulating live needs libsumo; run: pip install "rampcast[sumo]"') from error
    end = WARM_UP + 3600.0 * HOURS
    with tempfile.TemporaryDirectory(prefix="rampcast-") as name:
        libsumo.start(_command(site, seed, Path(name), end))
        places = _places(site)
        try:
            libsumo.simulationStep(WARM_UP)
            while libsumo.simulation.getTime() < end:
                libsumo.simulationStep()
                yield _objects(libsumo, site, places, seed)
        finally:
            libsumo.close()


def _command(site: Site, seed: int, folder: Path, end: float) -> list[str]:
    """Returns what SUMO is started with; writes its files into a folder."""
    demand = Demand(FLOW_PER_LANE, RAMP_FLOW, SHARES, SIGN_SPEEDS, WARM_UP, seed)
    network = write_network(site, folder)
    write_vehicles(
        vehicles_of(site, demand, until=end), main=roads(site), ramp=ramp_roads(site), path=folder / "vehicles.xml"
    )
    sign = next(road for road in roads(site) if road.name == "slow")
    write_sign(folder / "sign.xml", road=sign, speeds=SIGN_SPEEDS, warm_up=WARM_UP, duration=end, seed=seed)
    command: list[object] = ["sumo", "-n", network, "-r", folder / "vehicles.xml", "-a", folder / "sign.xml"]
    command += ["--seed", seed, "--step-length", TIME_STEP, "--time-to-teleport", -1, "--collision.action", "warn"]
    command += ["--max-depart-delay", 30, "--xml-validation", "never", "--no-warnings", "true", "--no-step-log", "true"]
    return [str(part) for part in command]


def _places(site: Site) -> dict[str, tuple[int, float]]:
    """Returns the site's number of each of SUMO's lanes, and where its road begins [m]."""
    mains = main_lanes(site)
    found: dict[str, tuple[int, float]] = {}
    for road in (*roads(site)[1:4], ramp_roads(site)[1]):
        numbers = {"ramp": [site.ramp_lanes[-1]], "merge": [*mains, site.ramp_lanes[0]]}.get(road.name, mains)
        found |= {f"{road.name}_{place}": (number, road.start) for place, number in enumerate(reversed(numbers))}
    return found


def _objects(sumo: Any, site: Site, places: dict[str, tuple[int, float]], seed: int) -> list[dict[str, Any]]:
    """Returns the vehicles of the section as a frame names them."""
    found = []
    kinds = {"motorcycle": "motorcycle", "passenger": "car", "truck": "truck"}
    for name in sumo.vehicle.getIDList():
        lane, start = places.get(sumo.vehicle.getLaneID(name), (0, 0.0))
        x = start + sumo.vehicle.getLanePosition(name)
        if not lane or not 0.0 <= x <= site.length:
            continue
        y = site.lane_centre(lane) - (RAMP_SLOPE * max(0.0, site.gore - x) if lane in site.ramp_lanes else 0.0)
        found.append(
            {
                "id": f"{seed}-{name}",
                "x": round(x, 2),
                "y": round(float(np.round(y, 2)), 2),
                "lane": lane,
                c.LENGTH: sumo.vehicle.getLength(name),
                c.WIDTH: sumo.vehicle.getWidth(name),
                "class": kinds.get(sumo.vehicle.getVehicleClass(name), "car"),
            }
        )
    return found


def output_alone() -> TextIO:
    """Returns what the output stream was, for frames alone: what SUMO says there itself goes nowhere from now on."""
    found = os.fdopen(os.dup(1), "w", encoding="utf-8")
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.close(nowhere)
    return found


if __name__ == "__main__":
    with contextlib.suppress(BrokenPipeError):  # nobody reads any longer, and nothing is left to be said
        main(float(sys.argv[1]), int(sys.argv[2]), json.load(sys.stdin), output_alone())
