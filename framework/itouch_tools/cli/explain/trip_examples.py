"""For each code of a running device, the smallest run that causes it, on simulated twins."""

from __future__ import annotations

from dataclasses import replace

from itouch_tools.cli.explain.example import Example

_FAULT = '<fault device="table" kind="disconnect" at="8 s"/>'
_SAFETY = '<safety force="3 N"/>'


def _scene(fault: str, safety: str = "") -> Example:
    """Return the example of `scenes/faults.xml` with another fault, and with further limits if any are given."""
    from itouch_tools.cli.demo import scenes_folder

    tighter = f"{_SAFETY[:-2]} {safety}/>"
    changed = [fault, tighter] if safety else [fault]
    text = (scenes_folder() / "faults.xml").read_text(encoding="utf-8").replace(_FAULT, fault)
    files = {"scene.xml": text.replace(_SAFETY, tighter) if safety else text}
    note = "\n".join(["<!-- in scenes/faults.xml -->", *changed])
    return Example(files, ("run", "scene.xml", "--headless", "--for", "9s"), note=note, shipped=True)


def _fault(device: str, kind: str, more: str = "", *, safety: str = "", at: str = "6 s") -> Example:
    return _scene(f'<fault device="{device}" kind="{kind}" at="{at}"{" " + more if more else ""}/>', safety)


_RUN = """\
try:
    {lines}
except itouch.DeviceFaultError as fault:
    print(f"fault[{{fault.trip.label}}]: {{fault}}")
engine.close()
"""


def _python(build: str, lines: str, files: dict[str, str] | None = None, *, plugin: bool = False) -> Example:
    text = "import itouch\n" + build + _RUN.format(lines=lines.strip().replace("\n", "\n    "))
    return Example({"run.py": text, **(files or {})}, ("python", "run.py"), "run.py", shipped=True, plugin=plugin)


_DRIVEN = """\
engine = itouch.build("display.xml")  # a display, and nothing that commands it but this
current = engine.state["peltier.command.current"]
"""


def _driven(fault: str, current: str) -> Example:
    """Return the example of a display that does not do as it is commanded."""
    text = (
        '<itouch version="1.0">\n  <devices><device name="peltier" plugin="thermal"/></devices>\n'
        f'  <fault device="peltier" at="0.1 s" {fault}/>\n</itouch>\n'
    )
    note = f'display.xml with a Peltier display and\n\n<fault device="peltier" at="0.1 s" {fault}/>\n\n'
    lines = f"engine.run(5.0, each=lambda: current.fill({current}))"
    return replace(_python(_DRIVEN, lines, {"display.xml": text}), note=note + _python(_DRIVEN, lines).text)


_TOUCHED = 'engine = itouch.build("scenes/faults.xml")\n'

_LIFT = """\
from dataclasses import dataclass

from itouch.plugin import Device, Field, Twin, pose, pose_target, wrench


@dataclass(frozen=True)
class LiftParams: ...


class LiftTwin(Twin):
    def fields(self): return (Field("height", unit="m", doc="height of the last touch"),)
    def step(self, state, command, touch, period): state["height"] -= 0.4 * period  # whatever it is told
    def read(self, state, reading): reading["pose"] = (0, 0, state["height"], 1, 0, 0, 0)


class Lift(Device):
    Params, Twin = LiftParams, LiftTwin
    reads, commands = (pose(), wrench(force=9.0)), (pose_target(low=(-1, -1, -1), high=(1, 1, 1), speed=0.25),)

    def open(self): ...
    def close(self): ...
    def read(self, reading): ...
"""
_LIFT_FILES = {
    "itouch_lift.py": _LIFT,
    "itouch_lift-1.0.dist-info/METADATA": "Metadata-Version: 2.1\nName: itouch-lift\nVersion: 1.0\n",
    "itouch_lift-1.0.dist-info/entry_points.txt": "[itouch.devices]\nlift = itouch_lift:Lift\n",
    "lift.xml": '<itouch version="1.0">\n  <devices>\n    <device name="arm" plugin="usb-arm"/>\n'
                '    <device name="lift" plugin="lift"/>\n  </devices>\n  <interaction>\n'
                '    <probe name="finger" pose-from="arm" surface-to="lift"/>\n  </interaction>\n</itouch>\n',
}  # fmt: skip


_WRIST_FILES = {
    "itouch_wrist.py": """\
from dataclasses import dataclass

from itouch.plugin import Device, pose, wrench


@dataclass(frozen=True)
class Params: ...


class Wrist(Device):
    Params = Params
    reads, commands, watchdog = (pose(),), (wrench(force=8.0, torque=0.2),), 0.1

    def open(self): ...
    def close(self): ...
    def read(self, reading): ...
""",
    "itouch_wrist-1.0.dist-info/METADATA": "Metadata-Version: 2.1\nName: itouch-wrist\nVersion: 1.0\n",
    "itouch_wrist-1.0.dist-info/entry_points.txt": "[itouch.devices]\nwrist = itouch_wrist:Wrist\n",
    "wrist.xml": '<itouch version="1.0">\n  <devices>\n    <device name="arm" plugin="wrist"/>\n  </devices>\n'
                 '  <interaction>\n    <probe name="finger" pose-from="arm" force-to="arm"/>\n  </interaction>\n'
                 '</itouch>\n',
}  # fmt: skip


_MONITOR_FILES = {
    "itouch_patience.py": """\
from itouch.plugin import Monitor, Role, Rule


class Patience(Monitor):
    name, trips = "patience", {1: "too-long"}

    @classmethod
    def of(cls, device): return [cls(device)] if device.command(Role.FORCE_ON_OPERATOR) else []
    def check(self, state, reading, sent, moment): return -1.0 if moment.now > 1.0 else 1.0
    def sentence(self, code, state, reading, moment): return f"has pushed for {moment.now:.2f} s"
    def rule(self, code, reading): return "time of a session"
    def rules(self): return (Rule("", "time of a session", trip="1 s"),)
""",
    "itouch_patience-1.0.dist-info/METADATA": "Metadata-Version: 2.1\nName: itouch-patience\nVersion: 1.0\n",
    "itouch_patience-1.0.dist-info/entry_points.txt": "[itouch.monitors]\npatience = itouch_patience:Patience\n",
}  # fmt: skip
_MONITORED = 'from itouch_patience import Patience\n\nengine = itouch.build("scenes/first_touch.xml")\n'


def trips() -> dict[str, Example]:
    """Return the examples by code."""
    return {
        "not-a-number": _fault("arm", "nan"),
        "sensor-range": _fault("arm", "wrong-units"),
        "sensor-jump": _fault("table", "spike"),
        "sensor-disagree": _fault("table", "bias", 'channel="wrench" amount="1 N"', at="4 s"),
        "plate-temperature": _fault("peltier", "spike"),
        "sink-temperature": _fault("peltier", "drift", 'channel="sink_temperature" amount="20 K"'),
        "plate-rate": _fault("peltier", "drift", 'channel="plate_temperature" amount="3 K"',
                             safety='plate-rate="1 K/s"'),
        "plate-force": _fault("table", "bias", 'channel="wrench" amount="6 N"'),
        "flux": _fault("peltier", "saturated", safety='flux="500 W/m^2"', at="2 s"),
        "speed": _fault("arm", "bias"),
        "tracking": _fault("table", "drift"),
        "silent": _fault("arm", "drop", safety='watchdog="1 ms"'),
        "device-error": _fault("peltier", "disconnect"),
        "calibration": _fault("table", "freeze", 'channel="wrench"', at="0 s"),
        "injected": _fault("arm", "delay"),
        "dose": _python(_TOUCHED + 'current = engine.state["peltier.command.current"]\n',
                        "engine.run(5.5)  # the plate is touched\n"
                        'engine.state["peltier.heat.dose"] = 119.99  # of 120 s at 43 degC\n'
                        "engine.run(2.5, each=lambda: current.fill(-3.0))  # and heats"),
        "cold": _python(_TOUCHED + 'plate = engine.state["peltier.heat.cold_time"]\n',
                        "engine.run(5.5)  # the plate is touched\n"
                        "plate[...] = 120.0  # of 120 s\n"
                        'current = engine.state["peltier.command.current"]\n'
                        "engine.run(6.0, each=lambda: current.fill(6.0))  # and cools"),
        "finger-force": _python(_TOUCHED, 'sent = engine.state["arm.sent.wrench"]\n'
                                "engine.run(1.0, each=lambda: sent[:3].fill(5.0))  # past the guard"),
        "finger-torque": _python('engine = itouch.build("wrist.xml")\n', 'sent = engine.state["arm.sent.wrench"]\n'
                                 "engine.run(1.0, each=lambda: sent[3:].fill(0.1))  # past the guard",
                                 _WRIST_FILES, plugin=True),
        "monitor": _python(_MONITORED, "engine.run(2.0)", _MONITOR_FILES, plugin=True),
        "monitor-error": _python(_MONITORED, "Patience.check = lambda self, *seen: 1.0 / (seen[-1].now < 1.0)\n"
                                 "engine.run(2.0)", _MONITOR_FILES, plugin=True),
        "contact-time": _python(_TOUCHED, "engine.run(7.0)\n"
                                'engine.state["table.surface.contact_time"] = 59.99  # seconds\n'
                                "engine.run(1.0)"),
        "sensor-frozen": _driven('kind="freeze" channel="plate_temperature"', 'engine.state["tick"] % 1000 * 2e-3'),
        "runaway": _driven('kind="reversed-sign"', "4.0"),
        "surface-speed": _python('engine = itouch.build("lift.xml")\n', "engine.run(1.0)", _LIFT_FILES, plugin=True),
        "modality-error": _python(_TOUCHED.replace("faults", "four_materials")
                                  + "heat = engine.model.modalities[0].instance\n",
                                  "whole = 1\n"
                                  "heat.update = lambda model, state, period: 1 / whole  # as a plugin's mistake\n"
                                  "engine = itouch.Session(engine.model)\n"
                                  "whole = 0\n"
                                  "engine.run(1.0)"),
        "released": _python("""
from pathlib import Path

scene = Path("scenes/faults.xml").read_text().replace('<safety ', '<safety hold-to-run="yes" ')
Path("scenes/held.xml").write_text(scene)
engine = itouch.build("scenes/held.xml")
""", "engine.hold()  # good for 80 ms\nengine.run(1.0)"),
        "overrun": replace(_python("""
import time
from pathlib import Path

scene = Path("scenes/first_touch.xml").read_text().replace('</itouch>', '<safety servo-overrun="stop"/></itouch>')
Path("scenes/late.xml").write_text(scene)
engine = itouch.build("scenes/late.xml", clock=itouch.WallClock())
""", "engine.run(1.0, each=lambda: time.sleep(0.2), every=100)"),
            varies=((r"was [\d.]+ ms late", "was 199.2 ms late"), (r"at tick \d+", "at tick 101"))),
    }  # fmt: skip
