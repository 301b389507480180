"""Clients of the service: forecasts as they come, alarms without loss, frames in; one waits, the other awaits."""

import asyncio
import time
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass, field
from typing import Any, Final
from urllib.parse import urlsplit

import httpx
import msgspec
import numpy as np
from jaxtyping import Float
from websockets.asyncio.client import ClientConnection as AsyncConnection
from websockets.asyncio.client import connect as connect_async
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.sync.client import ClientConnection
from websockets.sync.client import connect as connect_sync

from rampcast.errors import RampcastError

ADDRESS: Final = "http://127.0.0.1:8480"
PAUSE: Final = 0.25  # [s] until the service is called again, twice as long each time
LONGEST: Final = 5.0  # [s] but no longer than this
FATAL: Final = (1007, 1008, 1009, 4404)  # codes after which calling again is of no use
GONE: Final = (OSError, ConnectionClosed, InvalidHandshake, TimeoutError)


@dataclass(frozen=True)
class LiveVehicle:
    """What is forecast of one vehicle.

    Attributes:
        id: its id.
        x, y, v, lane: where it is, and how fast [m, m/s].
        on_ramp: whether it may merge.
        quantiles: of its front at 0, 1 ... 15 s, at 5, 25, 50, 75 and 95 % [m].
        p_merged: probability to have merged by then; None for who is not on the ramp.
        told: all that the message tells of it.
    """

    id: int | str
    x: float
    y: float | None
    v: float | None
    lane: int
    on_ramp: bool
    quantiles: Float[np.ndarray, "horizon level"] = field(repr=False)
    p_merged: Float[np.ndarray, "horizon"] | None = field(repr=False)
    told: dict[str, Any] = field(repr=False)


@dataclass(frozen=True)
class LiveForecast:
    """The forecast of all vehicles of a site at a moment.

    Attributes:
        site: its id.
        t_obs_ms: the moment, on the clock of the source [ms].
        age_ms: from the frame's coming in to the forecast's going out [ms].
        degraded: what was left out for lack of time; None for nothing.
        vehicles: by id.
        told: the message.
    """

    site: str
    t_obs_ms: float
    age_ms: float
    degraded: str | None
    vehicles: dict[int | str, LiveVehicle] = field(repr=False)
    told: dict[str, Any] = field(repr=False)

    def __getitem__(self, vehicle: int | str) -> LiveVehicle:
        """Returns what is forecast of one vehicle.

        Raises:
            RampcastError: it is not in the forecast.
        """
        if vehicle not in self.vehicles:
            raise RampcastError(f"this forecast has no vehicle {vehicle!r}; it has {len(self.vehicles)}")
        return self.vehicles[vehicle]


def live_forecast(message: dict[str, Any]) -> LiveForecast:
    """Returns what a message of the kind "forecast" tells."""
    vehicles = {
        one["id"]: LiveVehicle(
            **{name: one[name] for name in ("id", "x", "y", "v", "lane", "on_ramp")},
            quantiles=np.array(one["q"], dtype=np.float64),
            p_merged=None if one["p_merged"] is None else np.array(one["p_merged"], dtype=np.float64),
            told=one,
        )
        for one in message["vehicles"]
    }
    age = float(message["t_pub_ms"] - message["t_in_ms"])
    return LiveForecast(message["site"], float(message["t_obs_ms"]), age, message["degraded"], vehicles, message)


@dataclass
class _Address:
    """Where the service is, and how one gets in."""

    address: str
    site: str | None
    token: str | None = field(repr=False)

    @property
    def headers(self) -> dict[str, str]:
        return {"authorization": f"Bearer {self.token}"} if self.token else {}

    def socket(self, site: str, door: str) -> str:
        where = urlsplit(self.address)
        return where._replace(scheme="wss" if where.scheme == "https" else "ws", path=_path(site, door)).geturl()

    def chosen(self, sites: list[dict[str, Any]]) -> str:
        names = [one["id"] for one in sites]
        if len(names) != 1:
            raise RampcastError(f"the service has the sites {', '.join(names)}: say which one, site=")
        return str(names[0])


def _path(site: str, door: str = "") -> str:
    return f"/v1/sites/{site}" + (f"/{door}" if door else "")


def _checked(answer: httpx.Response) -> Any:
    if answer.is_success:
        return answer.json()
    try:
        text = answer.json()["error"]
    except (ValueError, KeyError, TypeError):
        text = answer.text[:200]
    raise RampcastError(f"{answer.request.url.path}: the service answered {answer.status_code}: {text}")


@dataclass
class _Course:
    """What one follows at a door of the service, and how far one has come: the same for who waits and who awaits."""

    path: str
    first: str | None = None
    kinds: tuple[str, ...] = ()
    after: int | None = None
    failures: int = 0

    @property
    def door(self) -> str:
        return self.path if self.after is None else f"{self.path}?after={self.after}"

    def take(self, text: str | bytes) -> dict[str, Any] | None:
        """Returns the message; None if it is of a kind that was not asked for."""
        message: dict[str, Any] = msgspec.json.decode(text)
        self.failures = 0
        if self.after is not None:
            self.after = message.get("number", self.after)
        return message if not self.kinds or message["type"] in self.kinds else None

    def pause(self) -> float:
        """Returns how long to wait until the service is called again [s], longer each time."""
        self.failures += 1
        return min(PAUSE * 2.0 ** (self.failures - 1), LONGEST)


def _messages(kinds: tuple[str, ...], token: str | None) -> _Course:
    first = msgspec.json.encode({"want": kinds or None, "token": token}).decode()
    return _Course("live?first=1", first, kinds)


def _frame(t_ms: int | float, objects: list[dict[str, Any]], seq: int | None) -> str:
    return msgspec.json.encode({"v": 1, "t_ms": t_ms, "objects": objects, "seq": seq}).decode()


def _give_up(error: Exception) -> None:
    """Raises an error if calling the service again is of no use."""
    code = error.rcvd.code if isinstance(error, ConnectionClosed) and error.rcvd else None
    if code in FATAL:
        assert isinstance(error, ConnectionClosed)
        assert error.rcvd is not None
        raise RampcastError(f"the service closed the connection ({code}): {error.rcvd.reason}") from error


class Client:
    """A client that waits for what comes.

    Example:
        >>> with rampcast.live.Client("http://127.0.0.1:8480") as client:
        ...     for forecast in client.forecasts():
        ...         print(forecast.t_obs_ms, forecast.vehicles)
    """

    def __init__(self, address: str = ADDRESS, *, site: str | None = None, token: str | None = None) -> None:
        """Begins; nothing is asked yet.

        Args:
            address: of the service.
            site: id; None for the only one that it has.
            token: that it asks for.
        """
        self._where = _Address(address, site, token)
        self._http = httpx.Client(base_url=address, headers=self._where.headers, timeout=10.0)
        self._ingest: ClientConnection | None = None

    def __enter__(self) -> "Client":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends all connections."""
        if self._ingest is not None:
            self._ingest.close()
        self._http.close()

    def sites(self) -> list[dict[str, Any]]:
        """Returns the sites of the service."""
        found: list[dict[str, Any]] = _checked(self._http.get("/v1/sites"))["sites"]
        return found

    @property
    def site(self) -> str:
        """Returns the id of the site."""
        self._where.site = self._where.site or self._where.chosen(self.sites())
        return self._where.site

    def geometry(self) -> dict[str, Any]:
        """Returns the site as GeoJSON."""
        found: dict[str, Any] = _checked(self._http.get(_path(self.site)))
        return found

    def latest(self) -> LiveForecast:
        """Returns the newest forecast.

        Raises:
            RampcastError: there is none yet.
        """
        return live_forecast(_checked(self._http.get(_path(self.site, "latest"))))

    def status(self) -> dict[str, Any]:
        """Returns how the site is."""
        found: dict[str, Any] = _checked(self._http.get(_path(self.site, "status")))
        return found

    def alarms(self, after: int = 0) -> list[dict[str, Any]]:
        """Returns the alarms after that number."""
        answer = _checked(self._http.get(_path(self.site, "alarms"), params={"after": after}))
        found: list[dict[str, Any]] = answer["alarms"]
        return found

    def forecasts(self) -> Iterator[LiveForecast]:
        """Yields each forecast as it comes; calls the service again when it is gone.

        Raises:
            RampcastError: it does not let this client in.
        """
        for message in self.messages("forecast"):
            yield live_forecast(message)

    def messages(self, *kinds: str) -> Iterator[dict[str, Any]]:
        """Yields messages of those kinds, "state", "forecast" and "status"; of all without any."""
        return self._follow(_messages(kinds, self._where.token))

    def follow_alarms(self, after: int = 0) -> Iterator[dict[str, Any]]:
        """Yields each alarm after that number, none left out, also those of a time without a connection."""
        return self._follow(_Course("alarms", after=after))

    def _follow(self, course: _Course) -> Iterator[dict[str, Any]]:
        while True:
            try:
                with self._connected(course.door) as line:
                    if course.first is not None:
                        line.send(course.first)
                    for text in line:
                        message = course.take(text)
                        if message is not None:
                            yield message
            except GONE as error:
                _give_up(error)
            time.sleep(course.pause())

    def send(self, t_ms: int | float, objects: list[dict[str, Any]], *, seq: int | None = None) -> None:
        """Gives the service a frame; see docs/live-messages.md. Calls it again once if the line is broken."""
        message = _frame(t_ms, objects, seq)
        try:
            self._line().send(message)
        except GONE as error:
            self._ingest = None
            _give_up(error)
            try:
                self._line().send(message)
            except GONE as again:
                raise RampcastError(f"the service at {self._where.address} cannot be reached: {again}") from again

    def _line(self) -> ClientConnection:
        """Returns the line for frames."""
        if self._ingest is None:
            self._ingest = self._connected("ingest").__enter__()
        return self._ingest

    def _connected(self, door: str) -> ClientConnection:
        where = self._where.socket(self.site, door)
        return connect_sync(where, additional_headers=self._where.headers, compression=None, open_timeout=10.0)


class AsyncClient:
    """A client that awaits what comes.

    Example:
        >>> async for forecast in rampcast.live.AsyncClient().forecasts():
        ...     print(forecast.t_obs_ms)
    """

    def __init__(self, address: str = ADDRESS, *, site: str | None = None, token: str | None = None) -> None:
        """Begins; see `Client`."""
        self._where = _Address(address, site, token)

    async def sites(self) -> list[dict[str, Any]]:
        """Returns the sites of the service."""
        async with httpx.AsyncClient(base_url=self._where.address, headers=self._where.headers, timeout=10.0) as http:
            found: list[dict[str, Any]] = _checked(await http.get("/v1/sites"))["sites"]
        return found

    async def forecasts(self) -> AsyncIterator[LiveForecast]:
        """Yields each forecast as it comes; see `Client.forecasts`."""
        async for message in self.messages("forecast"):
            yield live_forecast(message)

    def messages(self, *kinds: str) -> AsyncIterator[dict[str, Any]]:
        """Yields messages of those kinds; see `Client.messages`."""
        return self._follow(_messages(kinds, self._where.token))

    def follow_alarms(self, after: int = 0) -> AsyncIterator[dict[str, Any]]:
        """Yields each alarm after that number, none left out; see `Client.follow_alarms`."""
        return self._follow(_Course("alarms", after=after))

    async def _follow(self, course: _Course) -> AsyncIterator[dict[str, Any]]:
        while True:
            try:
                async with await self._connected(course.door) as line:
                    if course.first is not None:
                        await line.send(course.first)
                    async for text in line:
                        message = course.take(text)
                        if message is not None:
                            yield message
            except GONE as error:
                _give_up(error)
            await asyncio.sleep(course.pause())

    async def _connected(self, door: str) -> AsyncConnection:
        self._where.site = self._where.site or self._where.chosen(await self.sites())
        where = self._where.socket(self._where.site, door)
        return await connect_async(where, additional_headers=self._where.headers, compression=None, open_timeout=10.0)
