"""The command that shows a recording with its forecasts."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rampcast.cli import show as terminal
from rampcast.cli.app import app
from rampcast.cli.options import AnyModel, writable_file
from rampcast.cli.reading import Reading, read_raw, reads_files
from rampcast.errors import RampcastError

if TYPE_CHECKING:
    from rampcast.forecast.forecaster import Forecaster
    from rampcast.recording import Recording

SHIPPED, SHIPPED_BEGIN = 1, 126.0  # the window that no shipped model was trained on, and when there is a queue [s]

Shown = Annotated[
    list[Path] | None, typer.Argument(help="Files of a recording. Default: a simulated one that ships with rampcast.")
]
Window = Annotated[str | None, typer.Option("--window", help="Of a recording with several. Default: the first.")]
Begin = Annotated[
    float | None, typer.Option("--from", help="Where to begin, after the recording's beginning \\[s].", min=0.0)
]
Speed = Annotated[float, typer.Option("--speed", help="Times as quick as it was recorded.", min=0.05, max=100.0)]
Export = Annotated[
    Path | None,
    typer.Option(
        "--export", callback=writable_file, help="Write a film (.mp4, .gif, .webp) or a picture (.png) instead."
    ),
]
Seconds = Annotated[float, typer.Option("--seconds", help="Of a film: time of the recording that it shows \\[s].")]
Rate = Annotated[float, typer.Option("--rate", help="Of a film: pictures a second.", max=60.0)]
Height = Annotated[int, typer.Option("--height", help="Of a film: height of its pictures \\[pixels], 16:9.")]
Followed = Annotated[int | None, typer.Option("--vehicle", help="Of a film: the vehicle to follow.")]
Port = Annotated[int, typer.Option("--port", help="Port of the page; 0 takes one that is free.")]
Browser = Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")]


@app.command(
    epilog="Examples:\n\nrampcast view\n\nrampcast view recording.parquet --model model --from 120 --speed 2\n\n"
    "rampcast view recording.parquet --export clip.mp4 --from 120 --seconds 20"
)
@reads_files("accept_doubtful")
def view(
    recording: Shown = None,
    model: AnyModel = None,
    window: Window = None,
    begin: Begin = None,
    speed: Speed = 1.0,
    export: Export = None,
    seconds: Seconds = 10.0,
    rate: Rate = 10.0,
    height: Height = 540,
    vehicle: Followed = None,
    port: Port = 0,
    browser: Browser = True,
    reading: Reading = Reading(),
) -> None:
    """Shows a recording with its forecasts in the browser, or writes a film of it.

    The page plays, stops, steps and seeks; what came true stands beside the forecast. It stops at Ctrl-C.
    """
    shown, start = found_recording(recording or [], reading)
    begin = start if begin is None else begin
    if export is None:
        show_page(shown, model, window=window, begin=begin, speed=speed, port=port, browser=browser)
        return
    from rampcast.plots.film import Cut, film_recording

    cut = Cut(begin, seconds, speed, rate, vehicle, (2 * round(height * 8 / 9), 2 * round(height / 2)))
    with terminal.progress() as tell:
        count = film_recording(shown, export, joint_model(model), cut=cut, window=window, progress=tell)
    terminal.say(f"wrote {export}: {count} {'picture' if count == 1 else 'pictures'}")


def found_recording(files: list[Path], reading: Reading) -> "tuple[Recording, float]":
    """Returns the recording to show, and where to begin [s]."""
    if files:
        return read_raw(files, reading), 0.0
    from rampcast.recording.recording import read_recording
    from rampcast.simulate import shipped_sample

    return read_recording(shipped_sample()[SHIPPED]), SHIPPED_BEGIN


def joint_model(folder: Path | None) -> "Forecaster":
    """Returns the forecaster of a model folder; without one the pretrained one.

    Raises:
        RampcastError: it is none that forecasts all vehicles of a moment.
    """
    from rampcast.forecast.forecaster import Forecaster
    from rampcast.forecast.storage import load
    from rampcast.forecasters import PRETRAINED

    found = load(PRETRAINED if folder is None else folder)
    if not isinstance(found, Forecaster):
        raise RampcastError(f"--model {folder}: the paper's framework; expected a model of `rampcast train`")
    return found


def show_page(
    shown: "Recording", model: Path | None, *, window: str | None, begin: float, speed: float, port: int, browser: bool
) -> None:
    """Serves the page until it is interrupted."""
    from rampcast.errors import MissingExtra

    try:
        from rampcast.live.viewing import open_browser, view
    except ImportError as error:
        raise MissingExtra('the page needs more packages; run: pip install "rampcast[live]"') from error
    if model is not None:
        joint_model(model).check(shown.site)

    def announce(address: str) -> None:
        opened = browser and open_browser(address)
        terminal.say(f"{'opened' if opened else 'open'} {address} in your browser; Ctrl-C ends it")

    name = "pretrained" if model is None else str(model.absolute())
    view(shown, model=name, window=window, begin=begin, speed=speed, port=port, announce=announce)
