"""What the command line shows: progress bars, tables, errors. Progress and errors go to stderr, results to stdout."""

import dataclasses
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table

if TYPE_CHECKING:
    import polars as pl

    from rampcast.forecast.forecaster import Progress as Tell
    from rampcast.formats import ReadReport
    from rampcast.recording import CleaningReport
    from rampcast.recording.quality import Quality

output = Console()
messages = Console(stderr=True)

SHOWN_HORIZONS = (1.0, 3.0, 5.0, 8.0, 10.0, 15.0)  # [s]


@contextmanager
def progress(first: str | None = None) -> Iterator["Tell"]:
    """Gives a function (what, done, total) that shows a bar for each thing done; `first` is shown from the start."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=messages) as bars:
        tasks: dict[str, TaskID] = {}

        def tell(what: str, done: int, total: int) -> None:
            if what not in tasks:
                tasks[what] = bars.add_task(escape(what), total=total)
            bars.update(tasks[what], completed=done, total=total)

        if first is not None:
            tell(first, 0, 1)
        yield tell
        if first is not None:
            tell(first, 1, 1)


def say(text: str) -> None:
    """Prints a line of a result."""
    output.print(escape(text), soft_wrap=True, highlight=False)


def complain(text: str) -> None:
    """Prints an error."""
    messages.print(f"[bold red]error:[/] {escape(text)}", soft_wrap=True, highlight=False)


def print_json(values: Mapping[str, Any]) -> None:
    """Prints values as json and nothing else."""
    print(json.dumps(values, indent=2, default=str))


def print_reading(report: "ReadReport") -> None:
    """Prints what reading found: every count that is not zero, and the rows that were skipped."""
    for name, form in zip(report.files, report.forms, strict=True):
        say(f"{name}: {form}")
    counts = {name: value for name, value in report.to_dict().items() if isinstance(value, int) and value}
    say(", ".join(f"{name.replace('_', ' ')}: {value:,}" for name, value in counts.items()))
    for row in report.skipped:
        say(f"  skipped {row}")


def print_cleaning(report: "CleaningReport") -> None:
    """Prints what smoothing left out, filled and moved."""
    counts = {name: value for name, value in dataclasses.asdict(report).items() if isinstance(value, int) and value}
    say("smoothing: " + ", ".join(f"{name.replace('_', ' ')}: {value:,}" for name, value in counts.items()))
    say(f"  x moved by {report.mean_shift_x:.3f} m on average, by {report.largest_shift_x:.2f} m at most")


def print_quality(quality: "Quality") -> None:
    """Prints what is in a recording and how good it is, a column for each window, and its lanes."""
    from rampcast.recording.quality import lane_table, quality_table

    titles = (f"{quality.site}{' (simulated)' if quality.simulated else ''}", "lanes")
    for title, text in zip(titles, (quality_table(quality), lane_table(quality)), strict=True):
        table = Table(title=escape(title), title_justify="left")
        for head in text.heads:
            table.add_column(escape(head), justify="right" if head else "left")
        for row in text.rows:
            table.add_row(*map(escape, row))
        output.print(table)


def print_scores(out: Path) -> None:
    """Prints the position errors that a run left in its output folder."""
    import polars as pl

    print_errors(pl.read_parquet(out / "tables" / "longitudinal.parquet"))


def print_errors(longitudinal: "pl.DataFrame") -> None:
    """Prints the mean absolute position error at a few horizons, from the tidy table."""
    from rampcast.evaluate.longitudinal import model_labels

    labels = model_labels()
    for (mode,), of_mode in longitudinal.group_by("mode", maintain_order=True):
        table = Table(title=f"{mode} mode: mean absolute position error (m)", title_justify="left")
        for name in ("vehicles", "model"):
            table.add_column(name)
        for horizon in SHOWN_HORIZONS:
            table.add_column(f"{horizon:.0f} s", justify="right")
        for (group, model), rows in of_mode.group_by("group", "model", maintain_order=True):
            error = dict(zip(rows["horizon"], rows["mean_error"], strict=True))
            cells = (error.get(horizon) for horizon in SHOWN_HORIZONS)
            shown = ("–" if value is None else f"{value:.1f}" for value in cells)
            table.add_row(str(group).replace("_", " "), labels.get(str(model), str(model)), *shown)
        output.print(table)
