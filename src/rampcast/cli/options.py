"""Arguments and options that several commands share."""

import atexit
import math
import shutil
import sys
import tempfile
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from rampcast.errors import RampcastError
from rampcast.files import check_file, check_folder


def writable_file(path: Path | None) -> Path | None:
    """Returns a path at which a file can be written, before long work is done for it.

    Raises:
        OutputError: it is a folder, or nothing can be written there.
    """
    if path is not None:
        check_file(path)
    return path


def writable_folder(path: Path | None) -> Path | None:
    """Returns a path at which files can be written into a folder, before long work is done for them.

    Raises:
        OutputError: it is a file, or nothing can be written there.
    """
    if path is not None:
        check_folder(path)
    return path


def time_between(every: float) -> float:
    """Returns a time between two moments.

    Raises:
        RampcastError: it is not above 0, or not finite.
    """
    if not 0.0 < every < math.inf:
        raise RampcastError(f"--every: expected a time above 0 s, as 0.5, got {every:g}")
    return every


def with_stdin(paths: list[Path] | None) -> list[Path] | None:
    """Returns paths of files, of which - is a file of what comes in; it lasts as long as the program."""
    return None if paths is None else [_stdin_file() if path == Path("-") else path for path in paths]


def check_files(paths: list[Path]) -> None:
    """Checks that files to read are there, before work is done with the first.

    Raises:
        RampcastError: one is not.
    """
    for path in paths:
        if not path.exists():
            raise RampcastError(f"{path}: there is no such file")


def _stdin_file() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="rampcast-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    with (folder / "stdin").open("wb") as file:
        shutil.copyfileobj(sys.stdin.buffer, file)
    return folder / "stdin"


LARGEST_SEED = 2**31 - 1  # that all who draw take: numpy, scikit-learn, jax and SUMO
Files = Annotated[
    list[Path],
    typer.Argument(
        callback=with_stdin, help="Recordings, in any form that [bold]rampcast formats[/] lists; - is what comes in."
    ),
]
FormatName = Annotated[
    str | None, typer.Option("--format", help="Format of the files. Default: told by their content.")
]
MappingFile = Annotated[
    Path | None, typer.Option("--mapping", help="A .toml file that says what the columns of a foreign table are.")
]
SiteName = Annotated[str | None, typer.Option("--site", help="A site's name or .toml file. Default: told by the file.")]
SkipBadRows = Annotated[bool, typer.Option("--skip-bad-rows", help="Count and list rows that are malformed; go on.")]
AcceptDoubtful = Annotated[
    bool, typer.Option("--accept-doubtful", help="Go on with what no road or vehicle has; it is named and counted.")
]
OutFolder = Annotated[Path, typer.Option("--out", callback=writable_folder, help="Folder to write to.")]
OutFile = Annotated[Path, typer.Option("--out", callback=writable_file, help="File to write.")]
AnyModel = Annotated[
    Path | None,
    typer.Option("--model", help="Model folder made by [bold]rampcast train[/]. Default: the pretrained model."),
]
RecordingFile = Annotated[
    Path, typer.Option("--recording", help="Recording to score it on, in any form rampcast reads.")
]
Every = Annotated[
    float,
    typer.Option(
        "--every",
        callback=time_between,
        help="Time between two moments that are forecast \\[s]; for the paper's framework a multiple of 0.2.",
    ),
]
Seed = Annotated[int, typer.Option("--seed", min=0, max=LARGEST_SEED, help="Fixes everything drawn at random.")]
Epochs = Annotated[int, typer.Option("--epochs", min=1, help="Passes of the LSTMs over their training windows.")]
Batch = Annotated[int, typer.Option("--batch", min=1, help="Windows per step of the LSTMs' training.")]
Stride = Annotated[int, typer.Option("--stride", min=1, help="Train the LSTMs on a window at every so many steps.")]
SiteFile = Annotated[
    Path,
    typer.Option("--out", callback=writable_file, help="Site file to write (.toml); its picture goes beside it."),
]
TargetLane = Annotated[int | None, typer.Option("--target-lane", help="Lane that ramp vehicles merge into.")]
Gore = Annotated[float | None, typer.Option("--gore", help="x where the ramp begins to run beside it \\[m].")]
RampEnd = Annotated[float | None, typer.Option("--ramp-end", help="x where the ramp lane ends \\[m]; inf: goes on.")]
MergeZone = Annotated[
    tuple[float, float] | None,
    typer.Option("--merge-zone", metavar="FROM TO", help="x between which merges are expected \\[m], as 180 230."),
]
Mirrored = Annotated[bool, typer.Option("--mirrored", help="The source's plane grows to the right: turn it.")]
Start = Annotated[
    str,
    typer.Option(
        "--from",
        help="Model to whose sites a small recording is drawn, and whose parts are taken where it is too little to "
        "learn from; or 'none'.",
    ),
]


Json = Annotated[bool, typer.Option("--json", help="Print json instead of words.")]


class Report(Enum):
    """What report.html is about."""

    RAMP = "ramp"
    PAPER = "paper"
    NONE = "none"


WhichReport = Annotated[
    Report,
    typer.Option(
        "--report", help="report.html for people who run ramps, the paper's tables and figures, or none.",
    ),
]  # fmt: skip
