"""Time and memory of reading each csv format: rampcast's reader beside polars' own read of the same file.

Each way runs in a process of its own, so that its peak memory is its own. The files are made up, with all the columns
of the real ones: vehicles at a steady speed with a little noise, on a straight road of three lanes. On a busy machine
the ratio of processor times is the fairer number.

    python benchmarks/bench_formats.py                  every format, 4.5 million rows each
    python benchmarks/bench_formats.py highd exid       these two
    python benchmarks/bench_formats.py --rows 450000    a tenth of the rows
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from measure import how_many, print_ratio

ROWS = how_many(4_500_000, tiny=2_000)
ROAD = 400.0  # [m] about what a drone sees
LANES = (-1.8, -5.4, -9.0)  # [m] y of their centres
HIGHD_NEIGHBOURS = (
    *("preceding", "following", "leftPreceding", "leftAlongside", "leftFollowing"),
    *("rightPreceding", "rightAlongside", "rightFollowing"),
)
EXID_NEIGHBOURS = (
    *("leadId", "rearId", "leftLeadId", "leftRearId", "leftAlongsideId"),
    *("rightLeadId", "rightRearId", "rightAlongsideId"),
)
TARGETS = "targets: less than twice polars' time, less than 1,200 MB"


class Traffic(NamedTuple):
    """Made-up traffic as columns of equal length: whole numbers, and floats in [m] and [m/s]."""

    vehicle: np.ndarray
    frame: np.ndarray
    x: np.ndarray
    y: np.ndarray
    lane: np.ndarray  # from 0 at the left
    speed: np.ndarray
    seen: np.ndarray  # for so many frames before
    noise: np.ndarray  # for whatever else a file holds


class Case(NamedTuple):
    """A format: what writes its files to a folder, and the site to read them with (None: drafted from the files)."""

    write: Callable[[Path, int], list[Path]]
    site: Mapping[str, Any] | None = None
    is_csv: bool = True  # or else there is nothing of polars' to compare with, and MB/s are printed


def straight(sources: tuple[str, ...] = (), east: float = 0.0, north: float = 0.0) -> dict[str, Any]:
    """Returns the site of the made-up road; `sources` name its lanes, it begins at (east, north) in the plane [m]."""
    lanes = [{"number": number + 1, "role": "main", "centre": y} for number, y in enumerate(LANES)]
    for lane, name in zip(lanes, sources, strict=False):
        lane["sources"] = [name]
    return {
        "name": "made-up",
        "title": "made up",
        "simulated": True,
        "length": ROAD,
        "speed_limit": 40.0,
        "lanes": lanes,
        "reference": [[east, north], [east + ROAD, north]],
    }


def made_up(rows: int, rate: float) -> Traffic:
    """Returns about so many rows, sorted by vehicle and frame, at so many frames a second."""
    rng = np.random.default_rng(1)
    seen = round(14.0 * rate)  # [frames] highD's vehicles are seen for 13.6 s (median)
    vehicles = max(1, rows // seen)
    frames = np.tile(np.arange(seen), vehicles)
    start = np.repeat(np.sort(rng.integers(1, vehicles * 8, vehicles)), seen)
    lane = np.repeat(rng.integers(0, len(LANES), vehicles), seen)
    speed = np.repeat(rng.uniform(22, 28, vehicles), seen)
    noise = rng.normal(0, 1, len(frames)).round(2)
    return Traffic(
        vehicle=np.repeat(np.arange(1, vehicles + 1), seen),
        frame=start + frames,
        x=(5 + speed * frames / rate).round(2),
        y=(np.array(LANES)[lane] + 0.2 * noise).round(2),
        lane=lane,
        speed=speed.round(2),
        seen=frames,
        noise=noise,
    )


def write_highd(folder: Path, rows: int) -> list[Path]:
    """Writes highD's three files, the lower direction."""
    t = made_up(rows, 25.0)
    zero = pl.lit(0)
    path = folder / "01_tracks.csv"
    pl.DataFrame({"frame": t.frame, "id": t.vehicle, "x": t.x - 4.85, "y": 19.08 - t.y}).with_columns(
        pl.col("x", "y").round(2),
        width=pl.lit(4.85),
        height=pl.lit(1.92),
        xVelocity=pl.Series(t.speed),
        yVelocity=pl.Series(t.noise),
        xAcceleration=pl.Series(t.noise),
        yAcceleration=pl.Series(t.noise),
        frontSightDistance=(ROAD - pl.col("x")).round(2),
        backSightDistance=pl.col("x"),
        dhw=pl.Series(np.abs(t.noise) * 20).round(2),
        thw=pl.Series(np.abs(t.noise)).round(2),
        ttc=pl.Series(t.noise * 50).round(2),
        precedingXVelocity=pl.Series(t.speed),
        **{f"{name}Id": (pl.col("id") - place) if place % 2 else zero for place, name in enumerate(HIGHD_NEIGHBOURS)},
        laneId=pl.Series(t.lane + 5),
    ).write_csv(path)
    ids = pl.DataFrame({"id": np.unique(t.vehicle)})
    ids.with_columns(pl.lit("Car").alias("class"), drivingDirection=pl.lit(2)).write_csv(folder / "01_tracksMeta.csv")
    (folder / "01_recordingMeta.csv").write_text(
        "id,frameRate,locationId,speedLimit,upperLaneMarkings,lowerLaneMarkings\n"
        "1,25,2,-1.00,8.51;12.59;16.43,20.0;23.6;27.2;30.8\n"
    )
    return [path]


def write_exid(folder: Path, rows: int) -> list[Path]:
    """Writes exiD's three files: centres, lanelets, some rows in two of them."""
    t = made_up(rows, 25.0)
    noise = pl.Series(t.noise)
    lanelet = pl.Series(t.lane + 1501).cast(pl.String)
    path = folder / "00_tracks.csv"
    pl.DataFrame({"recordingId": np.zeros_like(t.frame), "trackId": t.vehicle, "frame": t.frame}).with_columns(
        trackLifetime=pl.Series(t.seen),
        xCenter=pl.Series(t.x - 2.4).round(4),
        yCenter=pl.Series(t.y),
        heading=(noise % 360).round(3),
        width=pl.lit(1.92),
        length=pl.lit(4.85),
        xVelocity=pl.Series(t.speed),
        **dict.fromkeys(("yVelocity", "xAcceleration", "yAcceleration"), noise),
        lonVelocity=pl.Series(t.speed),
        **dict.fromkeys(("latVelocity", "lonAcceleration", "latAcceleration"), noise),
        traveledDistance=pl.Series(t.x),
        latLaneCenterOffset=noise,
        laneWidth=pl.lit(3.6),
        laneletId=pl.when(pl.col("frame") % 20 == 0).then(lanelet + ";1509").otherwise(lanelet),
        laneChange=pl.lit(0),
        lonLaneletPos=pl.Series(t.x),
        laneletLength=pl.lit(400.0),
        **dict.fromkeys(("leadDHW", "leadDV", "leadTHW", "leadTTC"), noise),
        **{name: pl.col("trackId") - place for place, name in enumerate(EXID_NEIGHBOURS)},
        odrRoadId=pl.lit(0),
        odrSectionNo=pl.lit(0),
        odrLaneId=pl.Series(-1 - t.lane),
    ).write_csv(path)
    ids = pl.DataFrame({"recordingId": 0, "trackId": np.unique(t.vehicle)})
    ids.with_columns(pl.lit("car").alias("class")).write_csv(folder / "00_tracksMeta.csv")
    (folder / "00_recordingMeta.csv").write_text(
        "recordingId,locationId,frameRate,speedLimit,xUtmOrigin,yUtmOrigin,orthoPxToMeter\n"
        "0,0,25.0,-1.0,295000.0,5628000.0,0.1\n"
    )
    return [path]


def write_interaction(folder: Path, rows: int) -> list[Path]:
    """Writes one file of INTERACTION's tracks of vehicles."""
    t = made_up(rows, 10.0)
    path = folder / "vehicle_tracks_000.csv"
    pl.DataFrame({"track_id": t.vehicle, "frame_id": t.frame, "timestamp_ms": t.frame * 100}).with_columns(
        agent_type=pl.lit("car"),
        x=pl.Series(t.x - 2.4).round(3),
        y=pl.Series(t.y).round(3),
        vx=pl.Series(t.speed),
        vy=pl.Series(t.noise),
        psi_rad=pl.Series(t.noise * 0.01).round(3),
        length=pl.lit(4.85),
        width=pl.lit(1.92),
    ).write_csv(path)
    return [path]


def write_plain(folder: Path, rows: int) -> list[Path]:
    """Writes a table in rampcast's own columns, 25 Hz."""
    t = made_up(rows, 25.0)
    path = folder / "table.csv"
    pl.DataFrame(
        {"vehicle": t.vehicle, "time": (t.frame / 25.0).round(2), "x": t.x, "y": t.y, "lane": t.lane + 1}
    ).with_columns(
        length=pl.lit(4.85),
        width=pl.lit(1.92),
        kind=pl.lit("car"),
        speed=pl.Series(t.speed),
        acceleration=pl.Series(t.noise),
    ).write_csv(path)
    return [path]


def write_citysim(folder: Path, rows: int) -> list[Path]:
    """Writes CitySim's csv, without the columns of latitudes and longitudes: 30 Hz, feet, y down."""
    t = made_up(rows, 30.0)
    x, y = t.x / 0.3048, -t.y / 0.3048
    ends = {"carCenter": 8.0, "head": 0.0, "tail": 16.0}
    corners = {"1": (0, 3), "2": (16, 3), "3": (16, -3), "4": (0, -3)}
    points = {name: (x - back, y) for name, back in ends.items()}
    points |= {f"boundingBox{name}": (x - back, y + side) for name, (back, side) in corners.items()}
    columns = {"frameNum": t.frame, "carId": t.vehicle}
    for unit, scale in (("", 10.0), ("ft", 1.0)):
        for name, (px, py) in points.items():
            columns |= {f"{name}X{unit}": (px * scale).round(2), f"{name}Y{unit}": (py * scale).round(2)}
    columns |= {"speed": (t.speed / 0.44704).round(2), "course": 0.1 * t.noise, "laneId": t.lane + 1}
    path = folder / "FreewayX-01.csv"
    pl.DataFrame(columns).write_csv(path)
    return [path]


def write_sumo(folder: Path, rows: int) -> list[Path]:
    """Writes SUMO's floating car data as csv, sorted by time, with its columns as they are without any option."""
    path = folder / "fcd.csv"
    floating_car_data(rows).write_csv(path)
    return [path]


def write_sumo_xml(folder: Path, rows: int) -> list[Path]:
    """Writes the same as xml, one element a line."""
    path = folder / "fcd.xml"
    table = floating_car_data(rows)
    names = [name for name in table.columns if name.startswith("vehicle_") and name != "vehicle_edge"]
    attributes = " ".join(f'{name.removeprefix("vehicle_")}="{{}}"' for name in names)
    with path.open("w") as file:
        file.write('<?xml version="1.0" encoding="UTF-8"?>\n\n<fcd-export>\n')
        for part in table.iter_slices(200_000):
            vehicle = part.select(pl.col("timestep_time"), line=pl.format(f"        <vehicle {attributes}/>\n", *names))
            steps = vehicle.group_by("timestep_time", maintain_order=True).agg(pl.col("line").str.join(""))
            for time_, lines in steps.iter_rows():
                file.write(f'    <timestep time="{time_:.2f}">\n{lines}    </timestep>\n')
        file.write("</fcd-export>\n")
    return [path]


def floating_car_data(rows: int) -> pl.DataFrame:
    """Returns what SUMO writes of the made-up traffic, sorted by time."""
    t = made_up(rows, 10.0)
    x = pl.Series(t.x)
    columns = {"timestep_time": (t.frame * 0.1).round(2), "vehicle_id": t.vehicle, "vehicle_x": x, "vehicle_y": t.y}
    return (
        pl.DataFrame(columns)
        .with_columns(
            pl.format("flow.{}", "vehicle_id").alias("vehicle_id"),
            vehicle_angle=pl.lit(90.0),
            vehicle_type=pl.lit("passenger"),
            vehicle_speed=pl.Series(t.speed),
            vehicle_pos=x,
            vehicle_lane=pl.format("main_{}", pl.Series(2 - t.lane)),
            vehicle_edge=pl.lit(None, pl.String()),
            vehicle_slope=pl.lit(0.0),
        )
        .sort("timestep_time", maintain_order=True)
    )


def write_tgsim(folder: Path, rows: int) -> list[Path]:
    """Writes TGSIM's csv in the portal's spelling."""
    t = made_up(rows, 10.0)
    path = folder / "TGSIM_Trajectories.csv"
    table = {
        "ID": t.vehicle,
        "time": (0.1 * t.frame).round(1),
        "xloc-kf": t.x,
        "yloc-kf": t.y,
        "lane-kf": t.lane + 1,
        "speed-kf": t.speed,
        "acceleration-kf": t.noise,
        "length-smoothed": (4.8 + 0.01 * t.noise).round(3),
    }
    last = {"width-smoothed": 1.92, "type-most-common": "small-vehicle", "ACC": "no", "run-index": 1}
    pl.DataFrame(table).with_columns(pl.lit(value).alias(name) for name, value in last.items()).write_csv(path)
    return [path]


def write_i24_mvt(folder: Path, rows: int) -> list[Path]:
    """Writes the version of I-24 MOTION with lanes as a table, driving west."""
    t = made_up(rows, 25.0)
    path = folder / "mvt.csv"
    table = {
        "timestamp": (1_669_125_200.0 + 0.04 * t.frame).round(4),
        "x_position_meters": (ROAD - t.x).round(4),
        "y_position_corrected_meters": -t.y,
        "lane_number": t.lane + 1,
        "speed_meters_per_second": t.speed,
        "acceleration_meters_per_second_per_second": t.noise,
        "road_grade_radians": (0.01 * t.noise).round(4),
        "fuel_rate_grams_per_second": t.noise,
    }
    last = {"coarse_vehicle_class": 0, "length": 15.12, "width": 6.02, "height": 5.1, "energy_model": "midBase"}
    names = pl.format("64888e87a1b2c3d4{}-0", pl.Series(t.vehicle).cast(pl.String).str.zfill(8)).alias("trajectory_id")
    values = (pl.lit(value).alias(name) for name, value in last.items())
    pl.DataFrame(table).select(names, pl.all(), *values).write_csv(path)
    return [path]


CASES: dict[str, Case] = {
    "highd": Case(write_highd),
    "exid": Case(write_exid, straight(("1501", "1502", "1503"), east=295_000.0, north=5_628_000.0)),
    "interaction": Case(write_interaction, straight()),
    "plain": Case(write_plain),
    "citysim": Case(write_citysim, straight(("1", "2", "3"))),
    "sumo": Case(write_sumo, straight(("main_2", "main_1", "main_0"))),
    "sumo-xml": Case(write_sumo_xml, straight(("main_2", "main_1", "main_0")), is_csv=False),
    "tgsim": Case(write_tgsim, straight(("1", "2", "3"))),
    "i24_mvt": Case(write_i24_mvt, straight(("1", "2", "3")) | {"reference": [[ROAD, 0.0], [0.0, 0.0]]}),
}


def main() -> None:
    """Prints the table, or does one way of reading when it is its own subprocess."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("formats", nargs="*", help=f"of {', '.join(CASES)}; default: all")
    options.add_argument("--rows", type=int, default=ROWS)
    options.add_argument("--repeat", type=int, default=how_many(3, tiny=1), help="the best of so many runs counts")
    options.add_argument("--way", choices=["write", "ours", "polars"], help=argparse.SUPPRESS)
    options.add_argument("--files", nargs="*", help=argparse.SUPPRESS)
    chosen = options.parse_args()
    if chosen.way == "write":
        print(json.dumps([str(path) for path in CASES[chosen.formats[0]].write(Path(chosen.files[0]), chosen.rows)]))
        return
    if chosen.way:
        measure(chosen.way, chosen.formats[0], [Path(name) for name in chosen.files])
        return
    print(
        f"{'':<14}{'rows':>11}{'MB':>7}{'ours s':>9}{'polars s':>10}{'ratio':>7}{'CPU ratio':>11}{'peak MB':>9}", end=""
    )
    print(f"{'polars MB':>11}")
    for name in chosen.formats or list(CASES)[: how_many(len(CASES), tiny=1)]:
        with tempfile.TemporaryDirectory() as folder:
            names = run("write", name, [Path(folder)], rows=chosen.rows)
            compare(name, [Path(one) for one in names], chosen.repeat)
    print(TARGETS)


def compare(name: str, paths: list[Path], repeat: int) -> None:
    """Prints one format's line of the table."""
    if not CASES[name].is_csv:
        compare_nothing(name, paths, repeat)
        return
    runs = [{way: run(way, name, paths) for way in ("ours", "polars")} for _ in range(repeat)]
    ours, polars = (min((one[way] for one in runs), key=lambda found: found["seconds"]) for way in ("ours", "polars"))
    size = sum(path.stat().st_size for path in paths) / 1e6
    ratio, work = (ours[name] / polars[name] for name in ("seconds", "cpu_seconds"))
    times = f"{ours['seconds']:>9.2f}{polars['seconds']:>10.2f}{ratio:>7.2f}{work:>11.2f}"
    print(f"{name:<14}{ours['rows']:>11,}{size:>7,.0f}{times}{ours['peak_mb']:>9,.0f}{polars['peak_mb']:>11,.0f}")
    print_ratio(f"{name}, processor time over that of polars' csv reader", work)


def compare_nothing(name: str, paths: list[Path], repeat: int) -> None:
    """Prints the line of a format that polars does not read."""
    ours = min((run("ours", name, paths) for _ in range(repeat)), key=lambda found: found["seconds"])
    size = sum(path.stat().st_size for path in paths) / 1e6
    rate = f"{size / ours['seconds']:.0f} MB/s"
    print(f"{name:<14}{ours['rows']:>11,}{size:>7,.0f}{ours['seconds']:>9.2f}{rate:>17}{ours['peak_mb']:>9,.0f}")


def run(way: str, name: str, paths: list[Path], *, rows: int = ROWS) -> Any:
    """Returns what one way, run in a process of its own, measured; files are written so too, with the rows' memory."""
    command = [sys.executable, __file__, name, "--way", way, "--rows", str(rows), "--files", *map(str, paths)]
    return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout)


def measure(way: str, name: str, paths: list[Path]) -> None:
    """Prints rows, seconds and peak memory of one way as json; imports are not counted in the time."""
    from rampcast.formats import read_all
    from rampcast.sites.site import site_from_dict

    values = CASES[name].site
    site = site_from_dict(dict(values)) if values else None
    start, start_cpu = time.perf_counter(), time.process_time()
    if way == "polars":
        rows = sum(pl.read_csv(path).height for path in paths)
    else:
        recordings, _ = read_all(paths, site=site)
        rows = sum(recording.tracks.height for recording in recordings)
    seconds, cpu_seconds = time.perf_counter() - start, time.process_time() - start_cpu
    peak = peak_memory()
    print(json.dumps({"rows": rows, "seconds": seconds, "cpu_seconds": cpu_seconds, "peak_mb": peak}))


def peak_memory() -> float:
    """Returns the most memory that this process has held [MB]; unlike `getrusage` it leaves out who started it."""
    status = Path("/proc/self/status").read_text()
    return int(status.partition("VmHWM:")[2].split()[0]) * 1024 / 1e6  # [KiB] in the file


if __name__ == "__main__":
    main()
