"""What a training is worth: both forecasters on the last minutes of a recording, which neither has seen."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from rampcast.errors import RecordingError
from rampcast.forecast.calibrated import Calibrated
from rampcast.forecast.learning import Training
from rampcast.forecast.stages import Stages
from rampcast.horizon import FUTURE, STEP
from rampcast.models.correction import KNOTS
from rampcast.recording import Recording
from rampcast.recording.recording import seconds_of
from rampcast.traffic.platoons import HISTORY

SHARE = 0.2  # of the time of each window that is held out
MOST_MOMENTS = 60  # that are scored: at 60 vehicles each the error is known to a few percent
LEAST_SECONDS = 45.0  # of traffic: of less, nothing holds in other minutes
LEAST_MERGES = 1  # vehicles


@dataclass(frozen=True)
class HeldOut:
    """Mean errors of places on the minutes held out [m], and shares of truths in 90 % bands, at `correction.KNOTS`.

    Attributes:
        vehicles: forecasts that were scored.
        trained, trained_coverage: of the forecaster that was trained on the other minutes.
        start, start_coverage: of the one that it started from.
        steady: of constant speed.
    """

    vehicles: int
    trained: Float[np.ndarray, "knot"]
    trained_coverage: Float[np.ndarray, "knot"]
    start: Float[np.ndarray, "knot"]
    start_coverage: Float[np.ndarray, "knot"]
    steady: Float[np.ndarray, "knot"]


def check_enough(training: Training, recording: Recording) -> None:
    """Checks that a recording shows what is to be learned.

    Args:
        training: what is learned from it.
        recording: smoothed.

    Raises:
        RecordingError: nobody merges in it, or it lasts less than `LEAST_SECONDS`.
    """
    merged = training.merging & np.isfinite(training.change_time)
    merges = len(set(training.group[merged].tolist()))
    lasts = sum(seconds_of(recording).values())
    if merges >= LEAST_MERGES and lasts >= LEAST_SECONDS:
        return
    raise RecordingError(
        f"{', '.join(recording.names)}: too little to learn from: {merges} vehicles merge in {lasts:.0f} s; "
        f"expected {LEAST_MERGES} or more in {LEAST_SECONDS:.0f} s or more. Give more of that site's recordings, or "
        'forecast without training: `rampcast forecast` without --model, `rc.load("pretrained")` in Python'
    )


def held_out(
    training: Training, start: Calibrated, learn: Callable[[Training], Calibrated], stages: Stages
) -> HeldOut | None:
    """Returns the scores of what the first four fifths of each window teach, on the last; None if nothing is left."""
    window = np.array([name.split("-")[0] for name in training.group.tolist()])
    train, test = np.zeros(len(training), dtype=bool), np.zeros(len(training), dtype=bool)
    for one in np.unique(window):
        mine = window == one
        border = np.quantile(training.t0[mine], 1.0 - SHARE)
        train |= mine & (training.t0 + FUTURE * STEP < border)
        test |= mine & (training.t0 - (HISTORY - 1) * STEP >= border)
    if not train.any() or not test.any():
        return None

    def score() -> HeldOut:
        some = training.select(spread(training, np.flatnonzero(test)))
        truth = some.truth[:, KNOTS]
        trained = errors_of(learn(training.select(np.flatnonzero(train))), some, truth)
        speed = np.maximum(some.scenes.own.v[:, 0, -1], 0.0)
        steady = np.nanmean(np.abs(speed[:, None] * STEP * (KNOTS + 1) - truth), axis=0)
        return HeldOut(len(some), *trained, *errors_of(start, some, truth), steady)

    return stages.kept("held_out", score)


def spread(training: Training, rows: Int[np.ndarray, "row"]) -> Int[np.ndarray, "chosen"]:
    """Returns those of the rows that are in some moments, evenly spread."""
    moment = training.situation.moment[training.vehicle[rows]]
    moments = np.unique(moment)
    return rows[np.isin(moment, moments[:: -(-len(moments) // MOST_MOMENTS)])]


def errors_of(
    model: Calibrated, training: Training, truth: Float[np.ndarray, "row knot"]
) -> tuple[Float[np.ndarray, "knot"], Float[np.ndarray, "knot"]]:
    """Returns mean errors of the medians, and shares of truths in the 90 % bands; a moment is forecast as a whole."""
    found = model.quantiles(training, (0.05, 0.5, 0.95))
    inside = np.where(np.isfinite(truth), (found[0] <= truth) & (truth <= found[2]), np.nan)
    return np.nanmean(np.abs(found[1] - truth), axis=0), np.nanmean(inside, axis=0)
