"""Hardware is driven only if something stops it when the servo process dies; the guardian's second openers."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

import itouch
from itouch.exchange.thread import make_safe
from itouch.plugin import Device, Field, Record, current, pose, pose_target, wrench
from itouch.plugin.discovery import Catalog, Found
from itouch.plugin.wire_claims import WireClaims
from itouch.safety import Status
from itouch.safety.actuation import BACKWARDS, HELD
from itouch.scene import loads
from itouch.servo.opener import _act
from itouch.world import compile_scene

SCENE = """<itouch version="1.0">
  <materials><material name="m"><contact stiffness="300 N/m"/></material></materials>
  <world><box name="floor" size="100 100 20 mm" pos="0 0 10 mm" material="m"/></world>
  <devices><device name="stick" plugin="stick" twin="TWIN"/></devices>
  <interaction><probe name="tip" radius="0" pose-from="stick" force-to="stick"/></interaction>
</itouch>
"""


@dataclass(frozen=True)
class _Params:
    pass


class _Stick(Device):
    Params = _Params
    reads = (pose(),)
    commands = (wrench(force=3.0),)
    log: ClassVar[list[Any]] = []

    def open(self) -> None:
        self.log.append("open")

    def close(self) -> None:
        self.log.append("close")

    def read(self, reading: Record) -> bool | None:
        reading["pose"] = (0, 0, 0.1, 1, 0, 0, 0)
        return True

    def write(self, command: Record) -> None:
        self.log.append(command["wrench"].tolist())


class _Entry:
    def __init__(self, cls: type[Device]) -> None:
        self._cls = cls

    def load(self) -> type[Device]:
        return self._cls


def _catalog(cls: type[Device]) -> Catalog:
    found = {"stick": Found("stick", "test", "1", _Entry(cls))}  # type: ignore[arg-type]
    return Catalog(lambda group: found if group == "itouch.devices" else {})


@pytest.mark.parametrize(
    ("watchdog", "second_opener", "twin", "refused"),
    [(None, False, "no", True), (None, False, "yes", False), (0.1, False, "no", False), (None, True, "no", False)],
)
def test_what_nothing_would_stop_is_not_driven(
    watchdog: float | None, second_opener: bool, twin: str, refused: bool
) -> None:
    cls = type("Made", (_Stick,), {"watchdog": watchdog, "second_opener": second_opener})
    catalog = _catalog(cls)
    scene = loads(SCENE.replace("TWIN", twin).encode(), catalog)
    model, problems = compile_scene(scene, catalog)
    assert [problem.code for problem in problems if problem.severity == "error"] == ["no-watchdog"] * refused
    assert (model is None) is refused
    for problem in problems:
        if problem.code == "no-watchdog":
            assert problem.place is not None
            assert problem.place.line == 4


def test_a_device_that_only_reads_needs_no_watchdog() -> None:
    cls = type("Reader", (_Stick,), {"commands": ()})
    catalog = _catalog(cls)
    scene = loads(SCENE.replace("TWIN", "no").replace(' force-to="stick"', "").encode(), catalog)
    model, _ = compile_scene(scene, catalog)
    assert model is not None


def test_a_second_opener_opens_sends_the_safe_command_and_closes() -> None:
    _Stick.log.clear()
    safe = Record.of([Field("wrench", "f8", 6)])
    _Stick(_Params()).make_safe(safe)
    assert _Stick.log == ["open", [0.0] * 6, "close"]


def test_the_safe_command_is_made_of_what_was_sent() -> None:
    low, high = (-0.1, -0.1, 0.0), (0.1, 0.1, 0.05)
    channels = (wrench(force=3.0), pose_target(low=low, high=high, speed=0.2), current(limit=3.0))
    record = Record.of(Field.of(channel) for channel in channels)
    record["wrench"], record["current"] = 1.0, 2.0
    record["pose_target"] = (0.03, 0.02, 0.04, 1, 0, 0, 0)
    make_safe(record, channels)
    assert not record["wrench"].any()
    assert not record["current"].any()
    assert np.array_equal(record["pose_target"], (0.03, 0.02, 0.0, 1, 0, 0, 0))


@pytest.mark.parametrize(
    ("status", "stopped", "leg", "height"),
    [
        (Status.ENABLED, 0, np.nan, 0.0),
        (Status.FAULT, 0, np.nan, 0.0),  # it died while the surface retracted
        (Status.FAULT, HELD, np.nan, 0.03),
        (Status.OPEN, BACKWARDS, np.nan, 0.03),
        (Status.OPEN, 0, 0.025, 0.025),  # a leg of a retreat that is judged by what touches it
        (Status.OPEN, 0, 0.04, 0.03),  # never up
        (Status.OPEN, 0, -0.01, 0.0),
    ],
)
def test_a_second_opener_retracts_no_surface_that_goes_the_wrong_way(
    status: Status, stopped: int, leg: float, height: float
) -> None:
    low, high = (-0.1, -0.1, 0.0), (0.1, 0.1, 0.05)
    made: list[Record] = []

    class Table(_Stick):
        commands = (pose_target(low=low, high=high, speed=0.2),)

        def make_safe(self, safe: Record) -> None:
            made.append(safe)

    fields = [Field("table.sent.pose_target", "f8", 7), Field("table.way", "f8", 3)]
    state = Record.of([*fields, *(Field(f"table.{name}", "i8") for name in ("status", "stopped"))])
    state["table.sent.pose_target"] = (0.01, 0.0, 0.03, 1, 0, 0, 0)
    state["table.status"], state["table.stopped"], state["table.way"] = status, stopped, (0.03, leg, np.nan)
    model: Any = SimpleNamespace(name="table", cls=Table, params=_Params(), commands=Table.commands)
    link: Any = SimpleNamespace(state=state)
    _act(model, link, WireClaims())()
    assert made[0]["pose_target"].tolist() == [0.01, 0.0, height, 1, 0, 0, 0]


def test_hardware_in_a_servo_process_waits_for_the_operator() -> None:
    """The bundled table is hardware, too; without its port nothing can be opened, and that is told."""
    text = """<itouch version="1.0" xmlns:xyz-table="urn:itouch:plugin:xyz-table">
      <materials><material name="m"><contact stiffness="300 N/m"/></material></materials>
      <world><box name="floor" size="100 100 20 mm" pos="0 0 10 mm" material="m"/></world>
      <devices><device name="table" plugin="xyz-table"/><device name="arm" plugin="usb-arm"/></devices>
      <interaction>
        <probe name="tip" radius="8 mm" pose-from="arm" force-to="arm" surface-to="table"/>
        <operator probe="tip"><motion><to pos="0 0 150 mm" in="1 s"/></motion></operator>
      </interaction>
      <safety hold-to-run="yes"/>
    </itouch>"""
    with itouch.launch(loads(text.encode(), Catalog(), shown="held.xml")) as handle:
        assert handle.link.phase == "ready"  # nobody holds the switch: nothing moves
        assert handle.state["tick"] == 0
        handle.stop()
        assert handle.report()["servo"]["ticks"] == 0
