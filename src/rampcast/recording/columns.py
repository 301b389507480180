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

RECORDED_V = "recorded_v"  # speed as the source gives it [m/s]; only to check against the derived one
RECORDED_A = "recorded_a"  # longitudinal acceleration as the source gives it [m/s^2]; likewise

LARGEST = 2**31 - 1  # of vehicle and frame, which are 32 bit wide

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

# A raw recording may have these as well; smoothing leaves them out.
OPTIONAL_SCHEMA: dict[str, pl.DataType] = {RECORDED_V: pl.Float32(), RECORDED_A: pl.Float32()}

SMOOTHED_SCHEMA: dict[str, pl.DataType] = SCHEMA | {
    OBSERVED: pl.Boolean(),
    V: pl.Float64(),
    U: pl.Float64(),
    A: pl.Float64(),
    E: pl.Float64(),
}
