"""Times the way from a stranger's table to the report: a shipped simulated recording, written as a camera's UTM csv.

.venv/bin/python benchmarks/bench_start.py            the whole window of 15 minutes
RAMPCAST_TINY=1 .venv/bin/python benchmarks/bench_start.py     four minutes of it, to see that it works

It calls the commands that `rampcast start` prints, as a user would, each in a process of its own.
"""

import math
import resource
import shlex
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import polars as pl

from measure import how_many, print_ratio
from rampcast.recording import read_recording
from rampcast.simulate import shipped_sample

TURN = math.radians(35.0)  # of the road in the map
EAST, NORTH = 458_200.0, 5_428_900.0  # [m] of its beginning in UTM's zone 32
BEGIN = "2026-06-03T07:30:00"


def write_camera_csv(out: Path, *, seconds: float) -> int:
    """Writes the first seconds of a shipped recording as a camera in UTM metres would; returns its rows."""
    recording = read_recording(shipped_sample()[1])
    frames = seconds / recording.time_step
    tracks = recording.tracks.filter(pl.col("frame") - pl.col("frame").min() < frames)
    begin = pl.lit(BEGIN).str.to_datetime(time_unit="ms")
    moment = begin + pl.duration(milliseconds=(pl.col("frame") * recording.time_step * 1000).round().cast(pl.Int64))
    x, y = pl.col("x").cast(pl.Float64), pl.col("y").cast(pl.Float64)
    table = tracks.select(
        track_id="vehicle",
        timestamp=moment.dt.strftime("%Y-%m-%dT%H:%M:%S%.3f+02:00"),
        utm_easting=(EAST + x * math.cos(TURN) - y * math.sin(TURN)).round(3),
        utm_northing=(NORTH + x * math.sin(TURN) + y * math.cos(TURN)).round(3),
        length=pl.col("length").round(2),
        width=pl.col("width").round(2),
    )
    table.write_csv(out)
    return table.height


def main() -> None:
    """Prints how long each command takes, and all of them."""
    seconds = float(how_many(900, tiny=240))
    with tempfile.TemporaryDirectory() as folder:
        table, out = Path(folder) / "camera.csv", Path(folder) / "start"
        rows = write_camera_csv(table, seconds=seconds)
        print(f"a camera's csv in UTM metres: {rows:,} rows, {seconds / 60:g} min of simulated traffic")
        begin, used = time.perf_counter(), processor_time()
        timed(["rampcast", "start", str(table), "--reference", "front", "--out", str(out)])
        for line in (out / "commands.txt").read_text(encoding="utf-8").splitlines():
            timed(shlex.split(line))
        taken = time.perf_counter() - begin
        assert (out / "forecasts" / "report.html").is_file()
        print(f"from the table to report.html: {taken:.0f} s, {processor_time() - used:.0f} s of processor time")
        print_ratio("minutes recorded to minutes waited", seconds / taken)


def timed(command: list[str]) -> None:
    """Calls a command and prints how long it took.

    Raises:
        SystemExit: it failed.
    """
    begin, used = time.perf_counter(), processor_time()
    done = subprocess.run([sys.executable, "-m", *command], capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{shlex.join(command)}: exit code {done.returncode}\n{done.stdout}\n{done.stderr}")
    print(f"{command[1]}: {time.perf_counter() - begin:.1f} s, {processor_time() - used:.1f} s of processor time")


def processor_time() -> float:
    """Returns the processor time of all commands that ended so far [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    main()
