"""The doctor's checks: their texts and limits stand in checks.toml, each is made by the function of its name."""

import tomllib
from pathlib import Path
from typing import Any

from rampcast.doctor.checks import clock, identity, motion, ramp, reading, recorded, traffic, units
from rampcast.doctor.finding import Check

TEXTS = Path(__file__).parent / "checks.toml"
MODULES = (clock, identity, motion, ramp, reading, recorded, traffic, units)


def _check(name: str, values: dict[str, Any]) -> Check:
    """Returns a check; what no function is named after is counted when the files are read."""
    makers = [vars(module)[name] for module in MODULES if name in vars(module)]
    return Check(name=name, look=makers[0] if makers else reading.counted(name), **values)


CHECKS: tuple[Check, ...] = tuple(
    _check(name, values) for name, values in tomllib.loads(TEXTS.read_text(encoding="utf-8")).items()
)
