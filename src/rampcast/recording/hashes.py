"""What tells two recordings apart, whatever they are called."""

import hashlib
from dataclasses import replace

import numpy as np
import polars as pl

from rampcast.recording import columns as c
from rampcast.recording.recording import Recording


def recording_hash(recording: Recording) -> str:
    """Returns the SHA-256 of a recording's tracks."""
    digest = hashlib.sha256()
    for name in sorted(recording.tracks.columns):
        values = recording.tracks[name]
        numbers = values if values.dtype.is_numeric() else values.cast(pl.String).rank("dense")
        digest.update(name.encode())
        digest.update(np.ascontiguousarray(numbers.to_numpy()).tobytes())
    return digest.hexdigest()


def window_hashes(recording: Recording) -> tuple[str, ...]:
    """Returns the SHA-256 of the tracks of each window, without its name."""
    unnamed = pl.lit("")
    return tuple(
        recording_hash(replace(window, tracks=window.tracks.with_columns(unnamed.alias(c.RECORDING))))
        for window in map(recording.window, recording.names)
    )
