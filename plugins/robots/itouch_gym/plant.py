"""The plant: a finger presses a Peltier display that is to produce a given heat flux; a session of itouch-py."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import itouch

#: Duration of a step and of an episode [s]; in an episode the finger hovers, comes down, rests, and goes up.
STEP, EPISODE = 0.02, 6.5
#: Divisors of a heat flux [W/m^2] and of a temperature [K], and the temperature that counts as 0 [K].
FLUX, WARMTH, MIDDLE = 1000.0, 10.0, 303.15
MATERIALS = ("aluminium", "pyrex", "wood", "polystyrene")
_CONTROL = '<thermal:flux-control display="peltier" desired-from="heat"/>'
_SCENE = """<itouch version="1.0"
        xmlns:thermal="urn:itouch:plugin:thermal" xmlns:xyz-table="urn:itouch:plugin:xyz-table">
  <include file="itouch:materials.xml"/>
  <devices>
    <device name="arm" plugin="usb-arm"><mount pos="0 250 0 mm" rpy="0 0 180 deg"/><limits force="3 N"/></device>
    <device name="table" plugin="xyz-table">
      <mount pos="0 0 -8 mm"/><limits speed="0.25 m/s"/><xyz-table:hardware travel="200 140 60 mm"/>
    </device>
    <device name="peltier" plugin="thermal">
      <mount on="table" pos="0 0 4 mm"/><limits current="6 A" temperature="15 40 degC"/><thermal:hardware/>
    </device>
  </devices>
  <world temperature="23 degC"><box name="block" pos="0 0 9 mm" size="50 60 18 mm" material="{material}"/></world>
  <interaction>
    <probe name="finger" radius="8 mm" pose-from="arm" force-to="arm" surface-to="table"/>
    <operator probe="finger" mass="80 g" stiffness="300 N/m" damping="6 N*s/m" skin-temperature="{skin:.2f} degC">
      <motion>
        <to pos="0 0 48 mm" in="0.5 s" hold="1 s"/>
        <to pos="0 0 22 mm" in="0.7 s" hold="3.3 s"/>
        <to pos="0 0 48 mm" in="0.6 s" hold="0.4 s"/>
      </motion>
    </operator>
    <thermal:heat probe="finger" contact-resistance="0.002 m^2*K/W" arterial="37 degC"/>
    {control}
  </interaction>
  <safety force="3 N"/>
</itouch>
"""


class Plant:
    """One episode; with ``own``, itouch-py's controller drives the display, and ``step`` ignores its current.

    Raises
    ------
    itouch.ItouchError
        If the thermal display's plugin is not there.
    """

    def __init__(self, material: str, skin: float, seed: int, *, own: bool = False) -> None:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "plant.xml")
            path.write_text(
                _SCENE.format(material=material, skin=skin, control=_CONTROL if own else ""), encoding="utf-8"
            )
            self._engine = itouch.build(path, seed=seed)
        self._own = own
        self.most = float(self._engine.model.devices["peltier"].limits.current or 0.0)

    def step(self, current: float = 0.0) -> tuple[float, bool]:
        """Run for one step under a current [A]; return the cost of the flux, and whether a device has tripped.

        The cost is the mean square of obtained minus desired flux, in units of 1000 W/m^2, over the ticks of the step
        in which the finger touches; 0 if it does not touch.
        """
        errors = []
        state = self._engine.state
        if not self._own:
            state["peltier.command.current"][:] = current
        try:
            self._engine.run(STEP, each=lambda: errors.append(self._error()))
        except itouch.DeviceFaultError:
            return 0.0, True
        found = np.array([error for error in errors if np.isfinite(error)])
        return (float((found**2).mean()) if len(found) else 0.0), False

    def _error(self) -> float:
        state = self._engine.state
        if not bool(state["heat.in_contact"]):
            return np.nan
        return float(np.ravel(state["peltier.twin.true_flux"])[0] - np.ravel(state["heat.desired"])[0]) / FLUX

    def seen(self) -> NDArray[np.float32]:
        """Return a controller's observation, shape (6,): plate, skin, sink, measured flux, desired flux, touching."""
        state = self._engine.state
        warm = [self._of(name) for name in ("plate_temperature", "skin_temperature", "sink_temperature")]
        touching = bool(state["heat.in_contact"])
        wanted = float(np.ravel(state["heat.desired"])[0]) if touching else 0.0
        found = [
            *((kelvin - MIDDLE) / WARMTH for kelvin in warm),
            self._of("heat_flux") / FLUX,
            wanted / FLUX,
            touching,
        ]
        return np.clip(np.nan_to_num(np.array(found, np.float32)), -10.0, 10.0)

    def _of(self, name: str) -> float:
        return float(np.ravel(self._engine.state[f"peltier.{name}"])[0])

    def state(self) -> Any:
        """Return the session's State, for observers."""
        return self._engine.state

    def close(self) -> None:
        """End the session."""
        self._engine.close()
