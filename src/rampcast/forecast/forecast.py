"""What is forecast of vehicles of a recording, and the tables that it is written as."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import polars as pl
from jaxtyping import Float, Int, Shaped

from rampcast.forecast.conflicts import Conflicts, conflicts
from rampcast.forecast.scene_forecaster import GAPS, SceneForecast
from rampcast.forecast.tables import BANDS, TIMES, keys, lane_change_table, position_table
from rampcast.horizon import FUTURE, STEP, STEPS_PER_SECOND
from rampcast.notebook import html_table
from rampcast.sites.site import NO_LANE

NAME = "rampcast"  # in the column "model" of every table


@dataclass(frozen=True)
class Forecast:
    """What is forecast for each scene: a vehicle on the ramp at a moment.

    Attributes:
        recording, vehicle, t0: which window, which vehicle, and when [s].
        start: front of the vehicle at t0 [m].
        scene: samples, quantiles, lane change and gap, counted from there.
    """

    recording: np.ndarray
    vehicle: Shaped[np.ndarray, "scene"]
    t0: Float[np.ndarray, "scene"]
    start: Float[np.ndarray, "scene"]
    scene: SceneForecast

    def __len__(self) -> int:
        return len(self.t0)

    def __repr__(self) -> str:
        return f"<Forecast of {', '.join(sorted(set(self.recording.tolist())))}: {len(self):,} vehicles at a moment>"

    def _repr_html_(self) -> str:
        rows = {
            "windows": ", ".join(sorted(set(self.recording.tolist()))),
            "vehicles": f"{len({*zip(self.recording.tolist(), self.vehicle.tolist(), strict=True)}):,}",
            "forecasts": f"{len(self):,}, of a vehicle at a moment each",
            "moments": f"{self.t0.min():.1f} to {self.t0.max():.1f} s" if len(self) else "none",
            "futures": f"{self.scene.samples.shape[1]} of {FUTURE * STEP:g} s for each",
        }
        return html_table("Forecast", rows)

    @property
    def lane(self) -> Int[np.ndarray, "scene"]:
        """Returns that the lanes are not known."""
        return np.full(len(self), NO_LANE)

    @property
    def p_merged(self) -> Float[np.ndarray, "scene step"]:
        """Returns the probability to have merged by each step."""
        return self.scene.p_within

    def select(self, rows: Int[np.ndarray, "row"]) -> "Forecast":
        """Returns the forecasts of those scenes, in that order."""
        scene = replace(self.scene, **{name: values[rows] for name, values in vars(self.scene).items()})
        arrays = {name: getattr(self, name)[rows] for name in ("recording", "vehicle", "t0", "start")}
        return replace(self, **arrays, scene=scene)

    @cached_property
    def x(self) -> dict[str, Float[np.ndarray, "scene future"]]:
        """Returns the median of the samples' positions [m]: all vehicles around driven into the future together."""
        return {NAME: self.start[:, None] + self.scene.median}

    @cached_property
    def bands(self) -> dict[str, Float[np.ndarray, "scene future band"]]:
        """Returns the positions that are not exceeded with the probabilities of `tables.BANDS` [m]."""
        return {NAME: self.start[:, None, None] + self.scene.quantiles_at(*BANDS.values())}

    @cached_property
    def lane_changes(self) -> dict[str, tuple[Float[np.ndarray, "scene 16"], Float[np.ndarray, "scene 16"]]]:
        """Returns the probability of a lane change within, and at, 0, 1 ... 15 s: the share of the samples.

        A change in step k, counted from 1, is within t if k < 5 t and at t if k = 5 t; both at t = 0 if k = 1.
        """
        p_within, p_at = self.scene.p_within, self.scene.p_at
        at = np.maximum(np.array(TIMES) * STEPS_PER_SECOND - 1, 0)  # place of that step
        return {NAME: (p_within[:, np.maximum(at - 1, 0)], p_at[:, at])}

    @cached_property
    def conflicts(self) -> Conflicts:
        """Returns the probabilities of conflicts."""
        return conflicts(
            self.scene.samples,
            leader_rear=self.scene.leader_rear,
            follower_front=self.scene.follower_front,
            length=self.scene.length,
            merge_step=self.scene.merge_step,
        )

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
        """Returns the columns recording, vehicle, t0 [s], t [s], p_within, p_at, model."""
        return lane_change_table(self)

    def gap_table(self) -> pl.DataFrame:
        """Returns the columns recording, vehicle, t0 [s], gap, p: probability to merge within 15 s into that gap.

        Gap 0 lies between the vehicles of the target lane that are ahead and behind at t0, gap 1 in front of the one
        ahead, gap -1 behind the one behind, and so on.
        """
        gaps = pl.Series(np.tile(GAPS, len(self)), dtype=pl.Int64)
        return keys(self, len(GAPS)).with_columns(gap=gaps, p=pl.Series(self.scene.p_gap.ravel()))

    def conflict_table(self) -> pl.DataFrame:
        """Returns the columns recording, vehicle, t0 [s], measure, t [s], probability: of a conflict by then.

        Measures: "ttc" (time to collision below 3 s), "drac" (deceleration to avoid a crash above 3 m/s^2) at every
        second, and "pet" (post-encroachment time at the merge below 2 s) at 15 s.
        """
        found = self.conflicts
        seconds = np.arange(STEPS_PER_SECOND - 1, FUTURE, STEPS_PER_SECOND)
        names = ["ttc"] * len(seconds) + ["drac"] * len(seconds) + ["pet"]
        time = np.round(np.append(np.tile((seconds + 1) * STEP, 2), FUTURE * STEP), 1)
        p = np.column_stack([found.time_to_collision[:, seconds], found.deceleration[:, seconds], found.encroachment])
        return keys(self, len(names)).with_columns(
            measure=pl.Series(names * len(p), dtype=pl.String),
            t=pl.Series(np.tile(time, len(p))),
            probability=pl.Series(p.astype(np.float64).ravel()),
        )
