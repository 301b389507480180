"""Who drives, when, and how: every vehicle of a simulation has its own driver, drawn from ranges.

Each kind of draw has its own random stream, so that a longer simulation starts with the vehicles of a shorter one.
"""

from pathlib import Path

import numpy as np
import polars as pl
from jaxtyping import Float

from rampcast.recording.columns import KIND, KINDS, LENGTH, WIDTH
from rampcast.simulate.network import Road

# Uniform ranges of a driver's parameters in SUMO's EIDM and LC2013 models. A range of drivers rather than one spreads
# the merge places; the values were chosen by trial so that the traffic meets `realism.ACCEPTED`.
CAR_RANGES = {
    "tau": (0.7, 1.4),  # time headway [s]
    "accel": (1.0, 2.0),  # [m/s^2]
    "decel": (1.5, 3.0),  # comfortable braking [m/s^2]
    "minGap": (1.5, 3.0),  # standstill gap [m]
    "speedFactor": (0.85, 1.15),  # desired speed over the limit
    "lcStrategic": (0.2, 3.0),  # eagerness to change for the route's sake
    "lcAssertive": (0.6, 1.8),  # willingness to take small gaps
    "lcCooperative": (0.5, 1.0),  # willingness to make room
}
TRUCK_RANGES = CAR_RANGES | {"tau": (1.2, 1.8), "accel": (0.6, 1.0), "speedFactor": (0.8, 0.95)}
# SUMO's drivers keep to the right and do not pass on the right, as in Europe; on a Californian freeway they may.
EVERY_DRIVER = {
    "carFollowModel": "EIDM",
    "lcKeepRight": 0,
    "lcSpeedGain": 1,
    "lcSpeedGainRight": 1,
    "lcOvertakeRight": 1,
}
RANGES = {"motorcycle": CAR_RANGES, "car": CAR_RANGES, "truck": TRUCK_RANGES}
LENGTHS = {"motorcycle": (2.0, 2.4), "car": (3.8, 5.4), "truck": (8.0, 18.0)}  # [m]; the spread seen in NGSIM
WIDTHS = {"motorcycle": (0.7, 0.9), "car": (1.7, 2.1), "truck": (2.3, 2.6)}  # [m]
SUMO_CLASSES = {"motorcycle": "motorcycle", "car": "passenger", "truck": "truck"}
ROUTES = ("main", "ramp")
SIGN_HOLD = (20.0, 60.0)  # [s] how long the sign shows one speed
# The sign shows this speed for this share of the warm-up, so that the queue reaches the section in time; by trial
FILLING_SPEED, FILLING_SHARE = 2.0, 0.6  # [m/s]


def draw_vehicles(
    *, route: str, lanes: int, flow: float, duration: float, shares: tuple[float, float, float], seed: int
) -> pl.DataFrame:
    """Returns one row per vehicle of a route in order of departure.

    Args:
        route: "main" or "ramp".
        lanes: number of lanes at the source.
        flow: demand [vehicles/h], all lanes together; departures are a Poisson process.
        duration: time over which vehicles depart [s].
        shares: of motorcycles, cars and trucks; they sum to 1.
        seed: of all draws.
    """
    # Twice the mean number plus 50 covers the duration with certainty for all practical purposes (> 10 sigma).
    count = int(2 * flow * duration / 3600) + 50
    streams = (np.random.default_rng([seed, ROUTES.index(route), key]) for key in range(100))
    depart = np.cumsum(next(streams).exponential(3600 / flow, count))
    kind = next(streams).choice(len(KINDS), size=count, p=shares)
    columns: dict[str, object] = {
        "depart": np.round(depart, 1),
        "route": [route] * count,
        "lane": next(streams).integers(0, lanes, count),
        KIND: [KINDS[k] for k in kind],
    }
    tables: list[tuple[str, dict[str, tuple[float, float]]]] = [(LENGTH, LENGTHS), (WIDTH, WIDTHS)]
    tables += [(name, {k: RANGES[k][name] for k in KINDS}) for name in CAR_RANGES]
    for name, table in tables:
        bounds = np.array([table[k] for k in KINDS])[kind]
        columns[name] = np.round(_uniform(next(streams), bounds), 2)
    return pl.DataFrame(columns).filter(pl.col("depart") < duration)


def _uniform(stream: np.random.Generator, bounds: Float[np.ndarray, "vehicle 2"]) -> Float[np.ndarray, "vehicle"]:
    low, high = bounds[:, 0], bounds[:, 1]
    drawn: Float[np.ndarray, "vehicle"] = low + (high - low) * stream.random(len(bounds))
    return drawn


def write_vehicles(vehicles: pl.DataFrame, *, main: list[Road], ramp: list[Road], path: Path) -> None:
    """Writes SUMO's file of routes, drivers and vehicles; a vehicle's id is its row number."""
    joined = [*ramp, *main[2:]]
    lines = ["<routes>"]
    for name, route in zip(ROUTES, (main, joined), strict=True):
        lines.append(f'<route id="{name}" edges="{" ".join(road.name for road in route)}"/>')
    fixed = " ".join(f'{name}="{value}"' for name, value in EVERY_DRIVER.items())
    for row, values in enumerate(vehicles.iter_rows(named=True)):
        own = " ".join(f'{name}="{values[name]}"' for name in (LENGTH, WIDTH, *CAR_RANGES))
        lines.append(f'<vType id="driver_{row}" vClass="{SUMO_CLASSES[values[KIND]]}" {own} {fixed}/>')
        lines.append(
            f'<vehicle id="{row}" type="driver_{row}" route="{values["route"]}" depart="{values["depart"]}" '
            f'departLane="{values["lane"]}" departSpeed="avg"/>'
        )
    lines.append("</routes>")
    path.write_text("\n".join(lines), encoding="utf-8")


def write_sign(
    path: Path, *, road: Road, speeds: tuple[float, float], warm_up: float, duration: float, seed: int
) -> None:
    """Writes the variable speed sign whose changes send waves upstream.

    Args:
        path: SUMO's additional file.
        road: the stretch on which the sign holds.
        speeds: lowest and highest speed that it draws [m/s].
        warm_up: time before the recording begins [s].
        duration: of the whole simulation [s].
        seed: of the draws.
    """
    stream = np.random.default_rng([seed, 4])
    lanes = " ".join(f"{road.name}_{lane}" for lane in range(road.lanes))
    steps = [f'<step time="0" speed="{FILLING_SPEED}"/>']
    time = FILLING_SHARE * warm_up
    while time < duration:
        steps.append(f'<step time="{time:.1f}" speed="{stream.uniform(*speeds):.2f}"/>')
        time += stream.uniform(*SIGN_HOLD)
    sign = f'<variableSpeedSign id="sign" lanes="{lanes}">' + "".join(steps) + "</variableSpeedSign>"
    path.write_text(f"<additional>{sign}</additional>", encoding="utf-8")
