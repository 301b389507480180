"""The errors that rampcast raises for a user's mistake.

RampcastError
├── FormatError      a file is not what its format says: file, line, column, what was expected
├── SiteError        a site is unknown, or its data file is wrong
├── RecordingError   a recording lacks what the asked-for step needs
├── ModelError       a model folder is missing, damaged, or made by another version
├── OutputError      something cannot be written where it was asked for, or would be lost
├── DownloadError    a file cannot be got, or is not what was asked for
└── MissingExtra     an optional part is not installed
"""


class RampcastError(Exception):
    """Returns a message that says what was expected, what came, where, and what to do."""


class FormatError(RampcastError):
    """A file is not what its format says."""


class SiteError(RampcastError):
    """A site is unknown, or its data file is wrong."""


class RecordingError(RampcastError):
    """A recording lacks what the asked-for step needs."""


class ModelError(RampcastError):
    """A model folder is missing, damaged, or made by another version."""


class OutputError(RampcastError):
    """Something cannot be written where it was asked for, or would be lost."""


class DownloadError(RampcastError):
    """A file cannot be got, or is not what was asked for."""


class MissingExtra(RampcastError):
    """An optional part of rampcast is not installed."""
