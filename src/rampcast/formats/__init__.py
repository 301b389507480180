"""Formats: files of others to `Recording`. Units, axes and reference points are converted here and nowhere else."""

from rampcast.formats.readers.ngsim.ngsim import read_ngsim
from rampcast.formats.registry import FORMATS, Format, convert_all, read_all, read_any, why_not
from rampcast.recording.reading import BadRow, BadRows, ReadReport

__all__ = [
    "FORMATS",
    "BadRow",
    "BadRows",
    "Format",
    "ReadReport",
    "convert_all",
    "read_all",
    "read_any",
    "read_ngsim",
    "why_not",
]
