"""The command that trains, on one site or over several."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rampcast.cli import show as terminal
from rampcast.cli.app import app
from rampcast.cli.compiled import telling_of_compiling
from rampcast.cli.options import Batch, Epochs, Files, OutFolder, Seed, Start, Stride
from rampcast.cli.reading import Reading, read_smoothed, reads_files
from rampcast.errors import RampcastError
from rampcast.paper.laws.mode import Mode

if TYPE_CHECKING:
    import polars as pl

    from rampcast.forecast.forecaster import Forecaster, ForecasterSpec
    from rampcast.forecast.protocol import Progress, RecordingForecaster
    from rampcast.paper.framework import PaperSpec
    from rampcast.recording import Recording


Paper = Annotated[
    Mode | None, typer.Option("--paper", help="Train the paper's framework in that reading of the paper instead.")
]


@app.command(
    epilog="Examples:\n\nrampcast train window1.parquet window3.parquet --out model\n\n"
    "rampcast train window1.parquet window3.parquet --out paper-model --paper corrected\n\n"
    "rampcast train here.parquet there.parquet elsewhere.parquet --site-per-file --out any-site"
)
@reads_files()
def train(
    context: typer.Context,
    recordings: Files,
    out: OutFolder,
    paper: Paper = None,
    reading: Reading = Reading(),
    epochs: Epochs = 25,
    batch: Batch = 32,
    stride: Stride = 1,
    seed: Seed = 1,
    start: Start = "pretrained",
    site_per_file: Annotated[
        bool,
        typer.Option("--site-per-file", help="The files are of several sites: train for any; score each left out."),
    ] = False,
    mode: Annotated[str | None, typer.Option("--mode", hidden=True)] = None,
) -> None:
    """Trains the forecaster on a site, in stages that are kept: after an interruption the same command goes on.

    With --paper the paper's framework instead: two neighbour LSTMs and 32 lane-change forests.
    """
    from rampcast.forecast.forecaster import ForecasterSpec
    from rampcast.forecast.storage import save
    from rampcast.models.folder import check_replaceable

    refuse_without_effect(context, paper=paper, mode=mode)
    check_replaceable(out)
    spec = ForecasterSpec(seed=seed)
    if site_per_file:
        train_over_sites(recordings, out, reading, spec, started(start), paper)
        return
    with terminal.progress() as tell, telling_of_compiling(terminal.note):
        recording = read_smoothed(recordings, reading)
        if paper is None:
            model = own_of(recording, spec, started(start), out, tell)
        else:
            model = papers_of(recording, paper, paper_spec(epochs, batch, stride, seed), tell)
        save(model, out)
    terminal.print_trained(out, recording.names, getattr(model, "score", None))


def own_of(
    recording: "Recording", spec: "ForecasterSpec", start: "Forecaster | None", out: Path, tell: "Progress"
) -> "RecordingForecaster":
    """Returns the forecaster of a site, trained in stages that are kept in the folder."""
    from rampcast.forecast.forecaster import fit
    from rampcast.models.folder import STAGES

    return fit(recording, spec=spec, start=start, kept=out / STAGES, progress=tell)


def papers_of(recording: "Recording", mode: Mode, spec: "PaperSpec", tell: "Progress") -> "RecordingForecaster":
    """Returns the paper's framework, trained on a site."""
    from rampcast.paper.framework import fit_paper

    return fit_paper(recording, mode=mode, spec=spec, progress=tell)


def train_over_sites(
    files: list[Path],
    out: Path,
    reading: Reading,
    spec: "ForecasterSpec",
    start: "Forecaster | None",
    paper: Mode | None,
) -> None:
    """Trains a forecaster of any site, and writes how well each site is forecast by the others, and how they differ.

    Raises:
        RampcastError: the paper's framework is asked for, which is of one site.
    """
    from rampcast.cli.site_tables import print_differences, print_site_scores
    from rampcast.forecast.over_sites import fit_sites, scores_table
    from rampcast.forecast.populations import Populations, populations_table
    from rampcast.forecast.storage import save
    from rampcast.models.folder import STAGES

    if paper is not None:
        raise RampcastError("--site-per-file: the paper's framework is trained at one site; leave --paper out")
    with terminal.progress() as tell, telling_of_compiling(terminal.note):
        sites = [read_smoothed([file], reading) for file in files]
        model, scores = fit_sites(sites, spec=spec, start=start, kept=out / STAGES, progress=tell)
        save(model, out)
    differences = populations_table(model.model.base.sites or Populations())
    for name, table in {"sites.csv": scores_table(scores), "between_sites.csv": differences}.items():
        write_csv(table, out / name)
    terminal.say(f"wrote the model to {out}, trained on {', '.join(model.trained_on)}; it forecasts any site")
    print_site_scores(scores)
    print_differences(differences)


def write_csv(table: "pl.DataFrame", file: Path) -> None:
    """Writes a table, whole or not at all."""
    from rampcast.files import write_whole

    with write_whole(file) as new:
        table.write_csv(new, float_precision=4)


def started(start: str) -> "Forecaster | None":
    """Returns the forecaster that training starts from.

    Raises:
        RampcastError: it is the paper's, or cannot be read.
    """
    from rampcast.forecast.forecaster import Forecaster
    from rampcast.forecast.storage import load

    if start == "none":
        return None
    found = load(start)
    if not isinstance(found, Forecaster):
        raise RampcastError(f"--from {start}: the paper's framework; expected a model of `rampcast train`")
    return found


def refuse_without_effect(context: typer.Context, *, paper: Mode | None, mode: str | None) -> None:
    """Raises an error if `train` was given an option that would do nothing.

    Raises:
        RampcastError: names it.
    """
    if mode is not None:
        raise RampcastError(
            f"--mode {mode}: a model is rampcast's own now, or with `--paper {mode}` the paper's framework in that mode"
        )
    sources = {name: context.get_parameter_source(name) for name in ("epochs", "batch", "stride")}
    given = [f"--{name}" for name, source in sources.items() if source is not None and source.name == "COMMANDLINE"]
    if given and paper is None:
        raise RampcastError(f"{', '.join(given)}: only for the paper's LSTMs; leave it out, or add `--paper corrected`")


def paper_spec(epochs: int, batch: int, stride: int, seed: int) -> "PaperSpec":
    from rampcast.paper.framework import PaperSpec
    from rampcast.paper.neighbours.lstm import LstmSpec

    return PaperSpec(lstm=LstmSpec(epochs=epochs, batch=batch), window_stride=stride, seed=seed)
