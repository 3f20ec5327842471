"""What a virtual controller answers, request by request, without a line: as the protocol of the real one has it."""

from __future__ import annotations

import socket

import pytest

from itouch_thermal.drivers import emulator
from itouch_thermal.drivers.mecom import crc16
from itouch_thermal.drivers.virtual import InjectedErrors, Plate, VirtualMecom


def test_one_that_is_asked_for_several_answers_them_all_or_with_its_first_refusal_alone() -> None:
    """A refusal among values would be read as part of one: all those that follow would be others."""
    device = VirtualMecom(Plate(plate=300.0, sink=301.0))
    plate, status, unknown, elsewhere = "03E801", "006801", "777701", "03E809"
    one, other = (device._payload(f"?VR{name}") for name in (plate, status))
    assert device._payload(f"?VX02{plate}{status}") == one + other
    assert len(one) == len(other) == 8 and other.endswith(b"2")
    assert device._payload(f"?VX03{plate}{unknown}{elsewhere}") == b"+05"
    assert device._payload(f"?VX03{elsewhere}{plate}{unknown}") == b"+08"


def message(number: int, text: bytes) -> bytes:
    body = b"#00%04X" % number + text
    return body + b"%04X" % crc16(body) + b"\r"


@pytest.mark.parametrize(("asked", "before"), [(5, 4), (0, 0xFFFF)])
def test_a_lapse_is_one_answer_and_late_is_that_to_the_request_before(asked: int, before: int) -> None:
    device = VirtualMecom(Plate())
    right = device.take(message(asked, b"?IF"))
    assert right[:7] == b"!00%04X" % asked and right.endswith(b"%04X\r" % crc16(right[:-5]))
    said = {}
    for lapse in ("late", "lost", "busy", "damaged"):
        device.injected = InjectedErrors(**{lapse: 1})
        said[lapse] = device.take(message(asked, b"?IF"))
        assert device.take(message(asked, b"?IF")) == right
    assert said["late"][:7] == b"!00%04X" % before
    assert said["late"][-5:] == b"%04X\r" % crc16(said["late"][:-5])  # only its number tells that it is late
    assert said["lost"] == b"" and said["busy"][7:10] == b"+02"
    assert said["damaged"] != right and said["damaged"][-5:] != b"%04X\r" % crc16(said["damaged"][:-5])


def test_each_virtual_instrument_has_a_port_of_its_own() -> None:
    """One that is taken, or that only some may open, is none."""
    found = list[int]()
    with socket.create_server(("127.0.0.1", 0)) as taken:
        for _ in range(3):
            host, _, port = emulator._free_port().partition(":")
            assert host == "127.0.0.1"
            found.append(int(port))
        assert taken.getsockname()[1] not in found and min(found) > 1023
