"""Commands that close the loop: experiments with ramp meters and advice in SUMO."""

from typing import Annotated

import typer

from rampcast.cli import show as terminal
from rampcast.cli.app import app
from rampcast.cli.options import AnyModel, OutFile, OutFolder


@app.command(
    epilog="Examples:\n\nrampcast experiment tiny --out out/tiny   (a plan that ships)\n\n"
    "rampcast experiment plan.toml --out out/plan   (call it again after an interruption)"
)
def experiment(
    plan: Annotated[str, typer.Argument(help="A plan.toml, or tiny, ci, full, gaps, advice, corridor, which ship.")],
    out: OutFolder,
    processes: Annotated[int | None, typer.Option("--processes", min=1, help="Default: one for each core.")] = None,
) -> None:
    """Tries ramp meters and advice in SUMO, with and without forecasts; writes a report, and every run's numbers."""
    from rampcast.control.experiment import experiment as run
    from rampcast.control.plan import read_plan

    asked = read_plan(plan)
    with terminal.progress() as tell:
        done = run(asked, out, processes=processes, progress=tell)
    for path in done.files:
        terminal.say(f"wrote {path}")


@app.command(
    name="export-sumo",
    epilog="Example:\n\nrampcast export-sumo --model out/model --out drivers.add.xml   (then sumo -a drivers.add.xml)",
)
def export_sumo(out: OutFile, model: AnyModel = None) -> None:
    """Writes the drivers of a model as vehicle types that SUMO loads."""
    from rampcast.arguments import expected
    from rampcast.control.export_sumo import export_sumo as write
    from rampcast.forecast.forecaster import Forecaster
    from rampcast.forecast.storage import load
    from rampcast.forecasters import PRETRAINED

    found = load(PRETRAINED if model is None else model)
    advice = "the paper's framework has no drivers of its own"
    count = write(expected(Forecaster, found, name="--model", advice=advice), out)
    terminal.say(f"wrote {out}: {count} drivers, in the distributions drivers_main and drivers_ramp")
