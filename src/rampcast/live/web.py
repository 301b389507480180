"""The web application: what can be asked of the service, over HTTP and WebSockets."""

import contextlib
from collections.abc import AsyncIterator, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles

from rampcast.errors import RampcastError
from rampcast.live.answers import Refusal, answer, body_of, error_answer, number_of
from rampcast.live.entrance import Entrance
from rampcast.live.frames import FrameError
from rampcast.live.geo import site_geojson
from rampcast.live.guard import Buckets, Guard
from rampcast.live.metrics import KIND, Metrics
from rampcast.live.openapi import openapi
from rampcast.live.replay import Control, Replay
from rampcast.live.service import Service
from rampcast.live.sockets import alarm_socket, ingest_socket, live_socket
from rampcast.live.station import Station

PAGE: Final = Path(__file__).parent / "page"


def application(service: Service, *, guard: Guard | None = None, page: Path = PAGE) -> Starlette:
    """Returns the web application of a service, which it starts and stops.

    Args:
        service: sites, forecasts and sources.
        guard: who may come in; None lets all in who reach the address.
        page: folder of the page that is served at `/`.
    """
    guard = guard or Guard()

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        await service.start()
        try:
            yield
        finally:
            await service.stop()

    app = Starlette(routes=[*_routes(), *_page(page)], lifespan=lifespan, exception_handlers={Refusal: error_answer})
    app.state.service, app.state.guard, app.state.buckets = service, guard, Buckets()
    app.state.metrics = Metrics(service)
    app.add_middleware(Entrance, guard=guard)
    return app


def _routes() -> list[BaseRoute]:
    site = "/v1/sites/{site}"
    return [
        Route("/healthz", healthy),
        Route("/readyz", ready),
        Route("/metrics", metrics),
        Route("/openapi.json", description),
        Route("/v1/sites", sites),
        Route(site, geometry),
        Route(f"{site}/latest", latest),
        Route(f"{site}/status", status),
        Route(f"{site}/vehicles/{{vehicle}}/forecast", vehicle_forecast),
        Route(f"{site}/alarms", alarms),
        Route(f"{site}/tracks", tracks, methods=["POST"]),
        Route("/v1/replay", replay_state, methods=["GET"]),
        Route("/v1/replay", replay_control, methods=["POST"]),
        Route("/v1/replay/truth", replay_truth),
        WebSocketRoute(f"{site}/live", live_socket),
        WebSocketRoute(f"{site}/ingest", ingest_socket),
        WebSocketRoute(f"{site}/alarms", alarm_socket),
    ]


def _page(page: Path) -> Sequence[BaseRoute]:
    return [Mount("/", StaticFiles(directory=page, html=True))] if page.is_dir() else []


def service_of(request: Any) -> Service:
    """Returns the service that a request or a socket asks."""
    service: Service = request.app.state.service
    return service


def station_of(request: Request) -> Station:
    """Returns the site that a request names.

    Raises:
        Refusal: there is none.
    """
    name = request.path_params["site"]
    found = service_of(request).stations.get(name)
    if found is None:
        raise Refusal(404, f"there is no site {name!r}; GET /v1/sites lists them")
    return found


async def healthy(_: Request) -> Response:
    """Answers that the process runs."""
    return answer({"status": "ok"})


async def ready(request: Request) -> Response:
    """Answers whether forecasts can be had: 503 until the process that forecasts is warm."""
    is_ready = service_of(request).is_ready
    return answer({"status": "ready" if is_ready else "warming"}, status=200 if is_ready else 503)


async def metrics(request: Request) -> Response:
    """Answers with the metrics that Prometheus asks for."""
    found: Metrics = request.app.state.metrics
    return Response(found.text(), media_type=KIND)


async def description(_: Request) -> Response:
    """Answers with what can be asked, as OpenAPI tells it."""
    return answer(openapi())


async def sites(request: Request) -> Response:
    """Answers which sites there are."""
    stations = service_of(request).stations.values()
    return answer({"sites": [_summary(station) for station in stations]})


def _summary(station: Station) -> dict[str, Any]:
    site = station.site
    return {
        "id": station.name,
        "title": site.title,
        "simulated": site.simulated,
        "length": site.length,
        "stale": station.stale,
        "degraded": station.degraded,
        "viewers": len(station.viewers),
        "replay": station.told_by_source is not None,
    }


async def geometry(request: Request) -> Response:
    """Answers with the site as GeoJSON."""
    station = station_of(request)
    return answer(site_geojson(station.name, station.site, station.earth), kind="application/geo+json")


async def latest(request: Request) -> Response:
    """Answers with the newest forecast: 404 until there is one."""
    return Response(_newest(request), media_type="application/json")


async def status(request: Request) -> Response:
    """Answers how the site is."""
    service = service_of(request)
    return answer(station_of(request).status(ready=service.is_ready, starts=service.supervisor.starts))


def _newest(request: Request) -> bytes:
    found = station_of(request).latest
    if found is None:
        raise Refusal(404, "there is no forecast yet")
    return found.json


async def vehicle_forecast(request: Request) -> Response:
    """Answers with the newest forecast of one vehicle."""
    message = msgspec.json.decode(_newest(request))
    name = request.path_params["vehicle"]
    for vehicle in message.pop("vehicles"):
        if str(vehicle["id"]) == name:
            return answer(message | {"vehicle": vehicle})
    raise Refusal(404, f"there is no vehicle {name!r} in the newest forecast")


async def alarms(request: Request) -> Response:
    """Answers with the alarms after a number, and those that are raised now."""
    kept, after = station_of(request).alarms, int(number_of(request, "after", 0.0, least=0.0))
    lost = max(kept.oldest - 1 - after, 0)
    return answer({"alarms": kept.after(after), "active": kept.active, "last": kept.number, "lost": lost})


async def tracks(request: Request) -> Response:
    """Takes a frame in."""
    station = station_of(request)
    buckets: Buckets = request.app.state.buckets
    if not buckets.takes(station.name, request.client.host if request.client else ""):
        return answer({"error": "too many frames a second"}, status=429, headers={"retry-after": "1"})
    try:
        taken = service_of(request).receive(await body_of(request), station=station)
    except FrameError as error:
        raise Refusal(422, str(error)) from error
    return answer({"verdict": taken.verdict, "rows": taken.rows, "epoch": taken.epoch}, status=202)


def _replay(request: Request) -> Replay:
    asked = request.query_params.get("site")
    for source in service_of(request).sources:
        if isinstance(source, Replay) and asked in (None, source.station):
            return source
    raise Refusal(404, "no recording is being replayed")


async def replay_state(request: Request) -> Response:
    """Answers where the replay is, when vehicles of the recording merge, and which merges were dangerous."""
    replay = _replay(request)
    from rampcast.live.near_misses import near_misses  # jax: only who replays waits for it

    marks = {"merges": replay.merges(), "conflicts": near_misses(replay.recording)}
    return answer({"site": replay.station, **replay.state, **marks})


async def replay_control(request: Request) -> Response:
    """Plays, stops, steps, moves or speeds the replay."""
    replay = _replay(request)
    try:
        asked = msgspec.json.decode(await body_of(request), type=Control)
        return answer({"site": replay.station, **replay.control(asked.action, asked.value)})
    except (msgspec.DecodeError, UnicodeDecodeError, RampcastError) as error:
        raise Refusal(422, str(error)) from error


async def replay_truth(request: Request) -> Response:
    """Answers with what vehicles of the recording did between two times."""
    replay = _replay(request)
    begin, end = number_of(request, "from_ms"), number_of(request, "to_ms")
    every = number_of(request, "every_ms", 200.0, least=1.0)
    return answer({"site": replay.station, "vehicles": replay.truth(begin, end, every)})
