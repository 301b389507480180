"""Forecasts of a stream, whose bands are as wide as the last minutes of its site ask for."""

from typing import Any, Final

import numpy as np
import polars as pl
from jaxtyping import Float

from rampcast.arguments import chosen
from rampcast.errors import ModelError
from rampcast.forecast.forecast import Forecast
from rampcast.forecast.forecaster import Forecaster, forecast_traffic
from rampcast.forecast.recalibration import HORIZONS, LEVELS, STEPS, Recalibration
from rampcast.horizon import EDGE, STEP
from rampcast.models.correction import KNOTS
from rampcast.recording.breach import Doubtful
from rampcast.sites import Site
from rampcast.traffic.moments import Traffic
from rampcast.traffic.stream import Stream, StreamCounts

NEW: Final = Recalibration()


class Online:
    """The newest frame of a site in, the forecast of all its vehicles out.

    Every second a forecast is noted, and its bands are scored when the truth is seen: where the bands of the last
    minutes held fewer truths than 90 %, or more, those of the next forecasts are widened or narrowed; see
    `recalibration`. Until enough truths were seen the forecasts are those of `Forecaster.predict`.

    Example:
        >>> online = rc.Online(forecaster)
        >>> forecast = online.push(12.3, {"vehicle": [7, 8], "x": [101.2, 88.0], "y": [-1.8, 1.9]})

    Attributes:
        site: the geometry.
        recalibration: how the bands are scaled now, which may be handed to another `Online` of the site; None if they
            are left as they are learned.
    """

    def __init__(
        self,
        forecaster: Forecaster,
        site: Site | None = None,
        *,
        samples: int | None = None,
        recalibration: Recalibration | None = NEW,
        doubtful: Doubtful | str = Doubtful.REFUSE,
    ) -> None:
        """Begins a stream.

        Args:
            forecaster: what `fit` returned.
            site: of the stream; None for that of the forecaster, which the pretrained one lacks.
            samples: futures of each forecast; None for as many as the forecaster was trained with.
            recalibration: to begin with; None to leave bands as they are learned, whatever becomes of them.
            doubtful: "accept" goes on with vehicles that no road has, which `push` refuses otherwise.

        Raises:
            ModelError: the forecaster is of another site, or it is of none and none is given.
        """
        if (site := site or forecaster.site) is None:
            raise ModelError(f"{forecaster!r} is of no site of its own: say which one the stream is of, site=")
        forecaster.check(site)
        self.site = site
        self._model, self._samples, self._first = forecaster.model, samples, recalibration
        self._doubtful = chosen(Doubtful, doubtful, name="doubtful")
        self.reset()

    def reset(self) -> None:
        """Forgets all frames, and what was learned from them, as where the clock of the stream begins anew."""
        self._stream = Stream(self.site, doubtful=self._doubtful)
        self.recalibration = self._first

    @property
    def counts(self) -> StreamCounts:
        """Returns what came in so far."""
        return self._stream.counts

    def push(self, time: float, frame: Any) -> Forecast:
        """Returns the forecast of the newest moment that came so far; with nobody there it is empty.

        Args:
            time: of the frame, on one clock for the whole stream [s].
            frame: its vehicles; see `Stream.push`.

        Raises:
            RecordingError: as `Stream.push`.
        """
        return self.forecast(self._stream.push(time, frame))

    def forecast(self, traffic: Traffic, *, samples: int | None = None) -> Forecast:
        """Returns the forecast of traffic that somebody else made of the stream, as `push` does of its own.

        Args:
            traffic: of the site, newer than what came before.
            samples: futures of this forecast; None for as many as `Online` was told.
        """
        samples = samples or self._samples
        if self.recalibration is None:
            return forecast_traffic(self._model, traffic, samples=samples)
        state = _seen(self.recalibration, traffic)
        forecast = forecast_traffic(self._model, traffic, samples=samples, scale=_scale(state.factors))
        if state.waits_for(traffic.t0):
            state = state.issued(traffic.t0, forecast.vehicle, _unscaled(forecast, state.factors))
        self.recalibration = state
        return forecast

    def coverage(self) -> pl.DataFrame:
        """Returns how good the bands of the last minutes were, by horizon; see `Recalibration.report`.

        Columns: horizon [s]; n, truths seen; coverage, share of them in the bands of 90 %; coverage_unscaled, share in
        those that were learned; factor, by which bands are scaled now; alpha. Without recalibration n is 0.
        """
        return (self.recalibration or NEW).report()


def _seen(state: Recalibration, traffic: Traffic) -> Recalibration:
    """Returns the state that knows where vehicles are who were seen within a step, for which the filter's is as good
    as a row: cameras may see them in turn."""
    rows = np.flatnonzero(traffic.valid[:, -1] & (traffic.age <= STEP + EDGE))
    return state.seen(traffic.t0, traffic.vehicle[rows], traffic.x[rows, -1])


def _scale(factors: Float[np.ndarray, "horizon"]) -> Float[np.ndarray, "knot"] | None:
    if (factors == 1.0).all():
        return None
    return np.interp(STEP * (KNOTS + 1), HORIZONS, factors)


def _unscaled(forecast: Forecast, factors: Float[np.ndarray, "horizon"]) -> Float[np.ndarray, "vehicle horizon 3"]:
    """Returns the bands that the samples would have without the factors [m], in each of which as many truths lie as in
    those they have with them: the projection gives a little less, or more, than the factors ask for."""
    found = forecast.quantiles(LEVELS)[:, STEPS]
    median = found[:, :, 1:2]
    return median + (found - median) / factors[:, None]
