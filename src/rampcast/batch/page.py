"""The page about all sites of a batch: what failed, how good recordings are, scores, conflicts; needs no other file."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import jinja2
import polars as pl

from rampcast import __version__
from rampcast.batch.plan import Plan
from rampcast.batch.tables import ALL
from rampcast.doctor import Severity
from rampcast.files import write_whole

PAGE: Final = "report.html"
HORIZONS: Final = (1.0, 3.0, 5.0, 8.0, 10.0, 15.0)  # [s]
SOON: Final = (5.0, 15.0)  # [s]
MOST: Final = 20  # failures that the page lists
CONFLICTS: Final = (("ttc", 5.0), ("ttc", 15.0), ("drac", 5.0), ("drac", 15.0), ("pet", 15.0))  # measure, within [s]
CLASSES: Final = {Severity.SPOILS: "bad", Severity.WARNING: "warning", Severity.NOTE: "note"}
Rows = list[tuple[str, ...]]


def write_page(tables: Mapping[str, pl.DataFrame], plan: Plan) -> Path:
    """Writes the page about a batch into its folder, and returns it.

    Args:
        tables: as `tables.tables_of` returns them.
        plan: of the batch.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("rampcast.batch", ""),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    page = environment.get_template("page.html.j2").render(_values(tables, plan))
    with write_whole(plan.out / PAGE) as path:
        path.write_text(page, encoding="utf-8")
    return plan.out / PAGE


def _values(tables: Mapping[str, pl.DataFrame], plan: Plan) -> dict[str, Any]:
    sites, summary = tables["sites"], tables["summary"]
    failed = tables["parts"].filter(pl.col("error").is_not_null())
    return {
        "version": __version__,
        "plan": plan,
        "files": summary["file"].n_unique(),
        "sites": sites.to_dicts(),
        "failed": [(name, _first_line(error)) for name, error in failed.select("file", "error").head(MOST).iter_rows()],
        "failures": failed.height,
        "hours": f"{sites['hours'].sum():,.1f}",
        "rows": f"{sites['rows'].sum():,}",
        "vehicles": f"{sites['vehicles'].sum():,}",
        "peak": max((f"{one:,.0f}" for one in sites["peak_mb"].drop_nulls().top_k(1)), default="?"),
        "overview": [_site_row(row) for row in sites.iter_rows(named=True)],
        "findings": list(_finding_rows(tables["findings"])),
        "horizons": [f"{one:g} s" for one in HORIZONS],
        "errors": _score_rows(tables["site_scores"], "mean_error", _metres),
        "bands": _score_rows(tables["site_scores"], "inside_90", _share),
        "conflicts": _conflict_rows(tables["site_conflicts"]),
        "tables": sorted(tables),
    }


def _first_line(text: str) -> str:
    return text.splitlines()[0] if text else ""


def _site_row(row: Mapping[str, Any]) -> tuple[str, ...]:
    counts = (
        f"{row[name]:,}" for name in ("files", "days", "vehicles", "rows", "parts", "parts_failed", "parts_spoilt")
    )
    errors = (_metres(row[f"mean_error_{horizon:g}"]) for horizon in SOON)
    bands = (_share(row[f"inside_90_{horizon:g}"]) for horizon in SOON)
    simulated = " (simulated)" if row["simulated"] else ""
    return (f"{row['site']}{simulated}", *counts, f"{row['hours']:,.1f}", *errors, *bands, _share(row["ttc_5"]))


def _finding_rows(findings: pl.DataFrame) -> list[tuple[str, str, tuple[str, ...]]]:
    """Returns the class and severity of each kind of finding of each site, and its cells; the worst first."""
    found = findings.group_by("site", "severity", "name", "title").agg(pl.len(), pl.col("count", "of").sum())
    order = {kind.value: number for number, kind in enumerate(Severity)}
    classes = {kind.value: name for kind, name in CLASSES.items()}
    rank = pl.col("severity").replace_strict(order, return_dtype=pl.Int64)
    return [
        (
            classes[row["severity"]],
            row["severity"],
            (row["site"] or "files as a whole", row["title"], f"{row['count']:,}", _of(row), f"{row['len']:,}"),
        )
        for row in found.sort(rank, "site", "name").iter_rows(named=True)
    ]


def _of(row: Mapping[str, Any]) -> str:
    return _share(row["count"] / row["of"]) if row["of"] else ""


def _score_rows(scores: pl.DataFrame, value: str, shown: Callable[[float | None], str]) -> Rows:
    """Returns, for all sites and each one, n and a value at each of `HORIZONS`."""
    found = []
    for (site, model), rows in _by_site(scores, "model"):
        at = {round(horizon, 1): (n, one) for horizon, n, one in rows.select("horizon", "n", value).iter_rows()}
        counted = max((n for n, _ in at.values()), default=0)
        found.append((site, model, f"{counted:,}", *(shown(at.get(one, (0, None))[1]) for one in HORIZONS)))
    return found


def _conflict_rows(conflicts: pl.DataFrame) -> Rows:
    """Returns, for all sites and each one, the forecasts, and of each of `CONFLICTS` probability and likely ones."""
    found = []
    for (site,), rows in _by_site(conflicts):
        at = {(row["measure"], round(row["t"], 1)): row for row in rows.iter_rows(named=True)}
        cells = [at.get(one) for one in CONFLICTS]
        shown = (_share(one["expected"] / one["n"]) if one else "" for one in cells)
        likely = (f"{one['likely']:,}" if one else "" for one in cells)
        pairs = (cell for pair in zip(shown, likely, strict=True) for cell in pair)
        found.append((site, f"{max((one['n'] for one in cells if one), default=0):,}", *pairs))
    return found


def _by_site(table: pl.DataFrame, *more: str) -> Iterator[tuple[tuple[str, ...], pl.DataFrame]]:
    """Yields the rows of all sites, then those of each, with its name."""
    ordered = table.sort(pl.col("site") != ALL, "site", *more, maintain_order=True)
    for key, rows in ordered.group_by("site", *more, maintain_order=True):
        site, *others = map(str, key)
        yield ("all sites" if site == ALL else site, *others), rows


def _metres(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


def _share(value: float | None) -> str:
    return "" if value is None else f"{value:.1%}"
