"""The data doctor on 4.5 million rows beside reading them: the shipped simulated recordings, four times over.

Run: python benchmarks/bench_doctor.py
Reach: examined in 20 s on two cores (the paper's three I-80 windows have as many rows), in less than 3 GB.
"""

import tempfile
import time
from dataclasses import replace
from pathlib import Path

import polars as pl

from measure import how_many, once, peak_memory, print_ratio
from rampcast.doctor import CHECKS, examine
from rampcast.doctor.subject import subject_of
from rampcast.formats import read_any
from rampcast.recording import Recording, clean, concatenate, read_recording, write_recording
from rampcast.simulate import shipped_sample

COPIES = how_many(4, tiny=1)  # of 1.18 million rows
VEHICLES = how_many(1_000_000, tiny=200)  # of each window, at most


def main() -> None:
    """Prints the times of reading, smoothing and examining, and the slowest checks."""
    recording = tiled()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "tiled.parquet"
        write_recording(recording, path)
        reading = once(lambda: read_any([path]))
    smoothing = once(lambda: clean(recording))
    print(f"{recording.tracks.height:,} rows: read (parquet) {reading:.2f} s, smoothed {smoothing:.2f} s")
    worked = time.process_time()
    seconds = once(lambda: examine(recording))
    worked = time.process_time() - worked
    print(f"examined, smoothing included: {seconds:.2f} s ({worked:.2f} s of both cores together)")
    print_ratio("examining over reading and smoothing", seconds / (reading + smoothing))
    print(f"peak memory {peak_memory(lambda: examine(recording)):+.0f} MB")
    subject = subject_of(recording, None)
    times = {check.name: once(lambda check=check: check.look(subject)) for check in CHECKS}
    for name, seconds in sorted(times.items(), key=lambda item: -item[1])[:6]:
        print(f"  {name} {seconds:.2f} s")


def tiled() -> Recording:
    """Returns the shipped sample several times, each time as other windows."""
    sample = concatenate([read_recording(path) for path in shipped_sample()])
    sample = replace(sample, tracks=sample.tracks.filter(pl.col("vehicle") <= VEHICLES))
    parts = [
        replace(
            sample, tracks=sample.tracks.with_columns(pl.format("{}-{}", "recording", pl.lit(copy)).alias("recording"))
        )
        for copy in range(COPIES)
    ]
    return concatenate(parts)


if __name__ == "__main__":
    main()
