"""What Prometheus asks for: counts, and how long things took."""

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Final

from prometheus_client import CollectorRegistry, Counter, Histogram, ProcessCollector, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from rampcast.live.clock import Verdict

if TYPE_CHECKING:
    from rampcast.live.service import Service
    from rampcast.live.station import Station

KIND: Final = "text/plain; version=0.0.4; charset=utf-8"
VERDICTS: Final = frozenset(str(one) for one in Verdict)
FAST: Final = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)  # [s] of states
SLOW: Final = (0.01, 0.02, 0.05, 0.075, 0.1, 0.15, 0.2, 0.3, 0.5, 1.0, 2.0)  # [s] of forecasts

Told = tuple[tuple[str, str, Callable[["Station"], float]], ...]
GAUGES: Final[Told] = (
    ("rampcast_viewers", "Viewers of a site", lambda one: len(one.viewers)),
    ("rampcast_stale", "1 where frames or forecasts are missing", lambda one: one.stale is not None),
    ("rampcast_degraded", "1 where something is left out", lambda one: one.degraded is not None),
    ("rampcast_alarms_active", "Alarms that are raised", lambda one: len(one.alarms.active)),
)
COUNTERS: Final[Told] = (
    ("rampcast_forecasts", "Forecasts published", lambda one: one.forecasts),
    ("rampcast_forecast_failures", "Moments that could not be forecast", lambda one: one.failures),
    ("rampcast_lost_frames", "Gaps in the numbers of frames", lambda one: one.lost_frames),
    ("rampcast_dropped", "Messages that slow viewers missed", lambda one: one.viewers.dropped),
    ("rampcast_alarms", "Alarms raised or cleared", lambda one: one.alarms.number),
)


class Metrics:
    """The metrics of one service, in a registry of their own."""

    def __init__(self, service: "Service") -> None:
        self._registry = CollectorRegistry()
        ProcessCollector(registry=self._registry)
        self._registry.register(_Now(service))
        self._frames = Counter(
            "rampcast_frames", "Frames, by what became of them", ("site", "verdict"), registry=self._registry
        )
        self._times = {
            "state": self._histogram("rampcast_state_seconds", "From a frame in to its state out", FAST),
            "forecast": self._histogram("rampcast_forecast_age_seconds", "Age of forecasts when they go out", SLOW),
            "tick": self._histogram("rampcast_tick_seconds", "What a forecast took", SLOW),
        }
        service.watchers.append(self._counted)

    def text(self) -> bytes:
        """Returns all metrics in the form that Prometheus reads."""
        return generate_latest(self._registry)

    def _histogram(self, name: str, help: str, buckets: tuple[float, ...]) -> Histogram:
        return Histogram(name, help, ("site",), buckets=buckets, registry=self._registry)

    def _counted(self, station: "Station", what: str, value: float) -> None:
        if what in self._times:
            self._times[what].labels(station.name).observe(value)
        elif what in VERDICTS:
            self._frames.labels(station.name, what).inc(value)


class _Now(Collector):
    """What is read from the service when Prometheus asks."""

    def __init__(self, service: "Service") -> None:
        self._service = service

    def collect(self) -> Iterable[Metric]:
        """Yields the metrics."""
        stations = self._service.stations.values()
        for name, text, value in GAUGES:
            gauge = GaugeMetricFamily(name, text, labels=["site"])
            for station in stations:
                gauge.add_metric([station.name], float(value(station)))
            yield gauge
        for name, text, value in COUNTERS:
            counter = CounterMetricFamily(name, text, labels=["site"])
            for station in stations:
                counter.add_metric([station.name], float(value(station)))
            yield counter
        yield GaugeMetricFamily("rampcast_ready", "1 where the forecaster is warm", float(self._service.is_ready))
        starts = self._service.supervisor.starts
        yield CounterMetricFamily("rampcast_forecaster_starts", "Starts of the forecaster", float(starts))
