"""What every request passes first: its host, its origin, its token; and the headers that every answer carries."""

from typing import Final

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from rampcast.live.answers import Refusal, refused
from rampcast.live.guard import HEADERS, Guard

OPEN: Final = ("/healthz", "/readyz")  # for those who watch the process, who have no token
POLICY_VIOLATED: Final = 1008


class Entrance:
    """Lets in who may come in, and closes the door to others."""

    def __init__(self, app: ASGIApp, guard: Guard) -> None:
        self.app, self.guard = app, guard

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Passes a request on, or refuses it."""
        if scope["type"] == "lifespan":
            return await self.app(scope, receive, send)
        refusal = self._refusal(scope)
        if scope["type"] == "websocket":
            if refusal is None:
                return await self.app(scope, receive, send)
            await receive()
            return await send({"type": "websocket.close", "code": POLICY_VIOLATED, "reason": refusal.text})

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        if refusal is None:
            return await self.app(scope, receive, send_with_headers)
        return await refused(refusal)(scope, receive, send_with_headers)

    def _refusal(self, scope: Scope) -> Refusal | None:
        headers = Headers(scope=scope)
        if not self.guard.knows_host(headers):
            return Refusal(421, "this is not the host that the service was asked to answer for")
        if not self.guard.knows_origin(headers) and (scope["type"] == "websocket" or scope["method"] != "GET"):
            return Refusal(403, "a page of another origin may not do this")
        if scope["type"] == "websocket":  # the token may come in the first message
            return None
        return self._token_refusal(scope, headers)

    def _token_refusal(self, scope: Scope, headers: Headers) -> Refusal | None:
        """Returns why a request without the right token is refused; the page itself holds nothing of the sites."""
        path = scope["path"]
        if path in OPEN or not path.startswith(("/v1", "/metrics")) or self.guard.token is None:
            return None
        address = (scope.get("client") or ("",))[0]
        if not self.guard.may_guess(address):
            return Refusal(429, "too many wrong tokens; wait a minute")
        if self.guard.has_token(headers):
            return None
        if "authorization" in headers:
            self.guard.guessed_wrong(address)
        return Refusal(401, "give the token in the header: Authorization: Bearer TOKEN")
