"""Small scenes of a finger on a plate, and what a run of one commands: under the names that we gave, or under any."""

from __future__ import annotations

from collections.abc import Sequence

from itouch.plugin import Device
from itouch.plugin.discovery import Catalog
from itouch.scene import loads
from itouch.session import Session, build
from itouch_evidence.renamed import RenamedCatalog

OURS = ("arm", "table", "peltier", "thermal")
QUIET = 'flux-noise="0 W/m^2" plate-noise="0 K" sink-noise="0 K" skin-noise="0 K"'


class Alias(RenamedCatalog):
    """A catalog whose thermal display is installed under another name of the plugin, too."""

    def __init__(self, seed: int, plugin: str) -> None:
        super().__init__(seed)
        self._plugin = plugin

    @property
    def device_names(self) -> Sequence[str]:
        """Names of the device plugins."""
        return sorted({*super().device_names, self._plugin})

    @property
    def plugin_names(self) -> Sequence[str]:
        """Names of all plugins."""
        return sorted({*super().plugin_names, self._plugin})

    def device(self, name: str) -> type[Device] | None:
        """Return a device class."""
        return super().device("thermal" if name == self._plugin else name)


def scene(
    names: Sequence[str] = OURS, hardware: str = QUIET, control: str = "", rates: str = "", more: str = ""
) -> str:
    """Return a scene of a touch of half a second; ``names``: of arm, table, plate, and of the plate's plugin."""
    arm, table, plate, plugin = names
    return f"""<itouch version="1.0" xmlns:thermal="urn:itouch:plugin:thermal" xmlns:own="urn:itouch:plugin:{plugin}"
                       xmlns:xyz-table="urn:itouch:plugin:xyz-table">
      <materials><material name="steel"><contact stiffness="2 N/mm" damping="2 N*s/m" static-friction="0.4"/>
        <thermal:material conductivity="15 W/(m*K)" specific-heat="500 J/(kg*K)" density="7900 kg/m^3"/></material>
      </materials>
      <world temperature="23 degC"><box name="block" size="60 60 18 mm" pos="0 0 9 mm" material="steel"/></world>
      <devices>
        <device name="{arm}" plugin="usb-arm"><mount pos="0 250 0 mm" rpy="0 0 180 deg"/></device>
        <device name="{table}" plugin="xyz-table"><mount pos="0 0 -8 mm"/>
          <xyz-table:hardware travel="200 140 60 mm" force-noise="0 N"/></device>
        <device name="{plate}" plugin="{plugin}"><mount on="{table}" pos="0 0 4 mm"/><own:hardware {hardware}/></device>
      </devices>
      <interaction>
        <probe name="finger" radius="8 mm" pose-from="{arm}" force-to="{arm}" surface-to="{table}"/>
        <operator probe="finger" skin-temperature="33 degC"><motion>
          <to pos="0 0 40 mm" in="0.2 s" hold="0.2 s"/><to pos="0 0 22 mm" in="0.3 s" hold="0.4 s"/>
          <to pos="0 0 40 mm" in="0.2 s"/></motion></operator>
        <thermal:heat probe="finger"/>
        <thermal:flux-control display="{plate}" desired-from="heat" {control}/>
      </interaction>
      <rates servo="1 kHz" {rates}/>{more}
    </itouch>"""


def commanded(
    text: str, catalog: Catalog | None = None, *, names: Sequence[str] = OURS
) -> tuple[list[list[float]], Session]:
    """Run a scene and return all that was sent to its devices, tick by tick, in the order of the devices' names."""
    catalog = catalog or Catalog()
    session = build(loads(text.encode(), catalog), catalog=catalog)
    devices = [session.model.devices[name] for name in names[:3]]
    views = [session.state[f"{d.name}.sent.{c.name}"] for d in devices for c in d.commands]
    found: list[list[float]] = []
    session.taps.append(lambda tick: found.append([x for view in views for x in view.reshape(-1).tolist()]))
    session.run()
    session.close()
    return found, session
