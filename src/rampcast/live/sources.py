"""Where frames come from, as the command line and compose files name it: `udp://`, `mqtt://`, `-`, or a recording."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final
from urllib.parse import SplitResult, urlsplit

from rampcast.errors import RampcastError
from rampcast.live.datagrams import Datagrams
from rampcast.live.guard import TOKEN
from rampcast.live.lines import Lines
from rampcast.live.mqtt import Broker
from rampcast.live.replay import Replay
from rampcast.live.service import Source
from rampcast.live.station import Station
from rampcast.live.sumo import Sumo
from rampcast.recording import Recording

UDP_PORT: Final = 8481
SCHEMES: Final = ("udp", "mqtt", "mqtts", "sumo")
PASSWORD: Final = "RAMPCAST_MQTT_PASSWORD"  # of the environment


def source_of(text: str, stations: dict[str, Station], read: Callable[[Path], Recording], **replayed: Any) -> Source:
    """Returns the source that a text names; a recording brings its site with it, if that is not there yet.

    Args:
        text: `udp://HOST:PORT`, `mqtt://HOST:PORT/PREFIX`, `sumo://SITE`, `-` for lines of the input stream, or the
            path of a recording.
        stations: the sites by their ids.
        read: gives the recording in a file.
        replayed: how a recording is replayed; see `Replay`.

    Raises:
        RampcastError: it names none.
    """
    if text == "-":
        return Lines()
    where = urlsplit(text)
    if "://" not in text:
        return _replay(read(Path(text)), stations, replayed)
    if where.scheme not in SCHEMES:
        known = ", ".join(f"{scheme}://" for scheme in SCHEMES)
        raise RampcastError(f"--source {where.scheme}://...: expected {known}, - for lines, or a recording's file")
    if where.password is not None:
        raise RampcastError(f"--source {where.scheme}://...: no secrets in addresses; put the password into {PASSWORD}")
    if where.scheme == "sumo":
        return _simulated(where, stations, replayed.get("speed", 1.0))
    if where.scheme == "udp":
        return Datagrams(_host(where), where.port or UDP_PORT, os.environ.get(TOKEN) or None)
    tls = where.scheme == "mqtts"
    prefix = where.path.strip("/") or "rampcast"
    port = where.port or (8883 if tls else 1883)
    return Broker(_host(where), port, prefix, where.username, os.environ.get(PASSWORD), tls=tls)


def _host(where: SplitResult) -> str:
    if not where.hostname:
        raise RampcastError(f"--source {where.geturl()}: expected {where.scheme}://HOST:PORT")
    return where.hostname


def _replay(recording: Recording, stations: dict[str, Station], replayed: dict[str, Any]) -> Replay:
    name = recording.site.name
    stations.setdefault(name, Station(name, recording.site))
    return Replay(recording, name, **replayed)


def _simulated(where: SplitResult, stations: dict[str, Station], speed: float) -> Sumo:
    name = where.netloc
    if name not in stations:
        raise RampcastError(f"--source {where.geturl()}: give the site that is simulated with --site {name}")
    return Sumo(name, speed=speed)
