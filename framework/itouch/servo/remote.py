"""The loop's side of remote twins: starting their processes, and standing in for them in the tick."""

from __future__ import annotations

import contextlib
import json
import os
import socket
import subprocess
import sys
import time

import numpy as np
from numpy.typing import NDArray

from itouch.loop.device_runner import Runner
from itouch.platforms import SERVO_PROCESS
from itouch.plugin import DeviceError, Field, Record, Twin, TwinInputs
from itouch.plugin.bound_twin import BoundTwin
from itouch.scene import write
from itouch.servo import twin_protocol
from itouch.servo.shared_memory import ServoError, monotonic
from itouch.session import Session

#: Time [s] without commands after which a remote twin makes itself safe: half of what may pass from a death to safety.
WATCHDOG = 0.1
#: How long [s] a remote twin's process may take to answer for the first time.
START_TIME = 60.0


class RemoteTwin(Twin):
    """Sends the tick's commands to a twin in another process, and takes over its State and readings as they come.

    Until it is connected it runs the twin in this process: a session on the virtual clock needs no second one.
    """

    def __init__(self, twin: Twin) -> None:
        super().__init__(twin.params)
        self.twin = twin
        self._bound = BoundTwin(twin)
        self._line: socket.socket | None = None
        self._sent = 0

    def fields(self) -> tuple[Field, ...]:
        """Return the fields of the twin's State, as far as it is known here."""
        return self.twin.fields()

    def reset(self, state: Record, rng: np.random.Generator) -> None:
        """Set the twin to its start."""
        self.twin.reset(state, rng)

    def position(self, state: Record) -> NDArray[np.float64] | None:
        """Return the twin's true position, as far as it is known here."""
        return self.twin.position(state)

    def connect(self, where: str, state: Record) -> None:
        """Connect to the twin in another process, and let it begin from this State.

        Raises
        ------
        ServoError
            If it does not answer.
        """
        try:
            line = twin_protocol.connect(where, START_TIME)
            line.send(twin_protocol.head(twin_protocol.INIT, 0, monotonic()) + state.tobytes())
            answer = line.recv(twin_protocol.PACKET)
        except OSError as error:
            raise ServoError(f"a remote twin does not answer: {error}") from error
        if not answer:
            raise ServoError("a remote twin ended while the session began")
        line.setblocking(False)
        self._line = line

    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        """Send the command; the twin's response comes back with a later reading."""
        if self._line is None:
            self._bound.step(state, command, touch, period)
            return
        self._sent += 1
        packet = (
            twin_protocol.head(twin_protocol.COMMAND, self._sent, monotonic())
            + command.tobytes()
            + twin_protocol.pack_touch(touch)
        )
        with contextlib.suppress(OSError):  # a twin that hangs or is gone is noticed by its silence
            self._line.send(packet)

    def read(self, state: Record, reading: Record) -> bool | None:
        """Take over the newest State and reading; False if none has come.

        Raises
        ------
        DeviceError
            If the remote twin has hung up, can't be reached, or has made itself safe.
        """
        if self._line is None:
            return self._bound.read(state, reading)
        newest: bytes | None = None
        try:
            while True:
                packet = self._line.recv(twin_protocol.PACKET)
                if not packet:
                    raise DeviceError("its remote twin has closed the connection")
                newest = packet
        except BlockingIOError:
            pass
        except OSError as error:
            raise DeviceError(f"its remote twin can't be reached: {error.strerror}") from error
        if newest is None:
            return False
        _, flags, body = twin_protocol.split(newest)
        size = state.nbytes
        state.raw.data[:], reading.raw.data[:] = body[:size], body[size:]
        if flags & twin_protocol.LATCHED:
            raise DeviceError("its remote twin has made itself safe")
        return True

    def hang_up(self) -> None:
        """Tell the twin that the session is over, and close the connection."""
        if self._line is not None:
            with contextlib.suppress(OSError):
                self._line.send(twin_protocol.BYE)
            self._line.close()
            self._line = None


class Remotes:
    """The remote twins of one session."""

    def __init__(self, session: Session, name: str) -> None:
        self._runners = [runner for runner in session.runners if runner.model.remote and SERVO_PROCESS]
        self._session = session
        #: Device -> the address on which its twin listens.
        self.addresses = {runner.model.name: twin_protocol.address(name, runner.model.name) for runner in self._runners}
        self.processes = [self._start(runner) for runner in self._runners]

    def _start(self, runner: Runner) -> subprocess.Popen[bytes]:
        scene = self._session.model.scene
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        listener.bind(self.addresses[runner.model.name])
        listener.listen(twin_protocol.WAITING)
        config = {
            "scene_xml": write(scene), "source": scene.source, "device": runner.model.name, "watchdog": WATCHDOG,
        }  # fmt: skip
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "itouch.servo.twin_process", str(listener.fileno()), str(os.getpid())],
            pass_fds=(listener.fileno(),), stdin=subprocess.PIPE, start_new_session=True,
        )  # fmt: skip
        listener.close()
        if process.stdin is not None:
            process.stdin.write(json.dumps(config).encode())
            process.stdin.close()
        return process

    def connect(self) -> None:
        """Let the twins in other processes take over from those in this one.

        Raises
        ------
        ServoError
            If one does not answer.
        """
        for runner in self._runners:
            if runner.gate.twin is not None:
                stand_in = RemoteTwin(runner.gate.twin)
                stand_in.connect(self.addresses[runner.model.name], runner.gate.twin_state)
                runner.gate.twin = stand_in

    def hang_up(self) -> None:
        """Hang up on the twins: each makes itself safe at once, then ends."""
        for runner in self._runners:
            if isinstance(runner.gate.twin, RemoteTwin):
                runner.gate.twin.hang_up()

    def close(self) -> None:
        """Wait for the twins' processes to end; one that was never connected has nothing to make safe: it is killed."""
        deadline = time.monotonic() + 5.0
        for runner, process in zip(self._runners, self.processes, strict=True):
            if not isinstance(runner.gate.twin, RemoteTwin):
                process.kill()
        for process in self.processes:
            try:
                process.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
