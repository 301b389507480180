"""The doctor's page: one file that needs nothing else, and beside it the findings as json and as tables."""

import base64
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
import polars as pl
from matplotlib.figure import Figure

from rampcast.doctor import figures
from rampcast.doctor.diagnosis import Diagnosis, RoadDiagnosis
from rampcast.doctor.distributions import LABELS
from rampcast.doctor.finding import Finding
from rampcast.doctor.severity import Severity
from rampcast.files import write_outputs
from rampcast.plots import style

PAGE, VALUES, PLACES = "doctor.html", "doctor.json", "findings"
CLASSES = {Severity.SPOILS: "spoils", Severity.WARNING: "warning", Severity.NOTE: "note"}
SHOWN_QUANTILES = (0.001, 0.01, 0.05, 0.5, 0.95, 0.99, 0.999)


@dataclass(frozen=True)
class Picture:
    """A picture as the page shows it: the image as a link that holds it, its size [px], and what it shows."""

    uri: str
    width: int
    height: int
    caption: str


def write_diagnosis(diagnosis: Diagnosis, out: Path | str, *, command: str = "") -> Path:
    """Writes doctor.html, doctor.json, findings.parquet and findings.csv into a folder; returns the page's path.

    Other files in the folder stay as they are; all are written or none.

    Args:
        diagnosis: of one road or several.
        out: the folder; made if it is not there.
        command: what the user called.
    """
    page = _page(diagnosis, command)
    text = json.dumps(diagnosis.to_dict(), indent=2, default=str)
    places = diagnosis.places()
    out = Path(out)
    with write_outputs(out) as new:
        places.write_parquet(new / f"{PLACES}.parquet")
        places.write_csv(new / f"{PLACES}.csv", float_precision=4)
        for name, content in ((VALUES, text), (PAGE, page)):
            (new / name).write_text(content, encoding="utf-8")
    return out / PAGE


def _page(diagnosis: Diagnosis, command: str) -> str:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("rampcast.doctor", ""),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    report = diagnosis.report
    return environment.get_template("page.html.j2").render(
        files=list(zip(report.files, report.forms, strict=True)) if report else [],
        command=command,
        recordings=[_recording(one, number) for number, one in enumerate(diagnosis.roads, start=1)],
        in_files=_shown(diagnosis.in_files),
        spoils=diagnosis.spoils,
    )


def _recording(diagnosis: RoadDiagnosis, number: int) -> dict[str, Any]:
    counts = [(CLASSES[kind], sum(one.severity is kind for one in diagnosis.findings)) for kind in Severity]
    return {
        "number": number,
        "diagnosis": diagnosis,
        "counts": counts,
        "findings": _shown(diagnosis.findings),
        "tracks": _tracks(diagnosis),
        "timelines": list(_timelines(diagnosis)),
        "distributions": list(_distributions(diagnosis)),
        "lateral": _lateral(diagnosis),
        "quantiles": SHOWN_QUANTILES,
    }


def _shown(findings: Sequence[Finding]) -> list[tuple[str, Finding, str, list[tuple[str, ...]]]]:
    """Returns each finding as the page shows it: its class, itself, its share in words, and its examples."""
    return [(CLASSES[one.severity], one, _share(one), list(_examples(one))) for one in findings]


def _share(finding: Finding) -> str:
    return f"{finding.count:,} of {finding.check.counting(finding.of)} ({_percent(finding.share)})"


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %" if share < 0.1 else f"{100 * share:.1f} %"


def _examples(finding: Finding) -> Iterator[tuple[str, ...]]:
    """Yields the cells of each example; empty where something is not known."""
    for row in finding.examples.iter_rows(named=True):
        x, value = (f"{row[name]:.2f}" if row[name] is not None else "" for name in ("x", "value"))
        others = ("" if row[name] is None else str(row[name]) for name in ("recording", "vehicle", "frame", "lane"))
        yield (*others, x, value)


def _tracks(diagnosis: RoadDiagnosis) -> Picture | None:
    tracks, marks = diagnosis.pictures["tracks"], diagnosis.pictures["marks"]
    if not tracks.height:
        return None
    window, lane = str(tracks["recording"][0]), int(tracks["lane"][0])
    where = f"Window {window}, lane {lane}: one line a vehicle"
    shown = "the minute and lane in which most findings show" if marks.height else "no fault has a place here"
    return _picture(style.figure_of(figures.faulty_tracks(tracks, marks)), f"{where}; {shown}.")


def _timelines(diagnosis: RoadDiagnosis) -> Iterator[Picture]:
    table = diagnosis.pictures["timeline"]
    for name in table["recording"].unique().sort():
        own = table.filter(pl.col("recording") == name)
        yield _picture(
            figures.timeline(own),
            f"Window {name}: vehicles seen at a time, and when faults were found; larger dots are more of them.",
        )


def _distributions(diagnosis: RoadDiagnosis) -> Iterator[Picture]:
    for quantity, label in LABELS.items():
        own = [one for one in diagnosis.distributions if one.quantity == quantity]
        if own:
            limits = list(own[0].beyond)
            ax = figures.distribution([(one.stage, one.histogram) for one in own], label=label, limits=limits)
            beyond = "; ".join(
                f"beyond {limit:g} {own[0].unit}: "
                + ", ".join(f"{_percent(one.beyond[limit])} {one.stage}" for one in own)
                for limit in limits
            )
            yield _picture(style.figure_of(ax), f"{quantity.capitalize()}. {beyond[0].upper()}{beyond[1:]}.")


def _lateral(diagnosis: RoadDiagnosis) -> Picture | None:
    if not diagnosis.pictures["lateral"].height:
        return None
    ax = figures.lateral_positions(diagnosis.pictures["lateral"], diagnosis.pictures["lanes"])
    return _picture(style.figure_of(ax), "Where the vehicles of each lane drive (blue), and the site's centres (red).")


def _picture(figure: Figure, caption: str) -> Picture:
    width, height = (round(96 * size) for size in figure.get_size_inches())
    uri = f"data:image/svg+xml;base64,{base64.b64encode(style.svg_of(figure)).decode('ascii')}"
    return Picture(uri, width, height, caption)
