"""Runs commands that kill themselves at one of their writes; `python -m tests.killing` answers one line with another.

Each runs in a fork of a process that has imported everything and computed nothing: threads of polars and of jax do not
outlive a fork, so the process that looks at the files cannot be the one that forks.
"""

import json
import os
import signal
import sys
from collections.abc import Callable
from dataclasses import replace
from itertools import count
from pathlib import Path
from unittest.mock import patch

import polars as pl
from typer.testing import CliRunner

from rampcast.benchmark.run import Benchmark, write_benchmark
from rampcast.cli import app
from rampcast.forecast.storage import load, save
from rampcast.recording import read_recording, write_recording
from tests.model_folders.make import FORM_FOLDER, TRAFFIC

WRITING = ("open", "os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.truncate", "shutil.")  # audit events
FAILED = 4
ACCEPT = "--accept-doubtful"  # made up, of long vehicles


def run(*arguments: object) -> None:
    done = CliRunner().invoke(app, [str(one) for one in arguments])
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception


def convert(out: Path) -> None:
    run("convert", TRAFFIC, ACCEPT, "--out", out / "x.parquet")


def site(out: Path) -> None:
    run("site", TRAFFIC, "--out", out / "x.toml", "--no-ramp")


def doctor(out: Path) -> None:
    run("doctor", TRAFFIC, "--out", out)


def forecast(out: Path) -> None:
    run("forecast", TRAFFIC, ACCEPT, "--model", FORM_FOLDER / "rampcast", "--every", 4, "--out", out, "--csv")


PAPER = ("--report", "paper")


def evaluate(out: Path) -> None:
    model = replace(load(FORM_FOLDER / "rampcast"), trained_on=("others",), window_hashes=())
    with patch("rampcast.forecast.storage.load", lambda _: model):
        run(
            "evaluate",
            ACCEPT,
            "--model",
            FORM_FOLDER / "rampcast",
            "--recording",
            TRAFFIC,
            "--every",
            4,
            "--out",
            out,
            *PAPER,
        )


def train(out: Path) -> None:
    """The end of a training: what it learns is there already."""
    model = load(FORM_FOLDER / "rampcast")
    with patch("rampcast.forecast.forecaster.fit", lambda *_, **__: model):
        run("train", TRAFFIC, ACCEPT, "--out", out)


def train_paper(out: Path) -> None:
    save(load(FORM_FOLDER / "paper"), out)


def benchmark(out: Path) -> None:
    table = pl.DataFrame({"x": [1]})
    write_benchmark(Benchmark(table, table, table, table), out)


def simulate(out: Path) -> None:
    recording = read_recording(TRAFFIC)
    with patch("rampcast.simulate.simulate", lambda *_, **__: recording):
        run("simulate", "--out", out / "x.parquet")


def write_again(out: Path) -> None:
    """Writes a file of the same name as `simulate` with other rows."""
    recording = read_recording(TRAFFIC)
    write_recording(recording.window(recording.names[0]), out / "x.parquet")


COMMANDS = {
    one.__name__: one
    for one in (convert, site, doctor, forecast, evaluate, train, train_paper, benchmark, simulate, write_again)
}


def killed(command: Callable[[Path], None], out: Path, moment: int) -> int:
    """Returns how a command ended that was to be killed at its so-many-th write to `out`."""
    child = os.fork()
    if child == 0:
        counted = count(1)

        def kill(event: str, arguments: tuple[object, ...]) -> None:
            if event.startswith(WRITING) and str(out) in str(arguments) and next(counted) == moment:
                os.kill(os.getpid(), signal.SIGKILL)

        code = 0
        try:
            sys.stdout = open(os.devnull, "w")  # noqa: SIM115
            sys.addaudithook(kill)
            command(out)
        except BaseException as error:
            print(f"{command.__name__} at {moment}: {error!r}", file=sys.stderr)
            code = FAILED
        os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


if __name__ == "__main__":
    for line in sys.stdin:
        name, folder, at = json.loads(line)
        print(killed(COMMANDS[name], Path(folder), at), flush=True)
