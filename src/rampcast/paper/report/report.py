"""The report: one page that needs nothing else, with its pictures and tables as files beside it."""

import base64
import re
from collections.abc import Iterator, Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import jinja2
import matplotlib as mpl
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rampcast.paper.report import figures
from rampcast.paper.report.claims import claims_table
from rampcast.paper.report.errata import ERRATA
from rampcast.paper.report.figures import FigureEntry
from rampcast.paper.report.tables import (
    Table,
    error_table,
    lane_change_table,
    modes_of,
    notation_table,
    outcome_table,
    parameter_table,
)
from rampcast.plots import style
from rampcast.sites import Site

TABLE_NAMES = ("longitudinal", "parameters", "outcomes", "lane_change", "importance", "examples")
PAPER_TABLES = {"idm": "2", "gipps_paper": "3", "ghr": "4"}  # the paper's table numbers
PNG_DPI = 160
LAW_NOTES = {
    "idm": "Drivers with a leader abreast of them (a gap at the floor of 1 m) have errors so large that they make the "
    "mean (erratum 10): the last row is without them. In corrected mode s₀ is fitted from 0.5 to 25.5 m, as gaps are "
    "net of the leader's length.",
    "gipps_paper": "This is the paper's law of that name, repaired (erratum 2); it is not the law of Gipps (1981).",
    "gipps": "The paper does not use this law; it stands here because the paper names it.",
}
NOT_RECORDED = "not recorded"
PAGE = "report.html"


def fill_report(
    tables: Mapping[str, pl.DataFrame],
    *,
    site: Site,
    run: Mapping[str, Any],
    folder: Path,
    paper: Mapping[str, Any] | None = None,
) -> Path:
    """Writes report.html, figures/*.svg, figures/*.png and tables/*.csv into a folder; returns the page's path.

    Whoever calls it puts the folder in its place as a whole.

    Args:
        tables: the tidy tables by name. Those that are missing are named on the page.
        site: the geometry.
        run: the run record; shown are date, seed, data_hash, versions, trained_on, tested_on, counts and all the rest.
        folder: is there.
        paper: printed values: `paper["parameters"][law][parameter]` has "mean", "median", "standard_deviation"; those
            of the law "gipps" are taken for printed by Gipps (1981).

    Raises:
        RampcastError: a table lacks a column that is drawn.
    """
    known = {name: table for name, table in tables.items() if name in TABLE_NAMES and table.height}
    for part in ("figures", "tables"):
        (folder / part).mkdir(exist_ok=True)
    drawn = {entry.number: (entry, list(_write_figure(entry, folder))) for entry in _entries(known, site)}
    listed = {table.number: table for table in _all_tables(known, paper or {})}
    for table in listed.values():
        if not table.missing:
            table.data.write_csv(folder / "tables" / f"table-{table.number}.csv")
    text = _page(site=site, run=run, figures=drawn, tables=listed, known=known)
    (folder / PAGE).write_text(text, encoding="utf-8")
    return folder / PAGE


def _entries(tables: Mapping[str, pl.DataFrame], site: Site) -> Iterator[FigureEntry]:
    yield from figures.setting_figures(site)
    yield figures.neighbour_figure(tables)
    yield figures.forecast_figure(tables)
    yield from figures.scene_figures(tables, site)
    yield figures.classification_figure(tables)
    yield figures.importance_figure(tables)
    yield from figures.own_figures(tables)


def _all_tables(tables: dict[str, pl.DataFrame], paper: Mapping[str, Any]) -> Iterator[Table]:
    parameters, printed = tables.get("parameters"), paper.get("parameters", {})
    yield notation_table()
    for law, number in PAPER_TABLES.items():
        note = LAW_NOTES.get(law, "")
        yield parameter_table(parameters, law=law, number=number, printed=printed.get(law), note=note)
    yield claims_table(tables, number="A1")
    own = {"printed": printed.get("gipps"), "author": "Gipps (1981)", "note": LAW_NOTES["gipps"]}
    yield parameter_table(parameters, law="gipps", number="A2", **own)
    yield outcome_table(tables.get("outcomes"), number="A3")
    yield error_table(tables.get("longitudinal"), number="A4")
    yield lane_change_table(tables.get("lane_change"), number="A5")
    more = [] if parameters is None else sorted(set(parameters["law"]) - {*PAPER_TABLES, "gipps"})
    for i, law in enumerate(more):
        yield parameter_table(parameters, law=law, number=f"A{6 + i}")


def _write_figure(entry: FigureEntry, out: Path) -> Iterator[dict[str, str]]:
    """Draws and saves the panels of a figure; yields what the page needs of each."""
    if entry.drawing:
        yield _write_drawing(entry, out)
    axes: list[tuple[str | None, Axes]] = []
    for panel in entry.panels:
        ax = panel.draw()
        if panel.title:
            with mpl.rc_context(style.RC):
                style.add_title(ax, panel.title)
        axes.append((panel.share, ax))
    for share in {share for share, _ in axes if share is not None}:
        style.share_height([ax for other, ax in axes if other == share])
    for panel, (_, ax) in zip(entry.panels, axes, strict=True):
        stem = f"figure-{panel.name}"
        svg = _save(style.figure_of(ax), out / "figures", stem)
        width, height = style.figure_of(ax).get_size_inches()
        yield _embedded(entry, stem, svg, size=(width, height), title=panel.title)


def _write_drawing(entry: FigureEntry, out: Path) -> dict[str, str]:
    """Copies a drawing that ships with the package; returns what the page needs of it."""
    svg = (resources.files("rampcast.paper.report") / "drawings" / entry.drawing).read_bytes()
    stem = f"figure-{entry.number}"
    (out / "figures" / f"{stem}.svg").write_bytes(svg)
    width, height = map(float, re.findall(rb'viewBox="0 0 ([\d.]+) ([\d.]+)"', svg)[0])  # in points, 72 an inch
    return _embedded(entry, stem, svg, size=(width / 72, height / 72))


def _embedded(
    entry: FigureEntry, stem: str, svg: bytes, *, size: tuple[float, float], title: str = ""
) -> dict[str, str]:
    """Returns what the page needs of one picture; its size in [inch]."""
    uri = f"data:image/svg+xml;base64,{base64.b64encode(svg).decode('ascii')}"
    text = f"Figure {entry.number}. {entry.title}. {title}".strip()
    return {"stem": stem, "uri": uri, "alt": text, "width": f"{96 * size[0]:.0f}", "height": f"{96 * size[1]:.0f}"}


def _save(figure: Figure, folder: Path, stem: str) -> bytes:
    svg = _compact(style.svg_of(figure).decode("utf-8")).encode("utf-8")
    (folder / f"{stem}.svg").write_bytes(svg)
    with mpl.rc_context(style.RC):
        figure.savefig(folder / f"{stem}.png", format="png", dpi=PNG_DPI)
    return svg


def _compact(svg: str) -> str:
    """Returns the same picture without line breaks, and with places to 0.01 of a point."""
    svg = re.sub(r"\s*\n\s*", " ", svg).replace("> <", "><")
    return re.sub(r'(?<=[\s"])(-?\d+\.\d\d)\d+(?=[\s"])', r"\1", svg)


def _page(
    *,
    site: Site,
    run: Mapping[str, Any],
    figures: Mapping[str, tuple[FigureEntry, list[dict[str, str]]]],
    tables: Mapping[str, Table],
    known: Mapping[str, pl.DataFrame],
) -> str:
    loader = jinja2.PackageLoader("rampcast.paper.report", "")
    environment = jinja2.Environment(
        loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    notes = {note.erratum: note for note in site.notes if note.erratum is not None}
    return environment.get_template("report.html.j2").render(
        site=site,
        summary=list(_summary(run)),
        findings=list(_findings(known)),
        absent=[name for name in TABLE_NAMES if name not in known],
        figures=figures,
        tables=tables,
        own_figures=[number for number in figures if number.startswith("A")],
        own_tables=[number for number in tables if number.startswith("A") and number not in ("A1", "A2", "A3")],
        errata=[(erratum, notes.get(erratum.number)) for erratum in ERRATA],
        notes=[note for note in site.notes if note.erratum is None],
        record=list(_flat(run)),
    )


def _summary(run: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yields the first things to know about a run, those not recorded among them."""
    names = {
        "trained_on": "Trained on",
        "tested_on": "Tested on",
        "counts": "Counts",
        "date": "Made on",
        "seed": "Seed",
        "versions": "Versions",
        "data_hash": "Hash of the data",
    }
    for key, text in names.items():
        yield text, _text(run[key]) if run.get(key) is not None else NOT_RECORDED


def _findings(tables: Mapping[str, pl.DataFrame]) -> Iterator[str]:
    """Yields one sentence per mode on the best forecast of the central vehicle."""
    table = tables.get("longitudinal")
    if table is None:
        return
    central = table.filter(pl.col("group") == "central")
    central = central.filter(pl.col("mean_error").is_not_null() & pl.col("mean_error").is_not_nan())
    for mode in modes_of(central):
        parts = []
        for horizon in (5.0, 10.0, 15.0):
            rows = central.filter((pl.col("mode") == mode) & (pl.col("horizon") == horizon)).sort("mean_error")
            if rows.height:
                best = rows.row(0, named=True)
                parts.append(
                    f"{best['mean_error']:.1f} m at {horizon:.0f} s ({style.label(best['model'])}, n = {best['n']:,})"
                )
        if parts:
            title = style.MODE_TITLES.get(mode, mode)
            start = f"{title[0].upper()}{title[1:]}, smallest mean absolute error of the central vehicle"
            yield f"{start}: {'; '.join(parts)}."


def _flat(values: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, str]]:
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{before}{key}.")
        else:
            yield f"{before}{key}", _text(value)


def _text(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{str(key).replace('_', ' ')} {_text(part)}" for key, part in value.items())
    if isinstance(value, (list, tuple)):
        return ", ".join(_text(part) for part in value)
    if isinstance(value, float):
        return f"{value:,.4g}"
    return str(value)
