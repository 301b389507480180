"""Commands of the live service."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rampcast.cli import show as terminal
from rampcast.cli.app import app
from rampcast.cli.options import AnyModel, FormatName, MappingFile, SkipBadRows
from rampcast.cli.reading import Reading, read_raw
from rampcast.errors import RampcastError
from rampcast.files import read_settings

if TYPE_CHECKING:
    from rampcast.live.service import Choices, Source
    from rampcast.live.station import Station
    from rampcast.recording import Recording

TOKEN = "RAMPCAST_TOKEN"  # as in rampcast.live.guard, which is not imported for the help


Sites = Annotated[list[str] | None, typer.Option("--site", help="A site's name or .toml file; may be given again.")]
Sources = Annotated[
    list[str] | None,
    typer.Option(
        "--source",
        help="A recording (any form that rampcast reads), udp://HOST:PORT, mqtt://HOST/PREFIX, sumo://SITE, - (lines).",
    ),
]
Origin = Annotated[
    list[str] | None,
    typer.Option("--origin", metavar="LAT,LON", help="Where (0, 0) of the site's plane lies; SITE=LAT,LON of several."),
]
Control = Annotated[
    str | None,
    typer.Option("--control", metavar="RULE", help="Drive a metered ramp in SUMO under a rule of docs/control.md."),
]
Speed = Annotated[float, typer.Option("--speed", help="Of a replay: times as quick as it was recorded.")]
Repeat = Annotated[bool, typer.Option("--repeat", help="Of a replay: begin anew at its end.")]
Host = Annotated[str, typer.Option("--host", help="Address to listen at.")]
Port = Annotated[int, typer.Option("--port", min=0, max=65535, help="Port to listen at; 0 takes one that is free.")]
TokenFile = Annotated[
    Path | None, typer.Option("--token-file", help=f"File with the token of clients. Default: {TOKEN}, or none.")
]
Certificate = Annotated[Path | None, typer.Option("--certificate", help="Certificate for TLS (.pem).")]
Key = Annotated[Path | None, typer.Option("--key", help="Its key (.pem).")]
BehindProxy = Annotated[bool, typer.Option("--behind-proxy", help="A proxy in front of the service does TLS.")]
Hosts = Annotated[list[str] | None, typer.Option("--allow-host", help="Name under which the service may be asked for.")]
Origins = Annotated[
    list[str] | None, typer.Option("--allow-origin", help="Origin of a page elsewhere that may use it.")
]


@app.command(
    epilog="Examples:\n\nrampcast serve --source recording.parquet --speed 1\n\n"
    "rampcast serve --control alinea\n\n"
    "rampcast serve --site i80 --site us101 --host 0.0.0.0 --token-file token --behind-proxy"
)
def serve(
    site: Sites = None,
    source: Sources = None,
    origin: Origin = None,
    control: Control = None,
    model: AnyModel = None,
    speed: Speed = 1.0,
    repeat: Repeat = False,
    host: Host = "127.0.0.1",
    port: Port = 8480,
    token_file: TokenFile = None,
    certificate: Certificate = None,
    key: Key = None,
    behind_proxy: BehindProxy = False,
    allow_host: Hosts = None,
    allow_origin: Origins = None,
    format: FormatName = None,
    mapping: MappingFile = None,
    skip_bad_rows: SkipBadRows = False,
) -> None:
    """Serves forecasts of sites while frames come in, and a page in the browser that shows them.

    Stops at Ctrl-C. Messages and addresses: docs/live-messages.md.
    """
    from rampcast.live.serving import Address
    from rampcast.live.serving import serve as run

    may_ask, may_use = tuple(allow_host or ()), tuple(allow_origin or ())
    address = Address(host, port, certificate, key, behind_proxy, token_of(token_file), may_ask, may_use)
    reading = Reading(only_site(site or []), format, mapping, skip_bad_rows)
    under = [] if control is None else [controlled(control, speed=speed, model=model)]
    stations, sources = parts_of(site or [], source or [], origin or [], reading, under, speed=speed, repeats=repeat)
    names = ", ".join(one.name for one in stations)
    run(
        stations,
        sources=sources,
        choices=choices_of(model, sources=sources),
        address=address,
        announce=lambda where: terminal.say(f"serving {names} at {where}"),
    )


def only_site(sites: list[str]) -> str | None:
    """Returns the site that recordings are read for; None, where there are none or several, leaves it to the file."""
    return sites[0] if len(sites) == 1 else None


def parts_of(
    sites: list[str],
    sources: list[str],
    origins: list[str],
    reading: Reading,
    under: "Sequence[tuple[Station, Source]]" = (),
    *,
    speed: float,
    repeats: bool,
) -> "tuple[list[Station], list[Source]]":
    """Returns the sites, and what gives them frames; those under a controller besides.

    Raises:
        RampcastError: there is none, or one cannot be read.
    """
    from rampcast.live.sources import source_of
    from rampcast.live.station import Station
    from rampcast.sites import load_site

    stations = {one.name: Station(one.name, one) for one in map(load_site, sites)}
    stations |= {station.name: station for station, _ in under}

    def read(path: Path) -> "Recording":
        return read_raw([path], reading)

    found = [source_of(source, stations, read, speed=speed, repeats=repeats) for source in sources]
    found += [source for _, source in under]
    if not stations:
        raise RampcastError("no site was given: name one with --site, or a recording with --source")
    for origin in origins:
        place_on_earth(stations, origin)
    return [*stations.values()], found


def controlled(rule: str, *, speed: float, model: Path | None) -> "tuple[Station, Source]":
    """Returns a ramp under a rule, in SUMO, and what drives it.

    Raises:
        RampcastError: there is no such rule.
    """
    from rampcast.control.showing import SITE, job_of
    from rampcast.live.station import Station
    from rampcast.live.sumo import Sumo

    site = job_of(rule, 1).plan.corridor.site
    name = "pretrained" if model is None else str(model.absolute())
    return Station(SITE, site), Sumo(SITE, speed=speed, rule=rule, model=name)


def place_on_earth(stations: "dict[str, Station]", origin: str) -> None:
    """Tells a site where it lies: "LAT,LON", or "SITE=LAT,LON" where there are several.

    Raises:
        RampcastError: it is neither.
    """
    from rampcast.live.earth import Earth

    name, _, place = origin.rpartition("=")
    named = stations.get(name) if name or len(stations) > 1 else next(iter(stations.values()))
    try:
        lat, lon = (float(part) for part in place.split(","))
        if named is None or not (abs(lat) <= 90.0 and abs(lon) <= 180.0):
            raise ValueError
    except ValueError:
        raise RampcastError(f"--origin {origin}: expected LAT,LON in degrees, or SITE=LAT,LON") from None
    named.earth = Earth(named.site, lat, lon)


def choices_of(model: Path | None, *, sources: "list[Source]") -> "Choices":
    """Returns how to forecast; of a recording as `rampcast forecast` does.

    Raises:
        RampcastError: the model is none that forecasts all vehicles of a moment.
    """
    from rampcast.live.replay import Replay
    from rampcast.live.service import Choices
    from rampcast.models.folder import kind_of

    if model is not None and kind_of(model) != "rampcast":
        raise RampcastError(f"--model {model}: the paper's framework; expected a model of `rampcast train`")
    replays = any(isinstance(one, Replay) for one in sources)
    return Choices("pretrained" if model is None else str(model.absolute()), recalibrates=not replays)


def token_of(file: Path | None) -> str | None:
    """Returns the token that clients have to know; None for none.

    Raises:
        RampcastError: its file cannot be read, or is empty.
    """
    if file is None:
        return os.environ.get(TOKEN) or None
    try:
        token = read_settings(file).strip()
    except (OSError, ValueError) as error:
        raise RampcastError(f"{file}: the token cannot be read: {error}") from error
    if not token:
        raise RampcastError(f"{file}: no token is in it; write one of 16 letters or more, drawn at random")
    return token
