"""The data doctor: what is in a recording, what is wrong with it, where, how bad it is, and what to do about it."""

from rampcast.doctor.checks import CHECKS
from rampcast.doctor.diagnosis import Diagnosis, RoadDiagnosis, doctor, examine
from rampcast.doctor.distributions import Distribution
from rampcast.doctor.finding import Check, Finding, Severity
from rampcast.doctor.summary import Summary, inspect

__all__ = [
    "CHECKS",
    "Check",
    "Diagnosis",
    "Distribution",
    "Finding",
    "RoadDiagnosis",
    "Severity",
    "Summary",
    "doctor",
    "examine",
    "inspect",
]
