"""Pictures of forecasts from their files."""

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from rampcast.cli import show as terminal
from rampcast.cli.app import app
from rampcast.cli.options import writable_file


class Picture(Enum):
    """What is drawn."""

    FAN = "fan"
    MERGES = "merges"
    TRUST = "trust"


@app.command(
    epilog="Examples:\n\nrampcast plot fan forecast.parquet --recording window2.parquet --vehicle 12 --t0 30\n\n"
    "rampcast plot trust forecast.parquet --recording window2.parquet --out trust.png"
)
def plot(
    picture: Annotated[Picture, typer.Argument(help="fan (one forecast), merges, or trust (errors and bands).")],
    forecast: Annotated[Path, typer.Argument(help="forecast.parquet, as `rampcast forecast` wrote it.")],
    recording: Annotated[Path, typer.Option("--recording", help="Recording that was forecast.")],
    vehicle: Annotated[str | None, typer.Option("--vehicle", help="Of a fan; default: a typical one.")] = None,
    t0: Annotated[float | None, typer.Option("--t0", help="Moment of a fan \\[s]; default: a typical one.")] = None,
    out: Annotated[
        Path, typer.Option("--out", callback=writable_file, help="Picture to write (.png, 1920 x 1080).")
    ] = Path("picture.png"),
) -> None:
    """Draws one of the report's pictures from the files of a forecast."""
    from rampcast.formats import read
    from rampcast.report import write_picture

    write_picture(picture.value, forecast, read(recording), out, vehicle=vehicle, t0=t0)
    terminal.say(f"wrote {out}")
