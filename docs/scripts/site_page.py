"""Draws the pictures of docs/sites.md: simulated traffic laid on a bend, its drafted site, and the site with its ramp.

python docs/scripts/site_page.py
"""

from pathlib import Path

import numpy as np
import polars as pl

from rampcast.cli.ramp import print_lanes
from rampcast.formats import ReadReport, read_any
from rampcast.plots.site_picture import site_picture
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.roads.plane import PLANE_SCHEMA, PX, PY, Plane
from rampcast.roads.project import on_roads
from rampcast.roads.ramp import RampValues, with_ramp
from rampcast.roads.reference import in_plane, reference_line
from rampcast.simulate import shipped_sample

IMAGES = Path(__file__).parents[1] / "images"
DPI = 80
RADIUS = 600.0  # [m] of the bend
RAMP_LANE = 2


def main() -> None:
    """Draws both pictures and prints what `rampcast site` would."""
    draft = drafted()
    print_lanes(draft)
    site_picture(draft).savefig(IMAGES / "site_drafted.png", dpi=DPI)
    site = with_ramp(draft.site, draft, RampValues((RAMP_LANE,)))
    for note in site.notes:
        print(note.text)
    made = Recording(tracks=draft.tracks, site=site, time_step=draft.time_step, source=draft.source)
    site_picture(made).savefig(IMAGES / "site_with_ramp.png", dpi=DPI)


def drafted() -> Recording:
    """Returns the first simulated window as a source in a plane, that knows no lanes, would give it."""
    recording, _ = read_any(shipped_sample()[:1])
    x, y = (recording.tracks[name].to_numpy() for name in (c.X, c.Y))
    angles = np.linspace(0.0, recording.site.length / RADIUS, 200)
    bend = np.stack([RADIUS * np.sin(angles), RADIUS * (1 - np.cos(angles))], axis=1)
    px, py = in_plane(reference_line(bend), x, y)
    known = recording.tracks.with_columns(pl.Series(PX, px), pl.Series(PY, py))
    absent = {name: pl.lit(None, kind) for name, kind in PLANE_SCHEMA.items() if name not in known.columns}
    rows = known.with_columns(**absent).select(pl.col(name).cast(kind) for name, kind in PLANE_SCHEMA.items())
    plane = Plane("bend", "Simulated traffic laid on a bend", "simulated", rows, recording.time_step, simulated=True)
    recordings, _ = on_roads(plane, None, ReadReport(("bend",), ("bend",), rows.height))
    return recordings[0]


if __name__ == "__main__":
    main()
