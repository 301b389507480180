"""Anchors: the vehicles and moments of a smoothed recording at which a forecast can begin."""

from dataclasses import dataclass

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int

from rampcast.arguments import expected
from rampcast.errors import RecordingError
from rampcast.horizon import PAST, STEP
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.recording.recording import READ_FIRST
from rampcast.sites import Site
from rampcast.traffic.neighbours import on_ramp_vehicles

FEATURES = ("x", "y", "v", "u", "a", "e")
X, Y, V, U, A, E = range(6)


@dataclass(frozen=True)
class Rows:
    """The rows of a recording as arrays, sorted by (recording, vehicle, frame)."""

    vehicle: Int[np.ndarray, "row"]
    track: Int[np.ndarray, "row"]  # number of the (recording, vehicle); a hole in it begins a new one
    frame: Int[np.ndarray, "row"]
    lane: Int[np.ndarray, "row"]
    length: Float[np.ndarray, "row"]
    observed: Bool[np.ndarray, "row"]  # False where a skipped frame was filled
    state: Float[np.ndarray, "row feature"]


def need_ramp(recording: Recording) -> None:
    """Checks that vehicles merge where the recording was made.

    Raises:
        RecordingError: its site has no ramp.
    """
    expected(Recording, recording, name="recording", advice=READ_FIRST)
    if not recording.site.has_ramp:
        raise RecordingError(
            f"site '{recording.site.name}' has no lane of role 'ramp': there is no merge to forecast; say which lane "
            "is the ramp, and where it ends, with `rampcast site`; if there is none, `rampcast forecast` without "
            "--model forecasts those who drive there"
        )


def find_anchors(recording: Recording, *, every: float = 1.0) -> Int[np.ndarray, "scene"]:
    """Returns the rows of the recording at which a vehicle on the ramp can be forecast.

    A vehicle is anchored at every such time at which its last 4 s lie in the ramp lane.

    Args:
        recording: smoothed and sampled at 0.2 s (see `clean`).
        every: time between anchors [s], a multiple of 0.2; anchors lie on one clock for all vehicles.

    Raises:
        RampcastError: it is no recording.
        RecordingError: the recording is not smoothed, `every` is no multiple of 0.2 s, or no vehicle is on the ramp for
            4 s.
    """
    expected(Recording, recording, name="recording", advice=READ_FIRST)
    if not recording.is_smoothed:
        raise RecordingError(
            "a forecast needs velocities: smooth the recording first, `recording, changes = rc.clean(recording)`"
        )
    need_ramp(recording)
    if not isinstance(every, int | float):
        raise RecordingError(f"every: expected the time between anchors as a number of seconds, got {every!r}")
    spacing = round(every / STEP)
    if spacing < 1 or abs(spacing * STEP - every) > 1e-6:
        raise RecordingError(f"expected anchors every multiple of {STEP} s, got every {every} s")
    anchors = _anchors(rows_of(recording), ramp_rows(recording), recording.site, spacing)
    if not len(anchors):
        raise RecordingError(
            f"no vehicle of this recording has {PAST} steps ({PAST * STEP:g} s) in a row in a ramp lane "
            f"{recording.site.ramp_lanes} of site '{recording.site.name}': nothing to forecast"
        )
    return anchors


def rows_of(recording: Recording) -> Rows:
    """Returns the rows of a smoothed recording as arrays."""
    tracks = recording.tracks
    continues = tracks.select(
        (pl.col(c.RECORDING) == pl.col(c.RECORDING).shift(1))
        & (pl.col(c.VEHICLE) == pl.col(c.VEHICLE).shift(1))
        & (pl.col(c.FRAME) == pl.col(c.FRAME).shift(1) + 1)
    )
    new = ~continues.to_series().fill_null(False).to_numpy()
    return Rows(
        vehicle=tracks[c.VEHICLE].to_numpy().astype(np.int64),
        track=np.cumsum(new),
        frame=tracks[c.FRAME].to_numpy().astype(np.int64),
        lane=tracks[c.LANE].to_numpy().astype(np.int64),
        length=tracks[c.LENGTH].to_numpy().astype(np.float64),
        observed=tracks[c.OBSERVED].to_numpy(),
        state=tracks.select(FEATURES).to_numpy(),
    )


def ramp_rows(recording: Recording) -> Int[np.ndarray, "ramp"]:
    """Returns every row of the on-ramp vehicles, before and after their lane change."""
    rows = recording.tracks.with_row_index("row").join(
        on_ramp_vehicles(recording), on=[c.RECORDING, c.VEHICLE], how="semi"
    )
    return np.sort(rows["row"].to_numpy().astype(np.int64))


def _anchors(table: Rows, ramp_rows: Int[np.ndarray, "ramp"], site: Site, spacing: int) -> Int[np.ndarray, "scene"]:
    """Returns the rows that end `PAST` gapless rows of one vehicle in a ramp lane, on the common clock of anchors.

    A skipped frame may be filled in the history, as in the paper, but not at the anchor itself.
    """
    on_ramp = site.on_ramp(table.lane)
    left = np.concatenate([[0], np.cumsum(~on_ramp)])
    ends = ramp_rows[ramp_rows >= PAST - 1]
    starts = ends - (PAST - 1)
    whole = (table.track[starts] == table.track[ends]) & (table.frame[ends] - table.frame[starts] == PAST - 1)
    stayed = left[ends + 1] == left[starts]
    return ends[whole & stayed & table.observed[ends] & (table.frame[ends] % spacing == 0)]
