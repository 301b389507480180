"""What a rule asks of a forecast: the density to come, the chance of a gap, who will have to make room."""

from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from rampcast.forecast.forecast import Forecast
from rampcast.horizon import STEP

SENSED_AFTER: Final = 100.0  # [m] behind the end of the ramp lane: where the density of a merge ends
WINDOW: Final = 2  # steps, 0.4 s, before and after the arrival within which a gap counts


def density_change(forecast: Forecast, *, ahead: float) -> float:
    """Returns how the density of the main lanes from the gore to the sensor changes [vehicles/km, lane].

    Who enters the view after t0 is not forecast: `ahead` is to be shorter than the drive from there to the gore.

    Args:
        forecast: of the traffic.
        ahead: time after t0 [s].
    """
    if not len(forecast):
        return 0.0
    site, step = forecast.site, round(ahead / STEP) - 1
    low, high = site.gore, min(site.ramp_end + SENSED_AFTER, site.length)
    lanes = [lane.number for lane in site.lanes if lane.role == "main"]

    def inside(x: Float[np.ndarray, "..."], lane: Int[np.ndarray, "..."]) -> Bool[np.ndarray, "..."]:
        return (x >= low) & (x < high) & np.isin(lane, lanes)

    now = inside(forecast.start, forecast.start_lane).sum()
    then = inside(forecast.samples[:, :, step], forecast.lane[:, :, step]).sum(axis=0).mean()
    return float(then - now) / (len(lanes) * (high - low) / 1000.0)


def gap_chance(forecast: Forecast, *, place: float, arrival: float, lead: float, lag: float) -> float:
    """Returns the share of futures in which somebody who comes to a place then finds a gap in the target lane.

    A gap is safe if nobody is there: the last vehicle ahead is past the place by `lead` seconds of its speed plus its
    length, and the next one behind is before it by `lag` seconds of its own.

    Args:
        forecast: of the traffic.
        place: where the newcomer wants to merge [m].
        arrival: when it gets there, after t0 [s].
        lead: headway to the vehicle ahead [s].
        lag: headway of the vehicle behind [s].
    """
    if not len(forecast):
        return 1.0
    middle = round(arrival / STEP) - 1
    last = forecast.samples.shape[2]
    steps = np.arange(max(0, min(middle - WINDOW, last - 1)), max(1, min(middle + WINDOW + 1, last)))
    x, speed = forecast.samples[:, :, steps], forecast.speeds[:, :, steps]
    there = forecast.lane[:, :, steps] == forecast.site.target_lane
    ahead = x - forecast.length[:, None, None] - lead * speed
    behind = x + lag * speed
    blocks = there & (ahead < place) & (behind > place)
    return float((~blocks.any(axis=0)).any(axis=1).mean())


def makes_room(forecast: Forecast, *, within: float, chance: float) -> list[object]:
    """Returns the vehicles in the target lane who will be behind a merge, as a share of futures says.

    Args:
        forecast: of the traffic.
        within: of t0 the merge must come [s].
        chance: least share of the futures.
    """
    if not len(forecast):
        return []
    soon = forecast.merge_step < round(within / STEP)
    _, behind, _ = forecast.gap_sides
    count = np.zeros(len(forecast))
    row, sample = np.nonzero(soon & (behind >= 0))
    np.add.at(count, behind[row, sample], 1.0)
    asked = (count / forecast.samples.shape[1] >= chance) & (forecast.start_lane == forecast.site.target_lane)
    return [one for one, wanted in zip(forecast.vehicle.tolist(), asked.tolist(), strict=True) if wanted]


def slows_ahead(forecast: Forecast, *, ahead: float) -> float:
    """Returns the mean speed in the main lanes beside the ramp at that time [m/s]; NaN where nobody is."""
    if not len(forecast):
        return float("nan")
    site, step = forecast.site, round(ahead / STEP) - 1
    x, speed = forecast.samples[:, :, step], forecast.speeds[:, :, step]
    there = (x >= site.gore) & (x < site.ramp_end) & ~site.on_ramp(forecast.lane[:, :, step])
    return float(speed[there].mean()) if there.any() else float("nan")
