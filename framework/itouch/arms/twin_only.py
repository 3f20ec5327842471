"""What virtual arms share: they only have a twin, with the force and stiffness of a common desktop arm."""

from __future__ import annotations

from itouch.plugin import Device, DeviceError, Mechanics, Opening, Record, wrench

#: Greatest force [N] and stiffness [N/m] of the simulated arm: those of common desktop arms.
FORCE, STIFFNESS = 8.0, 3000.0


class TwinOnlyArm(Device):
    """A simulated arm; its `input_source` leads the finger."""

    commands = (wrench(force=FORCE),)
    opening = Opening(twin_only=True)
    mechanics = Mechanics(max_stiffness=STIFFNESS, damping=0.0)

    def open(self) -> None:
        """Refuse: there is nothing to open.

        Raises
        ------
        DeviceError
            Always.
        """
        raise DeviceError(f'a {self.input_source} cannot be opened as hardware: it is twin only, write twin="yes"')

    def close(self) -> None:
        """Do nothing: it was never open."""

    def read(self, reading: Record) -> bool | None:
        """Refuse, as `open` does.

        Raises
        ------
        DeviceError
            Always.
        """
        raise DeviceError(f"a {self.input_source} cannot be read as hardware: it is twin only")
