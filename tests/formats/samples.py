"""A small good file of every format, in each form that it comes in: what the faults and the fuzz tests damage."""

import io
import json
import re
import tempfile
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import polars as pl

from rampcast.recording import Recording, write_recording
from rampcast.recording import columns as c
from rampcast.sites import Lane, Site, load_site
from tests.formats import ngsim_rows
from tests.formats.readers import sumo_faults
from tests.formats.writers import WRITERS

SITE = Site(
    name="short",
    title="A short road",
    simulated=True,
    length=60.0,
    speed_limit=30.0,
    lanes=(Lane(1, "main", -1.8), Lane(2, "main", -5.4), Lane(3, "ramp", -9.0)),
    gore=10.0,
    ramp_end=50.0,
    merge_zone=(10.0, 50.0),
    target_lane=2,
    lane_line=((0.0, -7.2), (60.0, -7.2)),
    reference=((100.0, 50.0), (160.0, 50.0)),
)
VEHICLES, FRAMES = 4, 9
MAPPING = b"""\
name = "mapped"
reference = "centre"

[columns]
vehicle = "car"
time = { column = "ms", unit = "ms" }
x = { column = "feet", unit = "ft" }
y = { column = "right", flip = true }
lane = { column = "lane", values = { left = 1, right = 2 } }
length = 4.5
"""
MAPPED = b"car,ms,feet,right,lane\n" + b"".join(
    b"%d,%d,%d.5,%d.8,%s\n" % (car, 100 * k, 10 * k, 1 + 4 * (car % 2), b"right" if car % 2 else b"left")
    for car in (1, 2, 3)
    for k in range(FRAMES)
)


@dataclass(frozen=True)
class Sample:
    """A good file, or several that are read together.

    Attributes:
        format: its name in FORMATS.
        files: contents by names.
        given: the files that are named to the reader; what lies beside them is found.
        site: to read with.
        mapping: name of the mapping file; "" where there is none.
    """

    format: str
    files: dict[str, bytes]
    given: tuple[str, ...]
    site: Site | None = None
    mapping: str = ""

    def write(self, folder: Path, changed: dict[str, bytes] | None = None) -> list[Path]:
        """Returns the paths to read, with some files changed."""
        for name, content in (self.files | (changed or {})).items():
            (folder / name).write_bytes(content)
        return [folder / name for name in self.given]


def traffic() -> Recording:
    """Returns a few vehicles on the short road at 10 Hz, a truck and a motorcycle among them."""
    vehicle, frame = np.repeat(np.arange(1, VEHICLES + 1), FRAMES), np.tile(np.arange(FRAMES), VEHICLES)
    lane = (vehicle - 1) % 3 + 1
    tracks = pl.DataFrame(
        {
            c.RECORDING: ["short-1"] * len(vehicle),
            c.VEHICLE: vehicle,
            c.FRAME: frame + 2 * vehicle,
            c.X: np.round(8.0 * vehicle + (1.0 + 0.1 * vehicle) * frame, 2),
            c.Y: -1.8 - 3.6 * (lane - 1),
            c.LANE: lane,
            c.LENGTH: np.where(vehicle == 2, 12.0, 4.5),
            c.WIDTH: np.where(vehicle == 2, 2.5, 1.8),
            c.KIND: np.array(["car", "truck", "motorcycle", "car"])[vehicle - 1],
        }
    )
    return Recording(tracks.cast(dict(c.SCHEMA)), SITE, 0.1, "made up")


@cache
def samples() -> dict[str, Sample]:
    """Returns the good files by the name of their form: every format of FORMATS is among them."""
    found = _own() | _ngsim() | _by_hand()
    for name, writer in WRITERS.items():
        if name == "ngsim":
            continue
        with tempfile.TemporaryDirectory() as folder:
            given = tuple(path.name for path in writer.write(traffic(), Path(folder)))
            files = {path.name: path.read_bytes() for path in sorted(Path(folder).iterdir())}
        site = replace(SITE, reference=()) if not writer.curved and name == "plain" else writer.site_of(SITE)
        found[name] = Sample(name, {file: _shorter(text) for file, text in files.items()}, given, site)
        if given[0].endswith(".csv") and writer.is_table:
            found[f"{name} parquet"] = _as_parquet(found[name])
    found["sumo parquet"] = _as_parquet(found["sumo csv"], separator=";")
    return found


def _shorter(text: bytes) -> bytes:
    """Returns a CommonRoad scenario with the ends of its straight bounds alone, and any other file as it is."""
    return re.sub(rb"(<(?:left|right)Bound>)(<point>.*?</point>).*(<point>.*</point>)", rb"\1\2\3", text)


def _own() -> dict[str, Sample]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "own.parquet"
        write_recording(traffic(), path)
        return {"rampcast": Sample("rampcast", {path.name: path.read_bytes()}, (path.name,), SITE)}


def _ngsim() -> dict[str, Sample]:
    rows = [ngsim_rows.row(vehicle, frame) for vehicle in (1, 2, 3) for frame in range(FRAMES)]
    forms = {
        "ngsim text": ("t.txt", ngsim_rows.text(rows)),
        "ngsim csv": ("t.csv", ngsim_rows.csv(rows)),
        "ngsim portal": ("t.csv", ngsim_rows.portal(rows)),
    }
    site = load_site("i80")
    return {form: Sample("ngsim", {name: content}, (name,), site) for form, (name, content) in forms.items()}


def _by_hand() -> dict[str, Sample]:
    return {
        "plain by mapping": Sample("plain", {"t.csv": MAPPED, "my.toml": MAPPING}, ("t.csv",), mapping="my.toml"),
        "sumo csv": Sample("sumo", {"f.csv": sumo_faults.CSV.encode()}, ("f.csv",)),
        "i24_mvt json": Sample("i24_mvt", {"m.json": _mvt()}, ("m.json",)),
    }


def _mvt() -> bytes:
    vehicles = [
        {
            "trajectory_id": f"{number}_a",
            "timestamp": [1_669_125_200.0 + 0.04 * k for k in range(FRAMES)],
            "x_position_meters": [3000.0 + 40 * number - 1.2 * k for k in range(FRAMES)],
            "y_position_corrected_meters": [5.5 + 3.66 * (number % 3)] * FRAMES,
            "speed_meters_per_second": [30.0] * FRAMES,
            "acceleration_meters_per_second_per_second": [0.0, -0.5, 0.5] * 3,
            "length": 15.0,
            "width": 6.0,
            "coarse_vehicle_class": number,
            "lane_number": number % 3 + 1,
        }
        for number in range(4)
    ]
    return json.dumps(vehicles).encode()


def _as_parquet(sample: Sample, separator: str = ",") -> Sample:
    """Returns the sample with its tracks as a parquet file."""
    (name,) = sample.given
    stem = name.removesuffix(".csv")
    buffer = io.BytesIO()
    pl.read_csv(sample.files[name], separator=separator).write_parquet(buffer)
    files = {other: content for other, content in sample.files.items() if other != name}
    return Sample(sample.format, files | {f"{stem}.parquet": buffer.getvalue()}, (f"{stem}.parquet",), sample.site)
