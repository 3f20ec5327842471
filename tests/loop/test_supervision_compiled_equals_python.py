"""What supervises in a tick does the same compiled as in Python: the same State, the same trips, the same words."""

from __future__ import annotations

import shutil
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from shipped import SCENES
from test_withdrawn_plate import HEAT, SCENE

import itouch
from itouch.loop import steps
from itouch.safety import DeviceFaultError, DeviceMonitors

#: What goes wrong.
FAULTS = {
    "nothing": "",
    "a force without a finger": '<fault device="table" kind="bias" channel="wrench" amount="-3" at="4.6 s"/>',
    "a plate that seems to be warmer": '<fault device="peltier" kind="drift" channel="plate_temperature" amount="4" at="4.5 s"/>',
    "a plate's sensor that is stuck": '<fault device="peltier" kind="freeze" at="4.5 s"/>',
    "a surface astray": '<fault device="table" kind="freeze" at="4.5 s"/>',
}


def scene(folder: Path, fault: str = "") -> Path:
    """Write the scene of a finger that touches for longer than T4 lets it, and return its file."""
    shutil.copytree(SCENES, folder / "scenes")
    path = folder / "scenes" / "both.xml"
    path.write_text(SCENE.format(heat=HEAT).replace("</itouch>", f"{fault}</itouch>"))
    return path


def told(path: Path) -> tuple[list[bytes], str]:
    """Run a scene; return its State after each fiftieth tick, and the fault that stopped it."""
    session, found = itouch.build(path), []
    session.records = False
    try:
        session.run(9.0, each=lambda: found.append(session.state.tobytes()), every=50)
    except DeviceFaultError as error:
        return [*found, session.state.tobytes()], str(error)
    return found, ""


@pytest.mark.parametrize("fault", FAULTS)
def test_supervision_is_the_same_both_ways(fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Through touch, the end of T4's time, withdrawal, and what trips."""
    path = scene(tmp_path, FAULTS[fault])
    compiled = told(path)
    monkeypatch.setattr(steps, "bound_supervision", lambda *given: ())
    monkeypatch.setattr(steps, "bound_together", lambda *given: None)
    monkeypatch.setattr(DeviceMonitors, "heats", ())
    python = told(path)
    assert compiled[1] == python[1]
    assert bool(compiled[1]) is (fault != "nothing")
    assert len(compiled[0]) == len(python[0])
    assert compiled[0] == python[0]


def test_a_touch_that_lasts_leaves_nothing_to_python(tmp_path: Path) -> None:
    """No look of a monitor, no clock: the row of compiled steps runs through from begin to end of a touch."""
    session, asked = itouch.build(scene(tmp_path)), Counter[str]()
    session.records = False

    def counted(name: str, answer: Any) -> Any:
        def count(*given: Any) -> None:
            asked[name] += 1
            answer(*given)

        return count

    session.run(20.0, until=lambda: int(session.state["finger.contact.object"]) >= 0)
    session.run(0.3)
    (piece,) = session.plan._pieces
    names = [step.name for step in piece.steps]
    answers = zip(names, piece._answers, strict=True)
    piece._answers = [answer and counted(name, answer) for name, answer in answers]
    looked, heard = (float(session.state[name]) for name in ("table.surface.looked", "peltier.heat.checked"))
    session.run(0.5)
    assert not asked
    assert float(session.state["table.surface.looked"]) > looked + 0.4
    assert float(session.state["peltier.heat.checked"]) > heard + 400
