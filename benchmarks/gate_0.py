"""Does the simulated bottleneck break down as real ones do? Which of SUMO's levers does what?

python benchmarks/gate_0.py screen FOLDER       two-level fractional factorial of 9 levers, 32 settings
python benchmarks/gate_0.py test FOLDER NAME    one set of drivers, 30 seeds
python benchmarks/gate_0.py show FOLDER         the tables of what is done

Each run is a line of FOLDER/runs.jsonl; what is there is not run again.

Demand rises slowly beyond capacity and stays there. Breakdown: the speed 150 m before the gore falls below 15 m/s for
three minutes. Flow before: downstream of the merge, mean of the five minutes before the breakdown. Discharge: the same
sensors from three minutes after the breakdown to the end. Capacity drop: 1 - discharge / flow before.
"""

import itertools
import json
import os
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import t as student

from rampcast.control.plan import SHARES
from rampcast.simulate.corridor import SENSOR_PERIOD, Corridor
from rampcast.simulate.drivers import DRIVERS, Drivers
from rampcast.simulate.plant import Plant, Scenario, driving

SLOW, LASTS, BEFORE, AFTER = 15.0, 180.0, 300.0, 180.0  # [m/s], [s], [s], [s]
HARD = 6.0  # [m/s^2], as in docs/simulation.md
LEVERS = ("action points 1 s", "weak acceleration", "startup delay 1 s", "headway after queue x 1.4", "assertive",
          "not cooperative", "short help", "ramp lane 120 m", "15 % trucks")  # fmt: skip
TINY = bool(os.environ.get("RAMPCAST_TINY"))
END = 2520.0
SEEDS = range(251, 281)  # none of those that drivers were chosen with
SCREEN_SEEDS = (1,)


def scenario(levels: tuple[bool, ...], seed: int, base: Drivers = DRIVERS["default"], step: float = 0.5) -> Scenario:
    """Returns a run whose levers are at those levels."""
    action, weak, startup, tau, assertive, selfish, short, lane, trucks = levels
    ranges = {kind: dict(values) for kind, values in base.ranges.items()}
    for values in ranges.values():
        if weak:
            values["accel"] = (0.6 * values["accel"][0], 0.6 * values["accel"][1])
        if assertive:
            values["lcAssertive"] = (2.0, 4.0)
        if selfish:
            values["lcCooperative"] = (0.0, 0.3)
    alike = dict(base.alike)
    alike |= {"actionStepLength": 1.0} if action else {}
    alike |= {"startupDelay": 1.0} if startup else {}
    alike |= {"lcCooperativeHelpTime": 5.0} if short else {}
    more = {"queue_tau": 1.4, "queue_memory": 60.0} if tau else {}
    drivers = replace(base, ranges=ranges, alike=alike, **more)
    shares = (0.0, 0.85, 0.15) if trucks else (0.0, 0.96, 0.04)
    return ramped(Corridor(ramp_lane=120.0 if lane else 200.0), drivers, shares, seed, step)


def ramped(
    corridor: Corridor, drivers: Drivers, shares: tuple[float, float, float], seed: int, step: float
) -> Scenario:
    """Returns a run whose demand rises from 3,000 to 4,400 vehicles/h within 25 minutes."""
    demand = {
        route: [(0.0, 3000.0 * share), (200.0, 3000.0 * share), (1700.0, 4400.0 * share), (END, 4400.0 * share)]
        for route, share in (("main", 0.84), ("ramp_0", 0.16))
    }
    return Scenario(corridor, demand, drivers=drivers, shares=shares, seed=seed, step=step)


def measured(what: Scenario) -> dict[str, Any]:
    """Returns what one run shows."""
    began, rows, watch = time.perf_counter(), [], Watch()
    with driving(what) as plant:
        every = round(SENSOR_PERIOD / what.step)
        for number in range(1, round(what.duration / what.step) + 1):
            plant.step()
            watch.look(plant)
            if number % every == 0:
                seen = [plant.sensed(name) for name in ("before_0", "after_0")]
                rows.append([plant.time, seen[0].speed, seen[0].flow, seen[1].speed, seen[1].flow])
    found = bottleneck(np.array(rows)) | watch.found(what.corridor)
    return found | {"seconds": time.perf_counter() - began}


class Watch:
    """Merges, hard brakings and faults of a run."""

    def __init__(self) -> None:
        self.on_ramp: dict[str, float] = {}
        self.places: list[float] = []
        self.hard: set[str] = set()
        self.all: set[str] = set()
        self.speeds: list[float] = []
        self.teleports = self.collisions = self.emergencies = 0

    def look(self, plant: Plant) -> None:
        """Looks at one step."""
        sumo, target = plant.sumo, 1
        self.teleports += sumo.simulation.getStartingTeleportNumber()
        self.collisions += sumo.simulation.getCollidingVehiclesNumber()
        self.emergencies += sumo.simulation.getEmergencyStoppingVehiclesNumber()
        for edge in ("ramp_0", "merge_0", "main_1"):
            for name in sumo.edge.getLastStepVehicleIDs(edge):
                self.all.add(name)
                if sumo.vehicle.getAcceleration(name) < -HARD:
                    self.hard.add(name)
                if edge == "merge_0":
                    lane = sumo.vehicle.getLaneIndex(name)
                    if lane == target:
                        self.speeds.append(sumo.vehicle.getSpeed(name))
                    if lane == 0:
                        self.on_ramp[name] = sumo.vehicle.getLanePosition(name)
                    elif name in self.on_ramp:
                        self.places.append(self.on_ramp.pop(name))

    def found(self, corridor: Corridor) -> dict[str, Any]:
        """Returns the numbers."""
        shares = np.sort(np.array(self.places)) / corridor.ramp_lane
        inside = np.searchsorted(shares, shares + 3.0 / corridor.ramp_lane, side="right") - np.arange(len(shares))
        quartiles = np.quantile(shares, [0.25, 0.5, 0.75]) if len(shares) else [np.nan] * 3
        return {
            "merges": len(shares), "place_25": quartiles[0], "place_50": quartiles[1], "place_75": quartiles[2],
            "within_3_m": float(inside.max() / len(shares)) if len(shares) else np.nan,
            "merge_lane_speed": float(np.mean(self.speeds)), "hard_share": len(self.hard) / max(1, len(self.all)),
            "teleports": self.teleports, "collisions": self.collisions, "emergency_stops": self.emergencies,
        }  # fmt: skip


def bottleneck(rows: np.ndarray) -> dict[str, Any]:
    """Returns when it broke down and the flows of before and after; None where it did not."""
    when, speed, flow = rows[:, 0], rows[:, 1], rows[:, 4]
    count = round(LASTS / SENSOR_PERIOD)
    smooth = np.array([np.nanmean(speed[k : k + count]) for k in range(len(speed) - count)])
    slow = np.flatnonzero((smooth < SLOW) & (when[: len(smooth)] > BEFORE))
    minute = round(300.0 / SENSOR_PERIOD)
    means = [float(flow[k : k + minute].mean()) for k in range(0, len(flow) - minute + 1, minute)]
    if not len(slow):
        return {"breakdown": None, "before": None, "discharge": None, "drop": None, "flows": means}
    first = slow[0]
    before = flow[max(0, first - round(BEFORE / SENSOR_PERIOD)) : first].mean()
    after = flow[first + round(AFTER / SENSOR_PERIOD) :]
    discharge = after.mean() if len(after) >= 30 else np.nan
    return {
        "breakdown": float(when[first]), "before": float(before), "discharge": float(discharge),
        "drop": float(1.0 - discharge / before), "queue_speed": float(np.nanmean(speed[first + count :])),
        "flows": [float(flow[max(0, k - minute) : k].mean()) for k in range(first, 0, -minute)][::-1],
    }  # fmt: skip


def design() -> Iterator[tuple[bool, ...]]:
    """Yields the settings of a 2^(9-4) design of resolution IV, in which no main effect is mixed with a pair.

    Source: Montgomery 2013, Design and Analysis of Experiments, 8th ed., table 8.14: F = BCDE, G = ACDE, H = ABDE,
    J = ABCE.
    """
    for a, b, c, d, e in itertools.product((-1, 1), repeat=5):
        signs = (a, b, c, d, e, b * c * d * e, a * c * d * e, a * b * d * e, a * b * c * e)
        yield tuple(sign > 0 for sign in signs)


def done(folder: Path) -> dict[str, dict[str, Any]]:
    """Returns the runs that are there."""
    path = folder / "runs.jsonl"
    lines = path.read_text().splitlines() if path.exists() else []
    return {row["key"]: row for row in map(json.loads, lines)}


def keep(folder: Path, key: str, make: Any, **about: Any) -> None:
    """Runs what is not there yet."""
    if key in done(folder):
        return
    row = {"key": key, **about, **measured(make())}
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "runs.jsonl").open("a") as file:
        file.write(json.dumps(row) + "\n")


def screen(folder: Path) -> None:
    """Runs the factorial."""
    for seed in SCREEN_SEEDS:
        for levels in design():
            name = "".join("+" if one else "-" for one in levels)
            keep(
                folder,
                f"{name} {seed}",
                lambda levels=levels, seed=seed: scenario(levels, seed),
                levels=name,
                seed=seed,
            )


def check(folder: Path, name: str, step: float) -> None:
    """Runs a set of drivers with 30 seeds."""
    for seed in SEEDS:
        make = partial(ramped, Corridor(), DRIVERS[name], SHARES, seed, step)
        keep(folder, f"{name} {step} {seed}", make, drivers=name, seed=seed, step=step)


SHOWN = ("drop", "before", "discharge", "breakdown", "place_50", "merge_lane_speed", "hard_share", "collisions")


def show(folder: Path) -> None:
    """Prints the main effects of the levers, and what sets of drivers show with intervals."""
    rows = list(done(folder).values())
    screened = [row for row in rows if "levels" in row]
    if screened:
        print(f"mean of all at the lever's high level less that at its low one; {len(screened)} runs")
        high = np.array([[sign == "+" for sign in row["levels"]] for row in screened])
        print("| lever | " + " | ".join(SHOWN) + " |\n|" + "---|" * (len(SHOWN) + 1))
        values = {name: np.array([row[name] or np.nan for row in screened], dtype=float) for name in SHOWN}
        values["collisions"] = np.nan_to_num(values["collisions"])
        values["hard_share"] = np.nan_to_num(values["hard_share"])
        for lever, some in zip(LEVERS, high.T, strict=True):
            off = [np.nanmean(one[some]) - np.nanmean(one[~some]) for one in values.values()]
            print(f"| {lever} | " + " | ".join(f"{one:+.3g}" for one in off) + " |")
    for name in dict.fromkeys(row["drivers"] for row in rows if "drivers" in row):
        summarised(name, [row for row in rows if row.get("drivers") == name])


def summarised(name: str, rows: list[dict[str, Any]]) -> None:
    """Prints means with 95 % intervals (Student's t), and how likely it has broken down by a flow."""
    print(f"\n{name}: {len(rows)} runs, {sum(row['breakdown'] is not None for row in rows)} of them broke down")
    for measure in ("drop", "before", "discharge", "place_25", "place_50", "place_75", "within_3_m",
                    "merge_lane_speed", "hard_share", "teleports", "collisions", "emergency_stops"):  # fmt: skip
        values = np.array([np.nan if row[measure] is None else row[measure] for row in rows], dtype=float)
        values = values[np.isfinite(values)]  # one that broke down in its last minutes has no discharge
        off = float(student.ppf(0.975, len(values) - 1)) * values.std(ddof=1) / np.sqrt(len(values))
        mean, count = values.mean(), len(values)
        print(f"| {measure} | {mean:.4g} | {mean - off:.4g} to {mean + off:.4g} | {count} |")
    print("breakdown within the five minutes after a flow, by Brilon's product limit:")
    flows = [(flow, k == len(row["flows"]) - 1 and row["breakdown"] is not None) for row in rows
             for k, flow in enumerate(row["flows"])]  # fmt: skip
    survives = 1.0
    for low in range(3000, 4400, 200):
        some = [broke for flow, broke in flows if low <= flow < low + 200]
        survives *= 1.0 - (sum(some) / len(some) if some else 0.0)
        print(f"| {low} to {low + 200} veh/h | {len(some)} | {sum(some)} | {1.0 - survives:.2f} |")


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["screen", folder]:
            screen(Path(folder))
        case ["test", folder, name, *step]:
            check(Path(folder), name, float(step[0]) if step else 0.5)
        case ["show", folder]:
            show(Path(folder))
        case _:
            sys.exit(__doc__)
