"""Writes a recording in the forms of NGSIM's files: feet, Local_X to the right, milliseconds since 1970.

For tests and benchmarks: nobody can ship the originals, so the reader is tested on recordings written in their layout.
"""

import gzip
import zipfile
from collections.abc import Iterator
from pathlib import Path

import polars as pl

from rampcast.recording import Recording
from rampcast.recording import columns as c

METRES_PER_FOOT = 0.3048
TXT_COLUMNS = (
    "Vehicle_ID",
    "Frame_ID",
    "Total_Frames",
    "Global_Time",
    "Local_X",
    "Local_Y",
    "Global_X",
    "Global_Y",
    "v_Length",
    "v_Width",
    "v_Class",
    "v_Vel",
    "v_Acc",
    "Lane_ID",
    "Preceding",
    "Following",
    "Space_Headway",
    "Time_Headway",
)
# The headers of the per-site csv files spell five names in their own way.
SITE_CSV_COLUMNS = tuple(
    {"Preceding": "Preceeding", "Space_Headway": "Space_Hdwy", "Time_Headway": "Time_Hdwy", "v_Width": "v_width"}.get(
        n, n
    )
    for n in TXT_COLUMNS
)
ARTERIAL_COLUMNS = ("O_Zone", "D_Zone", "Int_ID", "Section_ID", "Direction", "Movement")
TXT_LINE = (
    "%8d %8d %8d %13d %14.3f %14.3f %13.3f %13.3f %5.1f %5.1f %2d %7.2f %7.2f %2d %6d %6d %8.2f %8.2f \n"  # fixed width
)
CSV_LINE = "%d,%d,%d,%d,%.3f,%.3f,%.3f,%.3f,%.1f,%.1f,%d,%.2f,%.2f,%d,%d,%d,%.2f,%.2f\n"
PORTAL_LINE = "%d,%d,%d,%d,%.3f,%.3f,%.3f,%.3f,%.1f,%.1f,%d,%.2f,%.2f,%d,,,,,,,%d,%d,%.2f,%.2f,{location}\n"
PORTAL_CUT_LINE = CSV_LINE.replace("\n", ",{location}\n")


def write_ngsim_txt(recording: Recording, folder: Path) -> list[Path]:
    """Returns the files written: one 18-column text per window, named trajectories-<window>.txt."""
    return [
        _write(recording.window(name), folder / f"trajectories-{name}.txt", line=TXT_LINE) for name in recording.names
    ]


def write_site_csv(recording: Recording, folder: Path) -> list[Path]:
    """Returns the files written: one csv per window with the header of the per-site files, misspelt as there."""
    header = ",".join(SITE_CSV_COLUMNS) + "\n"
    return [
        _write(recording.window(name), folder / f"trajectories-{name}.csv", line=CSV_LINE, header=header)
        for name in recording.names
    ]


def write_portal_csv(recording: Recording, path: Path) -> Path:
    """Returns the file written: the 25-column export of the portal, all windows in one file."""
    names = (*TXT_COLUMNS[:8], "v_length", *TXT_COLUMNS[9:14], *ARTERIAL_COLUMNS, *TXT_COLUMNS[14:], "Location")
    line = PORTAL_LINE.format(location=recording.site.location)
    return _write(recording, path, line=line, header=",".join(names) + "\n")


def write_portal_cut_csv(recording: Recording, path: Path) -> Path:
    """Returns the file written: the portal's export without the six columns that only the arterials fill."""
    line = PORTAL_CUT_LINE.format(location=recording.site.location)
    return _write(recording, path, line=line, header=",".join((*TXT_COLUMNS, "Location")) + "\n")


def zipped(path: Path) -> Path:
    """Returns a zip archive beside the file that holds the file."""
    archive = path.with_name(path.name + ".zip")
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as target:
        target.write(path, f"vehicle-trajectory-data/{path.name}")
    return archive


def gzipped(path: Path) -> Path:
    """Returns a gzip file beside the file that holds the file."""
    archive = path.with_name(path.name + ".gz")
    archive.write_bytes(gzip.compress(path.read_bytes(), compresslevel=1))
    return archive


def _write(recording: Recording, path: Path, *, line: str, header: str = "") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", encoding="ascii", newline="") as file:
        file.write(header)
        for rows in _rows_in_feet(recording):
            file.writelines(line % row for row in rows)
    return path


def _rows_in_feet(recording: Recording) -> Iterator[Iterator[tuple[float, ...]]]:
    """Yields rows in the order of TXT_COLUMNS, sorted by window, vehicle and frame."""
    starts = {f"{recording.site.name}-{n}": start for n, (start, _) in recording.site.window_bounds().items()}
    track = (c.RECORDING, c.VEHICLE)
    x, y = pl.col(c.X) / METRES_PER_FOOT, -pl.col(c.Y) / METRES_PER_FOOT
    speed = (x.diff().over(track) / (pl.col(c.FRAME).diff().over(track) * recording.time_step)).backward_fill()
    table = recording.tracks.sort(*track, c.FRAME).select(
        Vehicle_ID=pl.col(c.VEHICLE),
        Frame_ID=pl.col(c.FRAME),
        Total_Frames=pl.len().over(track),
        Global_Time=pl.col(c.RECORDING).replace_strict(starts, return_dtype=pl.Int64)
        + (pl.col(c.FRAME) * round(recording.time_step * 1000)).cast(pl.Int64),
        Local_X=y,
        Local_Y=x,
        Global_X=6042000.0 + y,  # only the layout matters: nobody reads the global positions
        Global_Y=2133000.0 + x,
        v_Length=pl.col(c.LENGTH) / METRES_PER_FOOT,
        v_Width=pl.col(c.WIDTH) / METRES_PER_FOOT,
        v_Class=pl.col(c.KIND).cast(pl.String).replace_strict({"motorcycle": 1, "car": 2, "truck": 3}),
        v_Vel=speed.fill_null(0.0).fill_nan(0.0),
        v_Acc=pl.lit(0.0),
        Lane_ID=pl.col(c.LANE),
        Preceding=pl.lit(0),
        Following=pl.lit(0),
        Space_Headway=pl.lit(0.0),
        Time_Headway=pl.lit(0.0),
    )
    for part in table.iter_slices(200_000):
        yield zip(*(part[name].to_list() for name in TXT_COLUMNS), strict=True)
