"""Commands that forecast and score."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rampcast.cli import show as terminal
from rampcast.cli.app import app
from rampcast.cli.compiled import telling_of_compiling
from rampcast.cli.options import (
    AnyModel,
    Batch,
    Epochs,
    Every,
    Json,
    OutFolder,
    RecordingFile,
    Report,
    Seed,
    SkipBadRows,
    Stride,
    WhichReport,
    check_files,
    with_stdin,
)
from rampcast.cli.reading import Reading, bad_rows_of, read_raw, read_smoothed, reads_files, smoothed, user_command
from rampcast.cli.training import paper_spec
from rampcast.errors import RampcastError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from rampcast.forecast.protocol import Progress, RecordingForecast, RecordingForecaster
    from rampcast.recording import Recording


@app.command(
    epilog="Examples:\n\nrampcast forecast window2.parquet --out forecasts\n\n"
    "rampcast forecast window2.parquet window3.parquet --model model --every 0.1 --out forecasts --csv"
)
@reads_files()
def forecast(
    out: OutFolder,
    recordings: Annotated[
        list[Path] | None, typer.Argument(callback=with_stdin, help="Recordings, in any form rampcast reads; or -.")
    ] = None,
    model: AnyModel = None,
    every: Every = 1.0,
    reading: Reading = Reading(),
    csv: Annotated[bool, typer.Option("--csv", help="Write csv files as well.")] = False,
    report: WhichReport = Report.RAMP,
    recording: Annotated[list[Path] | None, typer.Option("--recording", hidden=True)] = None,
) -> None:
    """Forecasts all vehicles at regular moments: where they will be, when and into which gap they will merge.

    Writes report.html with slides and numbers (docs/report.md), forecast.parquet and lane_change.parquet; the paper's
    framework no such report, gap.parquet and conflicts.parquet. With --report paper the paper's tables and figures.
    The columns: docs/forecast_files.md.
    """
    from rampcast.forecast.parts import write_forecasts

    kept: list[Recording] = []
    forecaster = trained_model(model)
    with terminal.progress() as tell, telling_of_compiling(terminal.note):
        parts = forecast_files(forecaster, [*(recordings or []), *(recording or [])], reading, every, tell, kept)
        written = write_forecasts(parts, out, suffixes=(".parquet", ".csv") if csv else (".parquet",))
    for path, rows in written.items():
        terminal.say(f"wrote {path}: {rows:,} rows")
    if report is Report.PAPER:
        say_paper_report(forecaster, smoothed(kept[0]), out, every=every, seed=1)
    elif report is Report.RAMP:
        say_report(kept, out, forecaster, model_named(model))


def model_named(folder: Path | None) -> str:
    return "the pretrained model" if folder is None else f"the model {folder}"


def say_paper_report(
    forecaster: "RecordingForecaster", recording: "Recording", out: Path, *, every: float, seed: int
) -> None:
    """Writes the paper's tables, figures and report of a smoothed recording, and says where they are."""
    from rampcast.paper.reproduce import score

    with terminal.progress("score as the paper does"):
        result, page = score(forecaster, recording, out, every=every, seed=seed, command=user_command())
    terminal.print_errors(result.tables["longitudinal"])
    terminal.say(f"wrote {page}")


def say_report(
    recordings: "list[Recording]", out: Path, forecaster: "RecordingForecaster", named: str,
    more: "Mapping[str, str] | None" = None,
) -> None:  # fmt: skip
    """Writes the report on forecasts and says where it is; nothing of models that forecast no bands."""
    from rampcast import __version__
    from rampcast.report import About, report_on

    about = About(named, forecaster.site is not None, __version__, more or {})
    with terminal.progress("look at what came, and write the report"):
        page = report_on(recordings, out, about)
    if page is not None:
        of = ", ".join(name for one in recordings for name in one.names)
        terminal.say(f"wrote {page} on {of}: look at it first; its pictures are slides beside it")


def trained_model(folder: Path | None) -> "RecordingForecaster":
    """Returns the forecaster of a model folder; without one the pretrained one.

    Raises:
        RampcastError: it cannot be read.
    """
    from rampcast.forecast.storage import load
    from rampcast.forecasters import PRETRAINED

    return load(PRETRAINED if folder is None else folder)


def forecast_files(
    forecaster: "RecordingForecaster", files: list[Path], reading: Reading, every: float, tell: "Progress",
    kept: "list[Recording]",
) -> "Iterator[RecordingForecast]":  # fmt: skip
    """Yields the parts of the forecasts of recordings, read one after the other; the first is added to `kept`.

    Raises:
        RampcastError: there is none, two have a window of the same name, or one cannot be read or forecast.
    """
    if not files:
        raise RampcastError("no recording was given: name one or more files, as `rampcast forecast window2.parquet`")
    check_files(files)  # the last is not to be missed after an hour with the others
    read: dict[str, Path] = {}
    for file in files:
        recording = read_raw([file], reading)
        if twice := [name for name in recording.names if name in read]:
            raise RampcastError(f"{file}: its window '{twice[0]}' is in {read[twice[0]]} too; forecast one of the two")
        read |= dict.fromkeys(recording.names, file)
        if not kept:
            kept.append(recording)
        yield from told_parts(forecaster, recording, every, tell)


def told_parts(
    forecaster: "RecordingForecaster", recording: "Recording", every: float, tell: "Progress"
) -> "Iterator[RecordingForecast]":
    """Yields the parts of the forecast of a recording, and tells how many are done."""
    parts, what = forecaster.in_parts(recording, every=every), f"forecast {', '.join(recording.names)}"
    tell(what, 0, parts.total)
    for done, part in enumerate(parts.each, start=1):
        yield part
        tell(what, done, parts.total)


@app.command(
    epilog="Examples:\n\nrampcast evaluate --recording window2.parquet --out scores\n\n"
    "rampcast evaluate --model model --recording window2.parquet --report paper --out scores"
)
@reads_files()
def evaluate(
    recording: RecordingFile,
    out: OutFolder,
    model: AnyModel = None,
    every: Every = 1.0,
    reading: Reading = Reading(),
    seed: Seed = 1,
    report: WhichReport = Report.RAMP,
    json: Json = False,
) -> None:
    """Scores a model on a recording that it was not trained on: how far off, and how well calibrated.

    Writes report.html with slides, the errors by situation and horizon, and each forecast (docs/report.md). With
    --report paper, and of the paper's framework always, the paper's tables and figures.
    """
    from rampcast.forecast.parts import write_forecasts
    from rampcast.forecast.protocol import check_unseen
    from rampcast.paper.framework import PaperForecaster

    forecaster = trained_model(model)
    if json:
        terminal.results_to_stderr()
    with terminal.progress("read and smooth"):
        test = read_smoothed([recording], reading)
    if report is Report.PAPER or isinstance(forecaster, PaperForecaster):
        say_paper_report(forecaster, test, out, every=every, seed=seed)
        return
    check_unseen(forecaster, test)
    with terminal.progress() as tell, telling_of_compiling(terminal.note):
        write_forecasts(told_parts(forecaster, test, every, tell), out, suffixes=(".parquet",))
    terminal.print_scores_of(out, test, as_json=json)
    if report is Report.RAMP:
        say_report([test], out, forecaster, model_named(model))


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
    from rampcast.forecast.forecaster import ForecasterSpec
    from rampcast.paper.reproduce import Protocol, find_files
    from rampcast.paper.reproduce import reproduce as run

    ours, paper = ForecasterSpec(seed=seed), paper_spec(epochs, batch, stride, seed)
    protocol = Protocol(ours=ours, paper=paper, every=every, command=user_command())
    found = find_files(data, without=out)
    for reason in found.left_out.values():
        terminal.say(f"left out {reason}")
    with terminal.progress() as tell:
        bad_rows = bad_rows_of(skip_bad_rows)
        page = run(found.files, out, protocol=protocol, site=site, bad_rows=bad_rows, progress=tell)
    terminal.print_scores(out)
    terminal.say(f"wrote {page}")


@app.command(
    epilog="Examples:\n\nrampcast benchmark --out out/benchmark\n\n"
    "rampcast benchmark --train data/real --test data/held-back --out out/benchmark"
)
def benchmark(
    train: Annotated[
        Path | None,
        typer.Option("--train", help="Folder to train on. Default: real in RAMPCAST_DATA, or in ../shared/data."),
    ] = None,
    test: Annotated[
        Path | None,
        typer.Option("--test", help="Folder to test on. Default: that of --train, split as the committed file says."),
    ] = None,
    out: OutFolder = Path("out/benchmark"),
) -> None:
    """Scores every model and baseline on the open benchmark, and writes each single forecast for others to score."""
    from rampcast.benchmark import benchmark as run

    with terminal.progress() as tell:
        found = run(train, test=test, out=out, command=user_command(), progress=tell)
    terminal.print_benchmark(found)
    terminal.say(f"wrote its tables, pictures and run.json to {out}")


@app.command(epilog="Example:\n\nrampcast demo --out out/demo")
def demo(out: OutFolder = Path("out/demo")) -> None:
    """Trains on the simulated recordings that ship with rampcast, shortly, and reports on one that it was not shown.

    First the report for people who run ramps, report.html; then the paper's whole protocol, paper/report.html.
    """
    from rampcast.forecast.parts import write_forecasts
    from rampcast.forecast.storage import load
    from rampcast.paper.reproduce import DEMO, OURS
    from rampcast.paper.reproduce import reproduce as run
    from rampcast.recording import read_recording
    from rampcast.simulate import shipped_sample

    protocol, paper = replace(DEMO, command=user_command()), out / "paper"
    with terminal.progress() as tell, telling_of_compiling(terminal.note):
        page = run(shipped_sample(), paper, protocol=protocol, progress=tell)
        forecaster, test = load(paper / OURS), read_recording(shipped_sample()[1])
        write_forecasts(told_parts(forecaster, test, protocol.every, tell), out, suffixes=(".parquet",))
    beside = {"The paper's statements, checked": page.relative_to(out).as_posix()}
    say_report([test], out, forecaster, "a model that was trained for a minute or two", beside)
    terminal.print_scores(paper)
    terminal.say(f"wrote {page}: the paper's")
