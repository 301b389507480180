"""The rows of a recording by vehicle and frame, as the checks of what roads and vehicles have look at them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import polars as pl
from jaxtyping import Bool, Float

from rampcast.recording import columns as c
from rampcast.recording.breach import Breach
from rampcast.recording.recording import KEY, Recording
from rampcast.recording.smoothing import LONGEST_FILLED_GAP

Row = Float[np.ndarray, "row"]


@dataclass(frozen=True)
class TrackRows:
    """A recording's rows by vehicle and frame."""

    recording: Recording
    tracks: pl.DataFrame

    @cached_property
    def same(self) -> Bool[np.ndarray, "row"]:
        """Returns whether the row before is of the same vehicle."""
        part, vehicle = self.tracks[c.RECORDING].rle_id().to_numpy(), self.tracks[c.VEHICLE].to_numpy()
        return np.r_[False, (part[1:] == part[:-1]) & (vehicle[1:] == vehicle[:-1])]

    @cached_property
    def elapsed(self) -> Row:
        """Returns the time since the vehicle's row before [s]; NaN at its first, and after long holes."""
        frame = self.tracks[c.FRAME].to_numpy().astype(float)
        time = np.diff(frame, prepend=np.nan) * self.recording.time_step
        return np.where(self.same & (time > 0) & (time <= LONGEST_FILLED_GAP), time, np.nan)

    @cached_property
    def x(self) -> Row:
        """Returns the longitudinal positions [m]."""
        return self.tracks[c.X].to_numpy().astype(float)

    @cached_property
    def speed(self) -> Row:
        """Returns the mean speed since the row before [m/s]; NaN where there is none."""
        return np.diff(self.x, prepend=np.nan) / self.elapsed

    def breach(
        self, name: str, found: Bool[np.ndarray, "row"], values: Row, of: int, most: float, **words: str
    ) -> Breach | None:
        """Returns the breach of the rows found, if there are any; it spoils where their share is above `most`."""
        rows = np.flatnonzero(found)
        if not len(rows):
            return None
        size = np.abs(np.nan_to_num(values[rows], nan=np.inf))
        worst = int(rows[size.argmax()])
        window, vehicle, frame = self.tracks.select(*KEY).row(worst)
        return Breach(
            name,
            words["what"],
            str(window),
            vehicle,
            frame,
            float(values[worst]),
            words["expected"],
            len(rows),
            of,
            words["cause"],
            most,
        )
