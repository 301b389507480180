"""What is forecast for scenes, and the tables that it is written as."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import polars as pl
from jaxtyping import Float, Int

from rampcast.forecast.conflicts import Conflicts, conflicts
from rampcast.forecast.scene_forecaster import GAPS, SceneForecast
from rampcast.horizon import FUTURE, STEP, STEPS_PER_SECOND
from rampcast.paper.calibration.calibration import Calibration
from rampcast.paper.lane_change.sets import TIMES
from rampcast.paper.neighbours.predict import NeighbourForecast

OWN = "rampcast"  # the model that forecasts scenes as a whole
FORESTS = "forests"
BANDS = {"x_q05": 0.05, "x_q25": 0.25, "x_q50": 0.5, "x_q75": 0.75, "x_q95": 0.95}


@dataclass(frozen=True)
class Forecast:
    """What is forecast for each scene.

    Attributes:
        recording, vehicle, t0: which window, which vehicle, and when [s].
        start: front of the central vehicle at t0 [m].
        x: by model, front position of the central vehicle at 0.2, 0.4, ... s after t0 [m].
        p_within: probability of a lane change within 0, 1, ..., 15 s, by the forests.
        p_at: probability of a lane change at 0, 1, ..., 15 s, by the forests.
        neighbours: the predicted neighbours.
        calibrations: the drivers fitted to the history, by car-following law.
        scene: samples, quantiles, lane change and gap by the scene forecaster; None in paper mode, or if it was not
            asked for.
    """

    recording: np.ndarray
    vehicle: Int[np.ndarray, "scene"]
    t0: Float[np.ndarray, "scene"]
    start: Float[np.ndarray, "scene"]
    x: dict[str, Float[np.ndarray, "scene future"]]
    p_within: Float[np.ndarray, "scene 16"]
    p_at: Float[np.ndarray, "scene 16"]
    neighbours: NeighbourForecast
    calibrations: dict[str, Calibration]
    scene: SceneForecast | None = None

    @cached_property
    def conflicts(self) -> Conflicts | None:
        """Returns the probabilities of conflicts; None without samples."""
        if self.scene is None:
            return None
        return conflicts(
            self.scene.samples,
            leader_rear=self.scene.leader_rear,
            follower_front=self.scene.follower_front,
            length=self.scene.length,
            merge_step=self.scene.merge_step,
        )

    def bands(self) -> Float[np.ndarray, "scene future 5"] | None:
        """Returns the positions that are exceeded with the probabilities of `BANDS` [m]; None without samples."""
        if self.scene is None or OWN not in self.x:
            return None
        steps = self.x[OWN].shape[1]
        return self.start[:, None, None] + self.scene.quantiles_at(*BANDS.values())[:, :steps]

    def position_table(self) -> pl.DataFrame:
        """Returns the columns recording, vehicle, t0 [s], horizon [s], x [m], model, and quantiles of x [m].

        The quantiles are null for models that give none.
        """
        tables = []
        for name, x in self.x.items():
            steps = x.shape[1]
            horizon = np.round(np.arange(1, steps + 1) * STEP, 1)
            bands = self.bands() if name == OWN else None
            tables.append(
                self._keys(steps).with_columns(
                    horizon=pl.Series(np.tile(horizon, len(x))),
                    x=pl.Series(x.ravel()),
                    model=pl.lit(name),
                    **{
                        column: pl.lit(None, pl.Float64) if bands is None else pl.Series(bands[..., number].ravel())
                        for number, column in enumerate(BANDS)
                    },
                )
            )
        return pl.concat(tables)

    def lane_change_table(self) -> pl.DataFrame:
        """Returns the columns recording, vehicle, t0 [s], t [s], p_within, p_at, model."""
        found = {} if self.scene is None else {OWN: lane_change_at_seconds(self.scene)}
        found[FORESTS] = (self.p_within, self.p_at)
        time = pl.Series(np.tile(np.array(TIMES, dtype=float), len(self.t0)))
        tables = [
            self._keys(len(TIMES)).with_columns(
                t=time, p_within=pl.Series(within.ravel()), p_at=pl.Series(at.ravel()), model=pl.lit(name)
            )
            for name, (within, at) in found.items()
        ]
        return pl.concat(tables)

    def gap_table(self) -> pl.DataFrame:
        """Returns the columns recording, vehicle, t0 [s], gap, p: probability to merge within 15 s into that gap.

        Gap 0 lies between the vehicles of the target lane that are ahead and behind at t0, gap 1 in front of the one
        ahead, gap -1 behind the one behind, and so on. Without samples there are no rows.
        """
        p = np.zeros((0, len(GAPS))) if self.scene is None else self.scene.p_gap
        gaps = pl.Series(np.tile(GAPS, len(p)), dtype=pl.Int64)
        return self._keys(len(GAPS), scenes=len(p)).with_columns(gap=gaps, p=pl.Series(p.ravel()))

    def conflict_table(self) -> pl.DataFrame:
        """Returns the columns recording, vehicle, t0 [s], measure, t [s], probability: of a conflict by then.

        Measures: "ttc" (time to collision below 3 s), "drac" (deceleration to avoid a crash above 3 m/s^2) at every
        second, and "pet" (post-encroachment time at the merge below 2 s) at 15 s. Without samples there are no rows.
        """
        found = self.conflicts
        seconds = np.arange(STEPS_PER_SECOND - 1, FUTURE, STEPS_PER_SECOND)
        names = ["ttc"] * len(seconds) + ["drac"] * len(seconds) + ["pet"]
        time = np.round(np.append(np.tile((seconds + 1) * STEP, 2), FUTURE * STEP), 1)
        p = np.zeros((0, len(names)))
        if found is not None:
            p = np.column_stack(
                [found.time_to_collision[:, seconds], found.deceleration[:, seconds], found.encroachment]
            ).astype(np.float64)
        return self._keys(len(names), scenes=len(p)).with_columns(
            measure=pl.Series(names * len(p), dtype=pl.String),
            t=pl.Series(np.tile(time, len(p))),
            probability=pl.Series(p.ravel()),
        )

    def _keys(self, repeats: int, *, scenes: int | None = None) -> pl.DataFrame:
        some = slice(0, scenes)
        return pl.DataFrame(
            {
                "recording": pl.Series(np.repeat(self.recording[some], repeats), dtype=pl.String),
                "vehicle": np.repeat(self.vehicle[some], repeats),
                "t0": np.round(np.repeat(self.t0[some], repeats), 1),
            }
        )


def lane_change_at_seconds(
    scene: SceneForecast,
) -> tuple[Float[np.ndarray, "scene 16"], Float[np.ndarray, "scene 16"]]:
    """Returns the probability of a lane change within, and at, 0, 1 ... 15 s, as `models.forest_sets` defines these.

    A change in step k, counted from 1, is within t if k < 5 t and at t if k = 5 t; both at t = 0 if k = 1.
    """
    p_within, p_at = scene.p_within, scene.p_at
    at = np.maximum(np.array(TIMES) * STEPS_PER_SECOND - 1, 0)  # place of that step
    return p_within[:, np.maximum(at - 1, 0)], p_at[:, at]
