"""What every forecaster of a recording can do, ours and those that stand beside it."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import polars as pl
from jaxtyping import Float, Int, Shaped

from rampcast.errors import ModelError, RecordingError
from rampcast.recording import Recording
from rampcast.recording.hashes import window_hashes
from rampcast.sites import Site
from rampcast.sites.site import differences

NEEDS_RAW = (
    "a forecast needs the raw recording: a smoothed one that was read from a file knows what comes. Read the raw one, "
    "and smooth it with `rc.clean`"
)
# What is being done, steps done, steps in all; steps that the first call says are done were done before.
Progress = Callable[[str, int, int], None]


@runtime_checkable
class RecordingForecast(Protocol):
    """What is forecast of vehicles at moments of a recording: their positions, and when they will change lane."""

    @property
    def recording(self) -> np.ndarray:
        """Returns the name of the window of each scene."""

    @property
    def vehicle(self) -> Shaped[np.ndarray, "scene"]:
        """Returns the vehicle of each scene."""

    @property
    def t0(self) -> Float[np.ndarray, "scene"]:
        """Returns the moment of each scene [s]."""

    @property
    def lane(self) -> Int[np.ndarray, "scene"]:
        """Returns the lane of each vehicle then; `NO_LANE` where it is not known."""

    @property
    def x(self) -> Mapping[str, Float[np.ndarray, "scene future"]]:
        """Returns the front positions at 0.2, 0.4 ... s after t0, by name of the model [m]."""

    @property
    def bands(self) -> Mapping[str, Float[np.ndarray, "scene future band"]]:
        """Returns the quantiles of the positions, at `tables.BANDS`, of the models that give some [m]."""

    @property
    def lane_changes(self) -> Mapping[str, tuple[Float[np.ndarray, "scene 16"], Float[np.ndarray, "scene 16"]]]:
        """Returns the probabilities of a lane change within, and at, 0, 1 ... 15 s, by name of the model."""

    def tables(self) -> dict[str, pl.DataFrame]:
        """Returns the tables that a forecast is written as, by name of the file."""


@dataclass(frozen=True)
class Parts:
    """What is forecast of a recording.

    Attributes:
        total: number of the parts.
        each: gives them, one after the other.
    """

    total: int
    each: Iterator[RecordingForecast]


@runtime_checkable
class RecordingForecaster(Protocol):
    """A fitted forecaster of one site."""

    @property
    def site(self) -> Site | None:
        """Returns where it was trained; None for one of any site."""

    @property
    def trained_on(self) -> tuple[str, ...]:
        """Returns the names of the windows it was trained on."""

    @property
    def data_hash(self) -> str:
        """Returns the SHA-256 of their tracks."""

    @property
    def window_hashes(self) -> tuple[str, ...]:
        """Returns the SHA-256 of the tracks of each of them, whatever its name."""

    def predict(self, recording: Recording, *, every: float = 1.0, threads: int | None = None) -> RecordingForecast:
        """Returns the forecast of every on-ramp vehicle of a smoothed recording, every so many seconds."""

    def predict_at(self, recording: Recording, rows: Int[np.ndarray, "scene"]) -> RecordingForecast:
        """Returns the forecast of the vehicles at those rows of it, which `traffic.find_anchors` gave."""

    def in_parts(self, recording: Recording, *, every: float = 1.0) -> Parts:
        """Returns the forecast of a recording, raw or smoothed, in parts that are made one after the other."""


def check_same_site(trained: Site, site: Site) -> None:
    """Checks that a model is used where it was trained.

    Raises:
        ModelError: it is another site, or another road under the same name.
    """
    if site.name != trained.name:
        what = f"at site '{trained.name}', the scenes are of site '{site.name}'"
    elif different := differences(trained, site):
        what = f"at another site '{trained.name}' than that of the scenes: {', '.join(different)}"
    else:
        return
    raise ModelError(
        f"this model was trained {what}; what it learned holds for one road, so train a model of that site, or read "
        "both recordings with one site file (--site)"
    )


def check_unseen(forecaster: RecordingForecaster, recording: Recording) -> None:
    """Checks that a smoothed recording was not trained on.

    Raises:
        RecordingError: a window of it was, whatever its name.
    """
    hashes = zip(recording.names, window_hashes(recording), strict=True)
    leaked = sorted(
        name for name, found in hashes if name in forecaster.trained_on or found in forecaster.window_hashes
    )
    if leaked:
        raise RecordingError(
            f"the windows {leaked} were used to train this model, so a score on them says nothing; evaluate on others"
        )


def tell_nobody(what: str, done: int, total: int) -> None:
    """Is told of progress where nobody wants to know."""
