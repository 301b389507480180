"""Who drives, when, and how: every vehicle of a simulation has its own driver, drawn from ranges.

Each kind of draw has its own random stream, so that a longer simulation starts with the vehicles of a shorter one.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import polars as pl
from jaxtyping import Float

from rampcast.recording.columns import KIND, KINDS, LENGTH, WIDTH
from rampcast.simulate.drivers import DEFAULT, Drivers
from rampcast.simulate.network import Road

LENGTHS = {"motorcycle": (2.0, 2.4), "car": (3.8, 5.4), "truck": (8.0, 18.0)}  # [m]; the spread seen in NGSIM
WIDTHS = {"motorcycle": (0.7, 0.9), "car": (1.7, 2.1), "truck": (2.3, 2.6)}  # [m]
SUMO_CLASSES = {"motorcycle": "motorcycle", "car": "passenger", "truck": "truck"}
ROUTES = ("main", "ramp")
SIGN_HOLD = (20.0, 60.0)  # [s] how long the sign shows one speed
# The sign shows this speed for this share of the warm-up, so that the queue reaches the section in time; by trial
FILLING_SPEED, FILLING_SHARE = 2.0, 0.6  # [m/s]


def draw_vehicles(
    *,
    route: str,
    lanes: int,
    flow: float,
    duration: float,
    shares: tuple[float, float, float],
    seed: int,
    drivers: Drivers = DEFAULT,
) -> pl.DataFrame:
    """Returns one row per vehicle of a route in order of departure.

    Args:
        route: "main" or "ramp".
        lanes: number of lanes at the source.
        flow: demand [vehicles/h], all lanes together; departures are a Poisson process.
        duration: time over which vehicles depart [s].
        shares: of motorcycles, cars and trucks; they sum to 1.
        seed: of all draws.
        drivers: who may drive.
    """
    # Twice the mean number plus 50 covers the duration with certainty for all practical purposes (> 10 sigma).
    count = int(2 * flow * duration / 3600) + 50
    streams = (np.random.default_rng([seed, ROUTES.index(route), key]) for key in range(100))
    depart = np.cumsum(next(streams).exponential(3600 / flow, count))
    found = draw_drivers(streams, depart, route=route, lanes=lanes, shares=shares, drivers=drivers)
    return found.filter(pl.col("depart") < duration)


def draw_drivers(
    streams: Iterator[np.random.Generator],
    depart: Float[np.ndarray, "vehicle"],
    *,
    route: str,
    lanes: int,
    shares: tuple[float, float, float],
    drivers: Drivers,
) -> pl.DataFrame:
    """Returns one row per vehicle that sets out at those times [s], each kind of draw from the next stream."""
    count = len(depart)
    kind = next(streams).choice(len(KINDS), size=count, p=shares)
    columns: dict[str, object] = {
        "depart": np.round(depart, 1),
        "route": [route] * count,
        "lane": next(streams).integers(0, lanes, count),
        KIND: [KINDS[k] for k in kind],
    }
    tables: list[tuple[str, dict[str, tuple[float, float]]]] = [(LENGTH, LENGTHS), (WIDTH, WIDTHS)]
    tables += [(name, {k: drivers.ranges[k][name] for k in KINDS}) for name in drivers.parameters]
    for name, table in tables:
        bounds = np.array([table[k] for k in KINDS])[kind]
        columns[name] = np.round(_uniform(next(streams), bounds), 2)
    return pl.DataFrame(columns)


def _uniform(stream: np.random.Generator, bounds: Float[np.ndarray, "vehicle 2"]) -> Float[np.ndarray, "vehicle"]:
    low, high = bounds[:, 0], bounds[:, 1]
    drawn: Float[np.ndarray, "vehicle"] = low + (high - low) * stream.random(len(bounds))
    return drawn


def write_vehicles(
    vehicles: pl.DataFrame, *, main: list[Road], ramp: list[Road], path: Path, drivers: Drivers = DEFAULT
) -> None:
    """Writes SUMO's file of routes, drivers and vehicles; a vehicle's id is its row number."""
    joined = [*ramp, *main[2:]]
    routes = {name: [road.name for road in route] for name, route in zip(ROUTES, (main, joined), strict=True)}
    write_routes(vehicles, routes, path, drivers=drivers)


def write_routes(
    vehicles: pl.DataFrame, routes: Mapping[str, Sequence[str]], path: Path, *, drivers: Drivers, speed: str = "avg"
) -> None:
    """Writes SUMO's file of routes, drivers and vehicles.

    Args:
        vehicles: as `draw_vehicles` returns them; a vehicle's id is its row number.
        routes: names of the edges of each route.
        path: of the file.
        drivers: the set that they were drawn from.
        speed: with which they set out, in SUMO's words.
    """
    lines = ["<routes>"]
    for name, edges in routes.items():
        lines.append(f'<route id="{name}" edges="{" ".join(edges)}"/>')
    fixed = " ".join(f'{name}="{value}"' for name, value in drivers.alike.items())
    for row, values in enumerate(vehicles.iter_rows(named=True)):
        own = " ".join(f'{name}="{values[name]}"' for name in (LENGTH, WIDTH, *drivers.parameters))
        lines.append(f'<vType id="driver_{row}" vClass="{SUMO_CLASSES[values[KIND]]}" {own} {fixed}/>')
        lines.append(
            f'<vehicle id="{row}" type="driver_{row}" route="{values["route"]}" depart="{values["depart"]}" '
            f'departLane="{values["lane"]}" departSpeed="{speed}"/>'
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
