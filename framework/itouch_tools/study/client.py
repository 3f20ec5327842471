"""Lead a served study from another program: PsychoPy, a notebook, any Python 3.8 or newer.

It needs only the standard library, and nothing else of this package: this one file can be copied beside an experiment.
``itouch-py study serve STUDY.xml`` is the other end, and says where its key is::

    from itouch_tools.study.client import connect

    with connect("STUDY.key.json") as touch:
        touch.set(material="wood")
        felt = touch.touch()
        touch.mark("answer", {"key": "left", "flux": felt["mean_flux_W_m2"]})

Other languages speak the same lines: see the how-to "Lead the touch from another program".
"""

from __future__ import annotations

import json
import os
import socket
from typing import Any, Dict, Optional, Union  # noqa: UP035  - the file also runs on Python 3.8

#: Version of the protocol (of the lines) that this client speaks.
LINES = 1
#: A study that is silent for this long [s] beyond the time that was asked for counts as lost.
PATIENCE = 30.0

Told = Dict[str, Any]  # noqa: UP006


class ServedError(Exception):
    """A served study refuses a request, or can't be reached; ``code`` is a word for programs."""

    def __init__(self, code: str, sentence: str) -> None:
        super().__init__(sentence)
        self.code = code


def connect(key: Union[str, "os.PathLike[str]"], *, timeout: float = 10.0) -> Touch:  # noqa: UP007, UP037
    """Connect to the study whose key is in a file.

    Raises
    ------
    ServedError
        ``no-key``: there is no such file, or it is another study's; ``lost``: nobody listens.
    """
    try:
        with open(key, encoding="utf-8") as stream:
            told = json.load(stream)
        host, port, token = str(told["host"]), int(told["port"]), str(told["token"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        said = f"'{os.fspath(key)}' holds no key: {getattr(error, 'strerror', None) or error!r}; is the study served?"
        raise ServedError("no-key", said) from error
    return Touch(host, port, token, timeout=timeout)


class Touch:
    """A connection to a served study; also a context manager that ends it.  The study goes on without it.

    Every call waits for the answer.  Times are in seconds of the study's own clock.
    """

    def __init__(self, host: str, port: int, token: str, *, timeout: float = 10.0) -> None:
        self._number, self._rest = 0, b""
        try:
            self._line = socket.create_connection((host, port), timeout=timeout)
        except OSError as error:
            raise ServedError("lost", f"no study server at {host}:{port}") from error
        self._line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        told = self._exchange({"token": token}, timeout)
        if told.get("itouch") != LINES:
            self.close()
            raise ServedError("other-lines", f"the study speaks version {told.get('itouch')} of the lines")

    def describe(self) -> Told:
        """Return the study's name, its factors with their levels, and what is set now."""
        return self._ask("describe")

    def set(self, **levels: Any) -> Told:
        """Set what is touched next: levels of factors, numbers for staircases; those that are not named stay.

        Afterwards a twin's hand waits at the start of its path.
        """
        return self._ask("set", {"levels": levels})

    def go(self) -> Told:
        """Give the signal to touch: a twin's hand starts to move."""
        return self._ask("go")

    def now(self) -> Told:
        """Return what can be read now: seconds, what is touched, force, flux, the skin's temperature."""
        return self._ask("now")

    def wait(self, what: str, seconds: float = 60.0, **more: float) -> Told:
        """Wait for ``ready``, ``contact``, ``release``, ``skin`` (with ``skin_degC=``) or only ``seconds``.

        Returns
        -------
        dict
            The entries of ``now``, and ``met``: whether it happened within ``seconds``.
        """
        given: Told = {"for": what, "seconds": seconds}
        given.update(more)
        return self._ask("wait", given, seconds)

    def wait_contact(self, seconds: float = 60.0) -> bool:
        """Wait until the study's object is touched; return whether it was."""
        return bool(self.wait("contact", seconds)["met"])

    def wait_release(self, seconds: float = 60.0) -> bool:
        """Wait until nothing is touched; return whether that is so."""
        return bool(self.wait("release", seconds)["met"])

    def wait_skin(self, skin_degC: float, seconds: float = 120.0, within_K: float = 0.5) -> bool:
        """Wait until the skin's temperature is within ``within_K`` of ``skin_degC``; return whether it is."""
        return bool(self.wait("skin", seconds, skin_degC=skin_degC, within_K=within_K)["met"])

    def felt(self, samples: bool = False) -> Told:
        """Return what was felt in the touch since the last ``set``: figures, and ``void`` (why it would not count).

        With ``samples`` also ``flux_W_m2`` and ``skin_degC``, a number every ``period_s``.
        """
        told = self._ask("felt", {"samples": samples})
        found: Told = dict(told["figures"])
        found["void"] = told["void"]
        found.update(told.get("samples", {}))
        return found

    def touch(self, seconds: float = 60.0, samples: bool = False) -> Told:
        """Wait until the plate is ready, give the signal, wait for touch and release, and return what was felt.

        Raises
        ------
        ServedError
            ``not-touched``: one of these did not happen within ``seconds``.
        """
        for what in ("ready", "contact", "release"):
            if not self.wait(what, seconds)["met"]:
                raise ServedError("not-touched", f"no '{what}' within {seconds:g} s")
            if what == "ready":
                self.go()
        return self.felt(samples)

    def mark(self, name: str, payload: Any = None) -> float:
        """Set a mark, such as an answer, in the session's State; return its time [s]."""
        return float(self._ask("mark", {"name": name, "payload": payload})["seconds"])

    def stop(self) -> None:
        """End the study that is served."""
        self._ask("stop")

    def close(self) -> None:
        """Close the connection."""
        self._line.close()

    def __enter__(self) -> Touch:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _ask(self, what: str, given: Optional[Told] = None, seconds: float = 0.0) -> Told:  # noqa: UP045
        self._number += 1
        said: Told = {"do": what, "id": self._number}
        said.update(given or {})
        return self._exchange(said, seconds + PATIENCE)

    def _exchange(self, said: Told, seconds: float) -> Told:
        try:
            self._line.settimeout(seconds)
            self._line.sendall(json.dumps(said, allow_nan=False).encode() + b"\n")
            told = self._next()
        except OSError as error:
            self.close()
            raise ServedError("lost", f"the served study does not answer: {error}") from error
        if "error" in told:
            raise ServedError(told["error"]["code"], told["error"]["message"])
        return told

    def _next(self) -> Told:
        while b"\n" not in self._rest:
            piece = self._line.recv(1 << 16)
            if not piece:
                raise OSError("it has closed the connection")
            self._rest += piece
        line, _, self._rest = self._rest.partition(b"\n")
        return dict(json.loads(line.decode()))


__all__ = ["ServedError", "Touch", "connect"]
