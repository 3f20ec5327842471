"""Two devices on one wire: refused before anything is opened, for each would take the other's answers."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

import itouch
from itouch.plugin import Device

MECOM = '<thermal:hardware><thermal:mecom port="{}" address="{}"/>{}</thermal:hardware>'
LABJACK = '<thermal:labjack host="10.0.0.{}"><thermal:flux-sensor sensitivity="1 uV*m^2/W"/></thermal:labjack>'
EXTENSIONS = 'xmlns:thermal="urn:itouch:plugin:thermal" xmlns:xyz="urn:itouch:plugin:xyz-table" xmlns:arm="urn:itouch:plugin:haply"'


def problems(folder: Path, *devices: tuple[str, str], twin: str = "no") -> list[str]:
    """Return what is said of a scene of devices (plugin, what stands in it)."""
    listed = "".join(
        f'<device name="d{n}" plugin="{plugin}" twin="{twin}">{inside}</device>'
        for n, (plugin, inside) in enumerate(devices)
    )
    path = folder / "scene.xml"
    path.write_text(f'<itouch version="1.0" {EXTENSIONS}><devices>{listed}</devices></itouch>', "utf-8")
    try:
        itouch.build(path)
    except itouch.SceneError as error:
        return [f"{one.code}: {one.sentence}" for one in error.problems]
    return []


def display(port: str, address: int = 2, labjack: int = 1) -> tuple[str, str]:
    return "thermal", MECOM.format(port, address, LABJACK.format(labjack))


@pytest.mark.parametrize("address", [2, 3])
def test_two_displays_on_one_port_are_refused_also_by_another_name(tmp_path: Path, address: int) -> None:
    (tmp_path / "tty").touch()
    (tmp_path / "by-id").symlink_to(tmp_path / "tty")
    for one, other in (("tty", "tty"), ("tty", "by-id"), ("by-id", "tty")):
        one, other = str(tmp_path / one), str(tmp_path / other)
        (said,) = problems(tmp_path, display(one), display(other, address, 2))
        assert said.startswith(f"exclusive: devices 'd0' and 'd1' would both write to '{other}'")
    assert problems(tmp_path, display(one), display(other, address), twin="yes") == []
    assert problems(tmp_path, display(one), display(str(tmp_path / "another"))) == []  # one T7 may be read by both


@pytest.mark.parametrize(
    ("one", "other", "wire"),
    [
        ("", "", "the CAN-FD adaptor that is attached"),
        ('bus="socketcan:can0"', 'bus="socketcan:CAN0@500000" ids="4 5 6"', "socketcan:CAN0"),
        ('tmcl="/dev/ttyACM7"', 'tmcl="/dev/ttyACM7" address="2"', "/dev/ttyACM7"),
    ],
)
def test_two_tables_on_one_bus_are_refused(tmp_path: Path, one: str, other: str, wire: str) -> None:
    tables = [("xyz-table", f"<xyz:hardware {words}/>") for words in (one, other)]
    assert any(f"would both write to '{wire}'" in said for said in problems(tmp_path, *tables))


def test_one_arm_of_a_service_has_one_device(tmp_path: Path) -> None:
    said = problems(tmp_path, ("haply", '<arm:hardware device="049D"/>'), ("haply", '<arm:hardware device="049D"/>'))
    assert any("would both write to 'arm 049D of the Inverse Service" in one for one in said)
    assert (
        problems(tmp_path, ("haply", '<arm:hardware device="049D"/>'), ("haply", '<arm:hardware device="04A0"/>')) == []
    )


def test_a_loop_of_pyserial_is_no_wire_as_each_process_has_its_own() -> None:
    assert Device.wires(SimpleNamespace(port="loop://")) == ()
    assert Device.wires(SimpleNamespace(port="/dev/ttyACM0")) == ("/dev/ttyACM0",)
