"""Cleaning of a raw recording: fill skipped frames, smooth, derive velocity and acceleration, sample at 0.2 s.

The filter runs once over the concatenation of all tracks and is then made exact at the edges of each, so that it
equals ``scipy.signal.savgol_filter(mode="interp")`` applied to every track by itself.
"""

from dataclasses import dataclass, replace

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int
from scipy.ndimage import convolve1d
from scipy.signal import savgol_coeffs, savgol_filter

from rampcast.arguments import expected
from rampcast.errors import RecordingError
from rampcast.horizon import SAME_STEP, STEP
from rampcast.recording import columns as c
from rampcast.recording.recording import KEY, READ_FIRST, Recording
from rampcast.recording.resampling import EVEN_STEP, resample

HALF_WINDOW = 1.0  # [s] 21 samples at 10 Hz; the paper gives none, fixed on the method page, section 3
WINDOW = 21  # samples at 10 Hz
ORDER = 3  # likewise
LONGEST_FILLED_GAP = 5.0  # [s] a longer hole is more likely a reused id than a lost vehicle: it is left open
SHORTEST_STEP = 0.005  # [s] 200 Hz: no sensor on a road is as fast, and a second of it is a window
SHORTEST_TRACK = 5  # frames; the fewest that a cubic can smooth
IMPOSSIBLE_ACCELERATION = 8.0  # [m/s^2] about the grip of a dry road (mu = 0.8); no road vehicle exceeds it


@dataclass(frozen=True)
class CleaningReport:
    """What cleaning changed.

    Attributes:
        rows: rows that came in.
        duplicate_rows: rows dropped because the same (recording, vehicle, frame) came before.
        filled_rows: rows added by interpolation of skipped frames.
        open_gaps: holes longer than `LONGEST_FILLED_GAP`, left open.
        short_tracks: tracks of fewer than `SHORTEST_TRACK` frames, left out.
        short_track_rows: rows of those.
        resampled_rows: rows at 0.1 s made from frames of a rate that does not fit 0.2 s; 0 at any other rate.
        mean_shift_x, mean_shift_y, largest_shift_x, largest_shift_y: |smoothed - raw| over observed rows [m].
        impossible_before, impossible_after: share of rows with |a| above `IMPOSSIBLE_ACCELERATION`.
    """

    rows: int
    duplicate_rows: int
    filled_rows: int
    open_gaps: int
    short_tracks: int
    short_track_rows: int
    resampled_rows: int
    mean_shift_x: float
    mean_shift_y: float
    largest_shift_x: float
    largest_shift_y: float
    impossible_before: float
    impossible_after: float


def clean(recording: Recording) -> tuple[Recording, CleaningReport]:
    """Returns the recording smoothed and sampled at 0.2 s, with v, u, a, e, and what that changed.

    The filter is centred: a state knows of the second that follows it. To forecast without that, cut the recording at
    the moment of the forecast first; docs/methods.md, section 2, says how much it matters.

    Tracks whose time step does not divide 0.2 s are interpolated to 0.1 s first.

    Source: method page, section 3; the paper, section "Data Set".

    Raises:
        RecordingError: it is already smoothed, has no rows, or its time step is longer than 0.2 s.
    """
    _check(recording)
    unique = recording.tracks.unique(subset=KEY, keep="first", maintain_order=True).sort(KEY)
    starts = _track_starts(unique, longest_gap=round(LONGEST_FILLED_GAP / recording.time_step))
    kept, kept_starts, short_tracks = _without_short_tracks(unique, starts)
    filled, starts = _fill_gaps(kept, kept_starts)
    open_gaps = len(starts) + short_tracks - unique.select(KEY[:2]).unique().height
    even, starts, time_step, too_short = _evenly(filled, starts, recording.time_step)
    raw = {name: even[name].to_numpy() for name in (c.X, c.Y)}
    derived = _derive(raw, starts, time_step=time_step)
    smoothed = even.with_columns(**{name: pl.Series(values) for name, values in derived.items()})
    every = round(STEP / time_step)
    sampled = smoothed.filter(pl.col(c.FRAME) % every == 0).with_columns(pl.col(c.FRAME) // every)
    report = CleaningReport(
        rows=recording.tracks.height,
        duplicate_rows=recording.tracks.height - unique.height,
        filled_rows=filled.height - kept.height,
        open_gaps=open_gaps,
        short_tracks=short_tracks + too_short,
        short_track_rows=unique.height - kept.height,
        resampled_rows=even.height if time_step != recording.time_step else 0,
        **_shifts(raw, derived, even[c.OBSERVED].to_numpy()),
        impossible_before=_share_impossible(_second_derivative(raw[c.X], starts, time_step=time_step)),
        impossible_after=_share_impossible(derived[c.A]),
    )
    tracks = sampled.select(c.SMOOTHED_SCHEMA.keys()).cast(pl.Schema(c.SMOOTHED_SCHEMA))
    return replace(recording, tracks=tracks, time_step=STEP, raw=recording), report


def smooth_tracks(
    values: Float[np.ndarray, "row"], starts: Int[np.ndarray, "track"], *, window: int = WINDOW
) -> Float[np.ndarray, "row"]:
    """Returns a Savitzky-Golay filtered copy of the values, each track by itself, exact at its edges.

    A track shorter than the window is filtered with the longest odd window that fits it.

    Args:
        values: the tracks one after another, equally spaced in time [any unit].
        starts: row where each track begins, growing; the first is 0.
        window: samples that the filter spans, odd.
    """
    half = window // 2
    smoothed = convolve1d(values, savgol_coeffs(window, ORDER, use="dot")[::-1], mode="nearest")
    lengths = np.diff(np.append(starts, len(values)))
    long = starts[lengths >= window]
    ends = (starts + lengths)[lengths >= window]
    whole_window = _filter_matrix(window, window)
    head = long[:, None] + np.arange(window)
    tail = ends[:, None] - window + np.arange(window)
    smoothed[head[:, :half]] = values[head] @ whole_window[:half].T
    smoothed[tail[:, -half:]] = values[tail] @ whole_window[-half:].T
    for length in np.unique(lengths[lengths < window]):
        rows = starts[lengths == length][:, None] + np.arange(length)
        smoothed[rows] = values[rows] @ _filter_matrix(int(length), window).T
    return smoothed


def derivative(
    values: Float[np.ndarray, "row"], starts: Int[np.ndarray, "track"], *, time_step: float
) -> Float[np.ndarray, "row"]:
    """Returns the time derivative of each track by second-order differences, one-sided at its two ends.

    Args:
        values: the tracks one after another, three rows or more each.
        starts: row where each track begins, growing; the first is 0.
        time_step: time between rows [s].
    """
    slope = np.empty_like(values)
    slope[1:-1] = (values[2:] - values[:-2]) / (2 * time_step)
    first, last = starts, np.append(starts[1:], len(values)) - 1
    slope[first] = (-3 * values[first] + 4 * values[first + 1] - values[first + 2]) / (2 * time_step)
    slope[last] = (3 * values[last] - 4 * values[last - 1] + values[last - 2]) / (2 * time_step)
    return slope


def _check(recording: Recording) -> None:
    expected(Recording, recording, name="recording", advice=READ_FIRST)
    if recording.is_smoothed:
        raise RecordingError("this recording is smoothed already; clean the raw one")
    if recording.tracks.is_empty():
        raise RecordingError("this recording has no rows, so there is nothing to smooth")
    if recording.time_step < SHORTEST_STEP:
        raise RecordingError(
            f"expected a time step of {SHORTEST_STEP} s or more, got {recording.time_step:g} s: are the times in "
            "hours, days or milliseconds? A mapping states their unit (--mapping, docs/formats/plain.md)"
        )
    if recording.time_step > STEP + SAME_STEP:
        raise RecordingError(
            f"expected a time step of up to {STEP} s, got {recording.time_step:g} s: too much happens between two such "
            "frames. Export the recording at 10 Hz or more (SUMO: --step-length 0.1)"
        )


def _divides_sampling(time_step: float) -> bool:
    return abs(round(STEP / time_step) * time_step - STEP) <= SAME_STEP


def _evenly(
    tracks: pl.DataFrame, starts: Int[np.ndarray, "track"], time_step: float
) -> tuple[pl.DataFrame, Int[np.ndarray, "kept"], float, int]:
    """Returns the tracks at a time step that divides 0.2 s, the starts, that step [s], and the tracks left out."""
    if _divides_sampling(time_step):
        return tracks, starts, time_step, 0
    even, even_starts = resample(tracks, starts, time_step=time_step)
    even, even_starts, _ = _without_short_tracks(even, even_starts)
    return even, even_starts, EVEN_STEP, len(starts) - len(even_starts)


def _track_starts(tracks: pl.DataFrame, *, longest_gap: int) -> Int[np.ndarray, "track"]:
    """Returns the rows where a track begins: a new vehicle, or the same id after a hole too long to fill."""
    same = tracks.select(
        (pl.col(c.RECORDING) == pl.col(c.RECORDING).shift(1))
        & (pl.col(c.VEHICLE) == pl.col(c.VEHICLE).shift(1))
        & (pl.col(c.FRAME) - pl.col(c.FRAME).shift(1) <= longest_gap)
    )
    return np.flatnonzero(~same.to_series().fill_null(False).to_numpy())


def _without_short_tracks(
    tracks: pl.DataFrame, starts: Int[np.ndarray, "track"]
) -> tuple[pl.DataFrame, Int[np.ndarray, "kept"], int]:
    lengths = np.diff(np.append(starts, tracks.height))
    long = lengths >= SHORTEST_TRACK
    if not long.any():
        raise RecordingError(
            f"{', '.join(map(str, tracks[c.RECORDING].unique(maintain_order=True)))}: no track has {SHORTEST_TRACK} "
            f"frames or more, the longest has {lengths.max()}; give a longer recording, or, if this one is long, the "
            "column that keeps a vehicle's id"
        )
    kept = tracks.filter(pl.Series(np.repeat(long, lengths)))
    kept_starts = np.concatenate([[0], np.cumsum(lengths[long])[:-1]])
    return kept, kept_starts, int(np.count_nonzero(~long))


def _fill_gaps(tracks: pl.DataFrame, starts: Int[np.ndarray, "track"]) -> tuple[pl.DataFrame, Int[np.ndarray, "track"]]:
    """Returns the tracks with skipped frames filled: x and y linearly, all else from the nearest frame."""
    frame = tracks[c.FRAME].to_numpy().astype(np.int64)
    lengths = np.diff(np.append(starts, len(frame)))
    spans = frame[starts + lengths - 1] - frame[starts] + 1
    new_starts = np.concatenate([[0], np.cumsum(spans)[:-1]])
    position = frame - np.repeat(frame[starts], lengths) + np.repeat(new_starts, lengths)
    observed = np.zeros(int(spans.sum()), dtype=bool)
    observed[position] = True
    before = np.cumsum(observed) - 1
    after = np.where(observed, before, np.minimum(before + 1, len(frame) - 1))
    new_frame = np.arange(len(observed)) - np.repeat(new_starts - frame[starts], spans)
    span = np.maximum(frame[after] - frame[before], 1)
    share = (new_frame - frame[before]) / span
    nearest = np.where(share <= 0.5, before, after)
    x, y = (
        values[before] + share * (values[after] - values[before])
        for values in (tracks[c.X].to_numpy(), tracks[c.Y].to_numpy())
    )
    filled = tracks[nearest].with_columns(
        pl.Series(c.FRAME, new_frame, dtype=pl.Int32),
        pl.Series(c.X, x),
        pl.Series(c.Y, y),
        pl.Series(c.OBSERVED, observed),
    )
    return filled, new_starts


def _derive(
    raw: dict[str, Float[np.ndarray, "row"]], starts: Int[np.ndarray, "track"], *, time_step: float
) -> dict[str, Float[np.ndarray, "row"]]:
    """Returns smoothed positions and their first and second derivatives, by column name."""
    window = 2 * round(HALF_WINDOW / time_step) + 1
    x, y = (smooth_tracks(raw[name], starts, window=window) for name in (c.X, c.Y))
    v, u = derivative(x, starts, time_step=time_step), derivative(y, starts, time_step=time_step)
    a, e = derivative(v, starts, time_step=time_step), derivative(u, starts, time_step=time_step)
    return {c.X: x, c.Y: y, c.V: v, c.U: u, c.A: a, c.E: e}


def _second_derivative(
    values: Float[np.ndarray, "row"], starts: Int[np.ndarray, "track"], *, time_step: float
) -> Float[np.ndarray, "row"]:
    return derivative(derivative(values, starts, time_step=time_step), starts, time_step=time_step)


def _share_impossible(acceleration: Float[np.ndarray, "row"]) -> float:
    return float(np.mean(np.abs(acceleration) > IMPOSSIBLE_ACCELERATION))


def _shifts(
    raw: dict[str, Float[np.ndarray, "row"]],
    derived: dict[str, Float[np.ndarray, "row"]],
    observed: Bool[np.ndarray, "row"],
) -> dict[str, float]:
    shifts = {name: np.abs(derived[name] - raw[name])[observed] for name in (c.X, c.Y)}
    return {f"mean_shift_{name}": float(values.mean()) for name, values in shifts.items()} | {
        f"largest_shift_{name}": float(values.max()) for name, values in shifts.items()
    }


def _filter_matrix(length: int, longest: int) -> Float[np.ndarray, "length length"]:
    """Returns the matrix that filters a track of that many samples with the longest window that fits."""
    window = min(longest, length if length % 2 else length - 1)
    return np.asarray(savgol_filter(np.eye(length), window, ORDER, axis=0, mode="interp"))
