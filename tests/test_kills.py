"""Every command, killed at a moment at which it writes: the old files or the new ones are there, and it can go on.

RAMPCAST_KILLS=200 pytest tests/test_kills.py      kills so often over all commands; 50 times otherwise
"""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from random import Random

import polars as pl
import pytest

from rampcast.files import LIST, WORK, work_folder
from rampcast.forecast.storage import load
from rampcast.models.folder import STAGES
from rampcast.recording import read_recording

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork"),
]
KILLS = int(os.environ.get("RAMPCAST_KILLS", "50"))
COMMANDS = (
    "convert", "site", "doctor", "forecast", "evaluate", "train", "train_paper", "benchmark", "simulate"
)  # fmt: skip
HEAVY = ("site", "doctor", "evaluate")  # draw for seconds between two writes
NEVER = 10**9
MINE = "mine.txt"  # a user's own file beside what is written


def content(out: Path) -> dict[str, bytes]:
    """Returns what a user sees in a folder."""
    found = {}
    for path in sorted(out.rglob("*")):
        parts = path.relative_to(out).parts
        if path.is_file() and path.name != LIST and STAGES not in parts and not any(map(WORK.fullmatch, parts)):
            found["/".join(parts)] = path.read_bytes()
    return found


def check_whole(out: Path) -> None:
    """Reads each file as whoever uses it does."""
    readers: dict[str, Callable[[Path], object]] = {
        ".parquet": pl.read_parquet,
        ".csv": pl.read_csv,
        ".json": lambda path: json.loads(path.read_text()),
        ".html": lambda path: path.read_text().rindex("</html>"),
        ".toml": lambda path: path.read_text().index("lanes"),
        ".png": lambda path: path.read_bytes().rindex(b"IEND"),
        ".svg": lambda path: path.read_text().rindex("</svg>"),
    }
    for name in content(out):
        readers.get(Path(name).suffix, Path.read_bytes)(out / name)
    if (out / "model.json").exists():
        load(out)


@pytest.fixture(scope="module")
def killed():
    """Gives a function that runs a command which is killed at a moment, and returns whether it was."""
    server = [sys.executable, "-m", "tests.killing"]
    with subprocess.Popen(server, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:

        def ask(command: str, out: Path, moment: int) -> bool:
            process.stdin.write(json.dumps([command, str(out), moment]) + "\n")
            process.stdin.flush()
            status = int(process.stdout.readline())
            assert status in (0, -signal.SIGKILL)
            return status == -signal.SIGKILL

        yield ask
        process.stdin.close()


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_that_is_killed_loses_nothing_and_can_be_called_again(command, killed, tmp_path):
    random, kills, moment = Random(command), 0, 0
    step = 1
    wanted = -(-KILLS // 25) if command in HEAVY else -(-KILLS // 7)
    out = tmp_path / "out"
    out.mkdir()
    assert not killed(command, out, NEVER)  # a run before, whose files may be lost
    (out / MINE).write_text("precious")
    names = {*content(out)}
    for _ in range(3 * wanted):
        moment += random.randint(1, step)
        if not killed(command, out, moment):
            step, moment = max(1, moment // wanted), 0  # begin anew, at other moments
            continue
        kills += 1
        check_whole(out)
        assert {*content(out)} >= names - arrays(names), f"lost at {moment}"
        assert (out / MINE).read_text() == "precious"
        if kills == wanted:
            break
    assert kills == wanted
    assert not killed(command, out, NEVER)
    with work_folder(out):
        pass
    assert {name.split("-")[0] for name in content(out)} == {name.split("-")[0] for name in names}
    assert not [path for path in out.rglob("*") if WORK.fullmatch(path.name)]
    assert content(out)[MINE] == b"precious"


def arrays(names: set[str]) -> set[str]:
    """Returns those files of a model whose names tell their content; `check_whole` reads the one that counts."""
    return {name for name in names if name.startswith("arrays-")}


def test_a_recording_that_was_written_over_while_killed_is_one_of_the_two(killed, tmp_path):
    """Two writers of one file, one of which is killed at each of its writes in turn."""
    out, found = tmp_path / "out", []
    out.mkdir()
    for command in ("simulate", "write_again"):
        assert not killed(command, out, NEVER)
        found.append(read_recording(out / "x.parquet").tracks)
    for moment in range(1, 8):
        killed(("simulate", "write_again")[moment % 2], out, moment)
        tracks = read_recording(out / "x.parquet").tracks
        assert any(tracks.equals(one) for one in found)
