"""Moving pictures of forecasts: the road from above, place over time, and when ramp vehicles merge."""

from rampcast.plots.film.film import Film
from rampcast.plots.film.shooting import Cut, film_recording

__all__ = ["Cut", "Film", "film_recording"]
