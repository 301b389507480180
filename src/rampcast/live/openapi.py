"""What the service answers, as OpenAPI tells it."""

from typing import Any, Final

import msgspec

from rampcast import __version__
from rampcast.live.frames import Frame
from rampcast.live.replay import Control

SITE: Final = {"name": "site", "in": "path", "required": True, "schema": {"type": "string"}}
VEHICLE: Final = {"name": "vehicle", "in": "path", "required": True, "schema": {"type": "string"}}
REPLAYED: Final = {"name": "site", "in": "query", "required": False, "schema": {"type": "string"}}
ERRORS: Final = {
    400: "not HTTP",
    401: "the token is missing or wrong",
    403: "a page of another origin asks",
    404: "there is none",
    408: "the body did not come",
    413: "too long",
    421: "asked for by a name that is not the service's",
    422: "not what was expected",
    429: "too many",
    503: "not ready",
}
TAKES: Final = (403, 404, 408, 413, 422)  # what a door for bodies may answer
ALWAYS: Final = (401, 421, 429)  # what any door may answer


def openapi() -> dict[str, Any]:
    """Returns the description of all that can be asked over HTTP."""
    _, parts = msgspec.json.schema_components((Frame, Control), ref_template="#/components/schemas/{name}")
    error = {"type": "object", "required": ["error"], "properties": {"error": {"type": "string"}}}
    return {
        "openapi": "3.1.0",
        "info": {
            "title": "rampcast live",
            "version": __version__,
            "description": "Forecasts of the vehicles of highway sites. Messages and units: docs/live-messages.md.",
            "license": {"name": "MIT", "identifier": "MIT"},
        },
        "paths": _paths(),
        "components": {
            "schemas": parts | {"Error": error},
            "securitySchemes": {"token": {"type": "http", "scheme": "bearer"}},
        },
        "security": [{}, {"token": []}],
    }


def _paths() -> dict[str, Any]:
    site = "/v1/sites/{site}"
    numbers = [_number("from_ms", required=True), _number("to_ms", required=True), _number("every_ms", minimum=1.0)]
    return {
        "/healthz": {"get": _operation("Whether the process runs", errors=())},
        "/readyz": {"get": _operation("Whether forecasts can be had", errors=(503,))},
        "/metrics": {"get": _operation("Metrics for Prometheus", kind="text/plain")},
        "/openapi.json": {"get": _operation("This description", errors=())},
        "/v1/sites": {"get": _operation("The sites")},
        site: {"get": _operation("A site as GeoJSON", SITE, errors=(404,), kind="application/geo+json")},
        f"{site}/latest": {"get": _operation("The newest forecast", SITE, errors=(404,))},
        f"{site}/status": {"get": _operation("How a site is", SITE, errors=(404,))},
        f"{site}/vehicles/{{vehicle}}/forecast": {
            "get": _operation("The newest forecast of one vehicle", SITE, VEHICLE, errors=(404,))
        },
        f"{site}/alarms": {
            "get": _operation("Alarms after a number", SITE, _number("after", minimum=0.0), errors=(404, 422))
        },
        f"{site}/tracks": {"post": _operation("Takes a frame in", SITE, errors=TAKES, body="Frame")},
        "/v1/replay": {
            "get": _operation("Where the replay is", REPLAYED, errors=(404,)),
            "post": _operation("Controls the replay", REPLAYED, errors=TAKES, body="Control"),
        },
        "/v1/replay/truth": {"get": _operation("What vehicles did", REPLAYED, *numbers, errors=(404, 422))},
    }


def _operation(
    summary: str,
    *parameters: dict[str, Any],
    errors: tuple[int, ...] | None = None,
    kind: str = "application/json",
    body: str | None = None,
) -> dict[str, Any]:
    """Returns what OpenAPI tells of one question."""
    good = {"description": summary, "content": {kind: {"schema": {"type": "string" if "text" in kind else "object"}}}}
    wrong = {"application/json": {"schema": {"$ref": "#/components/schemas/Error"}}}
    codes = sorted({*(errors or ()), *(ALWAYS if errors != () else (421,))})
    answers = {"202" if body == "Frame" else "200": good}
    if 503 in codes:
        answers["503"] = good
        codes.remove(503)
    answers |= {str(code): {"description": ERRORS[code], "content": wrong} for code in codes}
    found: dict[str, Any] = {"summary": summary, "responses": answers}
    if parameters:
        found["parameters"] = list(parameters)
    if body is not None:
        schema = {"schema": {"$ref": f"#/components/schemas/{body}"}}
        found["requestBody"] = {"required": True, "content": {"application/json": schema}}
    return found


def _number(name: str, *, required: bool = False, minimum: float | None = None) -> dict[str, Any]:
    schema: dict[str, Any] = {"type": "number"} | ({} if minimum is None else {"minimum": minimum})
    return {"name": name, "in": "query", "required": required, "schema": schema}
