"""How the vehicles of a sample move: what its numbers must mean for them to be vehicles on a road."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl
from jaxtyping import Float

FASTEST: Final = 55.0  # [m/s] of the fastest in twenty: 200 km/h
SLOWEST: Final = 1.0  # [m/s] of the fastest in twenty: slower ones are walkers, or the unit is too large
LONGEST_STEP: Final = 1.6  # times the usual step: a longer one is a hole


@dataclass(frozen=True)
class Motion:
    """Steps of vehicles from a row to their next, in the units of the table.

    Attributes:
        dt: time of each step; dx, dy: and way.
        at: row of the table from which each step leads.
    """

    dt: Float[np.ndarray, "step"]
    dx: Float[np.ndarray, "step"]
    dy: Float[np.ndarray, "step"]
    at: np.ndarray

    @property
    def speed(self) -> Float[np.ndarray, "step"]:
        """Returns the way in a unit of time."""
        return np.hypot(self.dx, self.dy) / self.dt


def motion_of(vehicle: pl.Series, moment: pl.Series, x: pl.Series, y: pl.Series | None) -> Motion:
    """Returns the steps of vehicles over a quarter of a second or so: of more than one row where those are close.

    Args:
        vehicle: ids; moment: of each row, in any unit.
        x, y: places; None where there is no y.
    """
    rows = pl.DataFrame({"v": vehicle.cast(pl.String), "t": moment, "x": x, "y": y if y is not None else x * 0.0})
    rows = (
        rows.with_row_index("at")
        .drop_nulls()
        .sort("v", "t", maintain_order=True)
        .unique(["v", "t"], keep="first", maintain_order=True)
    )
    steps = rows.with_columns((pl.col(name).shift(-1) - pl.col(name)).over("v").alias(f"d{name}") for name in "txy")
    steps = steps.drop_nulls().filter(pl.col("dt") > 0)
    if steps.is_empty():
        nothing = np.zeros(0)
        return Motion(nothing, nothing, nothing, np.zeros(0, np.int64))
    usual = float(steps["dt"].median() or 1.0)  # type: ignore[arg-type]
    steps = steps.filter(pl.col("dt") < LONGEST_STEP * usual)
    dt, dx, dy = (steps[name].cast(pl.Float64).to_numpy() for name in ("dt", "dx", "dy"))
    return Motion(dt, dx, dy, steps["at"].to_numpy())


def fast(speeds: Float[np.ndarray, "step"]) -> float:
    """Returns the speed that one step in twenty exceeds; 0 of none."""
    return float(np.quantile(speeds, 0.95)) if len(speeds) else 0.0


def believable(speeds: Float[np.ndarray, "step"], factor: float) -> bool:
    """Returns whether speeds times a factor are those of vehicles [m/s]."""
    return SLOWEST <= fast(speeds) * factor <= FASTEST


def ratio(recorded: Float[np.ndarray, "step"], moved: Float[np.ndarray, "step"]) -> float:
    """Returns how many times larger recorded values are than those of the motion, by the median."""
    large = np.isfinite(recorded) & (np.abs(moved) > 0.3 * fast(np.abs(moved)))
    return float(np.median(np.abs(recorded[large]) / np.abs(moved[large]))) if large.sum() > 5 else float("nan")


def nearest_factor(found: float, factors: dict[str, float], *, within: float = 0.15) -> str:
    """Returns the name of the factor that a ratio is nearest to; "" where it is near none."""
    if not np.isfinite(found) or found <= 0:
        return ""
    name = min(factors, key=lambda one: abs(np.log(found * factors[one])))
    return name if abs(np.log(found * factors[name])) < within else ""
