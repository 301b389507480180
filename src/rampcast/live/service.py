"""The service: sites that take frames in, one process that forecasts for all of them, and those who watch."""

import asyncio
import hmac
import time
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Protocol, runtime_checkable

from rampcast.live.frames import Frame, FrameError, frame_of
from rampcast.live.log import log
from rampcast.live.messages import encoded
from rampcast.live.newest import NewestError
from rampcast.live.station import Station, Taken
from rampcast.live.supervisor import Supervisor
from rampcast.live.work import Answer, Work, WorkerSite
from rampcast.sites.site import site_to_dict

BEAT: Final = 0.5  # [s] between two looks at what is stale, and 1 s between two status messages


@runtime_checkable
class Source(Protocol):
    """Where frames of a site come from, other than from clients."""

    async def run(self, service: "Service") -> None:
        """Gives frames to the service until it has no more, or is cancelled."""


@dataclass(frozen=True)
class Choices:
    """How a service forecasts.

    Attributes:
        model: "pretrained", or the path of a model folder.
        recalibrates: whether bands are widened or narrowed by what came true.
        degrades: whether samples and forecasts are left out when there is no time for them.
        threads: of the process that forecasts; None for all cores.
    """

    model: str = "pretrained"
    recalibrates: bool = True
    degrades: bool = True
    threads: int | None = None


@dataclass
class Service:
    """All sites, the process that forecasts, and the sources.

    Attributes:
        stations: by id.
        choices: how it forecasts.
        sources: where frames come from, beside clients.
        watchers: called with (site, kind of event) when something is counted, as by metrics.
    """

    stations: dict[str, Station]
    choices: Choices = Choices()
    sources: Sequence[Source] = ()
    watchers: list[Callable[[Station, str, float], None]] = field(default_factory=list)
    supervisor: Supervisor = field(init=False)
    _tasks: list["asyncio.Task[None]"] = field(default_factory=list)

    def __post_init__(self) -> None:
        for place, station in enumerate(self.stations.values()):
            station.place = place
        chosen = self.choices
        sites = [
            WorkerSite(one.name, site_to_dict(one.site), chosen.model, chosen.recalibrates)
            for one in self.stations.values()
        ]
        self.supervisor = Supervisor(Work(sites, chosen.degrades, chosen.threads), self._answered)

    async def start(self) -> None:
        """Starts the process that forecasts, the sources, and the watch over both."""
        runs: list[Coroutine[Any, Any, None]] = [self.supervisor.run(), self._beat()]
        self._tasks = [asyncio.create_task(run) for run in runs]
        self._tasks += [asyncio.create_task(self._source(source)) for source in self.sources]

    async def stop(self) -> None:
        """Ends all of it."""
        log("stopping")
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await self.supervisor.close()
        log("stopped", **{name: station.seq for name, station in self.stations.items()})

    @property
    def is_ready(self) -> bool:
        """Returns whether the process that forecasts is warm."""
        return self.supervisor.is_ready

    def take(self, station: Station, frame: Frame) -> Taken:
        """Takes a frame in: viewers get the state at once, the process that forecasts the newest snapshot.

        Raises:
            FrameError: it tells of what the site cannot place, or there is too much of it.
        """
        t_in_ms = round(1e3 * time.time(), 1)
        taken = station.take(frame)
        self._counted(station, str(taken.verdict), 1.0)
        if taken.rows or (taken.verdict.is_taken and not frame.objects):
            station.viewers.publish("state", station.state(t_in_ms))
            try:
                self.supervisor.newest.write(station.place, station.store.snapshot(), station.note(t_in_ms))
            except NewestError as error:
                raise FrameError(f"site {station.name}: {error}") from error
            self.supervisor.tell()
            self._counted(station, "state", time.time() - t_in_ms / 1e3)
        return taken

    def receive(self, message: bytes, *, station: Station | None = None, token: str | None = None) -> Taken:
        """Takes a message in, of the site that it names.

        Args:
            message: JSON; see docs/live-messages.md.
            station: where it was sent to; None leaves it to the message, which need not name the only site there is.
            token: that it has to carry; None where it need not.

        Raises:
            FrameError: it is no frame, of no site, or without the token.
        """
        frame = frame_of(message)
        if token is not None and not hmac.compare_digest((frame.token or "").encode(), token.encode()):
            raise FrameError("the token is wrong or missing")
        if station is not None and frame.site not in (None, station.name):
            raise FrameError(f"site: the frame is of {frame.site!r}, and was sent to {station.name!r}")
        if station is None:
            station = self._named(frame.site)
        return self.take(station, frame)

    def _named(self, name: str | None) -> Station:
        if name is None and len(self.stations) == 1:
            return next(iter(self.stations.values()))
        if name not in self.stations:
            raise FrameError(f"site: expected one of {', '.join(self.stations)}, got {name!r}")
        return self.stations[name]

    def say(self, station: Station) -> None:
        """Tells viewers how the service is."""
        station.viewers.publish("status", encoded(station.status(ready=self.is_ready, starts=self.supervisor.starts)))

    def _answered(self, answer: Answer) -> None:
        stations = [*self.stations.values()]
        if answer.kind == "forecast":
            self._forecast(stations[answer.site], answer)
        elif answer.kind == "failed":
            stations[answer.site].failures += 1
            log("forecast_failed", site=stations[answer.site].name, text=answer.text)
        else:
            for station in stations:
                station.forecast_at = None if answer.kind == "gone" else station.forecast_at  # stale at once
                station.alarms.set("forecaster_gone", "service", is_on=answer.kind == "gone")
                self.say(station)

    def _forecast(self, station: Station, answer: Answer) -> None:
        before = station.forecasts
        station.forecast(answer)
        if station.forecasts == before:
            return
        self._counted(station, "forecast", station.ages[-1])
        self._counted(station, "tick", answer.took)
        station.alarms.look(answer.risks, answer.note["t_obs_ms"])
        station.alarms.set("degraded", "service", is_on=answer.degraded is not None, what=answer.degraded)

    def _counted(self, station: Station, what: str, value: float) -> None:
        for watcher in self.watchers:
            watcher(station, what, value)

    async def _beat(self) -> None:
        """Says every second how each site is, and at once when it becomes stale or no longer is."""
        stale: dict[str, str | None] = {}
        count = 0
        while True:
            await asyncio.sleep(BEAT)
            count += 1
            for name, station in self.stations.items():
                is_now = station.stale
                if count % 2 == 0 or is_now != stale.get(name):
                    self.say(station)
                stale[name] = is_now
                if station.heard is not None:
                    station.alarms.set("source_silent", "source", is_on=is_now == "source")

    async def _source(self, source: Source) -> None:
        """Runs a source; one that fails is begun again, later each time."""
        pause = 1.0
        while True:
            try:
                await source.run(self)
                return
            except FrameError as error:
                log("source_wrong", text=str(error))
            except (OSError, asyncio.IncompleteReadError) as error:
                log("source_gone", text=f"{type(error).__name__}: {error}")
            await asyncio.sleep(pause)
            pause = min(2.0 * pause, 15.0)
