"""Elements `<safety>`: limits for the whole scene, and `<fault>`: what goes wrong with a twin, on purpose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from itouch.schema.fields import children, choice, flag, quantity, ref, temperature, text

#: The kinds of fault that can be injected.
FAULTS = (
    "disconnect", "freeze", "nan", "bias", "drift", "spike", "delay", "drop", "reversed-sign", "saturated",
    "wrong-units", "garbage",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Safety:
    """Limits for the whole scene; they may only be tighter than the defaults."""

    TAG: ClassVar[str] = "safety"
    force: float | None = quantity("N", positive=True, default=None, doc="greatest force of any device on the operator")
    torque: float | None = quantity(
        "N*m", positive=True, default=None,
        doc="greatest torque of any device on the operator; never more than 20 mm times the force",
    )  # fmt: skip
    speed: float | None = quantity("m/s", positive=True, default=None, doc="greatest speed of any carried surface")
    temperature: tuple[float, float] | None = temperature(
        size=2, low=200, high=400, default=None, doc="lowest and highest plate temperature"
    )
    plate_force: float | None = quantity(
        "N", positive=True, default=None, doc="force on the finger above which the plate yields"
    )
    plate_rate: float | None = quantity(
        "K/s",
        positive=True,
        default=None,
        doc="rate of the plate's temperature in contact above which its drive is cut down",
    )
    flux: float | None = quantity(
        "W/m^2", positive=True, default=None, doc="mean flux above which the plate's drive is cut down"
    )
    dose: float | None = quantity("s", positive=True, default=None, doc="thermal dose of a session, CEM43")
    cold_time: float | None = quantity(
        "s", positive=True, default=None, doc="time in contact with a cold plate in a session, at most 120 s"
    )
    contact_time: float | None = quantity(
        "s", positive=True, default=None, doc="time of one contact after which the plate withdraws: 10 s, or up to 60 s"
    )
    ramp: float | None = quantity(
        "s", low=0.0, high=60.0, default=None, doc="ramp-in after enabling; default: 1 s on hardware, none on twins"
    )
    hold_to_run: bool = flag(
        default=False, doc="whether somebody must hold the dead-man's switch on twins, too; hardware always needs it"
    )
    servo_overrun: str = choice("stop", "warn", default="warn", doc="what happens when the loop falls behind real time")
    watchdog: float | None = quantity("s", positive=True, default=None, doc="greatest age of a device's reading")
    participant: str = text(
        default="",
        doc="code of the participant: thermal dose and time in the cold then add up over all sessions of that code",
    )


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault that is injected into the twin of a device, to see what follows from it; never into hardware."""

    TAG: ClassVar[str] = "fault"
    REQUIRES: ClassVar[tuple[tuple[str, str], ...]] = (("amount", "channel"),)
    device: str = ref("device", doc="whose twin fails")
    kind: str = choice(*FAULTS, doc="how it fails")
    at: float = quantity("s", low=0.0, high=1e6, doc="when it begins, in simulated time")
    for_: float | None = quantity(
        "s", positive=True, default=None, doc="how long it lasts; default: to the end of the session"
    )
    channel: str = text(default="", doc="the reading or command that fails; default: all that can")
    amount: str = text(default="", doc="size of a bias or spike, or of a drift in a second, in the channel's unit")


@dataclass(frozen=True, slots=True)
class Faults:
    """All faults of a file; in the file they are direct children of `<itouch>`."""

    TAG: ClassVar[str] = "faults"
    faults: tuple[Fault, ...] = children(Fault)
