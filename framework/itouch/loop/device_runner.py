"""A supervised device in the loop: its frame in the world, the inputs of its twin, and the twin's step."""

from __future__ import annotations

from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from itouch.exchange import LateTwin
from itouch.faults import FaultyTwin
from itouch.joining import is_newest
from itouch.loop.rigid_transforms import Frame, frame
from itouch.plugin import Bound, Channel, Record, Role, TwinInputs
from itouch.plugin.bound import bound_by
from itouch.plugin.quantity import SIZES
from itouch.safety import DeviceFaultError, Gate, Lifecycle, Status, Trip
from itouch.schema.plugin_errors import error_text, failing
from itouch.world import DeviceModel

__all__ = ["DeviceFaultError", "Runner", "Status"]


class Runner:
    """Runs one device, or its twin, on its part of State.

    It has a ``gate``, through which readings and commands pass, and a ``lifecycle``, which opens and enables it;
    both go by one ``latch``, which has its status.
    """

    __slots__ = (
        "_calibration", "_frame", "_framed_for", "_mount", "_period", "_true_frame", "command", "gate", "latch",
        "lifecycle", "model", "reading", "sent", "touch", "worn_by",
    )  # fmt: skip

    def __init__(self, model: DeviceModel, state: Record, period: float) -> None:
        device = None if model.twin else model.make_device()
        self.model, self._period = model, period
        #: What passes, when it may act, and its status; and the views of State that the gate lets through.
        self.gate = Gate(model, state, period, device=device, twin=model.make_twin() if model.twin else None)
        self.lifecycle, self.latch = Lifecycle(self.gate, state, period), self.gate.latch
        self.reading, self.command, self.sent = self.gate.reading, self.gate.command, self.gate.sent
        self._calibration = state[f"{model.name}.calibration"]
        self._mount = self._frame = frame(model.mount)
        self._framed_for: list[float] = []
        error = model.mount_error
        self._true_frame = self._mount.moved((-error[0], -error[1], -error[2]))
        self.touch = TwinInputs(ambient=model.ambient)
        #: Name of the probe on whose finger the device is worn; empty: on none.
        self.worn_by = ""

    def read_as(self, role: Role) -> NDArray[np.float64]:
        """Return the view of the first reading of a role; zeros if there is none."""
        return _view(self.reading, self.model.reading(role), role)

    def commanded(self, role: Role) -> NDArray[np.float64]:
        """Return the view of the first command of a role; zeros if there is none."""
        return _view(self.command, self.model.command(role), role)

    def sent_as(self, role: Role) -> NDArray[np.float64]:
        """Return the view of the first command of a role as it was sent; zeros if there is none."""
        return _view(self.sent, self.model.command(role), role)

    def start(self, seed: int) -> None:
        """Set the device's part of State to its start; ``seed`` and the device's name seed the twin's noise."""
        self.lifecycle.reset()
        self._calibration[:] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
        if self.gate.twin is not None:
            words = [seed, *self.model.name.encode()]
            self.gate.twin.reset(self.gate.twin_state, np.random.default_rng(words))

    def base_frame(self) -> Frame:
        """Return the device's frame in its carrier, from mount and calibration."""
        calibration = self._calibration.tolist()
        if calibration != self._framed_for:  # composed anew only when a calibration has changed
            self._framed_for = calibration
            self._frame = self._mount.compose(frame(calibration))
        return self._frame

    def true_frame(self) -> Frame:
        """Return the twin's true frame in its carrier."""
        return self._true_frame

    def bound_twin(self) -> Bound | None:
        """Return the step of the twin as one compiled call; None: there is no twin, or its step is Python's."""
        if self.gate.twin is None or not is_newest(type(self.gate.twin), "bound_step", "step"):
            return None
        with failing(f"device '{self.model.name}'", "the step of its twin", self.model.place):
            calls = bound_by(self.gate.twin.bound_step, self.gate.twin_state, self.sent, self.touch, self._period)
        return next(iter(calls), None)

    def step_twin(self, tick: int) -> None:
        """Advance the twin by one period under the commands that were sent.

        Raises
        ------
        DeviceFaultError
            If the twin has raised anything but KeyboardInterrupt.
        """
        twin = self.gate.link.bound
        if twin is None:
            return
        try:
            twin.step(self.gate.twin_state, self.sent, self.touch, self._period)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # a plugin that exits does not end the program
            self.not_stepped(error, 0, tick)

    def not_stepped(self, error: BaseException, which: int, tick: int) -> NoReturn:
        """Raise the fault for an error of the twin's step; ``which`` of its compiled calls it was makes no difference.

        Raises
        ------
        DeviceFaultError
            Always.
        """
        cause = f"failed in the step of its twin: {error_text(error)}"
        raise DeviceFaultError(self.model.name, tick, Trip.DEVICE_ERROR, cause) from error

    def settle(self) -> None:
        """Step the twin once before the first tick, so that its first reading is true; no planned fault acts yet."""
        twin = self.gate.twin.twin if isinstance(self.gate.twin, FaultyTwin) else self.gate.twin
        if twin is not None:
            with failing(f"device '{self.model.name}'", "the step of its twin", self.model.place):
                settle = twin.settle if isinstance(twin, LateTwin) else twin.step
                settle(self.gate.twin_state, self.sent, self.touch, self._period)

    def true_position(self) -> NDArray[np.float64] | None:
        """Return the view of the true position of the twin's end, in the device's frame; None: the twin has none."""
        return self.gate.twin.position(self.gate.twin_state) if self.gate.twin is not None else None


def _view(record: Record, channel: Channel | None, role: Role) -> NDArray[np.float64]:
    return np.zeros(SIZES.get(role, 1)) if channel is None else record[channel.name]
