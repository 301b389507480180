"""SUMO's programs, run as separate processes."""

import collections
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from rampcast.errors import MissingExtra, RampcastError

Progress = Callable[[float], None]  # called with the share done, 0 to 1
SHOWN_LINES = 12  # of what a failed program said


def program(name: str) -> Path:
    """Returns the path of one of SUMO's programs.

    Raises:
        MissingExtra: SUMO is not installed.
    """
    try:
        import sumo
    except ImportError as error:
        raise MissingExtra(
            'simulating needs SUMO, which is not installed; run: pip install "rampcast[sumo]"'
        ) from error
    return Path(sumo.SUMO_HOME) / "bin" / name


def run_quietly(command: Sequence[object]) -> None:
    """Runs a program to its end.

    Raises:
        RampcastError: it failed; the message holds the end of what it said.
    """
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise _failure(command, done.returncode, (done.stdout + done.stderr).splitlines())


def run_with_progress(command: Sequence[object], *, end: float, progress: Progress | None) -> None:
    """Runs `sumo` to its end and reports how far it is.

    Args:
        command: the program and its arguments.
        end: simulated time at which it ends [s].
        progress: called with the share done, about once a simulated 10 s.

    Raises:
        RampcastError: it failed; the message holds the end of what it said.
    """
    said: collections.deque[str] = collections.deque(maxlen=SHOWN_LINES)
    with (
        tempfile.TemporaryFile("w+") as complaints,
        subprocess.Popen(
            [str(part) for part in command], stdout=subprocess.PIPE, stderr=complaints, text=True
        ) as process,
    ):
        assert process.stdout is not None  # because of stdout=PIPE
        for line in process.stdout:
            if line.startswith("Step #"):
                if progress is not None:
                    progress(min(1.0, float(line[6:].split()[0]) / end))
            else:
                said.append(line.rstrip())
        process.wait()
        if process.returncode != 0:
            complaints.seek(0)
            raise _failure(command, process.returncode, [*said, *complaints.read().splitlines()])


def _failure(command: Sequence[object], code: int, said: Sequence[str]) -> RampcastError:
    last = "\n  ".join(line for line in list(said)[-SHOWN_LINES:] if line)
    return RampcastError(f"SUMO's program '{Path(str(command[0])).name}' ended with code {code} and said:\n  {last}")
