"""The page about one ramp and some minutes, its slides, and its numbers as csv."""

import base64
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import jinja2
import matplotlib as mpl
import polars as pl
from matplotlib.figure import Figure

from rampcast.doctor import Severity, examine
from rampcast.errors import RampcastError
from rampcast.files import write_outputs, write_whole
from rampcast.plots import style
from rampcast.recording import Recording, concatenate
from rampcast.recording import columns as c
from rampcast.report import measures, pictures

PAGE: Final = "report.html"
SLIDES: Final = ("slide-forecast.png", "slide-merges.png", "slide-trust.png")
NUMBERS: Final = ("errors.csv", "merges.csv", "tight.csv", "reliability.csv")
READ: Final = ("forecast", "lane_change", "conflicts")
DOTS: Final = 150  # to an inch: 1920 x 1080
MOST: Final = 5  # rows of a short list


@dataclass(frozen=True)
class About:
    """What the page says of itself.

    Attributes:
        model: what forecast, in words.
        trained_here: whether that was trained on this road.
        version: of rampcast.
        more: other pages to go on with: their places from this one, by title.
    """

    model: str
    trained_here: bool
    version: str
    more: Mapping[str, str] = field(default_factory=dict)


def report_on(recordings: Sequence[Recording], folder: Path, about: About) -> Path | None:
    """Writes the report on forecasts that were written into a folder, beside them; returns the page, None of none.

    Args:
        recordings: that were forecast; of several places those of the first are told.
        folder: with forecast.parquet and what is beside it.
        about: what the page says of itself.

    Raises:
        OutputError: as `write_report`.
    """
    of_one = [one for one in recordings if one.site == recordings[0].site]
    names = [name for one in of_one for name in one.names]
    whole = pl.col("horizon").round(1) == pl.col("horizon").round(0)
    scans = {
        name: pl.scan_parquet(folder / f"{name}.parquet") for name in READ if (folder / f"{name}.parquet").is_file()
    }
    scans["forecast"] = scans["forecast"].filter(whole & pl.col("x_q50").is_not_null())
    tables = {name: scan.filter(pl.col("recording").is_in(names)).collect() for name, scan in scans.items()}
    if not tables["forecast"].height:
        return None
    recording = of_one[0] if len(of_one) == 1 else concatenate(of_one)
    return write_report(recording, tables, folder, about)


def write_picture(
    picture: str, forecast: Path, recording: Recording, out: Path, *, vehicle: str | None, t0: float | None
) -> None:
    """Writes one of the report's pictures as a png.

    Args:
        picture: "fan", "merges" or "trust".
        forecast: the file forecast.parquet.
        recording: that was forecast.
        out: file to write.
        vehicle: of a fan; None for a typical one.
        t0: moment of a fan [s]; None for a typical one.

    Raises:
        RampcastError: the file is not there or none of the forecasts asked for.
    """
    if not forecast.is_file():
        raise RampcastError(f"{forecast}: there is no such file; `rampcast forecast` writes forecast.parquet")
    whole = pl.col("horizon").round(1) == pl.col("horizon").round(0)
    positions = pl.scan_parquet(forecast).filter(whole & pl.col("x_q50").is_not_null()).collect()
    asked = positions.filter(
        pl.lit(True) if vehicle is None else pl.col("vehicle").cast(pl.String) == vehicle,
        pl.lit(True) if t0 is None else (pl.col("t0") - t0).abs() < measures.SAME_TIME,
    )
    truth = measures.with_truth(asked if picture == "fan" else positions, recording)
    if not truth.height:
        raise RampcastError(
            f"{forecast}: no forecast of vehicle {vehicle} at {t0} s (None: any) that was seen afterwards"
        )
    drawing = {
        "fan": lambda figure: pictures.draw_fan(figure, *_typical(asked, truth), recording),
        "merges": lambda figure: pictures.draw_merges(figure, measures.merges(recording), recording.site),
        "trust": lambda figure: pictures.draw_trust(figure, measures.errors(truth), recording.site),
    }
    content = _drawn(drawing[picture])
    with write_whole(out) as partial:
        partial.write_bytes(content)


def _typical(positions: pl.DataFrame, truth: pl.DataFrame) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Returns the forecast of a typical scene and what came."""
    scene = measures.typical_scene(truth) or truth.row(0, named=True)
    of_it = [pl.col(name) == scene[name] for name in measures.SCENE]
    return positions.filter(*of_it).sort("horizon"), truth.filter(*of_it)


def write_report(recording: Recording, tables: dict[str, pl.DataFrame], out: Path, about: About) -> Path:
    """Writes report.html, three slides and four csv files into a folder; returns the page.

    Args:
        recording: that was forecast.
        tables: of its forecast: forecast, and maybe lane_change and conflicts.
        out: folder to write to.
        about: what the page says of itself.

    Raises:
        OutputError: a file of such a name is there that is not of an earlier run.
    """
    truth = measures.with_truth(tables["forecast"], recording)
    found = {
        "errors": measures.errors(truth),
        "merges": measures.merges(recording),
        "tight": measures.tight_places(tables["conflicts"], truth) if "conflicts" in tables else pl.DataFrame(),
        "reliability": measures.reliability(tables["lane_change"], truth, recording),
    }
    slides = _slides(recording, tables["forecast"], truth, found)
    values = _values(recording, found) | _uris(slides)
    page = _environment().get_template("page.html.j2").render(values | {"about": about})
    with write_outputs(out) as new:
        (new / PAGE).write_text(page, encoding="utf-8")
        for name, picture in slides.items():
            (new / name).write_bytes(picture)
        for name in NUMBERS:
            found[name.removesuffix(".csv")].write_csv(new / name, float_precision=4)
    return out / PAGE


def _slides(
    recording: Recording, positions: pl.DataFrame, truth: pl.DataFrame, found: dict[str, pl.DataFrame]
) -> dict[str, bytes]:
    """Returns the slides as png, by name."""
    scene = measures.typical_scene(truth)
    drawn = {
        SLIDES[1]: _drawn(lambda figure: pictures.draw_merges(figure, found["merges"], recording.site)),
        SLIDES[2]: _drawn(lambda figure: pictures.draw_trust(figure, found["errors"], recording.site)),
    }
    if scene:
        of_it = [pl.col(name) == scene[name] for name in measures.SCENE]
        forecast, seen = positions.filter(*of_it).sort("horizon"), truth.filter(*of_it)
        drawn[SLIDES[0]] = _drawn(lambda figure: pictures.draw_fan(figure, forecast, seen, recording))
    return drawn


@style.styled
def _drawn(draw: Callable[[Figure], None]) -> bytes:
    with mpl.rc_context(pictures.TYPE):
        figure = pictures.slide()
        draw(figure)
        content = io.BytesIO()
        figure.savefig(content, format="png", dpi=DOTS)
    return content.getvalue()


def _uris(slides: dict[str, bytes]) -> dict[str, str]:
    """Returns the slides as the page holds them."""
    names = dict(zip(SLIDES, ("fan", "merging", "trust"), strict=True))
    return {names[name]: f"data:image/png;base64,{base64.b64encode(png).decode()}" for name, png in slides.items()}


def _environment() -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.PackageLoader("rampcast.report", ""), autoescape=True, undefined=jinja2.StrictUndefined,
        trim_blocks=True,
    )  # fmt: skip


def _values(recording: Recording, found: dict[str, pl.DataFrame]) -> dict[str, Any]:
    """Returns what the page says in words and tables."""
    tracks, merges = recording.tracks, found["merges"]
    windows = tracks.group_by(c.RECORDING).agg(frames=pl.col(c.FRAME).max() - pl.col(c.FRAME).min())
    minutes = float(windows["frames"].sum()) * recording.time_step / 60
    return _verdict(recording) | {
        "site": recording.site,
        "fan": "",
        "minutes": f"{minutes:.1f}",
        "vehicles": f"{tracks.select(c.RECORDING, c.VEHICLE).n_unique():,}",
        "lanes": len(recording.site.lanes),
        "length": f"{recording.site.length:.0f}",
        "merged": merges.height,
        **_merging(merges),
        "tight": _tight(found["tight"]),
        "errors": _errors(found["errors"]),
        "reliability": _reliability(found["reliability"]),
        "n": f"{max(found['errors'].filter(situation='all')['n'].to_list(), default=0):,}",
    }


def _verdict(recording: Recording) -> dict[str, Any]:
    """Returns whether the recording is good enough, in words, and what the doctor found."""
    findings = examine(recording).findings
    spoilt = [one for one in findings if one.severity is Severity.SPOILS]
    worse = [one for one in findings if one.severity is not Severity.NOTE][:MOST]
    verdict = (
        "It is not good enough as it is: what follows may be wrong. See `rampcast doctor`."
        if spoilt
        else "It is good enough to forecast from."
    )
    listed = [f"{one.check.title}: {one.check.counting(one.count)}. {one.check.advice}" for one in worse]
    return {"spoilt": bool(spoilt), "verdict": verdict, "findings": listed}


def _merging(merges: pl.DataFrame) -> dict[str, str]:
    places = [merges["x"].quantile(share) or 0.0 for share in (0.25, 0.75)]
    gap = (merges["gap_ahead"] + merges["gap_behind"]).median()
    shown = f"{gap:.0f} m" if isinstance(gap, float) else "not known"
    return {"quarter": f"{places[0]:.0f}", "three_quarters": f"{places[1]:.0f}", "gap": shown}


def _tight(table: pl.DataFrame) -> list[dict[str, str]]:
    if not table.height:
        return []
    worst = table.filter((pl.col("n") >= MOST) & (pl.col("probability") > 0)).sort("probability", descending=True)
    return [
        {
            "x": f"{row['x']:.0f} to {row['x'] + measures.CELL:.0f} m",
            "minute": str(row["minute"]),
            "chance": f"{row['probability']:.0%}",
            "n": f"{row['n']:,}",
        }
        for row in worst.head(MOST).iter_rows(named=True)
    ]


def _errors(table: pl.DataFrame) -> list[dict[str, str]]:
    """Returns rows of all situations at `SHOWN` horizons, then of each at those that matter most."""
    rows = []
    for situation in ("all", *pictures.SITUATIONS):
        of_it = table.filter(pl.col("situation") == situation)
        for horizon in measures.SHOWN if situation == "all" else measures.SHOWN_OF_EACH:
            for one in of_it.filter((pl.col("horizon") - horizon).abs() < measures.SAME_TIME).iter_rows(named=True):
                rows.append(
                    {"situation": situation, "horizon": f"{horizon:g}", "n": f"{one['n']:,}"}
                    | {name: f"{one[name]:.1f}" for name in ("mean_error", "crps", "width_90")}
                    | {name: f"{one[name]:.0%}" for name in ("inside_50", "inside_90")}
                )
    return rows


def _reliability(table: pl.DataFrame) -> list[dict[str, str]]:
    return [
        {
            "t": f"{row['t']:g} s",
            "forecast": f"{row['forecast']:.0%}",
            "merged": f"{row['merged']:.0%}",
            "n": f"{row['n']:,}",
        }
        for row in table.iter_rows(named=True)
    ]
