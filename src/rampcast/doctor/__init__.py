"""The data doctor: what is wrong with a recording, where, how bad it is, and what to do about it."""

from collections.abc import Sequence

from rampcast.doctor.checks import CHECKS, reading
from rampcast.doctor.checks.ramp import facts
from rampcast.doctor.distributions import distributions
from rampcast.doctor.finding import (
    Check,
    Diagnosis,
    Distribution,
    Faults,
    Finding,
    NotAssessed,
    Severity,
    Unassessed,
    spoils,
    to_dict,
)
from rampcast.doctor.picture_tables import pictures
from rampcast.doctor.subject import subject_of
from rampcast.formats import ReadReport
from rampcast.recording import Recording

__all__ = [
    "CHECKS",
    "Check",
    "Diagnosis",
    "Distribution",
    "Finding",
    "Severity",
    "Unassessed",
    "examine",
    "examine_all",
    "spoils",
    "to_dict",
]


def examine(recording: Recording, report: ReadReport | None = None, *, checks: Sequence[Check] = CHECKS) -> Diagnosis:
    """Returns what is wrong with a recording, and what could not be told.

    Args:
        recording: raw or smoothed; raw tells more.
        report: what reading its files found; None if it was not read from files.
        checks: those to make.
    """
    subject = subject_of(recording, report)
    findings, sound, unassessed = _judged([(check, check.look(subject)) for check in checks])
    return Diagnosis(
        site=recording.site.name,
        source=recording.source,
        simulated=recording.site.simulated,
        windows=tuple(recording.names),
        time_step=recording.time_step,
        vehicles=len(subject.starts),
        rows=recording.tracks.height,
        findings=findings,
        sound=sound,
        unassessed=unassessed,
        distributions=distributions(subject),
        facts=facts(subject),
        pictures=pictures(subject, findings),
    )


def examine_all(
    recordings: Sequence[Recording], report: ReadReport | None = None
) -> tuple[tuple[Diagnosis, ...], tuple[Finding, ...]]:
    """Returns what is wrong with each recording of some files, and with these files where they hold several roads.

    What reading counted is not known road by road, so it is said once and spoils no single road.

    Args:
        recordings: the roads.
        report: what reading the files found; None if nothing was read.
    """
    if len(recordings) == 1:
        return (examine(recordings[0], report),), ()
    of_files = [(check, reading.in_files(report, check.name)) for check in CHECKS if check.name in reading.OF_FILES]
    of_roads = [check for check in CHECKS if check.name not in reading.OF_FILES or check.name in reading.OF_ROWS]
    found, _, _ = _judged(of_files)
    return tuple(examine(one, checks=of_roads) for one in recordings), found


def _judged(
    outcomes: Sequence[tuple[Check, Faults | NotAssessed]],
) -> tuple[tuple[Finding, ...], tuple[Check, ...], tuple[Unassessed, ...]]:
    """Returns what is a finding, the worst first, which checks found nothing to speak of, and what is not known."""
    findings, sound, unassessed = [], [], []
    for check, outcome in outcomes:
        if isinstance(outcome, NotAssessed):
            unassessed.append(Unassessed(check, outcome.reason))
            continue
        finding = Finding(check, Severity.NOTE, outcome)
        severity = check.severity(finding.share) if finding.count else None
        if severity is None:
            sound.append(check)
        else:
            findings.append(Finding(check, severity, outcome))
    order = list(Severity)
    findings.sort(key=lambda finding: (order.index(finding.severity), -finding.share))
    return tuple(findings), tuple(sound), tuple(unassessed)
