"""A Phantom or Touch as a device: it tracks the finger and pushes it; three translations, rotations locked."""

from __future__ import annotations

from dataclasses import dataclass

from itouch.plugin import Attached, ImpedanceArm, Mechanics, Opening, Record, Timing, schema, wrench
from itouch_arms.errors import ArmError, NotCalibrated
from itouch_arms.openhaptics.phantom import Phantom

#: Greatest force [N] and stiffness [N/m] of a Phantom Omni, as OpenHaptics states them (3.3 N and 0.5 N/mm).
FORCE, STIFFNESS = 3.3, 500.0
_BUTTONS = {"none": 0, "button1": 1, "button2": 2}


@dataclass(frozen=True, slots=True)
class OpenHapticsParams:
    """A Phantom or Touch behind OpenHaptics.

    The frame: x right, y away from the operator, z up; the origin is the library's.
    """

    name: str = schema.text(default="", doc="the arm's name in its maker's configuration; empty: the default one")
    library: str = schema.text(default="", doc="file of the library; empty: libHD.so where the system looks for it")
    grip: tuple[float, float, float] = schema.quantity(
        "m", size=3, low=-0.2, high=0.2, default=(0.0, 0.0, 0.0), doc="from the arm's end to the fingertip's centre"
    )
    calibration_time: float = schema.quantity(
        "s", low=0.0, high=3600.0, default=60.0, doc="how long the operator may take to calibrate the arm"
    )
    deadman: str = schema.choice(*_BUTTONS, default="none", doc="button of the stylus that must be held to run")
    resolution: float = schema.quantity(
        "m", low=0.0, high=1e-3, default=5e-5, doc="of the twin: step of the position that the arm gives"
    )


class OpenHaptics(ImpedanceArm[Phantom]):
    """A Phantom or Touch arm through OpenHaptics, the maker's library, presented with six degrees of freedom."""

    Params = OpenHapticsParams
    commands = (wrench(force=FORCE),)
    timing = Timing(blocking=True)
    #: When a process dies, its copy of the library dies with it, and another process can open the arm without force.
    opening = Opening(second_opener=True)
    mechanics = Mechanics(max_stiffness=STIFFNESS, damping=0.0)
    errors_after_zero_force = (NotCalibrated,)

    @classmethod
    def discover(cls) -> tuple[Attached, ...]:
        """Open the default arm without force, if the library is there."""
        arm = Phantom()
        try:
            arm.open()
        except ArmError as error:
            return (Attached(arm.model or "OpenHaptics", False, str(error)),)
        arm.close()
        return (Attached(arm.model or "an arm", True, f"calibrated; at most {arm.max_force:g} N"),)

    @classmethod
    def wires(cls, params: OpenHapticsParams) -> tuple[str, ...]:
        """Name the arm as OpenHaptics knows it."""
        return (f"OpenHaptics arm {params.name}".rstrip(),)

    def make_driver(self, *, safe: bool = False) -> Phantom:
        """Return the driver of the arm, not opened yet."""
        p = self.params
        return Phantom(
            p.name, p.library, calibration_time=0.0 if safe else p.calibration_time, patience=self.timeout_factor,
            trace=self.trace,
        )  # fmt: skip

    def read(self, reading: Record) -> bool:
        """Read the newest frame; the pose is the fingertip's.

        Raises
        ------
        DeviceError
            If frames stop, or the library reports an error.
        """
        found = self.opened().read()
        self.write_reading(reading, found.position, bool(found.buttons & _BUTTONS[self.params.deadman]))
        return True
