"""Rows a second, memory of a worker, and one process beside two, of `rampcast batch` from end to end.

The recordings are the shipped simulated ones, one after the other again and again with new vehicles, at three sites on
as many days as it takes (10 M rows a file, some 7 hours). What is timed is the command: doctor, convert, forecast,
evaluate and the tables of all sites. Every process compiles once, which few rows do not make up for.

    python benchmarks/bench_batch.py                                     2 M rows, one process and two
    python benchmarks/bench_batch.py --rows 100e6 --processes 2 --folder /somewhere/with/20/GB
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import cycle
from pathlib import Path

import polars as pl

from measure import how_many, print_ratio
from rampcast.recording import read_recording
from rampcast.recording.recording import file_metadata
from rampcast.simulate import shipped_sample

TARGET = "target: 2,000 MB a process, whatever the number of rows; two processes 1.7 times as fast as one"
SITES = ("north", "middle", "south")
FILE = 10_000_000  # rows
GROUP = 100_000  # rows of a group, as the parts of I-24 are written
QUARTER = 9000  # frames of a shipped recording
DAY = 86_400.0  # [s]
BEGIN = datetime(2026, 3, 2, 6, tzinfo=UTC).timestamp()


@dataclass(frozen=True)
class Run:
    """What a run took: of processor time in all, and by the process that had most, for its parts."""

    seconds: float
    cpu: float
    longest: float
    peak: float
    forecasts: int


def main() -> None:
    """Makes recordings, and prints a line for each run."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--rows", type=lambda text: int(float(text)), default=how_many(2_000_000, tiny=20_000))
    options.add_argument("--every", type=float, default=30.0, help="time between two forecasts [s]")
    options.add_argument("--window", type=float, default=300.0, help="length of a part [s]")
    options.add_argument("--processes", type=int, nargs="+", default=[1, 2])
    options.add_argument("--folder", type=Path, help="where files are made; default: a temporary folder")
    chosen = options.parse_args()
    with tempfile.TemporaryDirectory(dir=chosen.folder) as folder:
        begin = time.perf_counter()
        files = make_recordings(chosen.rows, Path(folder))
        size = sum(file.stat().st_size for file in files)
        rows = sum(int(pl.scan_parquet(file).select(pl.len()).collect().item()) for file in files)
        print(f"{rows:,} rows in {len(files)} files, {size / 1e6:,.0f} MB, made in {time.perf_counter() - begin:.0f} s")
        heads = f"{'processes':>9}{'seconds':>9}{'CPU s':>9}{'longest':>9}{'rows/s':>9}{'peak MB':>9}{'forecasts':>11}"
        print(f"{heads}{'load':>7}")
        runs = {}
        for processes in chosen.processes:
            out = Path(folder) / f"out{processes}"
            one = runs[processes] = run(files, out, processes, every=chosen.every, window=chosen.window)
            times = f"{one.seconds:>9.0f}{one.cpu:>9.0f}{one.longest:>9.0f}{rows / one.seconds:>9,.0f}"
            line = f"{processes:>9}{times}{one.peak:>9,.0f}{one.forecasts:>11,}"
            print(f"{line}{os.getloadavg()[1]:>7.1f}", flush=True)
    least, most = runs[min(runs)], runs[max(runs)]
    print_ratio(f"time of {min(runs)} process over that of {max(runs)}", least.seconds / most.seconds)
    print_ratio("the same by the processor time of the process that had most", least.longest / most.longest)
    print_ratio(f"processor time of {max(runs)} processes over that of {min(runs)}", most.cpu / least.cpu)
    print(TARGET)


def run(files: list[Path], out: Path, processes: int, *, every: float, window: float) -> Run:
    """Returns what `rampcast batch` takes for those files."""
    command = [sys.executable, "-m", "rampcast", "batch", *map(str, files), "--out", str(out), "--every", f"{every:g}"]
    command += ["--window", f"{window:g}", "--processes", str(processes)]
    begin, before = time.perf_counter(), _cpu()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    seconds, cpu = time.perf_counter() - begin, _cpu() - before
    sites = pl.read_parquet(out / "sites.parquet")
    forecasts = pl.read_parquet(out / "site_conflicts.parquet").filter(site="all", measure="pet")["n"].sum()
    longest = pl.read_parquet(out / "parts.parquet").group_by("process").agg(pl.col("cpu_seconds").sum())["cpu_seconds"]
    return Run(seconds, cpu, float(longest.max() or 0.0), float(sites["peak_mb"].max() or 0.0), int(forecasts))


def _cpu() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def make_recordings(rows: int, folder: Path) -> list[Path]:
    """Writes recordings of so many rows in all, and returns their files."""
    count = max(len(SITES), -(-rows // FILE))
    found = []
    for number in range(count):
        site, day = SITES[number % len(SITES)], number // len(SITES)
        found.append(folder / f"{site}-{day:03}.parquet")
        _write(found[-1], rows // count, site, day)
    return found


def _write(path: Path, rows: int, site: str, day: int) -> None:
    """Writes a recording of one site and day: shipped ones, one after the other."""
    left, time, first_id, parts = rows, 0, 0, []
    for source in cycle(shipped_sample()):
        if left <= 0:
            break
        tracks = pl.scan_parquet(source)
        if (height := int(tracks.select(pl.len()).collect().item())) > left:
            tracks = tracks.filter(pl.col("frame") < max(600, round(QUARTER * left / height)))
        moved = {"frame": pl.col("frame") + time, "vehicle": pl.col("vehicle") + first_id, "recording": pl.lit(site)}
        parts.append(tracks.with_columns(**moved).cast({"frame": pl.Int32, "vehicle": pl.Int32}))
        left, time = left - height, time + QUARTER
        first_id += int(tracks.select(pl.col("vehicle").max()).collect().item()) + 1
    like = read_recording(shipped_sample()[0])
    about = replace(like.site, name=site, title=f"Simulated on-ramp section, {site}")
    began = {site: BEGIN + DAY * day}
    metadata = file_metadata(about, time_step=like.time_step, source="simulated", began=began)
    pl.concat(parts).sink_parquet(path, metadata=metadata, row_group_size=GROUP)


if __name__ == "__main__":
    main()
