"""Builds scenes from a smoothed recording: anchors, neighbours, past, future, lane-change times."""

from dataclasses import dataclass, replace

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int

from rampcast.errors import RecordingError
from rampcast.recording import Recording, Site
from rampcast.recording import columns as c
from rampcast.scenes.merge_scenes import build_merge_scenes
from rampcast.scenes.neighbours import NONE, find_neighbours, on_ramp_vehicles
from rampcast.scenes.scenes import FEATURES, FUTURE, PAST, STEP, Scenes, X, Y
from rampcast.scenes.stand_ins import fill_past, fill_role_past, stand_ins


@dataclass(frozen=True)
class _Table:
    """The rows of a recording as arrays, sorted by (recording, vehicle, frame)."""

    vehicle: Int[np.ndarray, "row"]
    track: Int[np.ndarray, "row"]  # number of the (recording, vehicle); a hole in it begins a new one
    frame: Int[np.ndarray, "row"]
    lane: Int[np.ndarray, "row"]
    length: Float[np.ndarray, "row"]
    observed: Bool[np.ndarray, "row"]  # False where a skipped frame was filled
    state: Float[np.ndarray, "row feature"]


def build_scenes(recording: Recording, *, every: float = 1.0, future: int = FUTURE) -> Scenes:
    """Returns a scene for every on-ramp vehicle and every anchor time at which its last 4 s lie in the ramp lane.

    Args:
        recording: smoothed and sampled at 0.2 s (see `clean`).
        every: time between anchors [s], a multiple of 0.2; anchors lie on one clock for all vehicles.
        future: steps of 0.2 s to keep after the anchor.

    Raises:
        RecordingError: the recording is not smoothed, `every` is no multiple of 0.2 s, or no vehicle is on the ramp for
            4 s.
    """
    return build_scenes_at(recording, find_anchors(recording, every=every), future=future)


def need_ramp(recording: Recording) -> None:
    """Checks that vehicles merge where the recording was made.

    Raises:
        RecordingError: its site has no ramp.
    """
    if not recording.site.has_ramp:
        raise RecordingError(
            f"site '{recording.site.name}' has no lane of role 'ramp': there is no merge to forecast; say which lane "
            "is the ramp, and where it ends, with `rampcast site`"
        )


def find_anchors(recording: Recording, *, every: float = 1.0) -> Int[np.ndarray, "scene"]:
    """Returns the rows of the recording at which a scene can be anchored; see `build_scenes`."""
    if not recording.is_smoothed:
        raise RecordingError(
            "scenes need velocities: smooth the recording first, `recording, report = clean(recording)`"
        )
    need_ramp(recording)
    spacing = round(every / STEP)
    if spacing < 1 or abs(spacing * STEP - every) > 1e-6:
        raise RecordingError(f"expected anchors every multiple of {STEP} s, got every {every} s")
    anchors = _anchors(_table(recording), _ramp_rows(recording), recording.site, spacing)
    if not len(anchors):
        raise RecordingError(
            f"no vehicle of this recording has {PAST} steps ({PAST * STEP:g} s) in a row in a ramp lane "
            f"{recording.site.ramp_lanes} of site '{recording.site.name}': nothing to forecast"
        )
    return anchors


def build_scenes_at(recording: Recording, anchors: Int[np.ndarray, "scene"], *, future: int = FUTURE) -> Scenes:
    """Returns the scenes at those rows of the recording, which `find_anchors` gave."""
    scenes = _assemble(recording, _table(recording), _ramp_rows(recording), anchors, future)
    return replace(scenes, around=build_merge_scenes(recording, anchors))


def build_neighbour_scenes_at(recording: Recording, anchors: Int[np.ndarray, "scene"]) -> Scenes:
    """Returns the scenes at those rows with the six neighbours alone: no traffic around them, and no future.

    Lane-change forests need no more, and are trained on very many scenes.
    """
    return _assemble(recording, _table(recording), _ramp_rows(recording), anchors, 0)


def _assemble(
    recording: Recording,
    table: _Table,
    ramp_rows: Int[np.ndarray, "ramp"],
    anchors: Int[np.ndarray, "scene"],
    future: int,
) -> Scenes:
    neighbours = np.full((len(table.frame), 6), NONE)
    neighbours[ramp_rows] = find_neighbours(recording, ramp_rows)
    filled = np.concatenate([anchors[:, None], neighbours[anchors]], axis=1)
    virtual = filled == NONE
    standing = stand_ins(recording.site, table.lane[anchors])
    past_rows, past_valid = _follow(table, filled, np.arange(1 - PAST, 1))
    future_rows, future_valid = _follow(table, filled, np.arange(1, future + 1))
    future_valid &= table.observed[future_rows]  # a filled frame is no truth to score against
    history = anchors[:, None] + np.arange(1 - PAST, 1)
    role_rows = np.concatenate([history[:, :, None], neighbours[history]], axis=2).swapaxes(1, 2)
    role_virtual = role_rows == NONE
    label, crossing, seen_for = _lane_change_times(recording.site, table, anchors)
    return Scenes(
        site=recording.site,
        recording=recording.tracks[c.RECORDING].to_numpy()[anchors],
        vehicle=np.where(virtual, 0, table.vehicle[filled]),
        t0=table.frame[anchors] * STEP,
        lane=table.lane[anchors],
        virtual=virtual,
        length=np.where(virtual, 0.0, table.length[filled]),
        past=fill_past(table.state[past_rows], past_valid, virtual, standing),
        past_valid=past_valid,
        role_past=fill_role_past(table.state[role_rows], role_virtual, standing),
        role_virtual=role_virtual,
        role_length=np.where(role_virtual, 0.0, table.length[role_rows]),
        future=_future_states(table, future_rows, future_valid, virtual, standing),
        future_valid=future_valid,
        change_label=label,
        change_crossing=crossing,
        seen_for=seen_for,
    )


def _table(recording: Recording) -> _Table:
    tracks = recording.tracks
    continues = tracks.select(
        (pl.col(c.RECORDING) == pl.col(c.RECORDING).shift(1))
        & (pl.col(c.VEHICLE) == pl.col(c.VEHICLE).shift(1))
        & (pl.col(c.FRAME) == pl.col(c.FRAME).shift(1) + 1)
    )
    new = ~continues.to_series().fill_null(False).to_numpy()
    return _Table(
        vehicle=tracks[c.VEHICLE].to_numpy().astype(np.int64),
        track=np.cumsum(new),
        frame=tracks[c.FRAME].to_numpy().astype(np.int64),
        lane=tracks[c.LANE].to_numpy().astype(np.int64),
        length=tracks[c.LENGTH].to_numpy().astype(np.float64),
        observed=tracks[c.OBSERVED].to_numpy(),
        state=tracks.select(FEATURES).to_numpy(),
    )


def _ramp_rows(recording: Recording) -> Int[np.ndarray, "ramp"]:
    """Returns every row of the on-ramp vehicles, before and after their lane change."""
    rows = recording.tracks.with_row_index("row").join(
        on_ramp_vehicles(recording), on=[c.RECORDING, c.VEHICLE], how="semi"
    )
    return np.sort(rows["row"].to_numpy().astype(np.int64))


def _anchors(table: _Table, ramp_rows: Int[np.ndarray, "ramp"], site: Site, spacing: int) -> Int[np.ndarray, "scene"]:
    """Returns the rows that end `PAST` gapless rows of one vehicle in a ramp lane, on the common clock of anchors.

    A skipped frame may be filled in the history, as in the paper, but not at the anchor itself.
    """
    on_ramp = np.isin(table.lane, site.ramp_lanes)
    left = np.concatenate([[0], np.cumsum(~on_ramp)])
    ends = ramp_rows[ramp_rows >= PAST - 1]
    starts = ends - (PAST - 1)
    whole = (table.track[starts] == table.track[ends]) & (table.frame[ends] - table.frame[starts] == PAST - 1)
    stayed = left[ends + 1] == left[starts]
    return ends[whole & stayed & table.observed[ends] & (table.frame[ends] % spacing == 0)]


def _follow(
    table: _Table, filled: Int[np.ndarray, "scene slot"], steps: Int[np.ndarray, "step"]
) -> tuple[Int[np.ndarray, "scene slot step"], Bool[np.ndarray, "scene slot step"]]:
    """Returns the rows of the same vehicles so many steps later, and whether they were seen there without a hole."""
    wanted = filled[:, :, None] + steps
    rows = np.clip(wanted, 0, len(table.frame) - 1)
    start = filled[:, :, None]
    valid = (
        (rows == wanted)
        & (start != NONE)
        & (table.track[rows] == table.track[start])
        & (table.frame[rows] - table.frame[start] == steps)
    )
    return rows, valid


def _future_states(
    table: _Table,
    rows: Int[np.ndarray, "scene slot future"],
    valid: Bool[np.ndarray, "scene slot future"],
    virtual: Bool[np.ndarray, "scene slot"],
    standing: Float[np.ndarray, "scene slot feature"],
) -> Float[np.ndarray, "scene slot future feature"]:
    states = np.where(valid[..., None], table.state[rows], np.nan)
    return np.where(virtual[..., None, None], standing[:, :, None, :], states)


def _lane_change_times(
    site: Site, table: _Table, anchors: Int[np.ndarray, "scene"]
) -> tuple[Float[np.ndarray, "scene"], Float[np.ndarray, "scene"], Float[np.ndarray, "scene"]]:
    """Returns the time from each anchor to the change of label, to the crossing of the line, and to the last row [s].

    The label changes at the vehicle's first row in the target lane after the anchor. The line is crossed at the row
    from which the vehicle stays to the left of it; that may lie before the anchor (a time of 0 or less).
    """
    last_row = np.append(np.flatnonzero(np.diff(table.track)), len(table.track) - 1)
    track = np.searchsorted(last_row, anchors)
    end, begin = last_row[track], np.append(0, last_row + 1)[track]
    changed = np.flatnonzero(table.lane == site.target_lane)
    label_row = _first_at_or_after(changed, anchors, end)
    right = np.flatnonzero(table.state[:, Y] < site.lane_line_y(table.state[:, X]))
    before = np.searchsorted(right, end, side="right") - 1
    last_right = np.where(before >= 0, right[np.maximum(before, 0)], NONE) if len(right) else np.full_like(end, NONE)
    crossing_row = np.maximum(last_right + 1, begin)  # a track that was never to the right has crossed already

    def since(row: Int[np.ndarray, "scene"], found: Bool[np.ndarray, "scene"]) -> Float[np.ndarray, "scene"]:
        return np.where(found, (table.frame[np.where(found, row, 0)] - table.frame[anchors]) * STEP, np.nan)

    return since(label_row, label_row != NONE), since(crossing_row, crossing_row <= end), since(end, end >= 0)


def _first_at_or_after(
    rows: Int[np.ndarray, "candidate"], start: Int[np.ndarray, "scene"], end: Int[np.ndarray, "scene"]
) -> Int[np.ndarray, "scene"]:
    """Returns the first of `rows` between start and end (both included), or NONE."""
    if not len(rows):
        return np.full_like(start, NONE)
    place = np.searchsorted(rows, start)
    found = rows[np.minimum(place, len(rows) - 1)]
    return np.where((place < len(rows)) & (found <= end), found, NONE)
