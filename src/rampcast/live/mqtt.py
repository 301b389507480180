"""Frames from an MQTT broker, and forecasts and alarms to it."""

import asyncio
import ssl
from dataclasses import dataclass
from typing import Any, Final

import msgspec

from rampcast.errors import MissingExtra
from rampcast.live.frames import FrameError
from rampcast.live.log import log, log_wrong
from rampcast.live.messages import encoded
from rampcast.live.service import Service
from rampcast.live.station import Station
from rampcast.live.v2x import advice_of, frames_of_v2x
from rampcast.live.viewers import Viewer

WAITING: Final = 20  # messages of the broker that wait; more are a burst after a pause, of which the newest count
SOONEST, LATEST = 0.05, 1.0  # [s] until the broker is called again, twice as long each time
ADVICE: Final = 1.0  # [s] between two messages of advice
KINDS: Final = ("tracks", "cpm", "detected")


@dataclass
class Broker:
    """A broker: `PREFIX/SITE/tracks`, `cpm` and `detected` come in, `forecast`, `alarm` and `mcm` go out.

    Attributes:
        host, port: of the broker.
        prefix: of all topics.
        user, password: None where the broker asks for none.
        tls: whether the line is encrypted.
        wrong: messages that held no frame.
        connects: how often a connection was made.
    """

    host: str
    port: int
    prefix: str = "rampcast"
    user: str | None = None
    password: str | None = None
    tls: bool = False
    wrong: int = 0
    connects: int = 0

    async def run(self, service: Service) -> None:
        """Takes frames in until it is cancelled; calls the broker again when it is gone."""
        try:
            import aiomqtt
        except ImportError as error:
            raise MissingExtra('MQTT needs another package; run: pip install "rampcast[streams]"') from error
        pause = SOONEST
        while True:
            before = self.connects
            try:
                async with aiomqtt.Client(
                    self.host,
                    self.port,
                    username=self.user,
                    password=self.password,
                    tls_context=ssl.create_default_context() if self.tls else None,
                    max_queued_incoming_messages=WAITING,
                    timeout=5.0,
                    keepalive=5,
                ) as client:
                    await self._connected(client, service)
            except aiomqtt.MqttError as error:
                log("broker_gone", host=self.host, text=str(error)[:200])
            pause = SOONEST if self.connects > before else min(2.0 * pause, LATEST)
            await asyncio.sleep(pause)

    async def _connected(self, client: Any, service: Service) -> None:
        self.connects += 1
        for kind in KINDS:
            await client.subscribe(f"{self.prefix}/+/{kind}", qos=0)
        log("broker_connected", host=self.host, port=self.port)
        out = [asyncio.create_task(self._publish(client, station)) for station in service.stations.values()]
        out += [asyncio.create_task(self._publish_alarms(client, station)) for station in service.stations.values()]
        try:
            async for message in client.messages:
                self._take(service, str(message.topic), bytes(message.payload))
        finally:
            for task in out:
                task.cancel()
            await asyncio.gather(*out, return_exceptions=True)

    def _take(self, service: Service, topic: str, payload: bytes) -> None:
        name, _, kind = topic.removeprefix(f"{self.prefix}/").partition("/")
        station = service.stations.get(name)
        try:
            if station is None:
                raise FrameError(f"topic {topic}: there is no site {name!r}")
            if kind in ("cpm", "detected"):
                for frame in frames_of_v2x(payload, station.earth):
                    service.take(station, frame)
            else:
                service.receive(payload, station=station)
        except FrameError as error:
            self.wrong += 1
            log_wrong(self.wrong, "mqtt", error)

    async def _publish(self, client: Any, station: Station) -> None:
        """Gives the broker the newest forecasts, and advice in the form of V2X."""
        advised = -ADVICE
        viewer = Viewer(binary=False, kinds=frozenset({"forecast"}))
        station.viewers.add(viewer)
        try:
            while True:
                message = await viewer.next()
                await client.publish(f"{self.prefix}/{station.name}/forecast", message, qos=0)
                now = asyncio.get_running_loop().time()
                if station.earth is None or now - advised < ADVICE:
                    continue
                advised = now
                for advice in advice_of(msgspec.json.decode(message), station.earth):
                    await client.publish(f"{self.prefix}/{station.name}/mcm", encoded(advice).json, qos=0)
        finally:
            station.viewers.remove(viewer)

    async def _publish_alarms(self, client: Any, station: Station) -> None:
        """Gives the broker every alarm, at least once; those of a time without a line come when it is back."""
        while True:
            for alarm in await station.alarms.wait(station.alarms_published):
                await client.publish(f"{self.prefix}/{station.name}/alarm", encoded(alarm).json, qos=1)
                station.alarms_published = alarm["number"]
