"""The report's figures in the paper's order and numbers, then ours: what each panel draws and what its caption says."""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import polars as pl
from matplotlib.axes import Axes

from rampcast.paper.report import lane_change, longitudinal
from rampcast.paper.report.claims import main_reading
from rampcast.paper.report.tables import modes_of
from rampcast.plots import tracks
from rampcast.plots.site_geometry import site_geometry
from rampcast.plots.style import MODE_TITLES
from rampcast.sites import Site

SHOWN_MODELS = ("rampcast", "idm", "gipps_paper", "ghr")  # the paper's three laws, and ours beside them
OF_FORESTS = pl.col("model") == "forests"
FEW = 30  # below so many cases a share moves by 3 points or more with one case: the caption warns
SHOCK_CAPTION = (
    "Of the vehicles that met a wave, the ones that the forecast put furthest too far downstream (a) and too short (b) "
    "after 15 s. A wave that the six neighbours do not show by t = 0 cannot be foreseen from them."
)
GOOD_CAPTION = (
    "Of the vehicles that were forecast well throughout, the two whose neighbours were predicted worst: their "
    "errors can cancel in the actual leader, which is a mean of two of them."
)
LEAVING = (
    "Neighbours that drive away, and forecasts to where nobody of the scene was, leave the picture at its upper or "
    "lower edge."
)
NEVER = 0.005  # a true positive rate below is 0 % in whole percents
Tables = Mapping[str, pl.DataFrame]
Draw = Callable[..., Axes]


@dataclass(frozen=True)
class Panel:
    """One picture: the end of its file name, its title, how to draw it, and whose vertical range it shares."""

    name: str
    title: str
    draw: Callable[[], Axes]
    share: str | None = None


@dataclass(frozen=True)
class FigureEntry:
    """A numbered figure: its panels, its caption, and what could not be drawn and why.

    One that is the same in every report has the name of a file in the folder `drawings` instead of panels.
    """

    number: str
    title: str
    caption: str
    panels: tuple[Panel, ...] = ()
    missing: tuple[str, ...] = ()
    drawing: str = ""


def setting_figures(site: Site) -> Iterator[FigureEntry]:
    """Yields Figures 1 to 5, which need no results."""
    yield FigureEntry(
        "1",
        "A central vehicle and its neighbours",
        "The vehicle whose future is asked for (i), its leader and follower on the ramp (l, f), two leaders and two "
        "followers in the target lane (l1, l2, f1, f2), and the actual leader (m) that the car-following law obeys: "
        "half-way between l and the nearest target-lane vehicle ahead, or that vehicle alone once l has passed the "
        "ramp's end.",
        drawing="neighbours.svg",
    )
    yield FigureEntry(
        "2",
        "The framework",
        "From 4 s of observation (blue) two networks predict the neighbours (yellow); a law fitted to the driver is "
        "rolled out behind the actual leader for 15 s; apart from that, forests tell whether and when the lane "
        "change comes (green).",
        drawing="framework.svg",
    )
    yield FigureEntry(
        "3",
        "One cell of an LSTM",
        "Three gates (σ) decide what the cell state forgets, takes in, and shows. The neighbour models stack two "
        "encoding and two decoding layers of 100 such cells.",
        drawing="lstm_cell.svg",
    )
    yield FigureEntry(
        "4",
        "How a random forest decides",
        "One input walks down every tree (orange); the trees are of different depth; the share of leaves that say "
        "yes is the forest's probability of a lane change.",
        drawing="forest.svg",
    )
    yield _site_figure(site)


def _site_figure(site: Site) -> FigureEntry:
    end = "the ramp lane goes on" if site.ramp_goes_on else f"ramp end at {site.ramp_end:.0f} m"
    return FigureEntry(
        "5",
        f"The site: {site.title}",
        f"Drawn from the site file, to scale on each axis but not between them: {len(site.lanes)} lanes on "
        f"{site.length:.0f} m, gore at {site.gore:.0f} m, {end}, speed limit "
        f"{site.speed_limit:.1f} m/s. The line between ramp and target lane is solid where it may not be crossed. "
        "Lanes beside the ramp are schematic.",
        (Panel("5", "", partial(site_geometry, site)),),
    )


def neighbour_figure(tables: Tables) -> FigureEntry:
    """Returns Figure 6: the neighbour model."""
    rows, missing = _rows(tables, "longitudinal", (pl.col("group") != "central") & (pl.col("model") == "lstm"))
    draws: dict[str, tuple[str, Draw]] = {
        "a": ("within 5 m and 10 m", longitudinal.neighbour_accuracy),
        "b": ("mean absolute error", longitudinal.neighbour_error),
    }
    return FigureEntry(
        "6",
        "Neighbours predicted by the LSTMs",
        f"Left, how many predictions are near enough; right, how far off they are on average. {_counts(rows)} Read "
        "how soon the curves leave 100 %: the roll-out of the central vehicle inherits these errors through its "
        "leader.",
        _panels("6", rows, draws),
        missing,
    )


def forecast_figure(tables: Tables) -> FigureEntry:
    """Returns Figure 7: the central vehicle by the paper's three laws, and by rampcast in corrected mode."""
    chosen = (pl.col("group") == "central") & pl.col("model").is_in(SHOWN_MODELS)
    rows, missing = _rows(tables, "longitudinal", chosen)
    draws: dict[str, tuple[str, Draw]] = {
        "a": ("within 5 m and 10 m", longitudinal.forecast_accuracy),
        "b": ("mean absolute error", longitudinal.forecast_error),
    }
    return FigureEntry(
        "7",
        "Forecast of the central vehicle by three car-following laws, and by rampcast",
        f"Left, share of the forecasts within 5 m (filled, solid) and 10 m (open, dashed); right, mean absolute error. "
        "In corrected mode the median of rampcast, which drives all vehicles around into the future together, stands "
        f"beside the laws. {_counts(rows)} The paper reads off 5 s and 8 s as the times until which 90 % lie within "
        "5 m and 10 m.",
        _panels("7", rows, draws),
        missing,
    )


def scene_figures(tables: Tables, site: Site) -> Iterator[FigureEntry]:
    """Yields Figures 8 and 9: single scenes."""
    texts = (
        ("8", "shock", "Two scenes with a shock wave", SHOCK_CAPTION),
        ("9", "good", "Two good forecasts from poor predictions", GOOD_CAPTION),
    )
    for number, name, title, text in texts:
        panels: list[Panel] = []
        found: list[tuple[str, str, str]] = []
        missing: list[str] = []
        for letter, example in (("a", f"{name}_1"), ("b", f"{name}_2")):
            rows, absent = _rows(tables, "examples", pl.col("example") == example)
            missing += [f"({letter}) {why}" for why in absent]
            for mode in modes_of(rows):
                own = rows.filter(pl.col("mode") == mode)
                draw = partial(tracks.scene_tracks, own, ramp_end=site.ramp_end)
                heading = f"({letter}) {MODE_TITLES.get(mode, mode)}"
                panels.append(Panel(f"{number}{letter}-{mode}", heading, draw))
                if "title" in own.columns:
                    found.append((letter, mode, str(own["title"][0])))
        panels.sort(key=lambda panel: panel.name.partition("-")[2], reverse=True)
        caption = f"{text} {_scene_names(found)} Letters as in Figure 1. {LEAVING}"
        yield FigureEntry(number, title, caption, tuple(panels), tuple(missing))


def _scene_names(found: Sequence[tuple[str, str, str]]) -> str:
    texts = []
    for letter in sorted({letter for letter, _, _ in found}):
        titles = {mode: title for own, mode, title in found if own == letter}
        if len(set(titles.values())) == 1:
            texts.append(f"({letter}) {next(iter(titles.values()))}")
        else:
            texts += [f"({letter}, {MODE_TITLES.get(mode, mode)}) {title}" for mode, title in titles.items()]
    return f"Each panel is one scene: {'; '.join(texts)}." if texts else "No such scene was found."


def classification_figure(tables: Tables) -> FigureEntry:
    """Returns Figure 10: the quality of the forests on balanced samples."""
    rows, missing = _rows(tables, "lane_change", OF_FORESTS & (pl.col("sampling") == "balanced"))
    panels, silent = _readings("10", rows, main=True)
    for mode, (letter, kind) in itertools.product(modes_of(rows), (("a", "within"), ("b", "at"))):
        if rows.filter(mode=mode, kind=kind).is_empty():
            missing = (*missing, f"({letter}) no rows of kind '{kind}' for {MODE_TITLES.get(mode, mode)}")
    return FigureEntry(
        "10",
        "Lane-change classification by the random forests",
        "Left, lane change within t; right, at t, on samples with about as many lane changes as others. "
        f"{_counts(rows)} Paper mode dates lane changes by the lane label, corrected mode by the crossing of the line. "
        "Read accuracy against 50 %, which a coin reaches; Figure A5 has the natural rate of lane changes.",
        panels,
        missing + silent,
    )


def importance_figure(tables: Tables) -> FigureEntry:
    """Returns Figure 11: what the forests look at."""
    rows, missing = _rows(tables, "importance", pl.lit(value=True))
    panels = []
    cases = (("a", "within", "feature"), ("b", "within", "vehicle"), ("c", "at", "feature"), ("d", "at", "vehicle"))
    for mode in modes_of(rows):
        for letter, kind, grouping in cases:
            chosen = (pl.col("mode") == mode) & (pl.col("kind") == kind) & (pl.col("grouping") == grouping)
            own = rows.filter(chosen)
            title = f"({letter}) {kind} t, by {grouping}, {MODE_TITLES.get(mode, mode)}"
            if own.is_empty():
                missing = (*missing, f"({letter}) no rows for {MODE_TITLES.get(mode, mode)}")
            else:
                draw = partial(lane_change.feature_importance, own)
                panels.append(Panel(f"11{letter}-{mode}", title, draw, grouping))
    return FigureEntry(
        "11",
        "What the forests look at",
        "Share of the importance per kind of feature (left) and per group of vehicles (right), for lane changes "
        "within t (a, b) and at t (c, d); each set sums to 100 %. The target lane has four of the seven vehicles and "
        "the ramp two: by number of features alone they would hold 57 % and 29 %.",
        tuple(panels),
        missing,
    )


def own_figures(tables: Tables) -> Iterator[FigureEntry]:
    """Yields the figures that the paper does not have."""
    central, missing = _rows(tables, "longitudinal", pl.col("group") == "central")
    draws: dict[str, tuple[str, Draw]] = {
        "a": ("within 5 m", longitudinal.forecast_within),
        "b": ("within 10 m", partial(longitudinal.forecast_within, tolerance="within_10")),
        "c": ("mean absolute error", longitudinal.forecast_error),
        "d": ("bias", longitudinal.forecast_bias),
    }
    yield FigureEntry(
        "A1",
        "Every model and baseline on the central vehicle",
        f"The laws of Figure 7, the law of Gipps (1981), the LSTM alone, and baselines. {_counts(central)} A model "
        "that does not beat constant velocity has learnt nothing; a bias above 0 m means forecasts too far "
        "downstream.",
        _panels("A1", central, draws),
        missing,
    )
    yield _neighbour_baselines(tables)
    rows, missing = _rows(tables, "longitudinal", pl.lit(value=True))
    yield FigureEntry(
        "A3",
        "How many forecasts each second is scored on",
        f"{_counts(rows)} Tracks end, so later seconds are scored on fewer and on slower vehicles.",
        _panels("A3", rows, {"": ("", longitudinal.scenes_per_horizon)}),
        missing,
    )
    yield from _own_lane_change_figures(tables)


def _neighbour_baselines(tables: Tables) -> FigureEntry:
    panels = []
    rows, missing = _rows(tables, "longitudinal", pl.col("group") != "central")
    for mode in modes_of(rows):
        for letter, group in (("a", "ramp_neighbour"), ("b", "target_neighbour")):
            own = rows.filter((pl.col("mode") == mode) & (pl.col("group") == group))
            if own.height:
                title = f"({letter}) {longitudinal.GROUP_LABELS[group]}, {MODE_TITLES.get(mode, mode)}"
                panels.append(Panel(f"A2{letter}-{mode}", title, partial(longitudinal.forecast_error, own), "error"))
    caption = f"Mean absolute error of the LSTMs beside the baselines on the same vehicles. {_counts(rows)}"
    return FigureEntry("A2", "Neighbours: LSTM and baselines", caption, tuple(panels), missing)


def _own_lane_change_figures(tables: Tables) -> Iterator[FigureEntry]:
    natural, missing = _rows(tables, "lane_change", pl.col("sampling") == "natural")
    panels, silent = _readings("A5", natural, main=True)
    yield FigureEntry(
        "A4",
        "How rare lane changes are",
        "Share of the samples that are lane changes: all samples (orange) and the paper's balanced ones (blue).",
        tuple(_base_rates("A4", _rows(tables, "lane_change", OF_FORESTS)[0])),
        missing,
    )
    yield FigureEntry(
        "A5",
        "Lane-change classification at the natural base rate",
        f"As Figure 10, on all samples, and rampcast beside the forests. {_counts(natural)} Where lane changes are "
        "rare the positive predictive value says how far a yes can be trusted; accuracy says little, since a plain no "
        "is nearly always right.",
        panels,
        missing + silent,
    )
    both, missing = _rows(tables, "lane_change", OF_FORESTS)
    others, silent = _readings("A6", both, main=False)
    if others or silent:
        yield FigureEntry(
            "A6",
            "The other reading of a lane change",
            "As Figures 10 and A5, lane changes dated the other way. The distance to those figures is what the label's "
            "jump at the end of the ramp lane is worth (erratum 7). n is in Table A5.",
            others,
            missing + silent,
        )


def _readings(number: str, rows: pl.DataFrame, *, main: bool) -> tuple[tuple[Panel, ...], tuple[str, ...]]:
    """Returns the panels of a figure, and of those that would be flat lines what they would show."""
    panels, silent = [], []
    for mode in modes_of(rows):
        own = rows.filter(pl.col("mode") == mode)
        first = main_reading(own)
        models, readings, samplings = (own[name].unique().sort().to_list() for name in ("model", "reading", "sampling"))
        chosen = [reading for reading in readings if (reading == first) == main]
        for reading, sampling, model in itertools.product(chosen, samplings, models):
            for letter, kind in (("a", "within"), ("b", "at")):
                part = own.filter(reading=reading, kind=kind, sampling=sampling, model=model)
                if part.is_empty():
                    continue
                panel = _metrics_panel(number, letter, part, mode, main=main)
                if _never_says_yes(part):
                    silent.append(f"{panel.title}: {_silence(part)}")
                else:
                    panels.append(panel)
    return tuple(panels), tuple(silent)


def _never_says_yes(part: pl.DataFrame) -> bool:
    rate = part["tpr"].cast(pl.Float64).drop_nulls().drop_nans() if "tpr" in part.columns else pl.Series([])
    return len(rate) > 0 and bool((rate < NEVER).all())


def _silence(part: pl.DataFrame) -> str:
    """Returns what the flat lines of a model that never says yes would show."""
    right = part["accuracy"].cast(pl.Float64).drop_nulls().drop_nans()
    low, high = (f"{100 * float(one):.0f}" for one in (right.min(), right.max()))  # type: ignore[arg-type]
    of = f"{low} %" if low == high else f"{low} to {high} %"
    return (
        "at no t is a lane change held for likelier than not, so the true positive rate is 0 % and the true negative "
        f"rate 100 % throughout; accuracy, {of}, is the share of samples without a lane change"
    )


def _metrics_panel(number: str, letter: str, part: pl.DataFrame, mode: str, *, main: bool) -> Panel:
    kind, reading, sampling, model = (part[name][0] for name in ("kind", "reading", "sampling", "model"))
    title = f"({letter}) {kind} t, {MODE_TITLES.get(mode, mode)}, by {reading}"
    name = f"{number}{letter}-{mode}"
    if model != "forests":
        title, name = f"{title}, {model}", f"{name}-{model}"
    if not main:
        title, name = f"{title}, {sampling}", f"{name}-{reading}-{sampling}"
    return Panel(name, title, partial(lane_change.lane_change_metrics, part), sampling)


def _base_rates(number: str, rows: pl.DataFrame) -> Iterator[Panel]:
    for mode in modes_of(rows):
        for reading in rows.filter(pl.col("mode") == mode)["reading"].unique().sort().to_list():
            own = rows.filter((pl.col("mode") == mode) & (pl.col("reading") == reading))
            title = f"{MODE_TITLES.get(mode, mode)}, dated by {reading}"
            yield Panel(f"{number}-{mode}-{reading}", title, partial(lane_change.base_rate, own), "rate")


def _rows(tables: Tables, name: str, chosen: pl.Expr) -> tuple[pl.DataFrame, tuple[str, ...]]:
    """Returns the rows of a table that a figure needs, and what is missing."""
    if name not in tables:
        return pl.DataFrame(schema={"mode": pl.String, "n": pl.Int64}), (f"there is no table '{name}'",)
    rows = tables[name].filter(chosen)
    known = modes_of(pl.concat([table.select(pl.col("mode").cast(pl.String)) for table in tables.values()]))
    absent = [mode for mode in known if mode not in rows["mode"].unique().to_list()]
    return rows, tuple(f"the table '{name}' has no such rows for {MODE_TITLES.get(mode, mode)}" for mode in absent)


def _panels(number: str, rows: pl.DataFrame, draws: Mapping[str, tuple[str, Draw]]) -> tuple[Panel, ...]:
    panels = []
    for mode in modes_of(rows):
        own = rows.filter(pl.col("mode") == mode)
        for letter, (text, draw) in draws.items():
            parts = [text, MODE_TITLES.get(mode, mode)]
            title = f"({letter}) {', '.join(parts)}" if letter else parts[-1]
            panels.append(Panel(f"{number}{letter}-{mode}", title, partial(draw, own), letter))
    return tuple(panels)


def _counts(rows: pl.DataFrame) -> str:
    """Returns a sentence on the number of cases behind a figure, with a warning where it is small."""
    parts: list[str] = []
    smallest: Sequence[int] = ()
    for mode in modes_of(rows):
        counts = rows.filter(pl.col("mode") == mode)["n"].drop_nulls().to_list()
        if counts:
            low, high = min(counts), max(counts)
            smallest = (*smallest, low)
            parts.append(f"{MODE_TITLES.get(mode, mode)}: n = {low:,}" + (f" to {high:,}" if high > low else ""))
    if not parts:
        return "No cases."
    warning = f" Fewer than {FEW} cases at some times: read those with care." if min(smallest) < FEW else ""
    text = "; ".join(parts)
    return f"{text[0].upper()}{text[1:]}.{warning}"
