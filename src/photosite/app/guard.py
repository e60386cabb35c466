"""Who may call the server: the person with the link, from the page itself, on this machine."""

from __future__ import annotations

import hmac
import json
import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

SECURITY_HEADERS = {
    "content-security-policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-embedder-policy": "require-corp",
    "permissions-policy": "camera=(), microphone=(), geolocation=()",
    "cache-control": "no-store",
    "x-frame-options": "DENY",
}
MOST_JSON_BYTES = 1 << 20

_ENTERED = b"""<!doctype html><html lang="en"><head><meta charset="utf-8"><title>photosite</title>
<link rel="icon" href="/icon.svg">
<meta http-equiv="refresh" content="0; url=/"></head><body><p><a href="/">Open the workbench</a></p></body></html>"""
_NO_ENTRY = b"""<!doctype html><html lang="en"><head><meta charset="utf-8"><title>photosite</title></head><body>
<h1>photosite</h1><p>Open the link that <code>photosite serve</code> printed in the terminal. It holds the key of this
server.</p></body></html>"""


class Guard:
    """Middleware that checks host, origin and key, limits the size of requests and adds headers to every answer.

    Parameters
    ----------
    app
        The application.
    port
        Port of the server, which Host and Origin must name.
    token
        The key in the link, also accepted as `Authorization: Bearer`.
    upload_bytes
        Limit of the body of an upload; other requests have at most `MOST_JSON_BYTES`.
    """

    def __init__(self, app: App, port: int, token: str, upload_bytes: int) -> None:
        self._app, self._token, self._upload_bytes = app, token, upload_bytes
        self._hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}
        self._cookie, self._session = f"photosite_{port}", secrets.token_urlsafe(32)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve a request."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":
            return  # no web sockets
        headers: dict[str, str] = {}
        for name, value in scope["headers"]:
            headers.setdefault(name.decode("latin-1").lower(), value.decode("latin-1"))
        if (refused := self._refusal(scope, headers)) is not None:
            status, why = refused
            await _answer(send, status, json.dumps({"error": why}).encode(), "application/json")
            return
        if scope["path"] == "/" and scope["method"] == "GET" and self._has_token(scope):
            cookie = f"{self._cookie}={self._session}; Path=/; HttpOnly; SameSite=Strict"
            await _answer(send, 200, _ENTERED, "text/html; charset=utf-8", cookie)
            return
        if not self._is_known(headers):
            if scope["path"] == "/":
                await _answer(send, 401, _NO_ENTRY, "text/html; charset=utf-8")
            else:
                text = b'{"error": "open the link that photosite serve printed"}'
                await _answer(send, 401, text, "application/json")
            return
        limit = self._upload_bytes if scope["path"] == "/api/uploads" else MOST_JSON_BYTES
        await self._limited(scope, receive, send, headers, limit)

    def _refusal(self, scope: Scope, headers: dict[str, str]) -> tuple[int, str] | None:
        names = [name for name, _ in scope["headers"]]
        if headers.get("host", "") not in self._hosts or names.count(b"host") != 1:
            return 421, "this server answers to 127.0.0.1 and localhost only"
        origin = headers.get("origin")
        if origin is not None and origin not in {f"http://{host}" for host in self._hosts}:
            return 403, "requests of other pages are refused"
        if headers.get("sec-fetch-site", "none") not in ("none", "same-origin") and not self._is_link(scope, headers):
            return 403, "requests of other pages are refused"
        changes = scope["method"] not in ("GET", "HEAD")
        if changes and origin is None and "authorization" not in headers:
            return 403, "the header Origin or Authorization is missing"
        return None

    def _is_link(self, scope: Scope, headers: dict[str, str]) -> bool:
        """Return whether a person followed a link of another page, which shows the page but reads nothing."""
        return scope["method"] == "GET" and scope["path"] == "/" and headers.get("sec-fetch-mode") == "navigate"

    def _has_token(self, scope: Scope) -> bool:
        given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
        return hmac.compare_digest(given.encode(), self._token.encode())

    def _is_known(self, headers: dict[str, str]) -> bool:
        scheme, _, given = headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer":
            return hmac.compare_digest(given.strip().encode(), self._token.encode())
        try:
            cookies = SimpleCookie(headers.get("cookie", ""))
        except CookieError:
            return False
        found = cookies.get(self._cookie)
        return found is not None and hmac.compare_digest(found.value.encode(), self._session.encode())

    async def _limited(self, scope: Scope, receive: Receive, send: Send, headers: dict[str, str], limit: int) -> None:
        stated = headers.get("content-length", "0")
        if not (stated.isascii() and stated.isdigit()) or int(stated) > limit:
            text = json.dumps({"error": f"the request is larger than {limit} bytes"}).encode()
            await _answer(send, 413, text, "application/json")
            return
        received, started, refused = 0, False, False

        async def counted() -> Message:
            nonlocal received, refused
            message = await receive()
            received += len(message.get("body", b""))
            if received > limit:
                refused = True
                raise _TooLargeError
            return message

        async def with_headers(message: Message) -> None:
            nonlocal started
            if refused and not started:
                raise _TooLargeError  # in place of the application's own answer
            if message["type"] == "http.response.start":
                started = True
                message["headers"] = [*message["headers"], *_security_headers(message["headers"])]
            await send(message)

        try:
            await self._app(scope, counted, with_headers)
        except _TooLargeError:
            if not started:
                text = json.dumps({"error": f"the request is larger than {limit} bytes"}).encode()
                await _answer(send, 413, text, "application/json")


class _TooLargeError(Exception):
    pass


def _security_headers(existing: list[tuple[bytes, bytes]]) -> list[tuple[bytes, bytes]]:
    known = {name.lower() for name, _ in existing}
    added = ((name.encode(), value.encode()) for name, value in SECURITY_HEADERS.items())
    return [(name, value) for name, value in added if name not in known]


async def _answer(send: Send, status: int, body: bytes, kind: str, cookie: str | None = None) -> None:
    headers = [(b"content-type", kind.encode()), (b"content-length", str(len(body)).encode())]
    headers += _security_headers([])
    if cookie is not None:
        headers.append((b"set-cookie", cookie.encode()))
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
