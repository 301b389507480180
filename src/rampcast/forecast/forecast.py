"""What is forecast of all vehicles of one moment: samples of the whole traffic, and what is counted in them."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int, Shaped

from rampcast.errors import MissingExtra, RampcastError
from rampcast.forecast.conflicts import Conflicts, conflicts, shares_by
from rampcast.forecast.forecasts import Forecasts, conflict_columns
from rampcast.forecast.leaders import NOBODY, merge_gaps
from rampcast.forecast.tables import BANDS, moment, share
from rampcast.horizon import STEP
from rampcast.notebook import html_table
from rampcast.sites import Site

SHOWN = 8  # vehicles that an error names


@dataclass(frozen=True, repr=False)
class Forecast:
    """Samples of what becomes of the traffic of one moment; in each of them all vehicles see each other.

    All that is not given is counted in the samples when it is looked at, so that nothing contradicts.

    Attributes:
        site: the geometry.
        t0: the moment [s].
        vehicle: ids, in the order of `Traffic.vehicle`.
        start: front at t0 [m].
        start_lane: lane at t0; `NO_LANE` where it is not known.
        length: [m].
        samples: fronts at 0.2, 0.4 ... 15 s after t0 [m].
        lane: lanes then.
    """

    site: Site
    t0: float
    vehicle: Shaped[np.ndarray, "vehicle"]
    start: Float[np.ndarray, "vehicle"]
    start_lane: Int[np.ndarray, "vehicle"]
    length: Float[np.ndarray, "vehicle"]
    samples: Float[np.ndarray, "vehicle sample step"]
    lane: Int[np.ndarray, "vehicle sample step"]

    def __len__(self) -> int:
        return len(self.vehicle)

    def __repr__(self) -> str:
        _, count, steps = self.samples.shape
        return (
            f"<Forecast of {self.site.name} at {self.t0:.1f} s: {len(self)} vehicles, {count} futures "
            f"of {steps * STEP:g} s>"
        )

    def _repr_html_(self) -> str:
        _, count, steps = self.samples.shape
        likely = self.on_ramp & (self.p_merged[:, -1] >= 0.5)
        rows = {
            "moment": f"{self.t0:.1f} s",
            "vehicles": f"{len(self)}, {self.on_ramp.sum()} of them on the ramp",
            "futures": f"{count} of {steps * STEP:g} s, of all vehicles together",
            f"likely to merge within {steps * STEP:g} s": ", ".join(map(str, self.vehicle[likely])) or "none",
        }
        return html_table(f"Forecast of {self.site.name}", rows)

    def __getitem__(self, vehicle: object) -> "VehicleForecast":
        """Returns what is forecast of one vehicle.

        Raises:
            RampcastError: it is not in the forecast.
        """
        return VehicleForecast(self, int(self.places([vehicle])[0]))

    def places(self, vehicles: Sequence[object] | Shaped[np.ndarray, "asked"]) -> Int[np.ndarray, "asked"]:
        """Returns the places of vehicles in `vehicle`.

        Raises:
            RampcastError: one is not in the forecast.
        """
        known = {one: place for place, one in enumerate(self.vehicle.tolist())}
        missing = [one for one in vehicles if one not in known]
        if missing:
            some = ", ".join(map(str, self.vehicle[:SHOWN])) + (", ..." if len(self) > SHOWN else "")
            raise RampcastError(f"this forecast has no vehicle {missing[0]!s}; it has {len(self)}: {some or 'none'}")
        return np.array([known[one] for one in vehicles], dtype=np.int64)

    @cached_property
    def on_ramp(self) -> Bool[np.ndarray, "vehicle"]:
        """Returns who is in a ramp lane at t0, and so may merge."""
        return self.site.on_ramp(self.start_lane)

    @cached_property
    def speeds(self) -> Float[np.ndarray, "vehicle sample step"]:
        """Returns the speeds over the steps that end at 0.2, 0.4 ... s [m/s]."""
        before = np.broadcast_to(self.start.astype(self.samples.dtype)[:, None, None], (*self.samples.shape[:2], 1))
        return np.diff(self.samples, axis=2, prepend=before) / self.samples.dtype.type(STEP)

    @cached_property
    def _ordered(self) -> Float[np.ndarray, "vehicle sample step"]:
        return np.sort(self.samples, axis=1)

    def quantiles(
        self, levels: Sequence[float] | Float[np.ndarray, "level"]
    ) -> Float[np.ndarray, "vehicle step level"]:
        """Returns the fronts that are not exceeded with those probabilities [m].

        Of n samples the k-th smallest is the quantile at k / (n + 1), which one more sample would not exceed with
        just that probability; in between it is linear, and beyond the first and the last constant.

        Source: Hyndman and Fan 1996, "Sample quantiles in statistical packages", definition 6.

        Args:
            levels: above 0 and below 1, in any order.

        Raises:
            RampcastError: a level is not.
        """
        asked = _checked_levels(levels)
        count = self.samples.shape[1]
        place = np.clip(asked * (count + 1) - 1.0, 0.0, count - 1.0)
        low = np.floor(place).astype(np.int64)
        below, above = (self._ordered[:, rows].astype(np.float64) for rows in (low, np.minimum(low + 1, count - 1)))
        return np.moveaxis(below + (place - low)[:, None] * (above - below), 1, 2)

    @cached_property
    def median(self) -> Float[np.ndarray, "vehicle step"]:
        """Returns the fronts that are as likely exceeded as not [m]."""
        return self.quantiles((0.5,))[:, :, 0]

    @cached_property
    def merge_step(self) -> Int[np.ndarray, "vehicle sample"]:
        """Returns the first step in the target lane of those who start in a ramp lane; else the number of steps."""
        found = np.full(self.lane.shape[:2], self.samples.shape[2])
        there = self.lane[self.on_ramp] == self.site.target_lane
        found[self.on_ramp] = np.where(there.any(axis=2), there.argmax(axis=2), self.samples.shape[2])
        return found

    @cached_property
    def p_merged(self) -> Float[np.ndarray, "vehicle step"]:
        """Returns the probability to have merged by 0.2, 0.4 ... s: the share of the samples that have."""
        return shares_by(self.merge_step, self.samples.shape[2])

    @cached_property
    def merge_time(self) -> Float[np.ndarray, "vehicle sample"]:
        """Returns the time from t0 to the merge [s], the middle of its step; infinite where there is none."""
        return np.where(self.merge_step < self.samples.shape[2], STEP * (self.merge_step + 0.5), np.inf)

    def merge_time_quantiles(
        self, levels: Sequence[float] | Float[np.ndarray, "level"]
    ) -> Float[np.ndarray, "vehicle level"]:
        """Returns the times by which it has merged with those probabilities [s]; infinite where not in the forecast.

        Args:
            levels: above 0 and below 1.

        Raises:
            RampcastError: a level is not.
        """
        asked = _checked_levels(levels)
        return np.quantile(self.merge_time, asked, axis=1, method="inverted_cdf").T

    @cached_property
    def merge_place(self) -> Float[np.ndarray, "vehicle sample"]:
        """Returns the front in the step of the merge [m]; NaN where there is none."""
        steps = self.samples.shape[2]
        at = np.minimum(self.merge_step, steps - 1)[:, :, None]
        place = np.take_along_axis(self.samples, at, axis=2)[:, :, 0].astype(np.float64)
        return np.where(self.merge_step < steps, place, np.nan)

    @cached_property
    def gap_sides(self) -> tuple[Int[np.ndarray, "vehicle sample"], ...]:
        """Returns who is ahead and who is behind at the merge, as places in `vehicle`, and the gap's number.

        See `leaders.merge_gaps`.
        """
        return merge_gaps(
            self.samples,
            self.lane,
            start=self.start,
            in_target=self.start_lane == self.site.target_lane,
            merge_step=self.merge_step,
        )

    @cached_property
    def gap(self) -> pl.DataFrame:
        """Returns the probability of each gap that some sample merges into.

        Columns: vehicle, gap, ahead, behind, p. `gap` is 0 beside the vehicle at t0, 1 in front of the target-lane
        vehicle ahead then, -1 behind the one behind; `ahead` and `behind` are the ids of those between whom it merges,
        null where nobody is. What is missing to 1 is the probability not to merge.
        """
        row, sample = np.nonzero(self.merge_step < self.samples.shape[2])
        sides = np.stack([row, *(part[row, sample] for part in self.gap_sides)], axis=1)
        cases, count = np.unique(sides, axis=0, return_counts=True)
        order = np.lexsort((-count, cases[:, 0]))
        row, ahead, behind, number = cases[order].T
        return pl.DataFrame(
            {
                "vehicle": self._ids(row),
                "gap": number,
                "ahead": self._ids(ahead),
                "behind": self._ids(behind),
                "p": count[order] / self.samples.shape[1],
            }
        )

    def _ids(self, places: Int[np.ndarray, "case"]) -> pl.Series:
        """Returns the ids at those places, null for `NOBODY`."""
        return pl.Series(self.vehicle).gather(
            pl.Series([place if place != NOBODY else None for place in places.tolist()], dtype=pl.UInt32)
        )

    @cached_property
    def conflicts(self) -> Conflicts:
        """Returns the probabilities of conflicts with the leader and, after the merge, with the vehicle behind."""
        ahead, behind, _ = self.gap_sides
        return conflicts(
            self.samples,
            self.lane,
            speeds=self.speeds,
            length=self.length,
            merge_step=self.merge_step,
            ahead=ahead,
            behind=behind,
        )

    def reduced(self, rows: Int[np.ndarray, "scene"] | None = None, *, recording: str | None = None) -> Forecasts:
        """Returns what tables tell of some vehicles, without the samples.

        Args:
            rows: their places in `vehicle`; None for all.
            recording: name of the window; None for the site's.
        """
        rows = np.arange(len(self)) if rows is None else rows
        window = recording or self.site.name
        gaps = self.gap.filter(pl.col("vehicle").is_in(self.vehicle[rows].tolist()))
        return Forecasts(
            recording=np.full(len(rows), window),
            vehicle=self.vehicle[rows],
            t0=np.full(len(rows), self.t0),
            start=self.start[rows],
            lane=self.start_lane[rows],
            on_ramp=self.on_ramp[rows],
            quantiles=self.quantiles(tuple(BANDS.values()))[rows].astype(np.float32),
            p_merged=self.p_merged[rows].astype(np.float32),
            p_conflict=conflict_columns(self.conflicts)[rows],
            gaps=gaps.select(
                pl.lit(window).alias("recording"), "vehicle", pl.lit(moment(self.t0)).alias("t0"), pl.exclude("vehicle")
            ),
        )

    def tables(self) -> dict[str, pl.DataFrame]:
        """Returns the tables that a forecast is written as, by name of the file; see `Forecasts`."""
        return self.reduced().tables()

    def to_polars(self) -> pl.DataFrame:
        """Returns a row for each vehicle and step: vehicle, t0, lane, horizon, x, its quantiles, p_merged."""
        table = self.reduced().position_table().drop("recording", "model")
        return table.with_columns(p_merged=share(self.p_merged))

    def to_pandas(self) -> Any:
        """Returns the table of `to_polars` as a frame of pandas.

        Raises:
            MissingExtra: pandas or pyarrow is not installed.
        """
        try:
            return self.to_polars().to_pandas()
        except ImportError as error:
            raise MissingExtra("to_pandas needs pandas and pyarrow; run: pip install pandas pyarrow") from error

    def to_xarray(self) -> Any:
        """Returns a data set of xarray: fronts and lanes of all samples with named axes, and what is counted in them.

        Raises:
            MissingExtra: xarray is not installed.
        """
        try:
            import xarray
        except ImportError as error:
            raise MissingExtra('to_xarray needs xarray; run: pip install "rampcast[xarray]"') from error
        horizon = np.round(STEP * np.arange(1, self.samples.shape[2] + 1), 1)
        values: dict[str, Any] = {
            "x": (("vehicle", "sample", "horizon"), self.samples, {"units": "m"}),
            "lane": (("vehicle", "sample", "horizon"), self.lane),
            "start": ("vehicle", self.start, {"units": "m"}),
            "start_lane": ("vehicle", self.start_lane),
            "length": ("vehicle", self.length, {"units": "m"}),
            "p_merged": (("vehicle", "horizon"), self.p_merged),
            "merge_time": (("vehicle", "sample"), self.merge_time, {"units": "s"}),
        }
        axes: dict[str, Any] = {"vehicle": self.vehicle, "horizon": ("horizon", horizon, {"units": "s"})}
        return xarray.Dataset(values, axes, attrs={"site": self.site.name, "t0": self.t0})

    def plot(self, **asked: Any) -> Any:
        """Returns the picture of `rc.plot(forecast, ...)`."""
        import rampcast as rc

        return rc.plot(self, **asked)


@dataclass(frozen=True)
class VehicleForecast:
    """What is forecast of one vehicle: its rows of a `Forecast`.

    Attributes:
        forecast: of the whole traffic.
        row: the vehicle's place in it.
    """

    forecast: Forecast
    row: int

    def __repr__(self) -> str:
        return f"<Forecast of vehicle {self.vehicle} of {self.forecast.site.name} at {self.forecast.t0:.1f} s>"

    @property
    def vehicle(self) -> object:
        """Returns its id."""
        return self.forecast.vehicle[self.row]

    @property
    def start(self) -> float:
        """Returns its front at t0 [m]."""
        return float(self.forecast.start[self.row])

    @property
    def samples(self) -> Float[np.ndarray, "sample step"]:
        """Returns its fronts at 0.2, 0.4 ... s after t0 [m]."""
        return self.forecast.samples[self.row]

    @property
    def lane(self) -> Int[np.ndarray, "sample step"]:
        """Returns its lanes then."""
        return self.forecast.lane[self.row]

    @property
    def speeds(self) -> Float[np.ndarray, "sample step"]:
        """Returns its speeds over the steps that end then [m/s]."""
        return self.forecast.speeds[self.row]

    @property
    def median(self) -> Float[np.ndarray, "step"]:
        """Returns the fronts that are as likely exceeded as not [m]."""
        return self.forecast.median[self.row]

    def quantiles(self, levels: Sequence[float] | Float[np.ndarray, "level"]) -> Float[np.ndarray, "step level"]:
        """Returns the fronts that are not exceeded with those probabilities [m]; see `Forecast.quantiles`."""
        return self.forecast.quantiles(levels)[self.row]

    @property
    def p_merged(self) -> Float[np.ndarray, "step"]:
        """Returns the probability to have merged by then."""
        return self.forecast.p_merged[self.row]

    @property
    def merge_time(self) -> Float[np.ndarray, "sample"]:
        """Returns the time from t0 to the merge [s]; infinite where there is none."""
        return self.forecast.merge_time[self.row]

    @property
    def merge_place(self) -> Float[np.ndarray, "sample"]:
        """Returns the front in the step of the merge [m]; NaN where there is none."""
        return self.forecast.merge_place[self.row]

    @property
    def gap(self) -> pl.DataFrame:
        """Returns the probability of each gap that some sample merges into; see `Forecast.gap`."""
        return self.forecast.gap.filter(pl.col("vehicle") == self.vehicle).drop("vehicle")


def _checked_levels(levels: Sequence[float] | Float[np.ndarray, "level"]) -> Float[np.ndarray, "level"]:
    asked = np.asarray(levels, dtype=np.float64)
    wrong = asked[~((asked > 0.0) & (asked < 1.0))]
    if len(wrong):
        raise RampcastError(f"levels: expected probabilities above 0 and below 1, got {wrong[0]:g}")
    return asked
