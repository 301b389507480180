"""The simulated sample that ships with rampcast, and how it was made.

python -m rampcast.simulate sample FOLDER      makes it again (needs SUMO)
"""

from dataclasses import dataclass, replace

import polars as pl

from rampcast.errors import RecordingError
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.simulate.programs import Progress
from rampcast.simulate.simulation import MINUTES, simulate
from rampcast.sites import load_site

SITE = "simulated"
DIGITS = 2  # positions are kept to the centimetre: it makes the files a third of their size


@dataclass(frozen=True)
class Window:
    """What differs between the windows of the sample: the seed and the demand."""

    seed: int
    flow_per_lane: float  # [vehicles/h]
    ramp_flow: float  # [vehicles/h]
    sign_speeds: tuple[float, float]  # [m/s]


# Of a handful of seeds and demands tried, three that meet `realism.ACCEPTED`.
WINDOWS = {
    "1": Window(seed=4, flow_per_lane=1900.0, ramp_flow=660.0, sign_speeds=(6.0, 17.0)),
    "2": Window(seed=2, flow_per_lane=1900.0, ramp_flow=580.0, sign_speeds=(5.0, 17.0)),
    "3": Window(seed=3, flow_per_lane=2000.0, ramp_flow=620.0, sign_speeds=(5.0, 18.0)),
}


def make_sample(window: str, *, minutes: float = MINUTES, progress: Progress | None = None) -> Recording:
    """Returns one window of the sample: the ramp and its adjacent lane, positions rounded to the centimetre.

    Args:
        window: "1", "2" or "3".
        minutes: recorded time [min]; a shorter recording is the beginning of the whole one.
        progress: called with the share done, 0 to 1.

    Raises:
        RecordingError: the sample has no such window.
        MissingExtra: SUMO is not installed.
    """
    if window not in WINDOWS:
        raise RecordingError(f"the sample has no window '{window}'; it has {', '.join(WINDOWS)}")
    values = WINDOWS[window]
    whole = simulate(
        load_site(SITE),
        minutes=minutes,
        seed=values.seed,
        window=window,
        flow_per_lane=values.flow_per_lane,
        ramp_flow=values.ramp_flow,
        sign_speeds=values.sign_speeds,
        progress=progress,
    )
    near = pl.col(c.LANE).is_in([whole.site.target_lane, *whole.site.ramp_lanes])
    return replace(whole, tracks=whole.tracks.filter(near).with_columns(pl.col(c.X, c.Y).round(DIGITS)))
