"""From a stranger's table to a mapping, a site and a picture of it."""

import shlex
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import tomli_w

from rampcast.doctor import Severity, examine
from rampcast.errors import FormatError
from rampcast.files import write_outputs
from rampcast.formats import read_all, read_any
from rampcast.formats.files.head import heads_of
from rampcast.formats.reading import check_is_table, format_of
from rampcast.plots.site_picture import write_site_picture
from rampcast.recording import Recording
from rampcast.recording.reading import ReadReport
from rampcast.roads.ramp import SOURCE, mirrored, road_named, with_ramp, without_ramp
from rampcast.sites import Site, write_site
from rampcast.start.asking import NOTHING, Answers, Ask, Proposal, Question, StartError, answer_to, nobody_answers
from rampcast.start.point import by_overlaps
from rampcast.start.proposal import propose
from rampcast.start.ramp_lane import edges_of, is_ramp
from rampcast.start.sample import sample_of_head
from rampcast.start.wrong_guess import wrong_in

MAPPING, SITE, PICTURE, COMMANDS = "mapping.toml", "site.toml", "site.png", "commands.txt"
NONE: Final = "none"
BETTER: Final = {
    "target_lane": "--target-lane NUMBER",
    "gore": "--gore METRES",
    "ramp_end": "--ramp-end METRES (inf: it goes on). Forecasts hold that nobody drives on the ramp beyond it",
    "merge_zone": "--merge-zone FROM TO",
}


@dataclass(frozen=True)
class Started:
    """What a table was taken for.

    Attributes:
        format: of the files; "" of a table of its own, which the mapping describes.
        mapping: the values of mapping.toml; {} where the format is known.
        reasons: what each was told by, in words.
        recording: as it is read with them.
        site: the road, with its ramp.
        report: what reading found.
        commands: that repeat it, and go on.
        folder: where the files are.
    """

    format: str
    mapping: dict[str, Any]
    reasons: tuple[str, ...]
    recording: Recording
    site: Site
    report: ReadReport
    commands: tuple[str, ...]
    folder: Path

    def to_dict(self) -> dict[str, Any]:
        """Returns what was told as plain values, for json."""
        told = {"format": self.format, "mapping": self.mapping, "reasons": list(self.reasons)}
        return told | {"commands": list(self.commands), "reading": self.report.to_dict()}


def start(
    files: Sequence[Path],
    out: Path,
    *,
    answers: Answers = NOTHING,
    ask: Ask = nobody_answers,
    tell: Callable[[str], None] = lambda text: None,
) -> Started:
    """Writes mapping.toml, site.toml, a picture and the commands that repeat it, and returns what was found.

    Args:
        files: of one place, in any form.
        out: folder to write to.
        answers: what is known beforehand.
        ask: asks what cannot be told.
        tell: is told what was found, as soon as it is.

    Raises:
        StartError: nobody answers a question, or what was proposed cannot be right.
        RampcastError: a file cannot be read, or nothing be written.
    """
    taken_for = known_format(files)
    proposal = Proposal() if taken_for else proposed(files, answers, ask)
    for reason in [f"format: {taken_for}"] if taken_for else proposal.reasons:
        tell(reason)
    recording, report = _read_by_point(files, proposal, answers, ask, tell)
    recording = mirrored(recording) if answers.mirrored else recording
    _check(recording)
    tell(f"road: {recording.site.length:.0f} m, {len(recording.site.lanes)} lanes, {len(recording.names)} part(s)")
    site, why = _with_ramp(recording, answers, ask)
    guesses = _guesses(site)
    for reason in (f"ramp: {why}", *guesses):
        tell(reason)
    commands = tuple(_commands(files, out, mapping=bool(proposal.values)))
    made = _written(files, out, proposal, site, commands)
    verdict = _verdict(made)
    tell(verdict)
    reasons = (*proposal.reasons, f"ramp: {why}", *guesses, verdict)
    return Started(taken_for, proposal.values, reasons, made, site, report, commands, out)


def _written(files: Sequence[Path], out: Path, proposal: Proposal, site: Site, commands: Sequence[str]) -> Recording:
    """Writes what was found, and returns the recording as the commands will read it."""
    with write_outputs(out) as new:
        if proposal.values:
            (new / MAPPING).write_text(_toml(proposal), encoding="utf-8")
        write_site(site, new / SITE)
        made, _ = read_any([*files], mapping=new / MAPPING if proposal.values else None, site=new / SITE)
        write_site_picture(made, new / PICTURE)
        (new / COMMANDS).write_text("\n".join(commands) + "\n", encoding="utf-8")
    return made


def known_format(files: Sequence[Path]) -> str:
    """Returns the title of the format that files are told to be in; "" where they are in none."""
    heads = heads_of([*files])
    try:
        return format_of(heads).title
    except FormatError:
        return ""


def proposed(files: Sequence[Path], answers: Answers = NOTHING, ask: Ask = nobody_answers) -> Proposal:
    """Returns the mapping that the first of some files proposes.

    Raises:
        StartError: it asks what nobody answers.
        FormatError: it is no table.
    """
    name, head = answers.name or files[0].name.partition(".")[0], heads_of([files[0]])[0]
    check_is_table(head)
    return propose(sample_of_head(head), replace(answers, name=name), ask)


def _toml(proposal: Proposal) -> str:
    reasons = "".join(f"# {reason}\n" for reason in proposal.reasons)
    head = "# What this table is, as `rampcast start` told it; look through it.\n"
    return f"{head}{reasons}\n{tomli_w.dumps(proposal.values)}"


def _read(files: Sequence[Path], values: dict[str, Any], answers: Answers, ask: Ask) -> tuple[Recording, ReadReport]:
    """Returns the recording of the road that is meant, and what reading found."""
    with tempfile.TemporaryDirectory() as folder:
        mapping = Path(folder) / MAPPING
        mapping.write_text(tomli_w.dumps(values), encoding="utf-8")
        try:
            recordings, report = read_all([*files], mapping=mapping if values else None)
        except FormatError as error:
            if not values:
                raise
            raise StartError(f"This cannot be right: {error}") from error
    if answers.road or len(recordings) == 1:
        return road_named(recordings, answers.road), report
    with_a_ramp = [
        one for one in recordings if len(one.site.lanes) <= 12 and any(is_ramp(edge) for edge in edges_of(one)[:1])
    ]
    if len(with_a_ramp) == 1:
        return with_a_ramp[0], report
    names = ", ".join(f"{one.site.name} ({one.tracks.height:,} rows)" for one in recordings)
    answer = answer_to(Question(f"Which road? There are {len(recordings)}: {names}.", "--road NAME"), ask)
    return road_named(recordings, answer), report


def _verdict(recording: Recording) -> str:
    """Returns what `rampcast doctor` will say of it, in a sentence or two."""
    spoilt = [one for one in examine(recording).findings if one.severity is Severity.SPOILS]
    told = "; ".join(f"{one.check.title}: {one.check.counting(one.count)}. {one.check.advice}" for one in spoilt)
    return f"doctor: this would spoil a forecast: {told}" if told else "doctor: nothing here would spoil a forecast"


def _read_by_point(
    files: Sequence[Path], proposal: Proposal, answers: Answers, ask: Ask, tell: Callable[[str], None]
) -> tuple[Recording, ReadReport]:
    """Returns what `_read` does; where nothing tells which point of a vehicle is measured, overlaps propose it."""
    recording, report = _read(files, proposal.values, answers, ask)
    if "reference" in proposal.assumed and (better := by_overlaps(recording, partial(_as_reference, files, proposal))):
        proposal.values["reference"], (recording, report), why = better
        proposal.reasons.append(why)
        tell(why)
    return recording, report


def _as_reference(files: Sequence[Path], proposal: Proposal, reference: str, road: str) -> tuple[Recording, ReadReport]:
    """Returns the recording of a road as it is if positions are of that point of a vehicle, and what reading found."""
    return _read(files, proposal.values | {"reference": reference}, Answers(road=road), nobody_answers)


def _check(recording: Recording) -> None:
    if wrong := wrong_in(recording):
        raise StartError(f"This cannot be right: {wrong}")


def _with_ramp(recording: Recording, answers: Answers, ask: Ask) -> tuple[Site, str]:
    """Returns the site with its ramp, or without one, and why."""
    site = recording.site
    if answers.no_ramp or (site.has_ramp and not answers.ramp.lanes):
        return (without_ramp(site), "none, as was said") if answers.no_ramp else (site, "as the site has it")
    if answers.ramp.lanes:
        return with_ramp(site, recording, answers.ramp), "as was said"
    edges = edges_of(recording)
    found = [is_ramp(edge) for edge in edges]
    if edges and found[0]:
        made = with_ramp(site, recording, replace(answers.ramp, lanes=(edges[0].lane,)))
        return made, str(edges[0])
    if None not in found:
        return without_ramp(site), "none: no lane at an edge is left by most who begin in it"
    told = "; ".join(map(str, edges))
    answer = answer_to(
        Question(f"Which lane is the ramp ('{NONE}' for no ramp)? {told}.", "--ramp-lane NUMBER or --no-ramp"), ask
    )
    if answer == NONE:
        return without_ramp(site), "none, as was answered"
    if not answer.isdigit():
        raise StartError(f"--ramp-lane: expected the number of a lane, got {answer}")
    return with_ramp(site, recording, replace(answers.ramp, lanes=(int(answer),))), "as was answered"


def _guesses(site: Site) -> list[str]:
    """Returns what of the ramp is taken from the tracks alone, and the options that say it better."""
    told = [note.text for note in site.notes if note.source == SOURCE]
    return [
        f"{text} Know better: {option}" for text in told for name, option in BETTER.items() if text.startswith(name)
    ]


def _commands(files: Sequence[Path], out: Path, *, mapping: bool) -> list[str]:
    """Returns the commands that read the table as it was told, and go on."""
    named = " ".join(shlex.quote(str(file)) for file in files)
    how = f"--mapping {shlex.quote(str(out / MAPPING))} " if mapping else ""
    recording = shlex.quote(str(out / "recording.parquet"))
    return [
        f"rampcast convert {named} {how}--site {shlex.quote(str(out / SITE))} --out {recording}",
        f"rampcast doctor {recording}",
        f"rampcast forecast {recording} --out {shlex.quote(str(out / 'forecasts'))}",
    ]
