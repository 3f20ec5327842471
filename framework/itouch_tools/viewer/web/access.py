"""Who may look at a session in a browser: a gate, with the one open port and a token, before the library's server.

That server has no access control of its own.  It listens on this machine only; a request is forwarded to it if it comes
from a page of this address and, where other machines may look, from a browser that has shown the token.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
from dataclasses import dataclass
from urllib.parse import parse_qs, urlsplit

#: Largest head of a request [bytes], how long [s] it may take to arrive, and most connections at once.
HEAD, PATIENCE, MOST = 16384, 10.0, 64
#: The cookie that holds the token.
COOKIE = "itouch-view"
LOOPBACK = frozenset({"localhost", "127.0.0.1", "[::1]"})
_PIECE = 1 << 16


@dataclass(frozen=True, slots=True)
class Access:
    """Where browsers reach the view: the address and port to listen at, and the token that browsers must show.

    Without a token only requests to this machine by its own name are answered.
    """

    host: str = "127.0.0.1"
    port: int = 8080
    token: str = ""

    @property
    def near(self) -> bool:
        """Whether the address can be reached from this machine only."""
        return self.host in LOOPBACK | {"::1"}


@dataclass(frozen=True, slots=True)
class Request:
    """The head of a request: its target, its headers by lower-case name, its bytes."""

    target: str
    headers: dict[str, str]
    data: bytes


class Gate:
    """Answers browsers in place of a server at ``inner`` (address, port), which sees only what may pass."""

    def __init__(self, access: Access, inner: tuple[str, int]) -> None:
        self._access, self._inner = access, inner
        self._server: asyncio.Server | None = None
        self._open = 0

    async def __aenter__(self) -> Gate:
        host = self._access.host.strip("[]")
        self._server = await asyncio.start_server(self._answer, host, self._access.port, limit=HEAD)
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._server is not None:
            self._server.close()

    @property
    def port(self) -> int:
        """The port at which the gate listens."""
        assert self._server is not None  # noqa: S101
        return int(self._server.sockets[0].getsockname()[1])

    async def _answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._open += 1
        try:
            if self._open > MOST:
                writer.write(_page(503, "too many browsers view this session"))
                return
            request = await asyncio.wait_for(_request(reader), PATIENCE)
            refused = self.refusal(request)
            if refused is not None:
                writer.write(refused)
                return
            await self._forward(request, reader, writer)
        except (OSError, ValueError, TimeoutError, asyncio.IncompleteReadError, asyncio.LimitOverrunError):
            pass  # a browser that goes away, or a client that does not speak HTTP
        finally:
            self._open -= 1
            with contextlib.suppress(OSError):
                writer.close()

    def refusal(self, request: Request) -> bytes | None:
        """Return the answer to a request that may not pass, or None if it may."""
        access, host = self._access, request.headers.get("host", "")
        if not access.token and _name(host) not in LOOPBACK:
            return _page(403, "this view is for this machine only")  # a foreign name that leads here: DNS rebinding
        origin = request.headers.get("origin")
        if origin is not None and urlsplit(origin).netloc != host:
            return _page(403, "a page of another address may not look")
        if not access.token:
            return None
        parts = urlsplit(request.target)
        shown = parse_qs(parts.query).get("token", [""])[0]
        if shown and _same(shown, access.token):
            kept = f"{COOKIE}={access.token}; HttpOnly; SameSite=Strict; Path=/"
            return _page(303, "", f"Location: {parts.path or '/'}\r\nSet-Cookie: {kept}\r\n")
        cookies = (part.strip().partition("=") for part in request.headers.get("cookie", "").split(";"))
        if any(name == COOKIE and _same(value, access.token) for name, _, value in cookies):
            return None
        return _page(401, "open the address that `itouch-py view --web` printed: it ends in ?token=...")

    async def _forward(self, request: Request, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Carry bytes both ways until either side ends; each connection is checked once, at its first request."""
        inner_reader, inner_writer = await asyncio.open_connection(*self._inner)
        try:
            inner_writer.write(request.data)
            ways = {asyncio.ensure_future(_carry(reader, inner_writer)),
                    asyncio.ensure_future(_carry(inner_reader, writer))}  # fmt: skip
            try:
                await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
            finally:
                for way in ways:
                    way.cancel()
                await asyncio.gather(*ways, return_exceptions=True)
        finally:
            inner_writer.close()


async def _carry(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    while data := await reader.read(_PIECE):
        writer.write(data)
        await writer.drain()  # a slow browser slows down its own stream and no other's


async def _request(reader: asyncio.StreamReader) -> Request:
    """Read a request's head.

    Raises
    ------
    ValueError
        If it is not a request that a browser would make of a view.
    """
    data = await reader.readuntil(b"\r\n\r\n")
    first, *lines = data.decode("latin-1").split("\r\n")[:-2]
    method, target, _ = first.split(" ")
    if method != "GET":
        raise ValueError(f"{method} is not asked of a view")
    headers: dict[str, str] = {}
    for line in lines:
        name, colon, value = line.partition(":")
        name = name.strip().lower()
        if not colon or (name in headers and name in ("host", "origin")):
            raise ValueError("a header that says two things")
        headers[name] = value.strip()
    return Request(target, headers, data)


def _name(host: str) -> str:
    """Return the name in a host header, without its port."""
    return host if host.endswith("]") or ":" not in host else host.rpartition(":")[0]


def _same(one: str, other: str) -> bool:
    return hmac.compare_digest(one.encode(), other.encode())


def _page(status: int, words: str, more: str = "") -> bytes:
    body = (words + "\n").encode() if words else b""
    head = f"HTTP/1.1 {status} \r\nContent-Type: text/plain; charset=utf-8\r\nContent-Length: {len(body)}\r\n"
    return (head + more + "Cache-Control: no-store\r\nConnection: close\r\n\r\n").encode() + body
