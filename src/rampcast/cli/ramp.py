"""Questions about the ramp of a site, and what to answer them by."""

import dataclasses
import sys
from typing import TYPE_CHECKING

import typer

from rampcast.cli import show

if TYPE_CHECKING:
    from rampcast.recording import Recording
    from rampcast.roads.ramp import RampValues
    from rampcast.sites import Site


def site_with_ramp(recording: "Recording", values: "RampValues") -> "Site":
    """Returns the recording's site with a ramp; asks for what is missing if somebody can answer.

    Raises:
        SiteError: nobody can, and the lane of the ramp is not known.
    """
    from rampcast.errors import SiteError
    from rampcast.roads.ramp import with_ramp, without_ramp

    site = recording.site
    values = values.or_of(site)
    print_lanes(recording)
    if not values.lanes and len(site.lanes) == 1:
        raise SiteError(
            f"{site.name}: which lane is the ramp? Only one is seen, from which none can merge: say --no-ramp"
        )
    if not values.lanes and not _somebody_answers():
        raise SiteError(
            f"{site.name}: which lane is the ramp? Give --ramp-lane with a number of the table (and, if you know them, "
            "--target-lane, --gore, --ramp-end, --merge-zone), or --no-ramp for a site without one"
        )
    asked = not values.lanes
    if asked:
        values = dataclasses.replace(values, lanes=_ask_lanes(site))
    if not values.lanes:
        return without_ramp(site)
    made = with_ramp(site, recording, values)
    if asked:
        made = with_ramp(site, recording, _ask_values(made))
    for note in made.notes:
        show.say(f"  {note.text} ({note.source})")
    return made


def _somebody_answers() -> bool:
    return sys.stdin.isatty()


def _ask_lanes(site: "Site") -> tuple[int, ...]:
    known = {str(lane.number): lane.number for lane in site.lanes}
    question = f"Which lane is the ramp? ({', '.join(known)}; several with a comma between; empty for none)"
    while True:
        answer = str(typer.prompt(question, default="", show_default=False))
        numbers = answer.replace(",", " ").split()
        if all(number in known for number in numbers):
            return tuple(known[number] for number in numbers)
        show.say(f"  expected numbers of lanes from the table ({', '.join(known)}), got {answer}")


def _ask_values(proposed: "Site") -> "RampValues":
    """Returns the values that the user settles for; what is proposed and kept stays a proposal."""
    from rampcast.roads.ramp import RampValues

    def ask(what: str, proposal: float) -> float | None:
        answer = float(typer.prompt(what, default=round(proposal, 1), type=float))
        return None if answer == round(proposal, 1) else answer

    target = int(typer.prompt("Lane that ramp vehicles merge into", default=proposed.target_lane, type=int))
    return RampValues(
        lanes=proposed.ramp_lanes,
        target_lane=None if target == proposed.target_lane else target,
        gore=ask("Gore: x where the ramp begins to run beside it [m]", proposed.gore),
        ramp_end=ask("End of the ramp lane: x [m], inf if it goes on", proposed.ramp_end),
    )


def print_lanes(recording: "Recording") -> None:
    """Prints the lanes of a recording's site from the left: what drives on them, and where it changes lane."""
    from rampcast.roads.ramp import lanes_driven

    heads = ("lane", "role", "y [m]", "vehicles", "rows", "x [m]", "to left", "to right")
    table = show.titled(f"lanes of {recording.site.name}, from the left", heads, numbers={*heads} - {"role"})
    for row in lanes_driven(recording).iter_rows(named=True):
        seen = "" if row["x_from"] is None else f"{row['x_from']:.0f}–{row['x_to']:.0f}"
        changes = [
            f"{row[side]:,}: {row[f'{side}_from']:.0f}–{row[f'{side}_to']:.0f} m" if row[side] else ""
            for side in ("left", "right")
        ]
        counts = (f"{row['vehicles']:,}", f"{row['rows']:,}", seen)
        table.add_row(str(row["lane"]), row["role"], f"{row['centre']:z.2f}", *counts, *changes)
    show.output.print(table)
