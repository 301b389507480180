"""What a message tells of each vehicle of a forecast."""

from typing import Any, Final

import numpy as np
from jaxtyping import Float

from rampcast.forecast.forecast import Forecast
from rampcast.forecast.tables import TIMES
from rampcast.horizon import STEPS_PER_SECOND
from rampcast.live.messages import LEVELS

AT: Final = np.array(TIMES[1:]) * STEPS_PER_SECOND - 1  # steps that end at 1 ... 15 s
SOON: Final = 5 * STEPS_PER_SECOND - 1  # the step that ends at 5 s
GAPS: Final = 5  # of a vehicle that are told, the likeliest


def vehicles_of(forecast: Forecast, state: dict[int, dict[str, Any]], names: dict[int, str]) -> list[dict[str, Any]]:
    """Returns what is told of each vehicle of a forecast.

    Args:
        forecast: of the site.
        state: what is known of the vehicles now, by the numbers of the forecast.
        names: what numbers stand for that stand for texts.
    """
    if not len(forecast):
        return []
    levels = _quantiles(forecast)
    merged = _merged(forecast)
    found = forecast.conflicts
    gaps = _gaps(forecast, names)
    vehicles = []
    for row, number in enumerate(forecast.vehicle.tolist()):
        ramp = bool(forecast.on_ramp[row])
        told = {
            "q": levels[row],
            "p_merged": merged[row] if ramp else None,
            "conflicts": {
                "ttc": _share(found.time_to_collision[row, -1]),
                "drac": _share(found.deceleration[row, -1]),
                "pet": _share(found.encroachment[row]),
                "ttc_5s": _share(found.time_to_collision[row, SOON]),
                "drac_5s": _share(found.deceleration[row, SOON]),
            },
        }
        if ramp:
            mine = gaps.get(number, [])
            told |= {"gap": _by_index(mine), "gaps": mine[:GAPS]}
        vehicles.append(state[number] | {"on_ramp": ramp} | told)
    return vehicles


def _by_index(gaps: list[dict[str, Any]]) -> dict[str, float]:
    found: dict[str, float] = {}
    for gap in gaps:
        name = str(gap["gap"])
        found[name] = round(found.get(name, 0.0) + gap["p"], 4)
    return found


def _share(p: float) -> float:
    return round(float(p), 3)


def _quantiles(forecast: Forecast) -> Float[np.ndarray, "vehicle 16 level"]:
    """Returns the fronts at 0, 1 ... 15 s; at 0 s that is where it is."""
    later = forecast.quantiles(LEVELS)[:, AT]
    now = np.broadcast_to(forecast.start[:, None, None], (len(forecast), 1, len(LEVELS)))
    return np.concatenate([now, later], axis=1)


def _merged(forecast: Forecast) -> Float[np.ndarray, "vehicle 16"]:
    later = forecast.p_merged[:, AT]
    return np.concatenate([np.zeros((len(forecast), 1)), later], axis=1)


def _gaps(forecast: Forecast, names: dict[int, str]) -> dict[int, list[dict[str, Any]]]:
    """Returns the gaps that each ramp vehicle may take, the likeliest first."""
    found: dict[int, list[dict[str, Any]]] = {}
    for vehicle, gap, ahead, behind, p in forecast.gap.iter_rows():
        told = {"gap": gap, "ahead": names.get(ahead, ahead), "behind": names.get(behind, behind), "p": round(p, 4)}
        found.setdefault(vehicle, []).append(told)
    return {vehicle: sorted(gaps, key=lambda gap: -gap["p"]) for vehicle, gaps in found.items()}
