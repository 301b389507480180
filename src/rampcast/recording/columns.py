"""Column names and types of a recording's table. All lengths [m], times [s]; x grows downstream, y to the left."""

import polars as pl

RECORDING = "recording"  # name of the window; ids repeat across windows, so the key is (recording, vehicle)
VEHICLE = "vehicle"
FRAME = "frame"  # t = frame * time_step [s]
X = "x"  # longitudinal position of the front centre [m]
Y = "y"  # lateral position of the front centre [m], grows to the left of travel
LANE = "lane"
LENGTH = "length"
WIDTH = "width"
KIND = "kind"

OBSERVED = "observed"  # False where a skipped frame was filled by interpolation
V = "v"  # longitudinal velocity [m/s]
U = "u"  # lateral velocity [m/s]
A = "a"  # longitudinal acceleration [m/s^2]
E = "e"  # lateral acceleration [m/s^2]

KINDS = ("motorcycle", "car", "truck")

SCHEMA: dict[str, pl.DataType] = {
    RECORDING: pl.String(),
    VEHICLE: pl.Int32(),
    FRAME: pl.Int32(),
    X: pl.Float64(),
    Y: pl.Float64(),
    LANE: pl.Int16(),
    LENGTH: pl.Float32(),
    WIDTH: pl.Float32(),
    KIND: pl.Enum(KINDS),
}

SMOOTHED_SCHEMA: dict[str, pl.DataType] = SCHEMA | {
    OBSERVED: pl.Boolean(),
    V: pl.Float64(),
    U: pl.Float64(),
    A: pl.Float64(),
    E: pl.Float64(),
}
