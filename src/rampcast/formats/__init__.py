"""Formats: files of others to `Recording`. Units, axes and reference points are converted here and nowhere else."""

from rampcast.formats.format import Format, Needs, table_of
from rampcast.formats.reading import convert_all, read, read_all, read_any, why_not
from rampcast.formats.registry import FORMATS, all_formats
from rampcast.recording.reading import BadRow, BadRows, ReadReport

__all__ = [
    "FORMATS",
    "BadRow",
    "BadRows",
    "Format",
    "Needs",
    "ReadReport",
    "all_formats",
    "convert_all",
    "read",
    "read_all",
    "read_any",
    "table_of",
    "why_not",
]
