"""The Inverse3 in a scene: felt through the wire as with its twin, unplugged and replugged under the engine."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest
from virtual_service import ServedService

from itouch.exchange import EveryNth
from itouch.loop import DeviceFaultError
from itouch.plugin import read_trace
from itouch.session import Session, build, load_scene
from itouch_arms.haply import Haply
from itouch_arms.haply.virtual import VirtualService
from itouch_tools.cli import main

SCENE = (Path(__file__).parent / "haply.xml").read_text(encoding="utf-8")


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[tuple[Session, ServedService]]:
    service = VirtualService(buttons={"a": True})
    with ServedService(service) as served:
        path = tmp_path / "scene.xml"
        path.write_text(SCENE.replace("PORT", str(served.port)))
        session = build(load_scene(path))
        session.runners[0].gate.device = EveryNth(Haply(session.model.devices["arm"].params), 1)
        service.finger.hand = (0.0, -0.12, 0.145)  # 3 mm under where the finger touches the block's top
        yield session, served
        session.close()


@pytest.mark.parametrize("fault", ["hang_up", "unplugged", "garbage", "nan", "mute", "unpowered"])
def test_the_arm_is_felt_fails_and_is_reconnected(rig: tuple[Session, ServedService], fault: str) -> None:
    session, served = rig
    service = served.service
    session.enable()
    session.run(1.2)  # the force ramps in over a second on hardware
    assert service.force[2] > 0.3
    setattr(service.faults, fault, 1)
    begin = session.ticks
    with pytest.raises(DeviceFaultError, match="arm"):
        session.run(1.0)
    assert session.fault is not None
    assert session.fault.tick - begin <= 20  # 20 ms
    assert session.status("arm").name == "FAULT"
    if fault not in ("hang_up", "unplugged"):
        assert service.force == (0.0, 0.0, 0.0)
    service.faults = type(service.faults)()
    count = len(service.asked)
    session.reconnect("arm")
    assert service.force == (0.0, 0.0, 0.0)
    assert not any(any(force) for force in service.asked[count:])
    session.rearm()
    session.run(1.2)
    assert session.status("arm").name == "ENABLED"
    assert service.force[2] > 0.3
    session.close()
    assert service.force == (0.0, 0.0, 0.0)


def test_letting_go_of_the_button_takes_the_force_away(rig: tuple[Session, ServedService]) -> None:
    session, served = rig
    session.enable()
    session.run(1.1)
    assert any(served.service.force)
    served.service.buttons = {"a": False}
    with pytest.raises(DeviceFaultError, match="let go"):
        session.run(1.0)
    assert served.service.force == (0.0, 0.0, 0.0)


def test_the_scene_through_the_wire_is_the_scene_on_twins(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    scene = tmp_path / "haply.xml"
    scene.write_text(SCENE.replace("PORT", str(port)))
    trace, wire, twin = tmp_path / "trace", tmp_path / "wire", tmp_path / "twin"
    assert main(["virtual-rig", str(scene), "--run", "--report", str(wire), "--trace", str(trace)]) == 0
    assert main(["run", str(scene), "--headless", "--twin", "all", "--report", str(twin)]) == 0
    (one,), (other,) = (json.loads(path.read_text())["contacts"] for path in (wire, twin))
    assert one["object"] == other["object"] == "block"
    assert one["begin_s"] == pytest.approx(other["begin_s"], abs=0.01)
    sent = [json.loads(entry.data) for entry in read_trace(trace.read_text().splitlines()) if entry.mark == ">"]
    forces = [m["inverse3"][0]["commands"]["set_cursor_force"]["values"]["z"] for m in sent]
    assert max(forces) == pytest.approx(other["peak_force_N"], rel=0.05)
    assert forces[0] == forces[-1] == 0.0
