"""Recordings: one table of trajectories in SI units, the site it was made at, and its cleaning."""

from rampcast.recording.recording import Recording, concatenate, read_recording, write_recording, write_recordings
from rampcast.recording.sites import Lane, Note, Site, Window, load_site, site_names, write_site
from rampcast.recording.smoothing import CleaningReport, clean

__all__ = [
    "CleaningReport",
    "Lane",
    "Note",
    "Recording",
    "Site",
    "Window",
    "clean",
    "concatenate",
    "load_site",
    "read_recording",
    "site_names",
    "write_recording",
    "write_recordings",
    "write_site",
]
