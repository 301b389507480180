"""What the command line shows: progress bars, tables, errors. Progress and errors go to stderr, results to stdout."""

import dataclasses
import json
import re
import shlex
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape as without_markup
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from rampcast.cli.lines import line_by_line

if TYPE_CHECKING:
    import polars as pl

    from rampcast.benchmark import Benchmark
    from rampcast.doctor import Diagnosis, Finding, RoadDiagnosis, Summary
    from rampcast.download import Download
    from rampcast.forecast.held_out import HeldOut
    from rampcast.forecast.protocol import Progress as Tell
    from rampcast.formats import ReadReport
    from rampcast.recording import CleaningReport, Recording

# What a terminal obeys: controls but tab and line end, and those that turn the direction of writing.
OBEYED = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")
output = Console()
messages = Console(stderr=True)
notes = Console(stderr=True)  # what --quiet leaves out

SHOWN_HORIZONS = (1.0, 3.0, 5.0, 8.0, 10.0, 15.0)  # [s]
SHOWN_SKILLS = (3.0, 8.0)  # [s]


def escape(text: str) -> str:
    """Returns a text as it is to be printed: a name in a file, or a server's answer, is not to move the cursor."""
    return without_markup(OBEYED.sub(lambda found: repr(found[0])[1:-1], text))


def hush() -> None:
    """Lets progress and notes go nowhere; results, warnings and errors are printed as ever."""
    notes.quiet = True


@contextmanager
def progress(first: str | None = None) -> Iterator["Tell"]:
    """Gives a function (what, done, total) that shows a bar for each thing done; `first` is shown from the start."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    if not notes.is_terminal:
        yield from line_by_line(first, note)
        return
    with Progress(*columns, console=notes) as bars:
        tasks: dict[str, TaskID] = {}

        def tell(what: str, done: int, total: int) -> None:
            if what not in tasks:
                # what was done before is no part of the speed by which it tells the time left
                tasks[what] = bars.add_task(escape(what), total=total, completed=done)
            bars.update(tasks[what], completed=done, total=total)

        if first is not None:
            tell(first, 0, 1)
        yield tell
        if first is not None:
            tell(first, 1, 1)


def titled(title: str, heads: Sequence[str], *, numbers: Collection[str] = ()) -> Table:
    """Returns an empty table whose columns are of words, or of numbers where these are named."""
    table = Table(title=escape(title), title_justify="left")
    for head in heads:
        table.add_column(escape(head), justify="right" if head in numbers else "left")
    return table


def say(text: str) -> None:
    """Prints a line of a result."""
    output.print(escape(text), soft_wrap=True, highlight=False)


def complain(text: str) -> None:
    """Prints an error."""
    messages.print(f"[bold red]error:[/] {escape(text)}", soft_wrap=True, highlight=False)


def note(text: str) -> None:
    """Prints something that the user may want to know while waiting."""
    notes.print(escape(text), soft_wrap=True, highlight=False)


def warn(text: str) -> None:
    """Prints something that is likely to be a mistake, though it can be gone on with."""
    messages.print(f"[bold yellow]warning:[/] {escape(text)}", soft_wrap=True, highlight=False)


def print_data_sets(name: str | None = None) -> None:
    """Prints the data sets that can be got by name, and where to ask for the others; or the one of that name."""
    from rampcast.download import CATALOGUE, listed

    for entry in CATALOGUE.values() if name is None else [listed(name)]:
        say(f"{entry.name}\n  {entry.title}. Licence: {entry.licence}\n  {entry.page}")
        if entry.ask:
            say(f"  not downloaded: {entry.ask}")


def print_download(found: "Download", folder: Path) -> None:
    """Prints what was got, how it was checked, and what to do next."""
    say(f"{folder / found.file}: {found.bytes:,} bytes, got on {found.when}. Licence: {found.licence}")
    if found.rows:
        say(f"as many rows as the portal counts: {found.rows:,}")
    say("SHA-256 as others recorded it" if found.checksum_known else "no checksum is published; the counts are checked")
    if not found.rows_read:
        say("rampcast has no reader for it: describe its columns in a mapping file (rampcast convert --mapping)")
        return
    skipped = f" ({found.rows_skipped:,} of them not as the format says)" if found.rows_skipped else ""
    say(f"read: {found.rows_read:,} rows{skipped} of {found.vehicles:,} vehicles in {', '.join(found.recordings)}")
    files = " ".join(shlex.quote(str(folder / name)) for name in (found.unpacked or (found.file,)))
    say(f"next: rampcast inspect {files}" + (" --skip-bad-rows" if found.rows_skipped else ""))


def print_trained(out: Path, windows: Sequence[str], score: "HeldOut | None") -> None:
    """Prints where the model is, what it was trained on, and what it is worth."""
    say(f"wrote the model to {out}, trained on {', '.join(windows)}")
    print_held_out(score)


def print_held_out(score: "HeldOut | None") -> None:
    """Prints the errors on the minutes that were held out; nothing where none were."""
    from rampcast.horizon import STEP
    from rampcast.models.correction import KNOTS

    if score is None:
        return
    heads = ("horizon [s]", "trained [m]", "it started from [m]", "constant speed [m]", "90 % band holds")
    title = f"mean error on the last fifth of the recording, {score.vehicles:,} forecasts, by a training on the rest"
    table = titled(title, heads, numbers=heads)
    columns = (score.trained, score.start, score.steady, score.trained_coverage)
    for knot, trained, start, steady, share in zip(KNOTS.tolist(), *columns, strict=True):
        table.add_row(f"{(knot + 1) * STEP:g}", f"{trained:.2f}", f"{start:.2f}", f"{steady:.2f}", f"{share:.0%}")
    output.print(table)


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


def print_formats() -> None:
    """Prints the formats that rampcast reads."""
    from rampcast.formats import all_formats

    table = Table("format", "what it is", "files")
    table.add_column("described in", no_wrap=True)
    for one in all_formats():
        table.add_row(*map(escape, (one.name, one.title, one.reads, one.page)))
    output.print(table)


def print_written(paths: Sequence[Path]) -> None:
    """Prints how many rows of which parts there are in each recording's file."""
    import polars as pl

    for path in paths:
        scan = pl.scan_csv if path.suffix == ".csv" else pl.scan_parquet
        parts = scan(path).group_by("recording").len().sort("recording").collect(engine="streaming")
        names = ", ".join(parts["recording"][:5]) + (", ..." if parts.height > 5 else "")
        say(f"wrote {path}: {parts['len'].sum():,} rows of {names}")


def print_cleaning(report: "CleaningReport") -> None:
    """Prints what smoothing left out, filled and moved."""
    counts = {name: value for name, value in dataclasses.asdict(report).items() if isinstance(value, int) and value}
    say("smoothing: " + ", ".join(f"{name.replace('_', ' ')}: {value:,}" for name, value in counts.items()))
    say(f"  x moved by {report.mean_shift_x:.3f} m on average, by {report.largest_shift_x:.2f} m at most")


def print_summary(summary: "Summary") -> None:
    """Prints what is in a recording and how good it is: all of it, its windows, and its lanes."""
    from rampcast.doctor.summary import counts_table, lane_table, window_table

    site = f"{summary.site}{' (simulated)' if summary.simulated else ''}"
    tables = {site: counts_table(summary), "windows": window_table(summary), "lanes": lane_table(summary)}
    for title, text in tables.items():
        if text is None:
            continue
        table = titled(title, text.heads, numbers={*text.heads} - {"", "window"})
        for row in text.rows:
            table.add_row(*map(escape, row))
        output.print(table)
    for breach in summary.breaches:
        warn(str(breach))


def print_scores(out: Path) -> None:
    """Prints the position errors that a run left in its output folder."""
    import polars as pl

    print_errors(pl.read_parquet(out / "tables" / "longitudinal.parquet"))


def results_to_stderr() -> None:
    """Lets all words go to stderr, where json alone is to be on stdout."""
    output.stderr = True


def print_scores_of(folder: Path, recording: "Recording", *, as_json: bool) -> None:
    """Prints how far off the forecasts in a folder were, and how often their bands held; as json at all horizons."""
    import polars as pl

    from rampcast.evaluate.positions import beside_truth, errors_by

    table = errors_by(beside_truth(pl.scan_parquet(folder / "forecast.parquet"), recording), ["horizon"])
    if as_json:
        print_json({"recordings": recording.names, "errors": table.to_dicts()})
        return
    heads = ("seconds ahead", "mean error (m)", "CRPS (m)", "50 % band holds", "90 % band holds", "n")
    shown = titled(f"how far off forecasts of {', '.join(recording.names)} were", heads, numbers=heads)
    for row in table.filter(pl.col("horizon").round(1).is_in(SHOWN_HORIZONS)).iter_rows(named=True):
        off, shares = (row["mean_error"], row["crps"]), (row["inside_50"], row["inside_90"])
        shown.add_row(
            f"{row['horizon']:g}", *(f"{one:.2f}" for one in off), *(f"{one:.0%}" for one in shares), f"{row['n']:,}"
        )
    output.print(shown)


def print_diagnosis(diagnosis: "Diagnosis", *, out: Path | None, as_json: bool, command: str) -> None:
    """Prints what the doctor found, as json or as tables, and writes its page to `out` if that is given."""
    if as_json:
        print_json(diagnosis.to_dict())
    else:
        if diagnosis.report is not None:
            print_reading(diagnosis.report)
        if diagnosis.in_files:
            _print_findings(f"all files, with {len(diagnosis.roads)} roads", diagnosis.in_files)
        for road in diagnosis.roads:
            _print_road(road)
    if out is not None:
        from rampcast.doctor.page import write_diagnosis

        note(f"wrote {write_diagnosis(diagnosis, out, command=command)}")


def _print_road(diagnosis: "RoadDiagnosis") -> None:
    title = f"{diagnosis.site}: {diagnosis.vehicles:,} vehicles, {diagnosis.rows:,} rows"
    if diagnosis.findings:
        _print_findings(title, diagnosis.findings)
    else:
        say(f"{title}: nothing found")
    for name, value in diagnosis.facts.items():
        say(f"{name}: {value}")
    for check, reason in diagnosis.unassessed.items():
        say(f"not assessed: {check.title}: {reason}")
    say("this would spoil a forecast" if diagnosis.spoils else "nothing here would spoil a forecast")


def _print_findings(title: str, findings: "Sequence[Finding]") -> None:
    colors = {"spoils a forecast": "bold red", "warning": "yellow", "note": "cyan"}
    heads = ("severity", "finding", "count", "share", "for example")
    table = titled(title, heads, numbers=("count", "share"))
    for one in findings:
        severity = f"[{colors[one.severity.value]}]{one.severity.value}[/]"
        counted = one.check.counting(one.count)
        table.add_row(severity, escape(one.check.title), counted, f"{one.share:.2%}", escape(one.example()))
    output.print(table)
    for one in findings:
        detail = f" ({one.detail})" if one.detail else ""
        say(f"{one.check.title}{detail}: {one.check.advice}")


def print_errors(longitudinal: "pl.DataFrame") -> None:
    """Prints the mean absolute position error at a few horizons, from the tidy table."""
    from rampcast.forecasters import label

    for (mode,), of_mode in longitudinal.group_by("mode", maintain_order=True):
        heads = [f"{horizon:.0f} s" for horizon in SHOWN_HORIZONS]
        title = f"{mode} mode: mean absolute position error (m)"
        table = titled(title, ("vehicles", "model", *heads), numbers=heads)
        for (group, model), rows in of_mode.group_by("group", "model", maintain_order=True):
            error = dict(zip(rows["horizon"], rows["mean_error"], strict=True))
            cells = (error.get(horizon) for horizon in SHOWN_HORIZONS)
            shown = ("–" if value is None else f"{value:.1f}" for value in cells)
            table.add_row(str(group).replace("_", " "), label(str(model)), *shown)
        output.print(table)


def print_benchmark(found: "Benchmark") -> None:
    """Prints mean errors at a few horizons for each data set and depth (shares are of the last second), and merges."""
    for (data_set,), of_set in found.scores.group_by("data_set", maintain_order=True):
        shown_cases = None
        for (depth,), rows in of_set.group_by("depth", maintain_order=True):
            most = max(rows["n"].to_list())
            if most == shown_cases:  # all cases have that many leaders: the same table again
                continue
            shown_cases = most
            who = f"leaders known: {depth!s} or more" if depth else "all cases"
            _print_benchmark_table(f"{data_set!s}, {who} (n = {most:,}): mean absolute error (m)", rows)
    if found.merge_scores.height:
        for (data_set,), of_set in found.merge_scores.group_by("data_set", maintain_order=True):
            _print_merge_table(str(data_set), of_set)
    for name, about in found.record["data_sets"].items():
        say(f"{name}: trained on {about['train']:,} cases, tested on {about['test']:,}; split: {about['split']}")
        for model, count in about.get("overlaps", {}).items():
            say(f"{name}: {count:,} samples of {model} overlap another vehicle")
    for name, reason in found.record["left_out"].items():
        say(f"{name}: left out, {reason}")


def _print_benchmark_table(title: str, rows: "pl.DataFrame") -> None:
    heads = (*(f"{horizon:.0f} s" for horizon in SHOWN_HORIZONS), "gap closed", "90 % band covers")
    table = titled(title, ("model", *heads), numbers=heads)
    lines: list[tuple[list[str], tuple[str, ...]]] = []  # neighbouring models that agree, as chains do, are one row
    for (model,), of_model in rows.group_by("model", maintain_order=True):
        error = dict(zip(of_model["horizon"], of_model["mean_error"], strict=True))
        cells = ["–" if horizon not in error else f"{error[horizon]:.2f}" for horizon in SHOWN_HORIZONS]
        last = of_model.row(-1, named=True)
        shares = (f"{last[name]:.0%}" if last[name] is not None else "–" for name in ("gap_closed", "coverage_90"))
        shown = (*cells, *shares)
        if lines and lines[-1][1] == shown:
            lines[-1][0].append(str(model))
        else:
            lines.append(([str(model)], shown))
    for models, shown in lines:
        table.add_row(models[0] if len(models) == 1 else f"{models[0]} ... {models[-1]}", *shown)
    output.print(table)


def _print_merge_table(data_set: str, rows: "pl.DataFrame") -> None:
    of_times = rows.filter(rows["horizon"].is_null())
    n = max(of_times["n"].to_list())
    heads = ("error (s)", "of K.-M.", "C-index", "gap right", *(f"skill {horizon:.0f} s" for horizon in SHOWN_SKILLS))
    table = titled(f"{data_set}, time to the merge (n = {n:,} within 15 s)", ("model", *heads), numbers=heads)
    table.columns[0].no_wrap = True
    columns = ("time_error", "time_error_ratio", "c_index", "gap_accuracy")
    for row in of_times.iter_rows(named=True):
        skills = rows.filter((rows["model"] == row["model"]) & rows["horizon"].is_in(SHOWN_SKILLS))["brier_skill"]
        cells = ["–" if value is None else f"{value:.2f}" for value in (*(row[name] for name in columns), *skills)]
        table.add_row(row["model"], *cells)
    output.print(table)
