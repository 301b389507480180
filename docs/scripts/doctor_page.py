"""Draws the pictures of docs/doctor.md, from the simulated sample with faults put in, and fills in its table of checks.

python docs/scripts/doctor_page.py
"""

import math
import re
from dataclasses import replace
from pathlib import Path

import polars as pl

from rampcast.doctor import CHECKS, Check, RoadDiagnosis, examine
from rampcast.doctor import figures as doctor_figures
from rampcast.formats import read_any
from rampcast.plots import style
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.simulate import shipped_sample

DOCS = Path(__file__).parents[1]
PAGE = DOCS / "doctor.md"
BEGIN, END = "<!-- table of checks: begin -->", "<!-- table of checks: end -->"
DPI = 80
MINUTE = (300.0, 360.0)  # [s] in which the faults are put


def main() -> None:
    """Draws the pictures and fills in the table."""
    diagnosis = examine(faulty())
    for one in diagnosis.findings:
        print(f"{one.severity.value}: {one.check.name} {one.count:,} of {one.of:,} {one.check.counted}")
    draw(diagnosis)
    text = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(with_table(text), encoding="utf-8")
    print(f"filled in {PAGE}")


def faulty() -> Recording:
    """Returns the first simulated window with faults in one minute of the lane beside the ramp."""
    recording, _ = read_any(shipped_sample()[:1])
    t = pl.col(c.FRAME) * recording.time_step
    here = t.is_between(*MINUTE) & (pl.col(c.LANE) == recording.site.target_lane)
    vehicles = recording.tracks.filter(here).group_by(c.VEHICLE).len().filter(pl.col("len") > 200)[c.VEHICLE].sort()
    jumping, lost, flickering, doubled = (vehicles[place] for place in (12, 9, 15, 18))
    late = pl.col(c.VEHICLE).is_in([jumping]) & (t > MINUTE[0] + 25.0)
    flickers = (pl.col(c.VEHICLE) == flickering) & here & (t % 8.0 < 1.0)
    tracks = recording.tracks.filter(~((pl.col(c.VEHICLE) == lost) & here & (t % 10.0 < 2.0))).with_columns(
        pl.when(late).then(pl.col(c.X) + 7.0).otherwise(pl.col(c.X)).alias(c.X),
        pl.when(flickers).then(recording.site.target_lane - 1).otherwise(pl.col(c.LANE)).cast(pl.Int16).alias(c.LANE),
    )
    ghost = tracks.filter((pl.col(c.VEHICLE) == doubled) & here).with_columns(
        pl.lit(99_999, pl.Int32).alias(c.VEHICLE), pl.col(c.X) - 2.5
    )
    return replace(recording, tracks=pl.concat([tracks, ghost]).sort(c.RECORDING, c.VEHICLE, c.FRAME))


def draw(diagnosis: RoadDiagnosis) -> None:
    """Draws tracks, timeline and accelerations into docs/images."""
    tables = diagnosis.pictures
    tracks = style.figure_of(doctor_figures.faulty_tracks(tables["tracks"], tables["marks"]))
    spread = [(one.stage, one.histogram) for one in diagnosis.distributions if one.quantity == "acceleration"]
    drawn = doctor_figures.distribution(spread, label="acceleration a [m/s²]", limits=[3.41, 8.0])
    figures = {
        "doctor_tracks": tracks,
        "doctor_timeline": doctor_figures.timeline(tables["timeline"]),
        "doctor_accelerations": style.figure_of(drawn),
    }
    for name, figure in figures.items():
        figure.savefig(DOCS / "images" / f"{name}.png", dpi=DPI)


def with_table(text: str) -> str:
    """Returns the page with the table of checks between its markers."""
    table = "\n".join(
        ["| finding | what counts | warning | spoils | why |", "|---|---|---:|---:|---|", *map(_row, CHECKS)]
    )
    filled, found = re.subn(f"{BEGIN}.*?{END}", lambda _: f"{BEGIN}\n{table}\n{END}", text, flags=re.DOTALL)
    assert found == 1, f"{PAGE}: expected the markers {BEGIN} and {END} once, found them {found} times"
    return filled


def _row(check: Check) -> str:
    shares = (_above(share, check.counted) for share in (check.warns, check.spoils))
    return f"| `{check.name}` | {check.limit} | {' | '.join(shares)} | {check.why} |"


def _above(share: float, counted: str) -> str:
    if math.isinf(share):
        return "never"
    return "any" if share == 0.0 else f"> {100 * share:g} % of {counted}"


if __name__ == "__main__":
    main()
