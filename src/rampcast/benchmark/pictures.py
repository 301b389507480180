"""The pictures of a run of the benchmark, drawn from the tables that it wrote."""

import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from rampcast.benchmark.figures import (
    LEAST,
    band_coverage,
    cases_of,
    data_set_label,
    error_over_horizon,
    reliability_of_merges,
    reliability_of_places,
)
from rampcast.benchmark.reliability import merge_reliability, shares_below, typical_case, typical_merges, with_merges
from rampcast.errors import RampcastError
from rampcast.files import write_outputs
from rampcast.plots import style
from rampcast.plots.forecast_pictures import forecast_fan, merge_densities
from rampcast.plots.panels import Draw, panels

OWN = "rampcast"
PLACES_AT = (5.0, 10.0, 15.0)  # [s]
MERGES_AT = (3, 5, 10)  # [s]
FAN_MODELS = (OWN, "constant_velocity")
LEAST_MERGES = 100  # cases; of fewer a reliability diagram shows nothing
DOTS = 120  # per inch: a panel is 480 px wide
SQUARE, STRIP_HEIGHT, FAN = 3.0, 3.6, 2.6  # [inch] of the axes of reliability diagrams, of those with cases below
Tables = Mapping[str, pl.DataFrame]


def write_benchmark_pictures(out: Path) -> list[Path]:
    """Writes the pictures of a run as png and svg beside its tables, each whole or not, and returns them.

    Args:
        out: the folder that `rampcast benchmark` wrote.

    Raises:
        RampcastError: the folder has no table of scores.
    """
    return save_pictures(benchmark_pictures(read_benchmark(out)), Path(out))


def read_benchmark(out: Path) -> dict[str, pl.DataFrame]:
    """Returns the tables scores, cases and merge_cases of a run; those that have no rows are left out.

    Raises:
        RampcastError: there is no table of scores.
    """
    tables = {}
    for name in ("scores", "cases", "merge_cases"):
        path = Path(out) / f"{name}.parquet"
        if path.is_file():
            table = pl.read_parquet(path)
            if table.height:
                tables[name] = table
    if "scores" not in tables:
        raise RampcastError(f"{out} has no scores.parquet with rows: give the folder that `rampcast benchmark` wrote")
    return tables


def benchmark_pictures(tables: Tables) -> dict[str, Figure]:
    """Returns the pictures by name; what the tables do not hold is not drawn.

    Args:
        tables: see `read_benchmark`.
    """
    scores = tables["scores"].filter(pl.col("depth") == 0)
    pictures = {"error_over_horizon": _errors(scores)}
    own = scores.filter(pl.col("model") == OWN)
    if own.height:
        pictures["band_coverage"] = style.figure_of(band_coverage(own))
        pictures["reliability_of_places"] = _places(own)
    if "cases" in tables:
        pictures["typical_forecasts"] = _fans(tables["cases"], tables.get("merge_cases"))
    for name, rows in _by_data_set(tables.get("merge_cases", pl.DataFrame())):
        if rows["event_time"].is_not_null().sum() and rows["case"].n_unique() >= LEAST_MERGES:
            pictures[f"reliability_of_merges_{name}"] = _merges(rows)
            pictures[f"merge_densities_{name}"] = style.figure_of(merge_densities(typical_merges(rows)))
    return pictures


def save_pictures(pictures: Mapping[str, Figure], folder: Path, *, kinds: Sequence[str] = ("png", "svg")) -> list[Path]:
    """Writes pictures to a folder, all or none, and returns the files. All are drawn before the first is written."""
    writers = {"png": _png, "svg": style.svg_of}
    with mpl.rc_context(style.RC):
        drawn = {f"{name}.{kind}": writers[kind](figure) for name, figure in pictures.items() for kind in kinds}
    with write_outputs(Path(folder)) as new:
        for name, content in drawn.items():
            (new / name).write_bytes(content)
    return [Path(folder) / name for name in drawn]


def _png(figure: Figure) -> bytes:
    """Returns a picture of 256 colours, which takes a third of the room."""
    buffer, small = io.BytesIO(), io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DOTS)
    with Image.open(buffer) as picture:
        picture.convert("RGB").quantize(method=Image.Quantize.MAXCOVERAGE).save(small, "PNG", optimize=True)
    return small.getvalue()


def _errors(scores: pl.DataFrame) -> Figure:
    draws: list[tuple[str, Draw]] = []
    for name, rows in _by_data_set(scores):
        seen = rows.filter((pl.col("model") == OWN) & (pl.col("n") >= LEAST))
        if seen.height:
            draws.append((f"{data_set_label(name)} ({cases_of(seen)})", _on(error_over_horizon, rows)))
    return panels(draws)


def _places(own: pl.DataFrame) -> Figure:
    shares = shares_below(own.filter(pl.col("n") >= LEAST))
    draws: list[tuple[str, Draw]] = []
    for horizon in PLACES_AT:
        if (shares["horizon"] == horizon).any():
            draws.append((f"after {horizon:.0f} s", _on(reliability_of_places, shares, horizon=horizon)))
    return panels(draws, height=SQUARE)


def _merges(merge_cases: pl.DataFrame) -> Figure:
    bins = merge_reliability(merge_cases)
    draws: list[tuple[str, Draw]] = []
    for second in MERGES_AT:
        rows = bins.filter(pl.col("t") == second)
        if rows.height:
            draws.append((f"within {second} s", _on(reliability_of_merges, rows)))
    return panels(draws, height=STRIP_HEIGHT)


def _fans(cases: pl.DataFrame, merge_cases: pl.DataFrame | None) -> Figure:
    shown = cases.filter(pl.col("model").is_in(FAN_MODELS))
    draws: list[tuple[str, Draw]] = []
    for name, rows in _by_data_set(shown):
        case = typical_case(rows)
        if case.height:
            case = case if merge_cases is None else with_merges(case, merge_cases)
            draws.append((f"{data_set_label(name)}, {case['case'][0]}", _on(forecast_fan, case)))
    return panels(draws, height=FAN)


def _on(draw: Callable[..., Axes], table: pl.DataFrame, **options: float) -> Draw:
    return lambda ax: draw(table, ax=ax, **options)


def _by_data_set(table: pl.DataFrame) -> list[tuple[str, pl.DataFrame]]:
    """Returns the rows of each data set, in the order in which they come."""
    if table.is_empty():
        return []
    names = table["data_set"].unique(maintain_order=True).to_list()
    return [(name, table.filter(pl.col("data_set") == name)) for name in names]
