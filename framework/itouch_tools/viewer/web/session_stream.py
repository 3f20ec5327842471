"""Streams a running session to browsers until it ends, in a process of its own that only reads the session."""

from __future__ import annotations

import asyncio
import contextlib
import io
import os
import random
import socket
import sys
from collections.abc import Callable, Iterator
from typing import Any

from itouch.plugin import Record
from itouch.plugin.discovery import Catalog
from itouch.schema import ItouchError
from itouch.servo import Link
from itouch.world import Model
from itouch_tools.viewer.web.access import Access, Gate
from itouch_tools.viewer.web.browser_scene import BrowserScene

#: Updates a second; after how many updates the text is renewed; and the niceness of this process.
RATE, WORDS, NICE = 30.0, 6, 10


def show(link: Link, access: Access, told: Callable[[str], None], looks: Callable[[int], None]) -> None:
    """Serve a session until it ends.

    Parameters
    ----------
    link
        The session; it is only read.
    access
        Where browsers reach it, and the token that they must show.
    told
        Called with the address for a browser when the server listens.
    looks
        Called, in another thread, when another browser connects, with the number of browsers.

    Raises
    ------
    ItouchError
        If it can't listen at that address.
    """
    with contextlib.suppress(OSError, AttributeError):
        os.nice(NICE)  # the loop comes first on a machine with few cores
    with _server(link.name) as server:
        inner = (server.get_host(), server.get_port())
        model = Model.of(link.scene(), Catalog())
        browser_scene = BrowserScene(server, model, link.state)
        server.on_client_connect(lambda _: looks(len(server.get_clients())))
        asyncio.run(_serve(link, access, inner, browser_scene, told))


async def _serve(
    link: Link, access: Access, inner: tuple[str, int], browser_scene: BrowserScene, told: Callable[[str], None]
) -> None:
    try:
        async with Gate(access, inner) as gate:
            told(address(access, gate.port))
            state, pictures = link.state, 0
            words = ""
            while link.alive:
                link.refresh(state)
                if pictures % WORDS == 0:
                    words = said(link, state)
                browser_scene.show(state, words)
                pictures += 1
                await asyncio.sleep(1.0 / RATE)
    except OSError as error:
        raise ItouchError(
            f"cannot listen at {access.host}:{access.port}: {error.strerror or error}; --port takes another"
        ) from error


def address(access: Access, port: int) -> str:
    """Return the URL to open in a browser."""
    host = "localhost" if access.near else access.host
    if host in ("0.0.0.0", "::"):  # all addresses of this machine: browsers elsewhere need its name
        host = socket.gethostname()
    host = f"[{host.strip('[]')}]" if ":" in host else host
    return f"http://{host}:{port}/" + (f"?token={access.token}" if access.token else "")


def said(link: Link, state: Record) -> str:
    """Return the words beside the picture, as Markdown: the session's name, its time and phase, and losses."""
    words = f"**{_plain(link.name)}**\n\n{int(state['tick']) * link.period:.2f} s, {link.phase}"
    for loss in link.losses:
        words += f"\n\n**{loss.upper()} LOST**"
    return words


def _plain(text: str) -> str:
    """Return a name escaped for Markdown."""
    return "".join(letter if letter.isalnum() or letter in " .-" else f"\\{letter}" for letter in text)


@contextlib.contextmanager
def _server(name: str) -> Iterator[Any]:
    """Yield the library's server, which listens on this machine only and does not print its address."""
    import viser

    class UnsharedServer(viser.ViserServer):
        """Does not share the view through a server on the internet, even if a browser asks for it."""

        def request_share_url(self, verbose: bool = True) -> str | None:
            """Refuse."""
            return None

    with contextlib.redirect_stdout(io.StringIO()):  # it would print an address that bypasses the gate
        server = UnsharedServer(host=_inner_host(), port=0, label=name, verbose=False)
    try:
        server.gui.configure_theme(show_logo=False, show_share_button=False, dark_mode=True)
        yield server
    finally:
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()


def _inner_host() -> str:
    """Return a loopback address that no page can guess, where there is more than one."""
    if sys.platform == "linux":
        found = ".".join(["127", *(str(random.SystemRandom().randrange(1, 255)) for _ in range(3))])
        with contextlib.suppress(OSError), socket.socket() as probe:
            probe.bind((found, 0))
            return found
    return "127.0.0.1"
