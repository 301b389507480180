"""Films of recordings: moment after moment is forecast and drawn."""

from collections.abc import Hashable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from rampcast.errors import RampcastError
from rampcast.forecast.forecaster import Forecaster
from rampcast.forecast.protocol import Progress, tell_nobody
from rampcast.plots.film.files import Picture, check_film, write_film
from rampcast.plots.film.film import SIZE, Film
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.traffic.moments import SPAN, traffic_at_times


@dataclass(frozen=True)
class Cut:
    """Which part of a recording a film shows, and how.

    Attributes:
        begin: its first moment, after the recording's own beginning [s].
        seconds: of the recording that it shows.
        speed: times as quick as it was recorded.
        rate: pictures a second.
        vehicle: that is followed; None for the one that merges next.
        size: of a picture [pixels].
    """

    begin: float = 0.0
    seconds: float = 10.0
    speed: float = 1.0
    rate: float = 10.0
    vehicle: Hashable | None = None
    size: tuple[int, int] = SIZE

    def __post_init__(self) -> None:
        for name in ("seconds", "speed", "rate"):
            if not getattr(self, name) > 0.0:
                raise RampcastError(f"{name}: expected a number above 0, got {getattr(self, name):g}")
        if any(side < 100 or side % 2 for side in self.size):
            raise RampcastError(f"size: expected two even numbers of 100 pixels or more, got {self.size}")

    def moments(self, first: float, last: float) -> Float[np.ndarray, "moment"]:
        """Returns the moments of a recording from `first` to `last` that are drawn [s]."""
        begin = first + max(self.begin, SPAN)
        moments = begin + np.arange(0.0, self.seconds - 1e-9, self.speed / self.rate)
        return moments[moments <= last + 1e-9]


def film_recording(
    recording: Recording,
    path: Path,
    forecaster: Forecaster,
    *,
    cut: Cut = Cut(),
    window: str | None = None,
    progress: Progress | None = None,
) -> int:
    """Writes a film of a recording with its forecasts, and returns the number of its pictures.

    Args:
        recording: raw, of any frame rate.
        path: .mp4, .gif, .webp, or .png for the first picture alone.
        forecaster: what forecasts.
        cut: which part is shown, and how.
        window: its name; None for the first.
        progress: called as (what, done, total).

    Raises:
        RampcastError: the recording has no such window, moment or vehicle, or the path no known suffix.
        MissingExtra: ffmpeg is not installed, and the film is an mp4.
    """
    path = Path(path)
    check_film(path)
    shown = recording.window(window or recording.names[0])
    forecaster.check(shown.site)
    frames = shown.tracks[c.FRAME]
    first, last = (float(frames.sort()[place]) * shown.time_step for place in (0, -1))
    times = cut.moments(first, last)[: 1 if path.suffix.lower() == ".png" else None]
    if not len(times):
        raise RampcastError(
            f"the recording is {last - first:.0f} s long: nothing is {cut.begin:g} s after its beginning"
        )
    if cut.vehicle is not None and cut.vehicle not in shown.tracks[c.VEHICLE]:
        raise RampcastError(f"there is no vehicle {cut.vehicle} in window '{shown.names[0]}'")
    return write_film(_pictures(shown, forecaster, cut, times, progress or tell_nobody), path, rate=cut.rate)


def _pictures(
    recording: Recording,
    forecaster: Forecaster,
    cut: Cut,
    times: Float[np.ndarray, "moment"],
    tell: Progress,
) -> Iterator[Picture]:
    film = Film(recording, vehicle=cut.vehicle, size=cut.size)
    tell("pictures", 0, len(times))
    for done, traffic in enumerate(traffic_at_times(recording, None, times), start=1):
        yield film.draw(traffic, forecaster.predict(traffic))
        tell("pictures", done, len(times))
