"""Checks of the recording's clock: moments that are missing for everybody, moments at which everybody jumps."""

import polars as pl

from rampcast.doctor.finding import Faults
from rampcast.doctor.places import VALUE, moments, no_places
from rampcast.doctor.row_measures import STEP
from rampcast.doctor.subject import Subject
from rampcast.recording import columns as c

FEWEST_VEHICLES = 3  # that must jump at once: one or two may have been mistaken for another
MOST = 0.5  # share of the vehicles seen at a moment that must jump
BRIDGING = 2  # vehicles that must be seen on both sides of a missing moment: an empty road is no fault


def missing_moments(subject: Subject) -> Faults:
    """Returns the frames before which frames are missing for every vehicle; the value is how many seconds."""
    frames = subject.tracks.select(c.RECORDING, c.FRAME).unique().sort(c.RECORDING, c.FRAME)
    hole = pl.col(c.FRAME).diff().over(c.RECORDING)
    holes = frames.with_columns(hole.alias(STEP)).filter(pl.col(STEP) > 1)
    bridges = subject.tracks.filter(pl.col(STEP) > 1).group_by(c.RECORDING, c.FRAME, STEP).len()
    found = holes.join(bridges.filter(pl.col("len") >= BRIDGING), on=[c.RECORDING, c.FRAME, STEP], how="semi")
    found = found.sort(c.RECORDING, c.FRAME)
    seconds = (found[STEP] - 1) * subject.time_step
    places = moments({c.RECORDING: found[c.RECORDING].cast(pl.String), c.FRAME: found[c.FRAME], VALUE: seconds})
    return Faults(places, of=frames.height)


def clock_jumps(subject: Subject) -> Faults:
    """Returns the frames at which most vehicles jump together; the value is their median jump [m]."""
    if not subject.jump.any():
        return Faults(no_places(), of=subject.tracks[c.FRAME].n_unique())
    jumped = subject.tracks.select(c.RECORDING, c.FRAME).with_columns(
        pl.Series("jump", subject.jump), pl.Series("known", (subject.step > 0) & (subject.step <= subject.longest))
    )
    suspects = jumped.filter(pl.col("jump") != 0).select(c.RECORDING, c.FRAME).unique()
    seen = jumped.filter("known").join(suspects, on=[c.RECORDING, c.FRAME], how="semi")
    together = seen.group_by(c.RECORDING, c.FRAME).agg(
        jumping=(pl.col("jump") != 0).sum(),
        seen=pl.len(),
        value=pl.col("jump").filter(pl.col("jump") != 0).median(),
    )
    found = together.filter(pl.col("jumping") >= FEWEST_VEHICLES, pl.col("jumping") > MOST * pl.col("seen"))
    found = found.sort(c.RECORDING, c.FRAME)
    places = moments({c.RECORDING: found[c.RECORDING].cast(pl.String), c.FRAME: found[c.FRAME], VALUE: found["value"]})
    return Faults(places, of=subject.tracks[c.FRAME].n_unique())
