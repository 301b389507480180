"""A simulated recording of a site: SUMO drives, rampcast reads what it did."""

import tempfile
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl
from jaxtyping import Float

from rampcast.errors import RecordingError
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.simulate.demand import draw_vehicles, write_sign, write_vehicles
from rampcast.simulate.drivers import DEFAULT, Drivers, drivers_of
from rampcast.simulate.lateral import lateral_path
from rampcast.simulate.network import Road, main_lanes, ramp_roads, roads, write_network
from rampcast.simulate.noise import add_position_noise
from rampcast.simulate.programs import Progress, program, run_with_progress
from rampcast.simulate.queue_headway import with_queue_headway
from rampcast.sites import Site, site_of

TIME_STEP = 0.1  # [s] NGSIM's 10 Hz; SUMO steps at the same rate, nothing is interpolated
SETTLE = 10.0  # [s] simulated before and after the recording, so that lane changes at its edges are whole
RAMP_SLOPE = 0.04  # [m/m] by which the ramp nears the main road before the gore: 28.6 to 24.0 m from the left on I-80
FLOW_PER_LANE = 1900.0  # [vehicles/h]
RAMP_FLOW = 600.0  # [vehicles/h]
SHARES = (0.015, 0.945, 0.04)  # motorcycles, cars, trucks; about those of NGSIM's I-80
SIGN_SPEEDS = (5.0, 16.0)  # [m/s]
MINUTES = 15.0  # as NGSIM's windows
WARM_UP = 240.0  # [s]


def simulate(
    site: Site | str | Path,
    *,
    minutes: float = MINUTES,
    seed: int = 1,
    window: str = "1",
    flow_per_lane: float = FLOW_PER_LANE,
    ramp_flow: float = RAMP_FLOW,
    shares: tuple[float, float, float] = SHARES,
    sign_speeds: tuple[float, float] = SIGN_SPEEDS,
    warm_up: float = WARM_UP,
    position_noise: float = 0.0,
    drivers: str = DEFAULT.name,
    progress: Progress | None = None,
) -> Recording:
    """Returns a simulated recording of all lanes of a site, 10 Hz, congested, with waves that travel upstream.

    The same arguments and release of SUMO give the same recording; a shorter one begins a longer one.

    Args:
        site: the geometry, or its name or file; of its lanes the main ones and the ramp are simulated.
        minutes: recorded time [min].
        seed: of every draw.
        window: its name; the recording is called "<site>-<window>".
        flow_per_lane: vehicles that want to enter each main lane [vehicles/h]; what the sign holds back makes a queue.
        ramp_flow: vehicles that want to enter from the ramp [vehicles/h].
        shares: of motorcycles, cars and trucks; they sum to 1.
        sign_speeds: lowest and highest that the sign downstream draws [m/s].
        warm_up: simulated time before the recording begins [s].
        position_noise: standard deviation of noise added to the positions [m], see `add_position_noise`.
        drivers: name of a set of drivers, in `drivers.DRIVERS`.
        progress: called with the share done, 0 to 1.

    Raises:
        MissingExtra: SUMO is not installed.
        RampcastError: the site's target lane is not its rightmost main lane, or an argument has no meaning.
    """
    demand = Demand(flow_per_lane, ramp_flow, shares, sign_speeds, warm_up, seed, drivers_of(drivers))
    whole = _recorded(site_of(site), demand, minutes=minutes, window=window, progress=progress)
    return add_position_noise(whole, standard_deviation=position_noise, seed=seed)


class Demand(NamedTuple):
    """Who wants to drive, and what holds them back; see `simulate`."""

    flow_per_lane: float
    ramp_flow: float
    shares: tuple[float, float, float]
    sign_speeds: tuple[float, float]
    warm_up: float
    seed: int
    drivers: Drivers = DEFAULT


def _recorded(site: Site, demand: Demand, *, minutes: float, window: str, progress: Progress | None) -> Recording:
    """Returns the recording without noise."""
    begin, seed = demand.warm_up, demand.seed
    if minutes <= 0 or begin < SETTLE:
        raise RecordingError(f"expected minutes > 0 and warm_up >= {SETTLE} s, got {minutes} and {begin}")
    end = begin + 60 * minutes + SETTLE
    with tempfile.TemporaryDirectory(prefix="rampcast-") as name:
        folder = Path(name)
        network = write_network(site, folder)
        vehicles = vehicles_of(site, demand, until=end)
        write_vehicles(
            vehicles, main=roads(site), ramp=ramp_roads(site), path=folder / "vehicles.xml", drivers=demand.drivers
        )
        sign = next(road for road in roads(site) if road.name == "slow")
        write_sign(folder / "sign.xml", road=sign, speeds=demand.sign_speeds, warm_up=begin, duration=end, seed=seed)
        positions = _drive(folder, network, demand, begin=begin - SETTLE, end=end, progress=progress)
    tracks = _tracks(positions, vehicles, site=site, seed=seed, begin=begin, frames=round(600 * minutes))
    named = tracks.with_columns(pl.lit(f"{site.name}-{window}").alias(c.RECORDING)).select(list(c.SCHEMA))
    return Recording(tracks=named.cast(pl.Schema(c.SCHEMA)), site=site, time_step=TIME_STEP, source="simulated")


def vehicles_of(site: Site, demand: Demand, *, until: float) -> pl.DataFrame:
    """Returns the vehicles of all lanes in the order in which they set out."""
    lanes = len(main_lanes(site))
    draw = partial(draw_vehicles, duration=until, shares=demand.shares, seed=demand.seed, drivers=demand.drivers)
    main = draw(route="main", lanes=lanes, flow=demand.flow_per_lane * lanes)
    ramp = draw(route="ramp", lanes=1, flow=demand.ramp_flow)
    return pl.concat([main, ramp]).sort("depart", maintain_order=True)


def _drive(
    folder: Path, network: Path, demand: Demand, *, begin: float, end: float, progress: Progress | None
) -> pl.DataFrame:
    """Returns SUMO's record of every vehicle near the section: time [s], id, lane (SUMO's) and pos (along it) [m]."""
    watched = ["before", "merge", "after", "ramp"]
    (folder / "watched.txt").write_text("\n".join(f"edge:{name}" for name in watched), encoding="utf-8")
    record = folder / "record.csv"
    command = [program("sumo"), "-n", network, "-r", folder / "vehicles.xml", "-a", folder / "sign.xml"]
    command += [
        "--seed",
        demand.seed,
        "--step-length",
        TIME_STEP,
        "--end",
        end,
        "--step-log.period",
        round(10 / TIME_STEP),
    ]
    command += ["--fcd-output", record, "--fcd-output.filter-edges.input-file", folder / "watched.txt"]
    command += ["--fcd-output.attributes", "id,lane,pos", "--device.fcd.begin", begin, "--precision", 3]
    # Vehicles are never removed for standing long; those that find no room to enter for half a minute are dropped.
    command += ["--time-to-teleport", -1, "--collision.action", "warn", "--max-depart-delay", 30]
    command += ["--xml-validation", "never", "--no-warnings", "true"]
    run_with_progress(with_queue_headway(command, demand.drivers), end=end, progress=progress)
    table = pl.read_csv(record, separator=";", schema_overrides={"vehicle_id": pl.Int32, "timestep_time": pl.Float64})
    table = table.rename({name: name.removeprefix("vehicle_").removeprefix("timestep_") for name in table.columns})
    return table.drop_nulls("id")


def _tracks(
    positions: pl.DataFrame, vehicles: pl.DataFrame, *, site: Site, seed: int, begin: float, frames: int
) -> pl.DataFrame:
    """Returns the rows inside the section and the recorded time, with vehicles numbered from 1 as they appear."""
    watched = [*roads(site)[1:4], ramp_roads(site)[1]]
    rows = _numbered_lanes(positions, site, watched).with_columns(
        ((pl.col("time") - begin) / TIME_STEP).round().cast(pl.Int32).alias(c.FRAME)
    )
    rows = rows.sort("id", c.FRAME).with_columns(pl.Series(c.Y, _lateral(rows.sort("id", c.FRAME), site, seed)))
    inside = rows.filter(pl.col(c.FRAME).is_between(0, frames - 1), pl.col(c.X).is_between(0, site.length))
    first = inside.sort(c.FRAME, c.X, "id", descending=[False, True, False]).unique(
        "id", keep="first", maintain_order=True
    )
    numbers = first.select("id").with_row_index(c.VEHICLE, offset=1)
    bodies = vehicles.select(c.LENGTH, c.WIDTH, c.KIND).with_row_index("id").with_columns(pl.col("id").cast(pl.Int32))
    return inside.join(numbers, on="id").join(bodies, on="id").sort(c.VEHICLE, c.FRAME)


def _numbered_lanes(positions: pl.DataFrame, site: Site, watched: list[Road]) -> pl.DataFrame:
    """Returns the positions with x and the site's lane numbers; SUMO counts lanes of an edge from the right, from 0."""
    places = []
    mains = main_lanes(site)
    for road in watched:
        # A site with two ramp lanes (US-101) numbers the ramp before the gore last and the auxiliary lane first.
        numbers = {"ramp": [site.ramp_lanes[-1]], "merge": [*mains, site.ramp_lanes[0]]}.get(road.name, mains)
        places += [(f"{road.name}_{k}", number, road.start) for k, number in enumerate(reversed(numbers))]
    table = pl.DataFrame(places, schema={"lane": pl.String, "number": pl.Int16, "start": pl.Float64}, orient="row")
    joined = positions.join(table, on="lane")
    return joined.select("id", "time", pl.col("number").alias(c.LANE), (pl.col("pos") + pl.col("start")).alias(c.X))


def _lateral(rows: pl.DataFrame, site: Site, seed: int) -> Float[np.ndarray, "row"]:
    """Returns the lateral position of every row [m]; rows are sorted by vehicle and time."""
    centres = {lane.number: lane.centre for lane in site.lanes}
    x, lane = rows[c.X].to_numpy(), rows[c.LANE].to_numpy()
    centre = np.array([centres.get(number, np.nan) for number in range(max(centres) + 1)])[lane]
    on_ramp = site.on_ramp(lane)
    centre = centre - on_ramp * RAMP_SLOPE * np.maximum(0.0, site.gore - x)
    ids = rows["id"].to_numpy()
    edges = [0, *(np.flatnonzero(np.diff(ids)) + 1).tolist(), len(ids)]
    y = np.empty(len(x))
    for start, stop in pairwise(edges):
        part = slice(start, stop)
        stream = np.random.default_rng([seed, 3, int(ids[start])])
        y[part] = lateral_path(
            x[part], centre[part], lane=lane[part], lane_centres=centres, time_step=TIME_STEP, stream=stream
        )
    return y
