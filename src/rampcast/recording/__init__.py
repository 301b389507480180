"""Recordings: one table of trajectories in SI units, and its cleaning."""

from rampcast.recording.recording import Recording, concatenate, read_recording, write_recording, write_recordings
from rampcast.recording.smoothing import CleaningReport, clean

__all__ = [
    "CleaningReport",
    "Recording",
    "clean",
    "concatenate",
    "read_recording",
    "write_recording",
    "write_recordings",
]
