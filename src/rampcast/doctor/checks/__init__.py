"""The doctor's checks: a module for each kind of fault, and one table of what counts, how bad it is, and what to do."""

from rampcast.doctor.checks.table import CHECKS

__all__ = ["CHECKS"]
