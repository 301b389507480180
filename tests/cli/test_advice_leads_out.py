"""Every error that a command ends in, on every kind of file that failed in public: its advice is followed.

A message is recognised by `ADVICE`; one that is not in there fails the test, so whoever writes a message says here what
somebody who believes it does. Each of its alternatives must end in a command that does what was asked, and no way may
come by the same message twice.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path

import pytest
import typer
from matplotlib.figure import Figure
from typer.core import TyperCommand
from typer.testing import CliRunner

from rampcast.cli.app import app
from rampcast.errors import RampcastError
from rampcast.forecast import forecaster
from tests.failing_kinds import KINDS, LONG, SHORT

pytestmark = pytest.mark.slow

COMMANDS: dict[str, tuple[str, ...]] = {
    "inspect": (),
    "convert": ("--out", "o.parquet"),
    "site": ("--out", "s.toml"),
    "train": ("--out", "model"),
    "forecast": ("--out", "f", "--every", "5", "--report", "none"),
    "evaluate": ("--out", "e", "--every", "5", "--report", "none"),
    "start": ("--out", "start"),
}
ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Call:
    """A command on a kind of file: what it is given, and how long the file is [s]."""

    command: str
    kind: str
    seconds: float = SHORT
    options: tuple[str, ...] = ()
    files: tuple[Path, ...] = ()  # instead of those of the kind


@dataclass(frozen=True)
class Ended:
    """What a call ended in: its error, or "", and all that it printed."""

    error: str
    printed: str


class Walk:
    """Follows advice in a folder, each step in a folder of its own."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.folder, self.steps, self.monkeypatch = folder, 0, monkeypatch

    def run(self, call: Call) -> Ended:
        """Runs a call in a folder of its own, which is the current one afterwards."""
        self.steps += 1
        here = self.folder / str(self.steps)
        files = call.files or tuple(KINDS[call.kind](here, call.seconds))
        here.mkdir(exist_ok=True)
        self.monkeypatch.chdir(here)
        given = ["--recording", str(files[0])] if call.command == "evaluate" else [str(file) for file in files]
        found = CliRunner().invoke(app, [call.command, *given, *COMMANDS[call.command], *call.options])
        if isinstance(found.exception, RampcastError):
            return Ended(str(found.exception), found.output)
        assert found.exit_code == 0, (call, found.output, found.exception)
        return Ended("", found.output)

    def leads_out(self, call: Call, passed: tuple[str, ...] = ()) -> None:
        """Follows each alternative of each message until the command does what was asked."""
        ended = self.run(call)
        if not ended.error:
            return
        known = [pattern for pattern in ADVICE if re.search(pattern, ended.error, re.DOTALL)]
        assert known, f"{call}: an error whose advice nobody follows: {ended.error}"
        here = f"{known[0]} of {call.seconds} s"
        assert here not in passed, f"{call}: advice in a circle, over {passed}: {ended.error}"
        for follow in ADVICE[known[0]]:
            for next_call in follow(self, call, ended):
                self.leads_out(next_call, (*passed, here))


Follow = Callable[[Walk, Call, Ended], Iterator[Call]]


def adding(*options: str) -> Follow:
    def follow(walk: Walk, call: Call, ended: Ended) -> Iterator[Call]:
        yield replace(call, options=(*call.options, *options))

    return follow


def a_ramp_lane_of_the_table(walk: Walk, call: Call, ended: Ended) -> Iterator[Call]:
    lanes = re.findall(r"│ +(\d+) │ main", ended.printed)
    yield replace(call, options=(*call.options, "--ramp-lane", lanes[-1]))


def each_road(walk: Walk, call: Call, ended: Ended) -> Iterator[Call]:
    for name in re.findall(r"([\w-]+) \([\d,]+ rows\)", ended.error):
        yield replace(call, options=(*call.options, "--road", name))


def converted(walk: Walk, call: Call, ended: Ended) -> Iterator[Call]:
    assert not walk.run(Call("convert", call.kind, call.seconds, files=call.files)).error
    for file in sorted(Path.cwd().glob("o*.parquet")):
        yield replace(call, files=(file,))


def with_a_site(walk: Walk, call: Call, ended: Ended) -> Iterator[Call]:
    """Follows what `site` itself advises, road by road, and goes on with each site; without a ramp to a forecast."""
    known = r"[\w-]+(?= \([\d,]+ rows\))"
    where = call.options.index("--mapping") if "--mapping" in call.options else len(call.options)
    mapping = call.options[where : where + 2]
    for road in re.findall(known, ended.error) or [""]:
        first = Call("site", call.kind, call.seconds, (*mapping, "--road", road) if road else mapping, call.files)
        site, has_ramp = walk.run(first), True
        if "Give --ramp-lane" in site.error:
            site = walk.run(next(a_ramp_lane_of_the_table(walk, first, site)))
        elif "say --no-ramp" in site.error:
            site, has_ramp = walk.run(replace(first, options=(*first.options, "--no-ramp"))), False
        assert not site.error
        goes_on = "forecast" if call.command == "train" and not has_ramp else call.command
        yield replace(call, command=goes_on, options=(*mapping, "--site", str(Path.cwd() / "s.toml")))


def longer(walk: Walk, call: Call, ended: Ended) -> Iterator[Call]:
    """Begins anew with more of the same place: what was drafted from a third of a second of it fits nothing."""
    assert call.seconds < LONG, f"{call}: it is long already: {ended.error}"
    assert not call.files
    yield Call(call.command, call.kind, LONG)


def more_to_learn_from(walk: Walk, call: Call, ended: Ended) -> Iterator[Call]:
    """Gives a minute with a merge; in more of the other kinds nobody merges either, and the other way leads out."""
    if call.kind == "twelve_seconds":
        yield from longer(walk, call, ended)


def forecast_instead(walk: Walk, call: Call, ended: Ended) -> Iterator[Call]:
    assert "--model" not in call.options
    yield replace(call, command="forecast")


def started(walk: Walk, call: Call, ended: Ended) -> Iterator[Call]:
    assert not walk.run(Call("start", call.kind, call.seconds)).error
    found = Path.cwd() / "start"
    options = ("--mapping", str(found / "mapping.toml"))
    site = () if call.command in ("site", "start") else ("--site", str(found / "site.toml"))
    yield replace(call, options=(*call.options, *options, *site))


def mapping_of_the_page(walk: Walk, call: Call, ended: Ended) -> Iterator[Call]:
    page = re.search(r"docs/[\w/]+\.md", ended.error)
    assert page
    text = (ROOT / page[0]).read_text(encoding="utf-8").partition("```toml\n")[2].partition("```")[0]
    mapping = walk.folder / "page.toml"
    mapping.write_text(text, encoding="utf-8")
    yield replace(call, options=(*call.options, "--mapping", str(mapping)))


ADVICE: dict[str, tuple[Follow, ...]] = {
    r"Frames follow from Global_Time.*--mapping": (started, mapping_of_the_page),
    r"which lane is the ramp\? Give --ramp-lane.* or --no-ramp": (a_ramp_lane_of_the_table, adding("--no-ramp")),
    r"Only one is seen.*say --no-ramp": (adding("--no-ramp"),),
    r"expected one road, found.*name it with --road": (each_road,),
    r"Which road\?.*Answer with --road NAME": (each_road,),
    r"`rampcast convert` writes a recording of each; or choose one with --site": (converted, with_a_site),
    r"say which lane is the ramp, and where it ends, with `rampcast site`; if there is none, `rampcast forecast`": (
        with_a_site,
        forecast_instead,
    ),
    r"expected \d+ s of traffic or more.*give a longer recording": (longer,),
    r"no track has \d+ frames or more.*give a longer recording": (longer,),
    r"too little to learn from.*Give more of that site's recordings, or forecast without training": (
        more_to_learn_from,
        forecast_instead,
    ),
}


@pytest.fixture
def walk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Walk:
    """Returns a walk on which a training learns nothing beyond what it starts from: it is asked whether it may."""
    monkeypatch.setattr(TyperCommand, "context_class", typer.Context)  # as `train` says, for the checks of types
    monkeypatch.setattr(forecaster, "fit_calibrated", lambda training, *, start, **_: start)
    monkeypatch.setattr(forecaster, "held_out", lambda *_: None)
    monkeypatch.setattr(
        import_module("rampcast.plots.site_picture"), "site_picture", lambda _: Figure()
    )  # which takes longer than all else
    return Walk(tmp_path, monkeypatch)


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("kind", KINDS)
def test_the_advice_of_every_message_leads_out(kind: str, command: str, walk: Walk) -> None:
    walk.leads_out(Call(command, kind))
