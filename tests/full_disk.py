"""Runs commands on a disk that is full, and tells of each how it ended; needs to be allowed to mount memory as a disk.

echo plot | unshare --map-root-user --mount python -m tests.full_disk FOLDER
"""

import json
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

from rampcast.cli import told
from rampcast.errors import RampcastError
from rampcast.forecast.calibrated import CalibratedSpec
from rampcast.forecast.forecaster import ForecasterSpec
from rampcast.models.correction import CorrectionSpec
from rampcast.recording import write_recording
from tests import killing
from tests.failing_kinds import auxiliary_lane
from tests.made_up_traffic import random_traffic
from tests.model_folders.make import TRAFFIC
from tests.test_kills import check_whole, content

ROOMS = (0, 8, 64)  # [kB] that are left: some files begin, some fit
HEAVY = {"doctor": (8,), "evaluate": (64,), "forecast": (64,), "start": (8,)}  # commands that compute for seconds
SIZE = 64  # [MB]
QUICK = ForecasterSpec(spacing=4.0, model=CalibratedSpec(samples=8, folds=2, correction=CorrectionSpec(trees=3)))

Command = Callable[[Path], None]


def train_in_stages(out: Path) -> None:
    """The whole of a training, of few trees."""
    with patch("rampcast.forecast.forecaster.ForecasterSpec", lambda seed: QUICK):
        killing.run("train", out.parent / "made.parquet", "--out", out, "--from", "none")


def plot(out: Path) -> None:
    drawn = out.parent / "forecast"
    if not drawn.exists():
        drawn.mkdir()
        killing.forecast(drawn)
    killing.run("plot", "fan", drawn / "forecast.parquet", "--recording", TRAFFIC, "--out", out / "fan.png")


def start(out: Path) -> None:
    (table,) = auxiliary_lane(out.parent / "tables")
    killing.run("start", table, "--ramp-lane", "3", "--out", out)


COMMANDS: dict[str, Command] = {name: one for name, one in killing.COMMANDS.items() if name != "write_again"} | {
    one.__name__: one for one in (train_in_stages, plot, start)
}


@contextmanager
def disk(place: Path) -> Iterator[Path]:
    """Gives a small disk of its own."""
    place.mkdir(parents=True)
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={SIZE}m", "tmpfs", place], check=True)
    try:
        yield place
    finally:
        subprocess.run(["umount", place], check=True)


def fill(there: Path, room: int) -> None:
    """Fills a disk but for so many kB."""
    filler = there / "filler"
    with filler.open("wb", buffering=0) as file:
        try:
            while True:
                file.write(bytes(1 << 16))
        except OSError:
            pass
        end = file.tell()
        file.truncate(max(end - 1024 * room, 0))


def ended(command: Command, out: Path) -> str:
    """Returns what a user is told; "" where all went well, and of a fault that would be a traceback its name."""
    try:
        command(out)
    except (RampcastError, OSError) as error:
        return told(error)
    except BaseException as error:
        return f"traceback: {error!r}"
    return ""


def is_whole(out: Path) -> bool:
    """Returns whether each file is one that its readers read."""
    try:
        check_whole(out)
    except Exception:
        return False
    return True


def tried(name: str, place: Path) -> Iterator[dict[str, object]]:
    """Yields of each room how a command ended, and what became of files of before and of a folder without any."""
    command = COMMANDS[name]
    with disk(place) as there:
        write_recording(random_traffic(1, vehicles=20, seconds=50.0), there / "made.parquet")
        old, new = there / "old", there / "new"
        old.mkdir()
        yield {"room": None, "told": ended(command, old)}
        for room in HEAVY.get(name, ROOMS):
            new.mkdir()
            fill(there, room)
            before = content(old)
            again, first = ended(command, old), ended(command, new)
            yield {
                "room": room,
                "told": again,
                "first": first,
                "is_same": content(old) == before,
                "is_whole": is_whole(old) and is_whole(new),
                "left": [*content(new)],
            }
            (there / "filler").unlink()
            shutil.rmtree(new)
        yield {"room": None, "told": ended(command, old)}


if __name__ == "__main__":
    with TemporaryDirectory(dir=sys.argv[1]) as folder:
        for line in sys.stdin:
            print(json.dumps([*tried(line.strip(), Path(folder) / line.strip())]), flush=True)
