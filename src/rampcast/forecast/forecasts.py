"""What is forecast of chosen vehicles at many moments, and the tables that it is written as."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int, Shaped

from rampcast.forecast.conflicts import Conflicts
from rampcast.forecast.tables import BANDS, TIMES, keys, lane_change_table, position_table, share
from rampcast.horizon import FUTURE, STEP, STEPS_PER_SECOND, WHOLE_SECONDS
from rampcast.notebook import html_table

NAME: Final = "rampcast"  # in the column "model" of every table
MEDIAN = list(BANDS.values()).index(0.5)
SECONDS = np.round(np.arange(1, FUTURE + 1)[WHOLE_SECONDS] * STEP, 1)  # [s] at which conflicts are told
MEASURES = ("ttc",) * len(SECONDS) + ("drac",) * len(SECONDS) + ("pet",)
UNTIL = np.append(np.tile(SECONDS, 2), SECONDS[-1])  # [s] of each of them


@dataclass(frozen=True, repr=False)
class Forecasts:
    """What is forecast of vehicles at moments, a scene each: of the samples of a `Forecast` what tables tell.

    Attributes:
        recording, vehicle, t0: which window, which vehicle, and when [s].
        start: front of the vehicle at t0 [m].
        lane: its lane then.
        on_ramp: whether that is a ramp lane.
        quantiles: of the front at 0.2, 0.4 ... 15 s, at the levels of `tables.BANDS` [m].
        p_merged: probability to have merged by then.
        p_conflict: probability of each of `MEASURES`, by `UNTIL`.
        gaps: the gaps that ramp vehicles merge into; see `gap_table`.
    """

    recording: np.ndarray
    vehicle: Shaped[np.ndarray, "scene"]
    t0: Float[np.ndarray, "scene"]
    start: Float[np.ndarray, "scene"]
    lane: Int[np.ndarray, "scene"]
    on_ramp: Bool[np.ndarray, "scene"]
    quantiles: Float[np.ndarray, "scene step level"]
    p_merged: Float[np.ndarray, "scene step"]
    p_conflict: Float[np.ndarray, "scene measure"]
    gaps: pl.DataFrame

    def __len__(self) -> int:
        return len(self.t0)

    def __repr__(self) -> str:
        return f"<Forecasts of {self._windows}: {len(self):,} vehicles at a moment>"

    def _repr_html_(self) -> str:
        rows = {
            "windows": self._windows,
            "vehicles": f"{len({*zip(self.recording.tolist(), self.vehicle.tolist(), strict=True)}):,}",
            "forecasts": f"{len(self):,}, of a vehicle at a moment each",
            "moments": f"{self.t0.min():.1f} to {self.t0.max():.1f} s" if len(self) else "none",
        }
        return html_table("Forecasts", rows)

    @property
    def _windows(self) -> str:
        return ", ".join(sorted(set(self.recording.tolist()))) or "no window"

    @cached_property
    def x(self) -> dict[str, Float[np.ndarray, "scene future"]]:
        """Returns the median of the samples' fronts [m]."""
        return {NAME: self.quantiles[:, :, MEDIAN].astype(np.float64)}

    @cached_property
    def bands(self) -> dict[str, Float[np.ndarray, "scene future band"]]:
        """Returns the fronts that are not exceeded with the probabilities of `tables.BANDS` [m]."""
        return {NAME: self.quantiles.astype(np.float64)}

    @cached_property
    def lane_changes(self) -> dict[str, tuple[Float[np.ndarray, "scene 16"], Float[np.ndarray, "scene 16"]]]:
        """Returns the probability of a merge within, and at, 0, 1 ... 15 s: the share of the samples.

        Within t: by the end of the step that ends at t; at t: in that step. Both at t = 0 mean the first step.
        """
        at = np.maximum(np.array(TIMES) * STEPS_PER_SECOND - 1, 0)  # place of that step
        p_merged = self.p_merged.astype(np.float64)
        return {NAME: (p_merged[:, at], np.diff(p_merged, axis=1, prepend=0.0)[:, at])}

    def select(self, rows: Int[np.ndarray, "row"] | Bool[np.ndarray, "scene"]) -> "Forecasts":
        """Returns the forecasts of those scenes, in that order."""
        arrays = {name: values[rows] for name, values in self._arrays().items()}
        some = replace(self, **arrays)
        scenes = keys(some, 1).unique(maintain_order=True)
        return replace(some, gaps=scenes.join(self.gaps, on=scenes.columns, maintain_order="left_right"))

    def _arrays(self) -> dict[str, np.ndarray]:
        return {name: values for name, values in vars(self).items() if isinstance(values, np.ndarray)}

    def tables(self) -> dict[str, pl.DataFrame]:
        """Returns the tables that a forecast is written as, by name of the file."""
        return {
            "forecast": self.position_table(),
            "lane_change": self.lane_change_table(),
            "gap": self.gap_table(),
            "conflicts": self.conflict_table(),
        }

    def position_table(self) -> pl.DataFrame:
        """Returns the columns recording, vehicle, t0 [s], lane, horizon [s], x [m], model, and quantiles of x [m]."""
        return position_table(self)

    def lane_change_table(self) -> pl.DataFrame:
        """Returns the columns recording, vehicle, t0 [s], t [s], p_within, p_at, model: of those on the ramp."""
        return lane_change_table(self.select(self.on_ramp))

    def gap_table(self) -> pl.DataFrame:
        """Returns the columns recording, vehicle, t0 [s], gap, ahead, behind, p: of those on the ramp.

        `p` is the probability to merge within 15 s between the vehicles `ahead` and `behind`, null where nobody is.
        Gap 0 lies between the vehicles of the target lane that are ahead and behind at t0, gap 1 in front of the one
        ahead, gap -1 behind the one behind, and so on.
        """
        return self.gaps

    def conflict_table(self) -> pl.DataFrame:
        """Returns the columns recording, vehicle, t0 [s], measure, t [s], probability: of a conflict by then.

        Measures: "ttc" (time to collision below 3 s), "drac" (deceleration to avoid a crash above 3 m/s^2) at every
        second, and "pet" (post-encroachment time at the merge below 2 s) at 15 s.
        """
        return keys(self, len(MEASURES)).with_columns(
            measure=pl.Series(MEASURES * len(self), dtype=pl.String),
            t=pl.Series(np.tile(UNTIL, len(self))),
            probability=share(self.p_conflict),
        )


def conflict_columns(found: Conflicts) -> Float[np.ndarray, "vehicle measure"]:
    """Returns the probabilities in the order of `MEASURES`."""
    by_then = (found.time_to_collision[:, WHOLE_SECONDS], found.deceleration[:, WHOLE_SECONDS])
    return np.column_stack([*by_then, found.encroachment])


def joined(parts: Sequence[Forecasts]) -> Forecasts:
    """Returns the forecasts of all parts, one after the other; there is at least one."""
    some = [part for part in parts if len(part)] or parts[:1]  # the ids of nobody are of any type
    arrays = {name: np.concatenate([vars(part)[name] for part in some]) for name in some[0]._arrays()}
    return replace(some[0], **arrays, gaps=pl.concat([part.gaps for part in some]))
