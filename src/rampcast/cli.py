"""The command line. Each command calls public functions; everything heavy is imported when a command runs."""

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rampcast import terminal
from rampcast.errors import RampcastError
from rampcast.physics.mode import Mode

if TYPE_CHECKING:
    from rampcast.forecast.forecaster import TrainingSpec
    from rampcast.formats import BadRows, ReadReport
    from rampcast.recording import Recording, Site

app = typer.Typer(
    name="rampcast",
    help="Forecasts where every vehicle on a highway on-ramp will be, and when it will change lane, up to 15 s ahead.",
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    add_completion=False,
)


Files = Annotated[list[Path], typer.Argument(help="Recordings: NGSIM text or csv (also in .gz or .zip), or parquet.")]
SiteName = Annotated[str | None, typer.Option("--site", help="A site's name or .toml file. Default: told by the file.")]
SkipBadRows = Annotated[bool, typer.Option("--skip-bad-rows", help="Count and list rows that are malformed; go on.")]
OutFolder = Annotated[Path, typer.Option("--out", help="Folder to write to.")]
OutFile = Annotated[Path, typer.Option("--out", help="File to write.")]
ModelFolder = Annotated[Path, typer.Option("--model", help="Model folder made by [bold]rampcast train[/].")]
RecordingFile = Annotated[Path, typer.Option("--recording", help="Recording to forecast, in any form rampcast reads.")]
Every = Annotated[float, typer.Option("--every", help="Time between anchors [s]; a multiple of 0.2.")]
Seed = Annotated[int, typer.Option("--seed", help="Fixes everything drawn at random.")]
Epochs = Annotated[int, typer.Option("--epochs", min=1, help="Passes of the LSTMs over their training windows.")]
Batch = Annotated[int, typer.Option("--batch", min=1, help="Windows per step of the LSTMs' training.")]
Stride = Annotated[int, typer.Option("--stride", min=1, help="Train the LSTMs on a window at every so many steps.")]


@app.command(
    epilog="Examples:\n\nrampcast inspect trajectories-0400-0415.txt\n\nrampcast inspect i80.parquet --json > i80.json"
)
def inspect(
    files: Files,
    site: SiteName = None,
    skip_bad_rows: SkipBadRows = False,
    json: Annotated[bool, typer.Option("--json", help="Print json instead of tables.")] = False,
) -> None:
    """Prints what is in a recording and how good it is."""
    from rampcast.recording.quality import quality

    with terminal.progress("read and check"):
        recording, report = _read(files, site, skip_bad_rows)
        found = quality(recording)
    if json:
        terminal.print_json({"reading": report.to_dict(), "quality": found.to_dict()})
    else:
        terminal.print_reading(report)
        terminal.print_quality(found)


@app.command(epilog="Example:\n\nrampcast convert trajectories-*.txt --site i80 --out i80.parquet")
def convert(files: Files, out: OutFile, site: SiteName = None, skip_bad_rows: SkipBadRows = False) -> None:
    """Reads recordings of one site and writes them as one parquet file."""
    from rampcast.recording import write_recording

    with terminal.progress(f"convert to {out}"):
        recording, report = _read(files, site, skip_bad_rows)
        write_recording(recording, out)
    terminal.print_reading(report)
    terminal.say(f"wrote {out}: {recording.tracks.height:,} rows of {', '.join(recording.names)}")


@app.command(epilog="Example:\n\nrampcast train window1.parquet window3.parquet --out model --mode corrected")
def train(
    recordings: Files,
    out: OutFolder,
    mode: Annotated[Mode, typer.Option(help="Which reading of the paper.")] = Mode.CORRECTED,
    site: SiteName = None,
    skip_bad_rows: SkipBadRows = False,
    epochs: Epochs = 25,
    batch: Batch = 32,
    stride: Stride = 1,
    seed: Seed = 1,
) -> None:
    """Trains a forecaster: two neighbour LSTMs and 32 lane-change forests."""
    from rampcast.forecast.forecaster import fit_forecaster
    from rampcast.forecast.storage import save

    with terminal.progress() as tell:
        recording = _smoothed(recordings, site, skip_bad_rows)
        spec = _training(epochs, batch, stride, seed)
        save(fit_forecaster(recording, mode=mode, spec=spec, progress=tell), out)
    terminal.say(f"wrote the model to {out}, trained on {', '.join(recording.names)}")


@app.command(
    epilog="Example:\n\nrampcast forecast --model model --recording 2.parquet --every 1.0 --out forecasts --csv"
)
def forecast(
    model: ModelFolder,
    recording: RecordingFile,
    out: OutFolder,
    every: Every = 1.0,
    site: SiteName = None,
    skip_bad_rows: SkipBadRows = False,
    csv: Annotated[bool, typer.Option("--csv", help="Write csv files as well.")] = False,
) -> None:
    """Forecasts every on-ramp vehicle at every anchor time; writes forecast.parquet and lane_change.parquet."""
    from rampcast.forecast.storage import load
    from rampcast.recording.files import write_table
    from rampcast.scenes import build_scenes

    with terminal.progress("forecast"):
        forecaster = load(model)
        result = forecaster.predict(build_scenes(_smoothed([recording], site, skip_bad_rows), every=every))
        tables = {"forecast": result.position_table(), "lane_change": result.lane_change_table()}
        written = [path for name, table in tables.items() for path in write_table(table, out / name, csv=csv)]
    terminal.say(f"{len(result.t0):,} scenes; wrote {', '.join(map(str, written))}")


@app.command(epilog="Example:\n\nrampcast evaluate --model model --recording window2.parquet --out scores")
def evaluate(
    model: ModelFolder,
    recording: RecordingFile,
    out: OutFolder,
    every: Every = 1.0,
    site: SiteName = None,
    skip_bad_rows: SkipBadRows = False,
    seed: Seed = 1,
) -> None:
    """Scores a model on a recording that it was not trained on; writes tidy tables, figures and a report."""
    from rampcast.forecast.storage import load
    from rampcast.reproduce import score

    with terminal.progress("forecast and score"):
        forecaster = load(model)
        smoothed = _smoothed([recording], site, skip_bad_rows)
        result, page = score(forecaster, smoothed, out, every=every, seed=seed, command=_command())
    terminal.print_errors(result.tables["longitudinal"])
    terminal.say(f"wrote {page}")


@app.command(
    epilog="Example:\n\nrampcast reproduce --data ngsim/ --out out/i80   (call it again after an interruption)"
)
def reproduce(
    data: Annotated[Path, typer.Option("--data", help="Folder with the three windows, in any of NGSIM's forms.")],
    out: OutFolder,
    site: Annotated[str, typer.Option("--site", help="A site's name, or a .toml file.")] = "i80",
    every: Every = 1.0,
    epochs: Epochs = 25,
    batch: Batch = 32,
    stride: Stride = 1,
    seed: Seed = 1,
    skip_bad_rows: SkipBadRows = False,
) -> None:
    """Runs the paper's whole protocol in both modes beside the paper's values; resumes after an interruption."""
    from rampcast.reproduce import Protocol, find_files
    from rampcast.reproduce import reproduce as run

    protocol = Protocol(training=_training(epochs, batch, stride, seed), every=every, command=_command())
    found = find_files(data, without=out)
    for reason in found.left_out.values():
        terminal.say(f"left out {reason}")
    with terminal.progress() as tell:
        page = run(
            found.files, out, protocol=protocol, site=_site(site), bad_rows=_bad_rows(skip_bad_rows), progress=tell
        )
    terminal.print_scores(out)
    terminal.say(f"wrote {page}")


@app.command(epilog="Example:\n\nrampcast demo --out out/demo")
def demo(out: OutFolder = Path("out/demo")) -> None:
    """Runs the whole protocol on the simulated recordings that ship with rampcast, with short training."""
    from rampcast.reproduce import DEMO_TRAINING, Protocol
    from rampcast.reproduce import reproduce as run
    from rampcast.simulate import shipped_sample

    protocol = Protocol(training=DEMO_TRAINING, every=5.0, command=_command())
    with terminal.progress() as tell:
        page = run(shipped_sample(), out, protocol=protocol, progress=tell)
    terminal.print_scores(out)
    terminal.say(f"wrote {page}")


@app.command(epilog="Example:\n\nrampcast simulate --site i80 --minutes 15 --seed 1 --out recording.parquet")
def simulate(
    out: OutFile,
    site: Annotated[str, typer.Option("--site", help="A site's name, or a .toml file.")] = "i80",
    minutes: Annotated[float, typer.Option("--minutes", min=0.1, help="Length of the recording [min].")] = 15.0,
    seed: Seed = 1,
    window: Annotated[str, typer.Option("--window", help="Name of the window.")] = "1",
    noise: Annotated[float, typer.Option("--noise", min=0.0, help="Standard deviation of position noise [m].")] = 0.0,
) -> None:
    """Simulates a recording of a site with SUMO (needs [bold]pip install "rampcast\\[sumo]"[/])."""
    from rampcast.recording import load_site, write_recording
    from rampcast.simulate import simulate as run

    with terminal.progress() as tell:
        recording = run(
            load_site(site),
            minutes=minutes,
            seed=seed,
            window=window,
            position_noise=noise,
            progress=lambda share: tell("simulate", round(100 * share), 100),
        )
        write_recording(recording, out)
    terminal.say(f"wrote {out}: {recording.tracks.height:,} rows of simulated traffic")


def main() -> None:
    """Runs the command line; a user's mistake is one message and exit code 2."""
    try:
        app()
    except (RampcastError, OSError) as error:  # an OSError names the path: no such folder, no right to write, disk full
        terminal.complain(str(error))
        sys.exit(2)


def _site(name: str | None) -> "Site | None":
    from rampcast.recording import load_site

    return load_site(name) if name else None


def _read(files: list[Path], site: str | None, skip_bad_rows: bool = False) -> "tuple[Recording, ReadReport]":
    from rampcast.formats import read_any

    return read_any(files, site=_site(site), bad_rows=_bad_rows(skip_bad_rows))


def _bad_rows(skip: bool) -> "BadRows":
    from rampcast.formats import BadRows

    return BadRows.SKIP if skip else BadRows.RAISE


def _smoothed(files: list[Path], site: str | None, skip_bad_rows: bool) -> "Recording":
    """Returns the recording in the files, smoothed unless it is already; prints what that left out or changed."""
    from rampcast.recording import clean

    recording, report = _read(files, site, skip_bad_rows)
    terminal.print_reading(report)
    if recording.is_smoothed:
        return recording
    smoothed, changes = clean(recording)
    terminal.print_cleaning(changes)
    return smoothed


def _command() -> str:
    """Returns what the user called."""
    return shlex.join(["rampcast", *sys.argv[1:]])


def _training(epochs: int, batch: int, stride: int, seed: int) -> "TrainingSpec":
    from rampcast.forecast.forecaster import TrainingSpec
    from rampcast.models.lstm import LstmSpec

    return TrainingSpec(lstm=LstmSpec(epochs=epochs, batch=batch), window_stride=stride, seed=seed)
