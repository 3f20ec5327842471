"""A T7 whose answers come twice: none is taken for the answer to another request."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import closing

import pytest
from test_t7_bad_answers import BadT7

from itouch_thermal.drivers.modbus import ModbusLine

pytestmark = pytest.mark.punctual  # what is driven is a thread beside the driver


class Doubling(BadT7):
    """A T7 that gives each answer twice, once it is told to."""

    doubles = False

    def _said(self, request: bytes) -> Iterator[bytes]:
        self._t7.volts[2] = 1.0
        whole = b"".join(super()._said(request))
        yield whole
        if self.doubles:
            time.sleep(3e-3)
            yield whole
            time.sleep(3e-3)


def test_an_answer_that_comes_twice_is_none_to_a_request_of_another_number() -> None:
    """The client numbers its requests from 1: the answer to one of these was taken for that to one of ours."""
    t7 = Doubling("good")
    with closing(t7), closing(ModbusLine("LabJack", t7.host, patience=4.0)) as line:
        t7.doubles = True
        for _ in range(3):
            assert line.floats(4)[0] > 0.9
            line.ask(0)
            assert line.answer()[0] == pytest.approx(1e-4)
