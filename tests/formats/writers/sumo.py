"""Writes a recording as SUMO's floating car data, as xml: front bumpers, degrees clockwise from north, no sizes."""

from pathlib import Path

import polars as pl

from rampcast.recording import Recording
from rampcast.recording import columns as c
from tests.formats.writers.common import planar


def write_sumo(recording: Recording, folder: Path) -> list[Path]:
    """Returns the files written, one a window."""
    paths = []
    for name in recording.names:
        tracks = planar(recording.window(name)).sort(c.FRAME, c.VEHICLE)
        vehicle = pl.format(
            '        <vehicle id="{}" x="{}" y="{}" angle="{}" type="{}" speed="{}" pos="{}" lane="{}"/>\n',
            c.VEHICLE,
            pl.col("px").round(2),
            pl.col("py").round(2),
            (90 - pl.col("heading").degrees()).round(2),
            pl.col(c.KIND).cast(pl.String),
            pl.col("speed").round(2),
            pl.col(c.X).round(2),
            c.LANE,
        )
        steps = (
            tracks.with_columns(text=vehicle).group_by(c.FRAME, maintain_order=True).agg(pl.col("text").str.join(""))
        )
        path = folder / f"fcd-{name}.xml"
        path.write_text(
            '<?xml version="1.0" encoding="UTF-8"?>\n\n<!-- made for a test -->\n\n<fcd-export>\n'
            + "".join(
                f'    <timestep time="{frame * recording.time_step:.2f}">\n{text}    </timestep>\n'
                for frame, text in steps.iter_rows()
            )
            + "</fcd-export>\n"
        )
        paths.append(path)
    return paths
