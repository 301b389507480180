"""Time and memory of reading NGSIM's forms: rampcast (to a parquet recording), polars and pandas, as ratios.

Each way runs in a process of its own, so that its peak memory is its own. The files are made up: three windows of
vehicles at a steady speed, in the layout of the originals. On a busy machine the processor time is the fairer number.

    python benchmarks/bench_reader.py                  4.5 million rows, as many as I-80 has
    python benchmarks/bench_reader.py --rows 450000    a tenth of that
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from measure import how_many, print_ratio

ROWS = how_many(4_500_000, tiny=5_000)
FRAMES_PER_VEHICLE = 750  # 75 s, about the mean on I-80
LAST_START = 9_000  # [frames] 15 minutes
SPEED = 6.5  # [m/s]


def main() -> None:
    """Prints the table, or does one way of reading when it is its own subprocess."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--rows", type=int, default=ROWS)
    options.add_argument("--repeat", type=int, default=how_many(3, tiny=1), help="the best of so many runs counts")
    options.add_argument("--way", choices=[*WAYS, "write"], help=argparse.SUPPRESS)
    options.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    chosen = options.parse_args()
    if chosen.way == "write":
        write_files(chosen.folder, chosen.rows)
    elif chosen.way:
        measure(chosen.way, chosen.folder)
    else:
        with tempfile.TemporaryDirectory() as folder:
            compare(Path(folder), chosen.rows, chosen.repeat)


def compare(folder: Path, rows: int, repeat: int) -> None:
    """Prints time, processor time, ratios and peak memory of each way."""
    run("write", folder, rows)
    size = sum(path.stat().st_size for path in folder.glob("*.txt"))
    print(f"{rows:,} rows in 3 windows, {size / 1e6:,.0f} MB as text; best of {repeat}\n")
    runs = [{way: run(way, folder, rows) for way in WAYS} for _ in range(repeat)]
    best = {way: min((one[way] for one in runs), key=lambda result: result["seconds"]) for way in WAYS}
    print(f"{'':<52}{'seconds':>9}{'of polars':>11}{'of pandas':>11}{'CPU s':>9}{'of polars':>11}{'peak MB':>9}")
    for way, (title, _) in WAYS.items():
        seconds, processor, peak = (best[way][name] for name in ("seconds", "cpu_seconds", "peak_mb"))
        ratios = [seconds / best[other]["seconds"] for other in ("polars", "pandas")]
        work = processor / best["polars"]["cpu_seconds"]
        times = f"{seconds:>9.2f}{ratios[0]:>11.2f}{ratios[1]:>11.2f}{processor:>9.2f}{work:>11.2f}"
        print(f"{title:<52}{times}{peak:>9,.0f}")
    for way, plain in (("text", "pandas"), ("portal", "polars_portal")):
        work = best[way]["cpu_seconds"] / best[plain]["cpu_seconds"]
        print_ratio(f"processor time of {way} over {plain}", work)


def run(way: str, folder: Path, rows: int) -> dict[str, float]:
    """Returns what one way, run in a process of its own, measured."""
    command = [sys.executable, __file__, "--way", way, "--folder", str(folder), "--rows", str(rows)]
    printed = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    return json.loads(printed) if printed else {}


def measure(way: str, folder: Path) -> None:
    """Prints seconds, processor seconds and peak memory of one way as json; imports are not counted in the time."""
    read = WAYS[way][1]
    import pandas  # noqa: F401  every way has the same imports, so that their memory compares
    import polars  # noqa: F401

    import rampcast.formats  # noqa: F401

    start, start_cpu = time.perf_counter(), time.process_time()
    read(folder)
    seconds, cpu_seconds = time.perf_counter() - start, time.process_time() - start_cpu
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024  # [KiB] on Linux
    print(json.dumps({"seconds": seconds, "cpu_seconds": cpu_seconds, "peak_mb": peak}))


def read_text(folder: Path) -> None:
    """Reads the three windows' text files and writes a recording, as `rampcast convert` does."""
    convert(sorted(folder.glob("*.txt")), folder)


def read_portal(folder: Path) -> None:
    """Reads the portal's export and writes a recording."""
    convert([folder / "portal.csv"], folder)


def convert(paths: list[Path], folder: Path) -> None:
    """Reads NGSIM files of I-80 and writes a recording."""
    from rampcast.formats import read_any
    from rampcast.recording import write_recording
    from rampcast.sites import load_site

    recording, _ = read_any(paths, site=load_site("i80"), format="ngsim")
    write_recording(recording, folder / "recording.parquet")


def read_polars(folder: Path) -> None:
    """Reads the same rows as plain csv, all columns."""
    import polars as pl

    pl.concat([pl.read_csv(path) for path in sorted(folder.glob("trajectories*.csv"))])


def read_polars_portal(folder: Path) -> None:
    """Reads the portal's export, all columns."""
    import polars as pl

    pl.read_csv(folder / "portal.csv")


def read_pandas(folder: Path) -> None:
    """Reads the text files, all columns."""
    import pandas as pd

    pd.concat([pd.read_csv(path, sep=r"\s+", header=None) for path in sorted(folder.glob("*.txt"))])


WAYS = {
    "text": ("rampcast: text files to a parquet recording", read_text),
    "polars": ("polars.read_csv: the same rows as csv", read_polars),
    "pandas": ("pandas.read_csv(sep=r'\\s+'): text files", read_pandas),
    "portal": ("rampcast: portal export to a parquet recording", read_portal),
    "polars_portal": ("polars.read_csv: portal export", read_polars_portal),
}


def write_files(folder: Path, rows: int) -> None:
    """Writes three windows of made-up traffic in NGSIM's layouts."""
    sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
    import ngsim_writer

    recording = made_up_recording(rows)
    ngsim_writer.write_ngsim_txt(recording, folder)
    ngsim_writer.write_site_csv(recording, folder)
    ngsim_writer.write_portal_csv(recording, folder / "portal.csv")


def made_up_recording(rows: int):  # type: ignore[no-untyped-def]  # its type is imported late, to measure memory
    """Returns a recording of about so many rows: vehicles at a steady speed with a little noise."""
    import polars as pl

    from rampcast.recording import Recording
    from rampcast.recording import columns as c
    from rampcast.sites import load_site

    site = load_site("i80")
    vehicles = max(1, rows // FRAMES_PER_VEHICLE // 3)
    numbers = np.repeat(np.arange(vehicles), FRAMES_PER_VEHICLE)
    since = np.tile(np.arange(FRAMES_PER_VEHICLE), vehicles)
    rng = np.random.default_rng(1)
    size = len(numbers)
    parts = []
    for name in ("1", "2", "3"):
        lane = np.repeat(rng.integers(1, 8, vehicles), FRAMES_PER_VEHICLE)
        values = {
            c.RECORDING: np.full(size, f"{site.name}-{name}"),
            c.VEHICLE: numbers + 1,
            c.FRAME: numbers * LAST_START // vehicles + since,
            c.X: 0.1 * SPEED * since + rng.normal(0, 0.05, size),
            c.Y: -1.83 - 3.66 * (lane - 1) + rng.normal(0, 0.3, size),
            c.LANE: lane,
            c.LENGTH: np.full(size, 4.5),
            c.WIDTH: np.full(size, 1.9),
            c.KIND: np.full(size, "car"),
        }
        parts.append(pl.DataFrame(values).cast(dict(c.SCHEMA)))
    return Recording(tracks=pl.concat(parts), site=site, time_step=0.1, source="made up")


if __name__ == "__main__":
    main()
