"""The guided way in."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rampcast.cli import show as terminal
from rampcast.cli.app import app
from rampcast.cli.options import Gore, Json, MergeZone, Mirrored, RampEnd, TargetLane, with_stdin, writable_folder

if TYPE_CHECKING:
    from rampcast.start import Question, Started


Tables = Annotated[
    list[Path], typer.Argument(callback=with_stdin, help="Any tables of trajectories of one place; - is what comes in.")
]
Out = Annotated[Path, typer.Option("--out", callback=writable_folder, help="Folder to write to.")]
Columns = Annotated[
    list[str] | None, typer.Option("--column", help="Column of a value, as vehicle=obj; lane= for none.")
]
Units = Annotated[
    list[str] | None, typer.Option("--unit", help="Unit of a value, as x=ft, time=ms, or x=0.05 (metres in one).")
]
FrameRate = Annotated[float | None, typer.Option("--frame-rate", min=0.1, help="Frames per second.")]
Reference = Annotated[
    str | None, typer.Option("--reference", help="Point of a vehicle that positions are: front, centre, rear.")
]
InPlane = Annotated[bool, typer.Option("--plane", help="Positions are in a plane, as a map's.")]
AlongRoad = Annotated[bool, typer.Option("--along-road", help="Positions are along the road.")]
TimeZone = Annotated[str | None, typer.Option("--timezone", help="Of times without one, as Europe/Berlin.")]
RoadName = Annotated[str | None, typer.Option("--road", help="Which road, if there are several.")]
PlaceName = Annotated[str, typer.Option("--name", help="Name of the place. Default: the file's.")]
RampLane = Annotated[list[int] | None, typer.Option("--ramp-lane", help="Lane of the ramp; once for each.")]
NoRamp = Annotated[bool, typer.Option("--no-ramp", help="There is no ramp.")]


@app.command(
    epilog="Examples:\n\nrampcast start camera.csv --out start\n\n"
    "rampcast start radar.csv --column vehicle=obj --unit time=ms --ramp-lane 4 --out start"
)
def start(
    files: Tables,
    out: Out = Path("start"),
    column: Columns = None,
    unit: Units = None,
    frame_rate: FrameRate = None,
    reference: Reference = None,
    plane: InPlane = False,
    along_road: AlongRoad = False,
    timezone: TimeZone = None,
    road: RoadName = None,
    name: PlaceName = "",
    ramp_lane: RampLane = None,
    target_lane: TargetLane = None,
    gore: Gore = None,
    ramp_end: RampEnd = None,
    merge_zone: MergeZone = None,
    no_ramp: NoRamp = False,
    mirrored: Mirrored = False,
    json: Json = False,
) -> None:
    """Tells what a stranger's table is, and writes a mapping, a site, a picture, and the commands that repeat it.

    Asks only what the table does not tell; every answer is an option.
    """
    from rampcast.start import answers_of
    from rampcast.start import start as run

    ramp = (tuple(ramp_lane or ()), target_lane, gore, ramp_end, merge_zone)
    said = {"frame_rate": frame_rate, "reference": reference, "timezone": timezone, "road": road, "name": name}
    shape = {"plane": True if plane else False if along_road else None, "no_ramp": no_ramp, "mirrored": mirrored}
    answers = answers_of(column or [], unit or [], ramp, said | shape)
    found = run(files, out, answers=answers, ask=_ask, tell=_nothing if json else terminal.say)
    if json:
        terminal.print_json(found.to_dict())
        return
    _say_what_is_next(found)


def _say_what_is_next(found: "Started") -> None:
    mapping = "mapping.toml, " if found.mapping else ""
    terminal.say(f"wrote {mapping}site.toml, site.png and commands.txt to {found.folder}. Look at the picture; then")
    for command in found.commands:
        terminal.say(f"  {command}")


def _nothing(text: str) -> None:
    """Says nothing."""


def _ask(question: "Question") -> str | None:
    return str(typer.prompt(question.text)) if sys.stdin.isatty() else None
