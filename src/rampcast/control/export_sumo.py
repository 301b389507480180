"""The drivers of a fitted forecaster as vehicle types that SUMO loads."""

from pathlib import Path
from typing import Final
from xml.sax.saxutils import quoteattr

import numpy as np
from jaxtyping import Float

from rampcast import __version__
from rampcast.files import write_whole
from rampcast.forecast.forecaster import Forecaster

DIGITS: Final = 3
LENGTH: Final = 4.7  # [m] of a car; the recordings' own lengths are no part of a driver
GROUPS: Final = ("main", "ramp")


def export_sumo(forecaster: Forecaster, path: Path) -> int:
    """Writes a file of SUMO vehicle types, and returns how many: the drivers that stand for the prior of a model.

    Two distributions, `drivers_main` and `drivers_ramp`, each of equally likely drivers with the IDM parameters of
    `models.drivers.DriverPrior`; a flow takes one with type="drivers_main". What is learned besides, the habit of
    keeping the gap of now, disturbances, merging and corrections, has no place in a vehicle type.

    Args:
        forecaster: what `rampcast.fit` or `rampcast.load` gave.
        path: of the file.
    """
    roll_out = forecaster.model.base.roll_out
    lines = [f"<!-- {_provenance(forecaster)} -->", "<additional>"]
    count = 0
    for group in GROUPS:
        drivers = getattr(roll_out, group).drivers
        lines.append(f'  <vTypeDistribution id="drivers_{group}">')
        lines += [f"    {_type(f'{group}_{number}', one)}" for number, one in enumerate(drivers)]
        lines.append("  </vTypeDistribution>")
        count += len(drivers)
    with write_whole(path) as new:
        new.write_text("\n".join([*lines, "</additional>", ""]), encoding="utf-8")
    return count


def _type(name: str, driver: Float[np.ndarray, "param"]) -> str:
    """Returns a driver as a vehicle type; the desired speed is `maxSpeed`: a limit counts from 1.9 times itself on."""
    standing, headway, highest, braking, desired, exponent = (round(float(one), DIGITS) for one in driver)
    values: dict[str, object] = {
        "id": name, "carFollowModel": "IDM", "minGap": standing, "tau": headway, "accel": highest, "decel": braking,
        "emergencyDecel": max(9.0, braking), "maxSpeed": desired, "delta": exponent, "speedFactor": 1.9, "speedDev": 0,
        "length": LENGTH,
    }  # fmt: skip
    return "<vType " + " ".join(f"{key}={quoteattr(str(value))}" for key, value in values.items()) + "/>"


def _provenance(forecaster: Forecaster) -> str:
    """Returns where the drivers come from, as a comment holds it."""
    text = (
        f"rampcast {__version__}, {forecaster!r}, SHA-256 of the recordings {forecaster.data_hash}; "
        "IDM parameters of the drivers that stand for its prior"
    )
    return text.replace("--", "- -").replace("<", "").replace(">", "")
