"""Twenty tables as trackers write them, of one made-up road: three lanes and a ramp that eight vehicles merge from."""

import math
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import polars as pl

STEP, SECONDS, ROAD = 0.1, 24.0, 400.0
BEGIN = datetime(2026, 6, 3, 7, 30, tzinfo=UTC)
MERGE = 3.5  # [s] that a change of lane takes


def traffic() -> pl.DataFrame:
    """Returns vehicle, frame, t [s], x, y (front centre) [m], lane (4: ramp), speed, length, kind."""
    rows = []
    for number in range(32):
        lane = number % 4 + 1
        speed = 23.0 - 2.0 * lane + 0.3 * (number // 4 % 3)
        start = -60.0 * (number // 4) + 9.0 * lane + 30.0
        changes_at = 6.0 + 0.3 * number if lane == 4 else math.inf
        for frame in range(round(SECONDS / STEP)):
            t = frame * STEP
            x = start + 60.0 + speed * t + 0.6 * math.sin(0.7 * t + number)
            v = speed + 0.42 * math.cos(0.7 * t + number)
            done = 0.5 - 0.5 * math.cos(math.pi * min(max((t - changes_at) / MERGE, 0.0), 1.0))
            if 0.0 <= x <= ROAD and not (lane == 4 and x > 330.0 and done < 0.5):
                y = -3.6 * (lane - 1) - 1.8 + 3.6 * done
                kind, length = ("truck", 12.0) if number % 11 == 5 else ("car", 4.6)
                rows.append((number + 1, frame, t, x, y, 3 if done > 0.5 else lane, v, length, kind))
    names = ("id", "frame", "t", "x", "y", "lane", "v", "length", "kind")
    return pl.DataFrame(rows, schema=names, orient="row").sort("frame", "id")


def turned(table: pl.DataFrame, degrees: float, east: float, north: float) -> pl.DataFrame:
    """Returns the table with columns e and n: the road in a map, that way round."""
    a = math.radians(degrees)
    e = pl.col("x") * math.cos(a) - pl.col("y") * math.sin(a) + east
    n = pl.col("x") * math.sin(a) + pl.col("y") * math.cos(a) + north
    return table.with_columns(e=e, n=n)


def csv(table: pl.DataFrame, path: Path, separator: str = ",", comma: bool = False, digits: int = 3) -> Path:
    rounded = table.with_columns(pl.col(pl.Float64).round(digits))
    text = rounded.write_csv(separator=separator)
    path.write_text(text.replace(".", ",") if comma else text, encoding="utf-8")
    return path


def iso(zone_hours: int = 2) -> pl.Expr:
    def written(t: float) -> str:
        moment = BEGIN + timedelta(seconds=t)
        return (moment + timedelta(hours=zone_hours)).strftime("%Y-%m-%dT%H:%M:%S.%f")[:-3] + f"+{zone_hours:02}:00"

    return pl.col("t").map_elements(written, return_dtype=pl.String)


Expected = dict[str, Any]
Made = tuple[
    pl.DataFrame, dict[str, Any], Expected
]  # table, how it is written, columns of the mapping that are expected


def _tables() -> dict[str, Callable[[], Made]]:
    own = traffic()
    utm = turned(own, 35.0, 458_200.0, 5_428_900.0)
    degrees_n, degrees_e = 111_200.0, 111_320.0 * math.cos(math.radians(49.0))
    earth = turned(own, 35.0, 0.0, 0.0).with_columns(
        lat=49.0 + pl.col("n") / degrees_n, lon=8.4 + pl.col("e") / degrees_e
    )
    near = pl.col("x") < 1e9
    pick = own.select
    ft = 0.3048
    return {
        "camera in UTM metres": lambda: (
            utm.select(
                track_id="id",
                timestamp=iso(),
                easting="e",
                northing="n",
                speed_kmh=pl.col("v") * 3.6,
                **{"class": "kind"},
            ),
            {},
            {
                "time": {"column": "timestamp", "unit": "iso"},
                "x": "easting",
                "y": "northing",
                "speed": {"column": "speed_kmh", "unit": "km/h"},
            },
        ),
        "probe with latitude and longitude": lambda: (
            earth.select(
                DeviceId="id",
                Timestamp=(pl.col("t") * 1000 + BEGIN.timestamp() * 1000).cast(pl.Int64),
                Latitude="lat",
                Longitude="lon",
            ),
            {"digits": 8},
            {"time": {"column": "Timestamp", "unit": "ms"}, "latitude": "Latitude"},
        ),
        "radar along the road in ms": lambda: (
            pick(
                obj="id",
                time_ms=(pl.col("t") * 1000).round().cast(pl.Int64),
                dist="x",
                lateral="y",
                vel="v",
                lane="lane",
                len="length",
            ),
            {},
            {"time": {"column": "time_ms", "unit": "ms"}, "x": "dist", "y": "lateral", "speed": "vel", "lane": "lane"},
        ),
        "semicolons and decimal commas": lambda: (
            pick(Fahrzeug="id", Zeit="t", x="x", y="y", Geschwindigkeit=pl.col("v") * 3.6, Spur="lane"),
            {"separator": ";", "comma": True},
            {"time": "Zeit", "x": "x", "speed": {"column": "Geschwindigkeit", "unit": "km/h"}, "lane": "Spur"},
        ),
        "tabs and feet": lambda: (
            pick(
                vehicle="id",
                t="t",
                x=pl.col("x") / ft,
                y=pl.col("y") / ft,
                length=pl.col("length") / ft,
                mph=pl.col("v") / 0.44704,
            ),
            {"separator": "\t"},
            {"x": {"column": "x", "unit": "ft"}, "length": {"column": "length", "unit": "ft"}},
        ),
        "feet by the name": lambda: (
            pick(vehicle_id="id", time_s="t", x_ft=pl.col("x") / ft, y_ft=pl.col("y") / ft),
            {},
            {"x": {"column": "x_ft", "unit": "ft"}, "y": {"column": "y_ft", "unit": "ft"}},
        ),
        "feet by the speed": lambda: (
            pick(vehicle_id="id", time="t", x=pl.col("x") / ft, y=pl.col("y") / ft, speed_mph=pl.col("v") / 0.44704),
            {},
            {"x": {"column": "x", "unit": "ft"}, "speed": {"column": "speed_mph", "unit": "mph"}},
        ),
        "drone in cm with heading": lambda: (
            turned(own, 120.0, 300.0, 200.0).select(
                trackId="id", t="t", xCenter=pl.col("e") * 100, yCenter=pl.col("n") * 100, heading=pl.lit(120.0)
            ),
            {},
            {"x": {"column": "xCenter", "unit": "cm"}, "heading": {"column": "heading", "unit": "deg"}},
        ),
        "compass heading": lambda: (
            utm.select(id="id", t="t", x_utm="e", y_utm="n", course=pl.lit(55.0)),
            {},
            {"x": "x_utm", "heading": {"column": "course", "unit": "deg from north"}},
        ),
        "across first, as a lens sees it": lambda: (
            pick(id="id", t="t", x=-pl.col("y"), y="x"),
            {},
            {"x": "y", "y": {"column": "x", "flip": True}},
        ),
        "towards the camera": lambda: (
            pick(id="id", time="t", x=500 - pl.col("x"), y=-pl.col("y")),
            {},
            {"x": {"column": "x", "flip": True}},
        ),
        "epoch seconds": lambda: (
            pick(object_id="id", epoch=pl.col("t") + BEGIN.timestamp(), pos_x="x", pos_y="y"),
            {},
            {"time": "epoch", "x": "pos_x"},
        ),
        "spreadsheet days": lambda: (
            pick(id="id", date=pl.col("t") / 86400 + 46176.3125, s="x", d="y"),
            {"digits": 9},
            {"time": {"column": "date", "unit": "day"}, "x": "s", "y": "d"},
        ),
        "clock times": lambda: (
            pick(id="id", clock=iso().str.slice(11, 12), x="x", y="y"),
            {},
            {"time": {"column": "clock", "unit": "clock"}},
        ),
        "dates the German way": lambda: (
            pick(
                id="id",
                time=iso()
                .str.slice(0, 23)
                .str.to_datetime("%Y-%m-%dT%H:%M:%S%.f")
                .dt.strftime("%d.%m.%Y %H:%M:%S%.3f"),
                x="x",
                y="y",
            ),
            {},
            {"time": {"column": "time", "unit": "%d.%m.%Y %H:%M:%S%.f"}},
        ),
        "names of objects and other things": lambda: (
            pick(
                ID=pl.format("obj-{}", "id"),
                T="t",
                X="x",
                Y="y",
                Type=pl.when(pl.col("id") % 7 == 0).then(pl.lit("Bus")).otherwise(pl.lit("Car")),
                conf=pl.lit(0.9),
            ),
            {},
            {"vehicle": "ID", "kind": {"column": "Type", "values": {"Bus": "truck", "Car": "car"}}},
        ),
        "several vehicles a row": lambda: (
            own.filter(near).pivot("id", index="t", values=["x", "y"]),
            {},
            {"time": "t"},
        ),
        "units in brackets": lambda: (
            pick(
                **{
                    "Vehicle ID": "id",
                    "Time [ms]": (pl.col("t") * 1000),
                    "X [m]": "x",
                    "Y [m]": "y",
                    "Speed [km/h]": pl.col("v") * 3.6,
                    "Acc [m/s²]": pl.lit(0.1),
                }
            ),
            {},
            {"time": {"column": "Time [ms]", "unit": "ms"}, "x": "X [m]", "acceleration": "Acc [m/s²]"},
        ),
        "frames alone": lambda: (pick(id="id", frame="frame", x="x", y="y"), {}, {"frame": "frame"}),
        "pixels": lambda: (
            pick(id="id", t="t", x_px=pl.col("x") / 0.08, y_px=pl.col("y") / 0.08),
            {},
            {"x": {"column": "x_px", "unit": 0.08}},
        ),
    }


TABLES = _tables()
# The one question that each of these needs, and the answer.
ASKED = {"frames alone": ("How many frames are a second", "10"), "pixels": ("How many metres is a pixel", "0.08")}


def write(name: str, folder: Path) -> tuple[Path, Expected]:
    table, how, expected = TABLES[name]()
    return csv(table, folder / "stranger.csv", **how), expected
