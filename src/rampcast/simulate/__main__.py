"""Commands about the simulated sample.

python -m rampcast.simulate sample FOLDER        makes the shipped sample again (needs SUMO)
python -m rampcast.simulate realism [FILE...]    prints how real recordings look; without files, the shipped sample
"""

import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import polars as pl
from rich.progress import Progress, TaskID

from rampcast.recording import read_recording, write_recording
from rampcast.simulate.realism import realism
from rampcast.simulate.sample import SITE, WINDOWS, make_sample
from rampcast.simulate.shipped import shipped_sample


def main(arguments: Sequence[str]) -> None:
    """Runs the command that the arguments name."""
    match list(arguments):
        case ["sample", folder]:
            write_sample(Path(folder))
        case ["realism", *files]:
            print_realism([Path(file) for file in files] or shipped_sample())
        case _:
            sys.exit(__doc__)


def write_sample(folder: Path) -> None:
    """Makes the windows of the sample in a folder."""
    with Progress() as bars:

        def show(task: TaskID, done: float) -> None:
            bars.update(task, completed=done)

        for window in WINDOWS:
            task = bars.add_task(f"simulating window {window}", total=1.0)
            recording = make_sample(window, progress=partial(show, task))
            write_recording(recording, folder / f"{SITE}-{window}.parquet")


def print_realism(files: Sequence[Path]) -> None:
    """Prints the measures of recordings beside what is accepted."""
    with pl.Config(tbl_rows=-1, tbl_cols=-1, fmt_str_lengths=60, tbl_width_chars=140, tbl_hide_dataframe_shape=True):
        for file in files:
            print(realism(read_recording(file)))


if __name__ == "__main__":
    main(sys.argv[1:])
