"""The Inverse3 as a device: it tracks the finger and pushes it; three translations, rotations locked."""

from __future__ import annotations

from dataclasses import dataclass

from itouch.plugin import Attached, Emulation, ImpedanceArm, Opening, Record, Timing, schema, wrench
from itouch_arms.errors import ArmError, NotCalibrated, NotFound, Refused
from itouch_arms.haply import messages
from itouch_arms.haply.emulator import HaplyEmulator
from itouch_arms.haply.inverse3 import SERVICE, Inverse3
from itouch_arms.haply.line import Line, address_of

#: Greatest force [N] that is asked of the arm: our own limit, below what such arms can give.
FORCE = 5.0
#: How long [s] a look at what is attached waits for the service and for its inventory.
_WAIT = 1.0


@dataclass(frozen=True, slots=True)
class HaplyParams:
    """A Haply Inverse3 behind its Inverse Service.

    The frame is the arm's own: x right, y away from the operator, z up, the origin at its base.
    """

    service: str = schema.text(default="", doc="HOST:PORT of the Inverse Service; empty: localhost:10001")
    device: str = schema.text(default="any", doc="the arm's number, such as 049D; any: the only one")
    grip: tuple[float, float, float] = schema.quantity(
        "m", size=3, low=-0.2, high=0.2, default=(0.0, 0.0, 0.0), doc="from the arm's cursor to the fingertip's centre"
    )
    calibration_time: float = schema.quantity(
        "s", low=0.0, high=3600.0, default=60.0, doc="how long the operator may take to calibrate the arm"
    )
    deadman: str = schema.choice(
        "none", "a", "b", "c", "button", default="none", doc="button of a VerseGrip that must be held to run"
    )
    resolution: float = schema.quantity(
        "m", low=0.0, high=1e-3, default=1e-5, doc="of the twin: step of the position that the arm gives"
    )

    def __post_init__(self) -> None:
        schema.validate(self)
        if self.service:
            try:
                address_of(self.service)
            except NotFound as error:
                raise ValueError(str(error)) from error


class Haply(ImpedanceArm[Inverse3]):
    """A Haply Inverse3 behind its local service (WebSocket), presented with six degrees of freedom."""

    Params = HaplyParams
    commands = (wrench(force=FORCE),)
    #: The service answers about a thousand times a second; asking more often than twice a tick only costs time.
    timing = Timing(blocking=True, period=5e-4)
    #: The service accepts a second connection, so another process can send zero force.
    opening = Opening(second_opener=True)
    emulation = Emulation(Emulator=HaplyEmulator)
    errors_after_zero_force = (NotCalibrated, Refused)

    @classmethod
    def discover(cls) -> tuple[Attached, ...]:
        """Ask the service on this machine for its arms."""
        return look()

    @classmethod
    def wires(cls, params: HaplyParams) -> tuple[str, ...]:
        """Name the arm behind its service: the service accepts commands from several clients."""
        return (f"arm {params.device} of the Inverse Service {params.service or SERVICE}",)

    def make_driver(self, *, safe: bool = False) -> Inverse3:
        """Return the driver of the arm behind the service."""
        p = self.params
        return Inverse3(
            p.service or SERVICE, p.device, button=p.deadman, calibration_time=0.0 if safe else p.calibration_time,
            patience=self.timeout_factor, trace=self.trace,
        )  # fmt: skip

    def read(self, reading: Record) -> bool:
        """Send one message and read the answer; the pose is the fingertip's; tell whether it held a position.

        Raises
        ------
        DeviceError
            If the service does not answer, answers nonsense, or the arm is gone.
        """
        found = self.opened().read()
        if found is None:
            return False
        self.write_reading(reading, found.position, found.pressed)
        return True


def look(service: str = SERVICE) -> tuple[Attached, ...]:
    """Return the arms in the service's inventory; nothing is commanded to them."""
    try:
        line = Line(service, wait=_WAIT)
    except ArmError as error:
        return (Attached(f"Inverse Service at {service}", False, str(error)),)
    try:
        inventory = messages.read(line.receive(_WAIT))
        found = messages.arms(inventory)
    except ArmError as error:
        return (Attached(f"Inverse Service at {service}", False, str(error)),)
    finally:
        line.close()
    if not found:
        return (Attached(f"Inverse Service at {service}", False, "it has no Inverse3: plug it in and power it"),)
    return tuple(_attached(one) for one in found)


def _attached(one: messages.Message) -> Attached:
    where = f"Inverse3 {one['device_id']}"
    try:
        messages.check(one)
    except ArmError as error:
        return Attached(where, False, str(error))
    return Attached(where, True, "calibrated and powered, as the service says")
