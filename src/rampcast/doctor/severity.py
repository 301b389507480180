"""How bad a finding is."""

from enum import Enum


class Severity(Enum):
    """How bad a finding is, the worst first."""

    SPOILS = "spoils a forecast"
    WARNING = "warning"
    NOTE = "note"
