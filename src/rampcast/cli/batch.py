"""The command that does much with many recordings."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rampcast.cli import show as terminal
from rampcast.cli.app import app
from rampcast.cli.options import Every, writable_folder
from rampcast.cli.reading import Reading, reads_files
from rampcast.errors import RampcastError

if TYPE_CHECKING:
    from rampcast.batch import Plan


@app.command(
    epilog="Examples:\n\nrampcast batch 'data/*.csv' --do doctor,forecast,evaluate --out out/batch\n\n"
    "rampcast batch plan.toml   (call it again after an interruption)\n\n"
    "rampcast batch plan.toml --scheduler tcp://10.0.0.1:8786"
)
@reads_files()
def batch(
    files: Annotated[list[str], typer.Argument(help="A plan.toml, or recordings; patterns as 'data/*.csv' too.")],
    out: Annotated[
        Path | None,
        typer.Option("--out", callback=writable_folder, help="Folder of all results; in a plan, its own."),
    ] = None,
    do: Annotated[str | None, typer.Option("--do", help="Of doctor,convert,forecast,evaluate. Default: all.")] = None,
    model: Annotated[str, typer.Option("--model", help="Folder of a model.")] = "pretrained",
    every: Every = 1.0,
    window: Annotated[
        float,
        typer.Option(
            "--window", min=0.0, help="Length of the parts that recordings are cut into \\[s]; 0: whole files."
        ),
    ] = 300.0,
    reading: Reading = Reading(),
    processes: Annotated[int | None, typer.Option("--processes", min=1, help="Default: one for each core.")] = None,
    scheduler: Annotated[str | None, typer.Option("--scheduler", help="Address of a Dask scheduler.")] = None,
) -> None:
    """Checks, converts, forecasts and scores many recordings, part by part; goes on where it was interrupted."""
    from rampcast.batch import batch as run

    plan = asked_plan(files, out, do, reading, {"model": model, "every": every, "window": window})
    with terminal.progress() as tell:
        found = run(plan, processes=processes, scheduler=scheduler, progress=tell)
    for name, reason in found.failed.select("file", "error").iter_rows():
        terminal.warn(f"{name}: {reason}")
    for path in found.files:
        terminal.say(f"wrote {path}")
    if found.failed.height:
        raise typer.Exit(1)


def asked_plan(files: list[str], out: Path | None, do: str | None, reading: Reading, more: dict[str, Any]) -> "Plan":
    """Returns the plan of a file, or of what the command line says.

    Raises:
        RampcastError: it is none, or lacks a folder for its results.
    """
    from rampcast.batch import plan_of_files, read_plan

    if len(files) == 1 and files[0].endswith(".toml"):
        return read_plan(files[0])
    if out is None:
        raise RampcastError("--out is missing: the folder of all results")
    if do is not None:
        more = more | {"do": [one.strip() for one in do.split(",")]}
    mapping = None if reading.mapping is None else str(reading.mapping)
    return plan_of_files(files, out, **reading._replace(mapping=None)._asdict() | more | {"mapping": mapping})
