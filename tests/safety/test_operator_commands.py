"""What an operator does: re-arm, reconnect, hold the switch; and what happens to devices that are optional."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from shipped import SCENES

import itouch
from itouch.loop import DeviceFaultError, Status
from itouch.monitors import Trip

Write = Callable[[str, str], Path]
FIRST, FOUR = SCENES / "first_touch.xml", SCENES / "four_materials_hurried.xml"


def first_with(write: Write, *elements: str, replaced: tuple[str, str] = ("", "")) -> Path:
    text = FIRST.read_text(encoding="utf-8").replace("</itouch>", "\n".join(["", *elements, "</itouch>"]))
    return write("s.xml", text.replace(*replaced) if replaced[0] else text)


def test_a_trip_latches_until_it_is_re_armed_with_a_ramp(write: Write) -> None:
    engine = itouch.build(first_with(write, '<fault device="arm" kind="nan" at="0.7 s" for="0.1 s"/>'))
    with pytest.raises(itouch.DeviceFaultError):
        engine.run(1.0)
    assert engine.fault is not None
    with pytest.raises(itouch.DeviceError, match=r"device 'arm' can't be re-armed: it reads NaN"):
        engine.rearm()
    engine.run(0.3)
    assert engine.status("arm") is Status.FAULT
    assert not np.any(engine.state["arm.sent.wrench"])
    assert np.all(np.isfinite(engine.state["arm.pose"]))
    engine.rearm()
    assert engine.fault is None
    assert engine.status("arm") is Status.ENABLED
    assert engine.state["arm.ramp"].item() == 0.0
    engine.run(0.1)
    assert engine.state["arm.ramp"].item() == pytest.approx(0.1)
    engine.run()
    (tripped,) = [entry for entry in engine.report()["faults"] if entry["trip"]]
    assert tripped["rearmed_s"] == pytest.approx(1.0, abs=0.05)


def test_trips_and_their_memory_are_restored(write: Write, tmp_path: Path) -> None:
    engine = itouch.build(first_with(write, '<fault device="arm" kind="garbage" at="0.7 s" for="0.1 s"/>'))
    with pytest.raises(itouch.DeviceFaultError):
        engine.run(1.0)
    engine.run(0.3)
    engine.save(tmp_path / "s.itouch")
    again = itouch.restore(tmp_path / "s.itouch")
    assert again.status("arm") is Status.FAULT
    for one in (engine, again):
        one.run(0.1)
        one.rearm()
        one.run(0.5)
    assert again.state.tobytes() == engine.state.tobytes()


def test_re_arming_what_is_not_stopped_changes_nothing_but_the_ramp() -> None:
    engine = itouch.build(FIRST)
    engine.run(0.3)
    engine.rearm()
    engine.run(0.1)
    assert engine.status("arm") is Status.ENABLED


def test_a_finger_that_sank_during_a_stop_is_not_called_quick_when_all_is_re_armed_at_once(scenes: Path) -> None:
    engine = itouch.build(scenes / "four_materials_hurried.xml")
    engine.run(20.0, until=lambda: engine.state["finger.contact.object"].item() >= 0)
    engine.run(0.6)
    before = engine.state["finger.hip"][..., 2].item()
    engine.make_safe(DeviceFaultError("peltier", engine.ticks, Trip.DEVICE_ERROR, "failed"))
    assert before - engine.state["arm.pose"][..., 2].item() > 1e-3
    engine.rearm()
    engine.run(0.3)
    assert engine.status("arm") is Status.ENABLED


def test_hold_to_run_stops_within_a_tick_and_latches(write: Write) -> None:
    path = first_with(write, '<safety hold-to-run="yes"/>')
    engine = itouch.build(path)
    with pytest.raises(itouch.DeviceError, match="nobody holds the dead-man's switch"):
        engine.run(0.1)
    engine.hold()
    engine.run(0.05)
    engine.run(0.5, each=engine.hold, every=20)
    engine.hold(False)
    with pytest.raises(itouch.DeviceFaultError, match="was let go") as caught:
        engine.run(0.5)
    assert engine.status("arm") is Status.FAULT
    assert caught.value.tick == 550
    with pytest.raises(itouch.DeviceError, match="nobody holds"):
        engine.rearm()
    engine.hold()
    engine.rearm()
    engine.run(0.05)
    with pytest.raises(itouch.DeviceFaultError):  # one word is good for 80 ms
        engine.run(0.05)


def test_twins_hold_themselves() -> None:
    engine = itouch.build(FIRST)
    engine.run(0.5)
    assert engine.state["hold"].item() == 0


def test_letting_go_retracts_the_table_within_a_tenth_of_a_second(scenes: Path) -> None:
    path = scenes / "four_materials_hurried.xml"
    path.write_text(path.read_text().replace('<safety force="3 N"/>', '<safety force="3 N" hold-to-run="yes"/>'))
    engine = itouch.build(path)
    engine.hold()
    engine.run(4.5, each=engine.hold, every=40)
    engine.hold(False)
    begin, before = engine.ticks, float(engine.state["table.twin.axes"][0, 2])
    heights = []
    engine.taps.append(lambda tick: heights.append((tick - begin, float(engine.state["table.twin.axes"][0, 2]))))
    with pytest.raises(itouch.DeviceFaultError):
        engine.run(0.1)
    assert engine.report()["faults"][0]["safe"]["reached"] is True
    assert next(tick for tick, height in heights if height < before - 0.003) <= 100


def test_an_optional_device_may_be_lost_and_comes_back(scenes: Path) -> None:
    rig = scenes / "rigs" / "twin.xml"
    rig.write_text(rig.read_text().replace('<device name="peltier" plugin="thermal">',
                                           '<device name="peltier" plugin="thermal" optional="true">'))  # fmt: skip
    path = scenes / "four_materials_hurried.xml"
    text = path.read_text().replace(
        "</itouch>", '<fault device="peltier" kind="disconnect" at="4 s" for="1 s"/></itouch>'
    )
    path.write_text(text)
    engine = itouch.build(path)
    engine.run(4.5)
    assert engine.status("peltier") is Status.FAULT
    assert engine.status("table") is Status.ENABLED
    lost = engine.report()["faults"][0]
    assert lost["optional"] is True
    assert lost["trip"] == "device-error"
    with pytest.raises(itouch.DeviceError, match="disconnected"):
        engine.reconnect("peltier")
    assert engine.status("peltier") is Status.CLOSED
    engine.run(1.0)
    engine.reconnect("peltier")
    assert engine.status("peltier") is Status.OPEN
    engine.rearm()
    assert engine.status("peltier") is Status.ENABLED
    engine.run(0.5)
    with pytest.raises(itouch.DeviceError, match="there is no device named 'x'"):
        engine.reconnect("x")


def test_an_optional_device_may_be_absent(scenes: Path) -> None:
    rig = scenes / "rigs" / "twin.xml"
    rig.write_text(rig.read_text().replace('<device name="peltier" plugin="thermal">',
                                           '<device name="peltier" plugin="thermal" optional="true">'))  # fmt: skip
    path = scenes / "four_materials_hurried.xml"
    path.write_text(
        path.read_text().replace("</itouch>", '<fault device="peltier" kind="disconnect" at="0 s"/></itouch>')
    )
    engine = itouch.build(path)
    engine.run(0.5)
    assert engine.status("peltier") is Status.CLOSED
    assert "is absent" in engine.report()["faults"][0]["cause"]


def test_who_tracks_the_finger_is_never_optional(write: Write) -> None:
    path = first_with(
        write, '<fault device="arm" kind="disconnect" at="0.5 s"/>',
        replaced=('<device name="arm" plugin="usb-arm"/>', '<device name="arm" plugin="usb-arm" optional="true"/>'),
    )  # fmt: skip
    with pytest.raises(itouch.DeviceFaultError):
        itouch.build(path).run(1.0)


def test_all_that_fail_to_connect_are_told_together(scenes: Path) -> None:
    path = scenes / "four_materials_hurried.xml"
    faults = "".join(f'<fault device="{name}" kind="disconnect" at="0 s"/>' for name in ("arm", "table"))
    path.write_text(path.read_text().replace("</itouch>", f"{faults}</itouch>"))
    engine = itouch.build(path)
    with pytest.raises(itouch.DeviceError) as caught:
        engine.run(0.1)
    assert [line.split(":")[0] for line in str(caught.value).splitlines()] == ["device 'arm'", "device 'table'"]
    assert all(engine.status(name) is not Status.ENABLED for name in engine.model.devices)


def test_a_contact_of_more_than_ten_seconds_is_ended(scenes: Path) -> None:
    path = scenes / "four_materials_hurried.xml"
    path.write_text(path.read_text().replace('in="0.7 s" hold="5 s"', 'in="0.7 s" hold="14 s"', 1))
    engine = itouch.build(path)
    pressed = []

    def look() -> None:
        pressed.append(float(engine.state["finger.plate_force"]) > 0.0)

    engine.run(22.0, each=look, every=10)
    longest = max(len(run) for run in "".join("x" if p else " " for p in pressed).split())
    assert longest * 0.01 == pytest.approx(10.0, abs=0.3)
    assert engine.report()["faults"] == []
    engine.run()
    assert engine.report()["faults"] == []
    assert [contact["object"] for contact in engine.report()["contacts"]] == [
        "aluminium",
        "pyrex",
        "wood",
        "polystyrene",
    ]


def test_no_limit_trips_in_the_shipped_scenes() -> None:
    for path in (FIRST, FOUR):
        engine = itouch.build(path)
        engine.run()
        assert engine.report()["faults"] == []
        assert all(state["status"] == "ENABLED" for state in engine.report()["devices"].values())


@pytest.mark.long
def test_five_minutes_of_touches_without_a_false_trip(scenes: Path) -> None:
    path = scenes / "four_materials_hurried.xml"
    text = path.read_text()
    motion = text[text.index("<motion>") + len("<motion>") : text.index("</motion>")]
    path.write_text(text.replace(motion, 7 * motion))
    engine = itouch.build(path)
    engine.run(300.0)
    assert engine.report()["faults"] == []
    assert len(engine.report()["contacts"]) == 28


def test_a_safety_report_of_a_scene(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from itouch_tools.cli import main

    assert main(["safety-report", str(FOUR), "-o", str(tmp_path / "r.md")]) == 0
    text = (tmp_path / "r.md").read_text(encoding="utf-8")
    for words in ("# Safety report", "not a medical device", "| K1 | arm |", "<safety> at", "| T3 | peltier |", "CEM43",
                  "No limit tripped", "36 faults were injected", "hold-to-run"):  # fmt: skip
        assert words in text
    assert main(["safety-report", str(FIRST), "--no-run", "-o", str(tmp_path / "r.html")]) == 0
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert page.startswith("<!DOCTYPE html>")
    assert "&lt;safety" not in page  # the first scene has none
    assert "<td>the default</td>" in page
    assert "http" not in page
    capsys.readouterr()
    assert main(["safety-report", str(FIRST), "--no-run"]) == 0
    assert "| K1 | arm | force on the finger | 3 N |" in capsys.readouterr().out
    assert main(["safety-report", str(tmp_path / "absent.xml")]) == 2


def test_a_safety_report_tells_which_devices_are_optional(scenes: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from itouch_tools.cli import main

    rig = scenes / "rigs" / "twin.xml"
    rig.write_text(rig.read_text().replace('<device name="peltier" plugin="thermal">',
                                           '<device name="peltier" plugin="thermal" optional="true">'))  # fmt: skip
    assert main(["safety-report", str(scenes / "four_materials_hurried.xml"), "--no-run"]) == 0
    lines = capsys.readouterr().out.splitlines()
    rows = [line.strip("| ").split(" | ") for line in lines if "| simulated twin |" in line]
    assert {row[0]: row[-1] for row in rows} == {"arm": "no", "table": "no", "peltier": "yes"}


def test_a_safety_report_of_a_script_that_trips(tmp_path: Path) -> None:
    from itouch_tools.cli import main

    path = tmp_path / "trips.xml"
    text = FIRST.read_text(encoding="utf-8")
    path.write_text(text.replace("</itouch>", '<fault device="arm" kind="nan" at="0.3 s"/></itouch>'), encoding="utf-8")
    assert main(["safety-report", str(path), "-o", str(tmp_path / "r.md")]) == 1
    report = (tmp_path / "r.md").read_text(encoding="utf-8")
    top = report[: report.index("## The rig")]
    assert "THE SCRIPT TRIPS: device 'arm' reads" in top
    assert "No limit tripped" not in report
