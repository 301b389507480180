"""Time and memory of converting I-24 MOTION's json: the peak does not grow with the file.

The file is made up, with all the keys of the real ones: vehicles in both directions at a steady speed, seen for two
minutes each. The conversion runs in a process of its own, so that its peak memory is its own.

    python benchmarks/bench_i24.py                     0.3 GB
    python benchmarks/bench_i24.py --gigabytes 5       as large as an hour of the real data; takes 5 GB of disk
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

SEEN = 3000  # times a vehicle: two minutes at 25 Hz
START = 1_669_123_189.1  # [s since 1970]
MILE_63 = 63 * 5280.0  # [ft]
TARGET = "target: less than 500 MB, whatever the size"


def main() -> None:
    """Prints the line of the table, or does the conversion when it is its own subprocess."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--gigabytes", type=float, default=how_many(300, tiny=1) / 1000)
    options.add_argument("--folder", type=Path, help="where the file is made; default: a temporary folder")
    options.add_argument("--convert", type=Path, help=argparse.SUPPRESS)
    chosen = options.parse_args()
    if chosen.convert:
        convert(chosen.convert)
        return
    with tempfile.TemporaryDirectory(dir=chosen.folder) as folder:
        path = Path(folder) / "i24.json"
        write(path, chosen.gigabytes * 1e9)
        command = [sys.executable, __file__, "--convert", str(path)]
        found = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout)
        megabytes = path.stat().st_size / 1e6
    print(f"{'MB':>9}{'rows':>13}{'seconds':>9}{'CPU s':>9}{'MB/s':>7}{'peak MB':>9}{'written MB':>12}")
    speed = megabytes / found["seconds"]
    times = f"{found['seconds']:>9.1f}{found['cpu_seconds']:>9.1f}{speed:>7.0f}"
    print(f"{megabytes:>9,.0f}{found['rows']:>13,}{times}{found['peak_mb']:>9,.0f}{found['written_mb']:>12,.0f}")
    print_ratio("peak memory over the size of the file", found["peak_mb"] / megabytes)
    print(TARGET)


def convert(path: Path) -> None:
    """Prints rows, seconds, peak memory and size of the recordings as json; imports are not counted in the time."""
    from rampcast.formats import convert_all

    start, start_cpu = time.perf_counter(), time.process_time()
    written, report = convert_all(path, path.with_name("i24.parquet"), format="i24")
    seconds, cpu_seconds = time.perf_counter() - start, time.process_time() - start_cpu
    found = {
        "rows": report.rows,
        "seconds": seconds,
        "cpu_seconds": cpu_seconds,
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,  # [KiB] on Linux
        "written_mb": sum(one.stat().st_size for one in written) / 1e6,
    }
    print(json.dumps(found))


def write(path: Path, size: float) -> None:
    """Writes an array of vehicles of about so many bytes."""
    rng = np.random.default_rng(1)
    with path.open("w") as file:
        file.write("[")
        number = 0
        while file.tell() < size:
            file.write(",\n" if number else "")
            file.write(json.dumps(vehicle(number, rng)))
            number += 1
        file.write("]")


def vehicle(number: int, rng: np.random.Generator) -> dict[str, object]:
    """Returns a vehicle that starts a little later than the one before, in any lane of either direction."""
    direction = int(rng.choice((-1, 1)))
    moments = np.arange(SEEN) * 0.04
    begin = START + 0.1 * number % 14_000  # four hours
    x = MILE_63 * (1 if direction < 0 else 59 / 63) + direction * rng.uniform(60, 110) * moments
    y = -direction * (18 + 12 * int(rng.integers(0, 4)) + rng.normal(0, 1) + 0.5 * np.sin(moments))
    return {
        "_id": {"$oid": f"{rng.integers(0, 2**63):016x}{number:08x}"},
        "timestamp": (begin + moments).tolist(),
        "first_timestamp": begin,
        "last_timestamp": begin + moments[-1],
        "x_position": x.tolist(),
        "y_position": y.tolist(),
        "starting_x": x[0],
        "ending_x": x[-1],
        "length": rng.uniform(13, 20),
        "width": 6.0,
        "height": 5.0,
        "direction": direction,
        "coarse_vehicle_class": int(rng.integers(0, 6)),
        "fine_vehicle_class": -1,
        "merged_ids": [],
        "fragment_ids": [{"$oid": f"{number:024x}"}],
        "compute_node_id": "node",
        "local_fragment_id": number,
        "road_segment_ids": [-1],
        "configuration_id": 1,
        "flags": [],
        "x_score": 0.1,
        "y_score": 0.1,
        "feasibility": {"conflict": 0.0},
    }


if __name__ == "__main__":
    main()
