"""What a virtual controller answers, request by request, without a line: as the protocol of the real one has it."""

from __future__ import annotations

from itouch_thermal.drivers.virtual import Plate, VirtualMecom


def test_one_that_is_asked_for_several_answers_them_all_or_with_its_first_refusal_alone() -> None:
    """A refusal among values would be read as part of one: all those that follow would be others."""
    device = VirtualMecom(Plate(plate=300.0, sink=301.0))
    plate, status, unknown, elsewhere = "03E801", "006801", "777701", "03E809"
    one, other = (device._payload(f"?VR{name}") for name in (plate, status))
    assert device._payload(f"?VX02{plate}{status}") == one + other
    assert len(one) == len(other) == 8 and other.endswith(b"2")
    assert device._payload(f"?VX03{plate}{unknown}{elsewhere}") == b"+05"
    assert device._payload(f"?VX03{elsewhere}{plate}{unknown}") == b"+08"
