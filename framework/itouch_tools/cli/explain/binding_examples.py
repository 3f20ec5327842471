"""Examples of problems with devices, plugins, limits, modalities, and with what connects them in a scene."""

from __future__ import annotations

import json
from collections.abc import Mapping

from itouch_tools.cli.explain.example import Example, scene
from itouch_tools.cli.explain.problem_examples import ARM, SIZE, WOOD, box

_LEVER = """\
from dataclasses import dataclass

from itouch.plugin import Device, Modality, pose, schema, wrench


@dataclass(frozen=True)
class LeverParams:
    travel: float = schema.quantity("m", doc="stroke of the lever")
    low: float | None = schema.quantity("m", default=None, doc="lower stop")
    high: float | None = schema.quantity("m", default=None, doc="upper stop")

    TOGETHER = (("low", "high"),)


class Lever(Device):
    Params = LeverParams
    reads = (pose(),)
    commands = (wrench(force=8.0, locked=(0, 1, 2)),)

    def open(self): ...
    def close(self): ...
    def read(self, reading): ...
    def write(self, command): ...


class OldLever(Lever):
    twin_only = True


@dataclass(frozen=True)
class EchoParams:
    source: str = schema.ref("modality", doc="what it repeats")


class Echo(Modality):
    Params = EchoParams

    def compile(self, name, params, world): ...
    def fields(self, model): return ()
    def reset(self, model, state, rng): ...
    def update(self, model, state, period): ...
"""
_ENTRY_POINTS = """\
[itouch.devices]
lever = itouch_lever:Lever
old-lever = itouch_lever:OldLever
[itouch.modalities]
lever.echo = itouch_lever:Echo
"""
_HARDWARE = '<device name="lever" plugin="lever" twin="no"><lever:hardware travel="5 cm"{more}/></device>'
_NAMESPACE = ' xmlns:lever="urn:itouch:plugin:lever"'


def _lever(body: str, code: str = _LEVER, points: str | None = None) -> Example:
    """Return the example of a scene for which a small plugin, "lever", is installed."""
    about = "Metadata-Version: 2.1\nName: itouch-lever\nVersion: 1.0\n"
    others = {
        "itouch_lever.py": code,
        "itouch_lever-1.0.dist-info/METADATA": about,
        "itouch_lever-1.0.dist-info/entry_points.txt": points or _ENTRY_POINTS,
    }
    return scene(body, others, plugin=True)


def _pad(command: str, *, twin: str = "yes", monitor: str = "") -> Example:
    """Return the example of a plugin with this command."""
    code = _LEVER.replace("import Device,", "import Channel, Role, Device,").replace(
        "wrench(force=8.0, locked=(0, 1, 2))", command
    )
    code = code.replace("    def open(self)", "    watchdog = 0.1\n\n    def open(self)", 1)
    body = _devices(
        f'<device name="lever" plugin="lever" twin="{twin}"><lever:hardware travel="5 cm"/></device>', _NAMESPACE
    )
    points = _ENTRY_POINTS + (f"[itouch.monitors]\n{monitor}\n" if monitor else "")
    return _lever(body, code, points)


def _devices(inside: str, namespace: str = "") -> str:
    return f"<devices{namespace}>\n  {inside}\n</devices>"


def _record() -> Mapping[str, str]:
    """Return a file with an expired calibration of a table."""
    record = {"device": "table", "kind": "touch-off", "twin": True, "made": "2025-01-01T09:00:00+00:00",
              "expires": "2025-01-08T09:00:00+00:00", "values": {}, "mount": [0, 0, 0.003, 1, 0, 0, 0],
              "residual": 0.0, "unit": "m", "samples": 3}  # fmt: skip
    return {"scene.calibration.json": json.dumps({"format": "itouch-py calibration 1", "records": [record]})}


_TABLE = '<devices><device name="table" plugin="xyz-table"/></devices>\n'
_FINGER = '<interaction><probe name="finger" pose-from="arm" force-to="arm"/></interaction>'
_TWICE = (
    "<interaction>\n"
    '  <probe name="thumb" pose-from="arm" force-to="arm"/>\n'
    '  <probe name="finger" pose-from="arm" force-to="arm"/>\n'
    "</interaction>"
)
_HEAT = 'xmlns:thermal="urn:itouch:plugin:thermal"'

DEVICES = {
    "unknown-plugin": scene(_devices('<device name="arm" plugin="usb-amr"/>')),
    "plugin-failed": _lever(_devices('<device name="lever" plugin="lever"/>'), "import leverdriver\n"),
    "wrong-plugin": scene(
        _devices('<device name="arm" plugin="usb-arm"><t:hardware/></device>', ' xmlns:t="urn:itouch:plugin:thermal"')
    ),
    "device": scene(
        _devices(
            '<device name="arm" plugin="recorded"><recorded:hardware file="notes.csv"/></device>',
            ' xmlns:recorded="urn:itouch:plugin:recorded"',
        ),
        {"notes.csv": "Tuesday: nothing.\n"},
    ),
    "twin-only": _lever(
        _devices(
            _HARDWARE.format(more="").replace("lever:", "old-lever:").replace('plugin="', 'plugin="old-'),
            ' xmlns:old-lever="urn:itouch:plugin:old-lever"',
        )
    ),
    "no-watchdog": _lever(_devices(_HARDWARE.format(more=""), _NAMESPACE)),
    "stale-readings": _lever(
        _devices(_HARDWARE.format(more=""), _NAMESPACE),
        _LEVER.replace("wrench\n", "wrench, Timing\n", 1).replace(
            "    def open(self)",
            "    timing = Timing(blocking=True, exchange_time=0.015, watchdog=0.1)\n\n    def open(self)",
            1,
        ),
    ),
    "no-plate-force": scene(
        _devices(
            '<device name="table" plugin="xyz-table" twin="no"><xyz:hardware tmcl="/dev/ttyACM0"/></device>',
            ' xmlns:xyz="urn:itouch:plugin:xyz-table"',
        )
    ),
    "calibration-stale": scene(_TABLE, _record(), words="run scene.xml --headless --for 1s"),
    "rig": scene(
        ARM,
        {"rig.xml": '<itouch version="1.0">\n  <devices><device name="am" plugin="usb-arm"/></devices>\n</itouch>\n'},
        words="check scene.xml --rig rig.xml",
    ),
    "missing-channel": scene(
        f'{ARM}<interaction>\n  <probe name="finger" pose-from="arm" surface-to="arm"/>\n</interaction>'
    ),
    "locked-dof": _lever(
        _devices('<device name="lever" plugin="lever"><lever:hardware travel="5 cm"/></device>', _NAMESPACE)
        + '\n<interaction>\n  <probe name="finger" pose-from="lever" force-to="lever"/>\n</interaction>'
    ),
    "two-writers": scene(ARM + _TWICE),
    "loosened-limit": scene('<safety force="9 N"/>'),
    "unmonitored-drive": _pad('Channel("heater", 1, "W", (0.0,), (5.0,), safe=(0.0,), role=Role.DRIVE)', twin="no"),
    "missing-role": _pad('Channel("heater", 1, "W", (0.0,), (5.0,), safe=(0.0,))'),
    "harmless-refused": _pad(
        'Channel("pulse", 1, "A", (0.0,), (0.002,), safe=(0.0,), role=Role.ELECTRODE, harmless="it is weak")'
    ),
    "monitor-failed": _pad("wrench(force=8.0, locked=(0, 1, 2))", monitor="lever = itouch_lever:NoSuchMonitor"),
    "limit-without-channel": scene(_devices('<device name="arm" plugin="usb-arm"><limits current="1 A"/></device>')),
    "fault-on-hardware": scene(
        f'{ARM}<fault device="arm" kind="disconnect" at="1 s"/>', words="check scene.xml --twin none"
    ),
    "out-of-reach": scene(
        WOOD
        + f'<world>\n  <box name="block" pos="1 0 0 m" {SIZE}/>\n</world>\n'
        + '<devices>\n  <device name="arm" plugin="usb-arm"/>\n'
        + '  <device name="table" plugin="xyz-table"/>\n</devices>\n'
        + '<interaction>\n  <probe name="finger" pose-from="arm" surface-to="table"/>\n</interaction>'
    ),
}
BINDINGS = {
    "together": _lever(_devices(_HARDWARE.format(more=' low="-1 cm"').replace(' twin="no"', ""), _NAMESPACE)),
    "rate": scene(
        f'{ARM}<interaction {_HEAT}>\n  <probe name="finger" pose-from="arm"/>\n  <thermal:heat probe="finger"/>\n'
        '</interaction>\n<rates servo="1 kHz" heat="60 Hz"/>'
    ),
    "modality": scene(
        f'<devices>\n  <device name="arm" plugin="usb-arm"/>\n  <device name="peltier" plugin="thermal"/>\n</devices>\n'
        f'<interaction {_HEAT}>\n  <probe name="finger" pose-from="arm"/>\n  <thermal:heat probe="finger"/>\n'
        '  <thermal:flux-control display="peltier" desired-from="heat" target="file" file="wood.csv"/>\n</interaction>',
        {"wood.csv": "t,j\n0,2600\n0,2400\n"},
    ),
    "modality-cycle": _lever(
        f'<interaction{_NAMESPACE}>\n  <lever:echo name="a" source="b"/>\n  <lever:echo name="b" source="a"/>\n'
        "</interaction>"
    ),
    "unknown-channel": scene(f'{ARM}{_FINGER}\n<record to="run.mcap" channels="fingr.*"/>'),
    "bad-recording": scene(
        f'{ARM}<interaction>\n  <probe name="finger" pose-from="arm"/>\n'
        '  <operator probe="finger"><motion file="notes.txt"/></operator>\n</interaction>',
        {"notes.txt": "Tuesday: nothing.\n"},
    ),
    "texture": scene(
        '<materials>\n  <material name="wood">\n    <contact stiffness="1 N/mm"/><texture file="notes.txt"/>\n'
        f'  </material>\n</materials>\n<world><box name="block" {SIZE}/></world>',
        {"notes.txt": "Tuesday: nothing.\n"},
    ),
    "motion": scene(
        box(SIZE, '\n    <motion repeat="yes"><to pos="0 0 5 mm" in="1 s"/></motion>\n  ')
    ),
    "dynamics": scene(
        f'{WOOD}<world>\n  <plane name="floor" material="wood"><dynamics mass="1 kg"/></plane>\n</world>'
    ),
    "missing-extra": scene(box(SIZE, '<dynamics mass="1 kg"/>'), absent="mujoco"),
}  # fmt: skip
