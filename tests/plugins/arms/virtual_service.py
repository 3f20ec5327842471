"""A virtual Inverse Service in a thread, for tests."""

from __future__ import annotations

import threading
import time
from types import TracebackType
from typing import Self

from itouch_arms.haply.server import Server
from itouch_arms.haply.virtual import VirtualService


class ServedService:
    """Listens on a free port of this machine; plugs in and out like a program that is started and ended."""

    def __init__(self, service: VirtualService | None = None) -> None:
        self.service = service or VirtualService()
        self.port = 0
        self.start()

    def start(self) -> None:
        self._stop = threading.Event()
        self._server = Server(self.service, ("127.0.0.1", self.port))
        self.port = self._server.port
        self._thread = threading.Thread(target=self._server.serve, args=(self._stop.is_set, time.monotonic))
        self._thread.start()

    def end(self) -> None:
        self._stop.set()
        self._thread.join(300.0)
        self._server.close()

    @property
    def address(self) -> str:
        return f"127.0.0.1:{self.port}"

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.end()
