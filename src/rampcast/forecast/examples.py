"""Training moments of a recording: the whole traffic from the past alone, and what became of its vehicles."""

from collections.abc import Callable, Iterator

import numpy as np
import polars as pl
from jaxtyping import Bool, Int

from rampcast.errors import RecordingError
from rampcast.forecast.learning import Training
from rampcast.forecast.protocol import NEEDS_RAW
from rampcast.horizon import PAST, STEP
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.traffic.anchors import need_ramp
from rampcast.traffic.around import joined, merge_scenes_at
from rampcast.traffic.merge_scenes import MergeScenes
from rampcast.traffic.moments import Traffic, traffic_at_times
from rampcast.traffic.outcomes import outcomes
from rampcast.traffic.situation import Situation, forecastable, joined_situations, situation_of_traffic

MOST_IN_LANE = 10_000  # vehicles of main lanes, and as many of the ramp, at different moments: more say the same
Tell = Callable[[int, int], None]  # moments done, moments in all


def training_of(recording: Recording, *, spacing: float, tell: Tell) -> Training:
    """Returns the vehicles of a recording at regular moments, and all traffic around them.

    All on-ramp vehicles are taken, and of the others as many as `MOST_IN_LANE`, spread evenly over the moments.

    Args:
        recording: smoothed by `clean`, which keeps the raw one.
        spacing: time between moments [s], a multiple of 0.2.
        tell: called as moments are done.

    Raises:
        RecordingError: the raw recording is not there, its site has no ramp, or no vehicle is there for long enough.
    """
    need_ramp(recording)
    if recording.raw is None:
        raise RecordingError(NEEDS_RAW)
    situation, vehicle, scenes, anchor = _known(recording, spacing, tell)
    became = outcomes(recording, anchor)
    # the truth counts from where the vehicle is by its past alone
    off = (recording.tracks[c.X].to_numpy()[anchor] - scenes.own.x[:, 0, -1])[:, None]
    training = Training(
        situation=situation,
        vehicle=vehicle,
        scenes=scenes.only_seen(),
        truth=became.displacement + off,
        leader_truth=became.leader_displacement + off,
        change_time=np.where(scenes.may_merge, became.change_time, np.nan),
        seen_for=became.seen_for,
        group=became.group,
        t0=became.t0,
        change_rate=change_rate(recording),
    )
    return training.select(_chosen(scenes.may_merge))


def _known(
    recording: Recording, spacing: float, tell: Tell
) -> tuple[Situation, Int[np.ndarray, "row"], MergeScenes, Int[np.ndarray, "row"]]:
    """Returns what is known of the vehicles at each moment: all traffic, their places in it, scenes; and their rows."""
    parts, anchors = [], []
    for traffic, rows in _moments(recording, spacing, tell):
        vehicles, anchor = _seen_later(traffic, rows)
        if len(vehicles):
            scenes = merge_scenes_at(traffic, forecastable(traffic)[vehicles])
            parts.append((situation_of_traffic(traffic), vehicles, scenes))
            anchors.append(anchor)
    if not parts:
        raise RecordingError(
            f"no vehicle of {', '.join(recording.names)} is seen for {PAST * STEP:g} s: nothing to learn from"
        )
    situation = joined_situations([part[0] for part in parts])
    vehicle = np.concatenate([part[1] + at for part, at in zip(parts, situation.first, strict=False)])
    return situation, vehicle, joined([part[2] for part in parts]), np.concatenate(anchors)


def change_rate(recording: Recording) -> float:
    """Returns how often vehicles go from a main lane to another [1/s]."""
    main = [lane.number for lane in recording.site.lanes if lane.role == "main"]
    rows = recording.tracks.filter(pl.col(c.LANE).is_in(main)).sort(c.RECORDING, c.VEHICLE, c.FRAME)
    same = (pl.col(c.RECORDING) == pl.col(c.RECORDING).shift(1)) & (pl.col(c.VEHICLE) == pl.col(c.VEHICLE).shift(1))
    changed = rows.select((same & (pl.col(c.LANE) != pl.col(c.LANE).shift(1))).sum()).item()
    return float(changed or 0) / max(len(rows) * STEP, 1.0)


def _moments(recording: Recording, spacing: float, tell: Tell) -> Iterator[tuple[Traffic, pl.DataFrame]]:
    """Yields the traffic at each moment, and the rows of the smoothed recording then."""
    assert recording.raw is not None
    every = round(spacing / STEP)
    if every < 1 or abs(every * STEP - spacing) > 1e-6:
        raise RecordingError(f"expected a multiple of {STEP} s between training moments, got {spacing} s")
    rows = recording.tracks.select(c.RECORDING, c.VEHICLE, c.FRAME, c.OBSERVED).with_row_index("row")
    rows = rows.filter(pl.col(c.OBSERVED) & (pl.col(c.FRAME) % every == 0)).sort(c.RECORDING, c.FRAME, c.VEHICLE)
    total = rows.select(c.RECORDING, c.FRAME).n_unique()
    done = 0
    for (window,), some in rows.group_by(c.RECORDING, maintain_order=True):
        by_frame = some.partition_by(c.FRAME, maintain_order=True)
        times = np.array([part[c.FRAME][0] for part in by_frame]) * STEP
        for traffic, part in zip(traffic_at_times(recording.raw, str(window), times), by_frame, strict=True):
            yield traffic, part
            done += 1
            tell(done, total)


def _seen_later(traffic: Traffic, rows: pl.DataFrame) -> tuple[Int[np.ndarray, "row"], Int[np.ndarray, "row"]]:
    """Returns which of the vehicles that can be forecast are in those rows, and in which row each."""
    ids = traffic.vehicle[forecastable(traffic)]
    known = rows[c.VEHICLE].to_numpy()
    place = np.minimum(np.searchsorted(known, ids), len(known) - 1)
    there = np.flatnonzero(known[place] == ids)
    return there, rows["row"].to_numpy()[place[there]].astype(np.int64)


def _chosen(merging: Bool[np.ndarray, "row"]) -> Int[np.ndarray, "chosen"]:
    """Returns which vehicles are learned from."""
    kept = [
        rows[:: -(-len(rows) // MOST_IN_LANE)]
        for rows in (np.flatnonzero(merging), np.flatnonzero(~merging))
        if len(rows)
    ]
    return np.sort(np.concatenate(kept))
