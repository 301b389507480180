"""What a film knows of a recording beside the forecasts: where vehicles were and will be, and where the ramp runs."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import polars as pl
from jaxtyping import Float, Int

from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.sites import Site

BIN = 10.0  # [m] of the ramp over which lateral places are averaged
SEEN_ENOUGH = 20  # rows in a bin before it is believed
NEAR = 0.5  # [s] by which a row may lie off the moment asked for


@dataclass(frozen=True)
class Track:
    """Rows of one vehicle: times [s], fronts [m], lanes."""

    t: Float[np.ndarray, "row"]
    x: Float[np.ndarray, "row"]
    lane: Int[np.ndarray, "row"]


@dataclass(frozen=True)
class Story:
    """A window of a recording.

    Attributes:
        recording: raw, of one window.
    """

    recording: Recording

    @property
    def site(self) -> Site:
        """Returns the geometry."""
        return self.recording.site

    @cached_property
    def tracks(self) -> dict[object, Track]:
        """Returns the rows of each vehicle, in their order."""
        rows = self.recording.tracks.sort(c.VEHICLE, c.FRAME)
        parts = rows.select(c.VEHICLE, c.FRAME, c.X, c.LANE).partition_by(c.VEHICLE, maintain_order=True)
        return {
            part[c.VEHICLE][0]: Track(
                part[c.FRAME].to_numpy() * self.recording.time_step,
                part[c.X].to_numpy(),
                part[c.LANE].to_numpy().astype(np.int64),
            )
            for part in parts
        }

    @cached_property
    def merges(self) -> list[tuple[float, float]]:
        """Returns when [s] and where [m] vehicles came from a ramp lane into the target lane."""
        found = []
        for track in self.tracks.values():
            came = self.site.on_ramp(track.lane[:-1]) & (track.lane[1:] == self.site.target_lane)
            found += [(float(track.t[row + 1]), float(track.x[row + 1])) for row in np.flatnonzero(came)]
        return sorted(found)

    @cached_property
    def ramp_path(self) -> tuple[Float[np.ndarray, "point"], Float[np.ndarray, "point"]]:
        """Returns x and y of the middle of the ramp [m]: where vehicles drove before the gore, the site's beyond."""
        site = self.site
        centre = site.lane_centre(site.ramp_lanes[0])
        rows = self.recording.tracks.filter(pl.col(c.LANE).is_in(site.ramp_lanes) & (pl.col(c.X) < site.gore - BIN / 2))
        bins = (
            rows.group_by((pl.col(c.X) / BIN).floor().alias("bin"))
            .agg(pl.col(c.Y).median(), pl.len())
            .filter((pl.col("len") >= SEEN_ENOUGH) & pl.col(c.Y).is_finite())
            .sort("bin")
        )
        x, y = (bins["bin"].to_numpy() + 0.5) * BIN, bins[c.Y].to_numpy()
        if len(x) > 1 and x[0] > 0.0:
            x, y = np.append(0.0, x), np.append(y[0] - x[0] * (y[1] - y[0]) / (x[1] - x[0]), y)
        return np.append(x, [site.gore, site.length]), np.append(y, [centre, centre])

    @cached_property
    def lanes(self) -> list[int]:
        """Returns the numbers of the lanes that are drawn, from left to right: those with vehicles, and one more."""
        site = self.site
        seen = {*self.recording.tracks[c.LANE].unique().to_list(), *site.ramp_lanes, site.target_lane}
        order = [lane.number for lane in sorted(site.lanes, key=lambda lane: -lane.centre)]
        first = min((place for place, number in enumerate(order) if number in seen), default=0)
        return order[max(first - 1, 0) :]

    def came(self, vehicle: object, t: float) -> tuple[float, int] | None:
        """Returns where a vehicle was, or will be [m], and its lane; None where it was not seen."""
        track = self.tracks.get(vehicle)
        if track is None or not track.t[0] - NEAR <= t <= track.t[-1] + NEAR:
            return None
        row = min(int(np.searchsorted(track.t, t)), len(track.t) - 1)
        return float(np.interp(t, track.t, track.x)), int(track.lane[row])
