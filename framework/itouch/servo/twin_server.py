"""One twin in a process of its own (``python -m itouch.servo.twin_process``), like a piece of hardware.

It steps on its own clock, whatever the servo process does.  It makes itself safe when no command comes for the time of
its watchdog, when the connection is lost, or when a second opener says so, and stays safe until a session begins anew.
"""

from __future__ import annotations

import contextlib
import json
import math
import socket
import struct
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from itouch.exchange.thread import make_safe
from itouch.loop import WallClock
from itouch.plugin import HOLD, RETRACT, Field, Record, TwinInputs
from itouch.plugin.bound_twin import BoundTwin
from itouch.plugin.discovery import Catalog
from itouch.scene import loads
from itouch.servo import realtime, twin_protocol
from itouch.servo.shared_memory import monotonic
from itouch.world import DeviceModel
from itouch.world.rig import build_devices

#: How long [s] the twin outlives its session: at most until it is at rest; and how long [s] it rests for late readers.
LINGER, REST = 3.0, 0.3
#: How long [s] it waits for a session to begin.
PATIENCE = 60.0
#: How many connections are accepted or refused in one step, and how many packets of each are read.
KNOCKS, PACKETS = 16, 256


class TwinServer:
    """Steps one twin, and talks to all that are connected."""

    def __init__(self, model: DeviceModel, listener: socket.socket, *, watchdog: float, period: float) -> None:
        self.model, self._period, self._watchdog = model, period, watchdog
        self._listener = listener
        listener.setblocking(False)
        self._clients: list[socket.socket] = []
        self._primary: socket.socket | None = None
        self._watchers: list[socket.socket] = []
        self.twin = model.make_twin()
        fields = self.twin.fields()
        self.state = Record.of(fields) if fields else Record(np.dtype([]))
        self.twin.reset(self.state, np.random.default_rng(0))
        self.reading, self.command, self.acting = (_record(c) for c in (model.reads, model.commands, model.commands))
        self.touch = TwinInputs(ambient=model.ambient)
        self._slow = model.limits.speed or 0.0
        self._latched, self._over, self._begun = "", False, False
        self._last_target, self._sank, self._steps = math.nan, -math.inf, 0
        self._bound = BoundTwin(self.twin)
        self._rehearse()
        self._heard = 0
        self._sequence = 0
        self._flags = 0
        self._height: float | None = None

    def _rehearse(self) -> None:
        """Load or compile the twin's kernels before any step counts."""
        scratch, reading = self.state.copy(), self.reading.copy()
        for touch in (TwinInputs(), TwinInputs(force=1.0, gap=-1e-3)):
            self.twin.step(scratch, self.acting, touch, self._period)
            self.twin.read(scratch, reading)

    # --- who is there -------------------------------------------------------------------------------------------------

    def _accept(self) -> None:
        with contextlib.suppress(BlockingIOError):
            for _ in range(KNOCKS):
                client, _ = self._listener.accept()
                if not twin_protocol.same_user(client):  # abstract sockets have no permissions: any user can connect
                    client.close()
                    continue
                client.setblocking(False)
                self._clients.append(client)

    def _listen(self) -> None:
        for client in list(self._clients):
            for _ in range(PACKETS):  # a client that sends more has to wait for the next step, but no other client has
                packet = self._receive(client)
                if packet is None:
                    break
                try:
                    self._hear(client, packet)
                except (struct.error, ValueError):  # truncated, or of another version
                    self._let_go(client)
                    break

    def _receive(self, client: socket.socket) -> bytes | None:
        try:
            packet = client.recv(twin_protocol.PACKET)
        except BlockingIOError:
            return None
        except OSError:
            packet = b""
        if packet:
            return packet
        self._let_go(client)
        return None

    def _let_go(self, client: socket.socket) -> None:
        """Hang up on a client that is gone or sends nonsense; if it was the session's, the twin makes itself safe."""
        self._clients.remove(client)
        if client in self._watchers:
            self._watchers.remove(client)
        if client is self._primary:
            self._primary = None
            self._latch("the connection to the servo process is gone")
        client.close()

    def _hear(self, client: socket.socket, packet: bytes) -> None:
        kind = packet[:1]
        if kind == twin_protocol.COMMAND and client is self._primary:
            self._obey(packet)
        elif kind == twin_protocol.INIT and self._primary in (None, client):
            self._begin(client, packet)
        elif kind == twin_protocol.SAFE:
            self._latch(packet[1:].decode(errors="replace") or "a second opener")
        elif kind == twin_protocol.WATCH:
            self._watchers.append(client)
        elif kind == twin_protocol.BYE and client is self._primary:
            self._latch("the session has ended")
            self._over = True

    def _begin(self, client: socket.socket, packet: bytes) -> None:
        _, _, body = twin_protocol.split(packet)
        if len(body) == len(self.state.raw):
            self.state.raw.data[:] = body
        self.twin.read(self.state, self.reading)
        self._primary, self._latched, self._over, self._begun = client, "", False, False
        self._tell_event("begin", "")

    def _obey(self, packet: bytes) -> None:
        self._sequence, _, body = twin_protocol.split(packet)
        self._heard, self._begun = monotonic(), True
        size = len(self.command.raw)
        self.command.raw.data[:] = body[:size]
        twin_protocol.unpack_touch(body[size:], self.touch)
        self._height = None

    # --- being safe ---------------------------------------------------------------------------------------------------

    def _latch(self, cause: str) -> None:
        if not self._latched:
            self._latched = cause
            self._tell_event("safe", cause)

    def _watch(self) -> None:
        silent = (monotonic() - self._heard) * 1e-9
        if self._begun and silent > self._watchdog:
            self._latch(f"its watchdog, after {silent * 1e3:.0f} ms without a command")

    def _choose(self) -> None:
        """Choose what acts in this step: the command, or if latched the safe one, approached at the allowed speed."""
        if not self._latched:
            self.acting.raw[:] = self.command.raw
            return
        before = {c.name: float(self.acting[c.name][2]) for c in self.model.commands if c.safe is RETRACT}
        make_safe(self.acting, self.model.commands)
        for name, height in before.items():
            self.acting[name][2] = max(float(self.acting[name][2]), height - self._slow * self._period)

    def _carry_on_alone(self) -> None:
        """Let the finger stay where it was, as nobody tells where it is now: a plate that sinks leaves it."""
        position = self.twin.position(self.state)
        if position is None:
            return
        if self._height is None:
            self._height, self._gap, self._force = float(position[2]), self.touch.gap, self.touch.wrench[2]
        sunk = self._height - float(position[2])
        share = max(0.0, 1.0 - sunk / 2e-3)  # a pad of 1 N/mm under a few newtons is free after 2 mm
        self.touch.wrench[2] = self._force * share
        self.touch.force *= share

    def _sinks(self, height: float) -> bool:
        """Tell whether the plate is on its way down.

        On a busy machine the next step of a retreat may be late; after the watchdog's time without one, the plate
        counts as standing still.
        """
        if height < self._last_target - 1e-9:
            self._sank = self._steps
        elif height > self._last_target + 1e-9:
            self._sank = -math.inf
        self._last_target = height
        return (self._steps - self._sank) * self._period < self._watchdog

    def _judge(self) -> int:
        """Return the flags for what acts now."""
        safe = clear = True
        for channel in self.model.commands:
            value = self.acting[channel.name]
            if isinstance(channel.safe, tuple):
                safe = safe and bool(np.array_equal(value, channel.safe))
            elif channel.safe is RETRACT:
                bottom = channel.low[2] if channel.low else -math.inf
                down = bool(self._latched) or float(value[2]) <= bottom + 1e-6
                safe = safe and (self._sinks(float(value[2])) or down)
                clear = clear and abs(float(self.touch.wrench[2])) < 0.1
            elif channel.safe is HOLD:
                safe = safe and bool(self._latched)
        flags = (
            twin_protocol.LATCHED * bool(self._latched)
            | twin_protocol.OUTPUTS_SAFE * safe
            | twin_protocol.CLEAR * clear
        )
        return flags | twin_protocol.BEGUN * self._begun

    # --- telling ------------------------------------------------------------------------------------------------------

    def _tell(self) -> None:
        if self._primary is not None:
            flags = self._flags
            body = (
                twin_protocol.head(twin_protocol.TELL, self._sequence, flags)
                + self.state.tobytes()
                + self.reading.tobytes()
            )
            _send(self._primary, body)
        packet = twin_protocol.head(twin_protocol.OBSERVED, monotonic(), self._flags)
        for watcher in self._watchers:
            _send(watcher, packet)

    def _tell_event(self, what: str, detail: str) -> None:
        text = json.dumps({"device": self.model.name, "what": what, "detail": detail, "host_ns": monotonic()})
        for watcher in self._watchers:
            _send(watcher, twin_protocol.EVENT + text.encode())

    # --- living -------------------------------------------------------------------------------------------------------

    @property
    def begun(self) -> bool:
        """Whether a command has come: from then on the process lives until the twin is safe."""
        return self._begun

    @property
    def flags(self) -> int:
        """The flags after the last step: LATCHED, OUTPUTS_SAFE, CLEAR, BEGUN."""
        return self._flags

    def step(self) -> None:
        """Take one step: listen, choose what acts, move on, tell."""
        self._steps += 1
        self._accept()
        self._listen()
        self._watch()
        if self._begun:  # before the first command nothing moves
            self._move()
        flags = self._judge()
        if flags != self._flags:
            self._flags = flags
            self._tell_event("flags", str(flags))
        self._tell()

    def _move(self) -> None:
        self._choose()
        if self._latched:
            self._carry_on_alone()
        self._bound.step(self.state, self.acting, self.touch, self._period)
        self._bound.read(self.state, self.reading)

    def live(self) -> None:
        """Step until the session is over and the twin is at rest."""
        clock, end = WallClock(), monotonic() + round(PATIENCE * 1e9)
        clock.start(self._period)
        rested = 0
        while monotonic() < end:
            if clock.wait() > 0.1:
                clock.start(self._period)
            self.step()
            if self._primary is not None and not self._over:
                end, rested = monotonic() + round(LINGER * 1e9), 0
                continue
            done = self._latched and self._flags & twin_protocol.OUTPUTS_SAFE and self._flags & twin_protocol.CLEAR
            rested = rested + 1 if done else 0
            if rested * self._period > REST:
                return

    def close(self) -> None:
        """Hang up."""
        for client in (*self._clients, self._listener):
            client.close()


def _send(client: socket.socket, packet: bytes) -> None:
    with contextlib.suppress(OSError):  # a client that does not read misses packets; one that is gone is noticed later
        client.send(packet)


def _record(channels: Sequence[Any]) -> Record:
    return Record.of(Field.of(channel) for channel in channels)


def serve(said: str, listener: socket.socket, living: Callable[[Callable[[], bool]], None]) -> None:
    """Serve one twin, described as JSON; ``living`` is called with a function that tells whether its session began."""
    config = json.loads(said)
    catalog = Catalog()
    scene = loads(config["scene_xml"].encode(), catalog, shown=config["source"])
    model = build_devices(scene, catalog, [])[config["device"]]
    server = TwinServer(model, listener, watchdog=config["watchdog"], period=1.0 / scene.rates.servo)
    living(lambda: server.begun)
    realtime.sharpen_timer()
    realtime.take_priority(realtime.REMOTE_PRIORITY)
    realtime.freeze_garbage()
    try:
        server.live()
    finally:
        server.close()
