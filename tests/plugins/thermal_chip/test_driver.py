"""The driver on the simulated chip, through a real serial port: version 2 of the line protocol, promises, cut-off."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from itouch.plugin import DeviceError, Terminal
from itouch_thermal.chip.host import SimulatedHost
from itouch_thermal.cli import main as thermal
from itouch_thermal.drivers import LinePort
from itouch_thermal.drivers.lineport import LineDriver, crc, seal_2, unseal, unseal_2
from itouch_thermal.drivers.stated_limits import StatedLimits, unmet_limits

from conftest import Start  # isort: skip

pytestmark = pytest.mark.punctual  # what is driven is a thread or a process beside the driver

PATIENT = 60.0
#: Held by who lets the simulated display go on.
LOCK = threading.Lock()


@contextmanager
def served(host: SimulatedHost, spoil: Callable[[bytes], bytes] = lambda data: data) -> Iterator[str]:
    """Let a simulated display answer on a port, while it has something to answer; it stands still otherwise."""
    terminal, stop = Terminal(), threading.Event()

    def work() -> None:
        while not stop.is_set():
            data = terminal.receive()
            if not data:
                time.sleep(2e-4)
                continue
            with LOCK:
                said = host.display.step(data)
                for _ in range(14):
                    said += host.display.step()
            terminal.send(spoil(said))

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield terminal.path
    finally:
        stop.set()
        thread.join()
        terminal.close()


def test_the_driver_exchanges_with_the_simulated_chip(start: Start, capsys: pytest.CaptureFixture[str]) -> None:
    host = start(greet=False)
    host.wait(100)
    with served(host) as port:
        rig = LineDriver(LinePort(port=port, firmware="reference"), patience=PATIENT, limits={"current": 3.0})
        assert rig.stated is not None
        assert rig.stated.reset == "power"
        for _ in range(12):
            read = rig.exchange(-1.25)
        assert read.current == pytest.approx(-1.25, abs=0.02)
        assert read.plate == pytest.approx(host.display.plate, abs=1.0)
        with pytest.raises(DeviceError, match="refuses 'I .* 3.50000': out of range"):
            rig.exchange(3.5)
        host.display.forced["plate"] = 5.0
        with pytest.raises(DeviceError, match="a thermistor of its plate is open or short"):
            for _ in range(4):
                rig.exchange(1.0)
        rig.close()
        with pytest.raises(DeviceError, match=r"cut itself off: a thermistor of its plate .* --release"):
            LineDriver(LinePort(port=port), patience=PATIENT)
        assert thermal(["display", port, "--release"]) == 2
        assert "what has cut it off is not over" in capsys.readouterr().err
        with LOCK:
            host.display.forced.clear()
            host.wait(200)
        LineDriver(LinePort(port=port), patience=PATIENT, release=True).close()
        rig = LineDriver(LinePort(port=port), patience=PATIENT)
        rig.exchange(1.0)
        with LOCK:
            host.display.chip.reset("brown-out")
            host.wait(100)
        with pytest.raises(DeviceError, match="restarted"):
            rig.exchange(1.0)


def test_a_command_looks_at_a_display(start: Start, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    host = start()
    with served(host) as port:
        assert thermal(["display", port, "--current", "1.5"]) == 2
        assert "1 A at most" in capsys.readouterr().err
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("itouch_thermal.drivers.lineport.PATIENCE", 5.0)  # a busy machine
            assert (
                thermal(["display", port, "--current", "-0.5", "--seconds", "0.2", "--csv", str(tmp_path / "t.csv")])
                == 0
            )
    assert "itouch-line 2 uno" in capsys.readouterr().out
    rows = [[float(word) for word in row.split(",")] for row in (tmp_path / "t.csv").read_text().splitlines()]
    assert rows
    assert all(290.0 < plate < 300.0 and 290.0 < sink < 300.0 for _, _, plate, sink in rows)


def test_one_answer_in_ten_damaged_costs_no_exchange(start: Start) -> None:
    host, count = start(), [0]

    def spoil(data: bytes) -> bytes:
        count[0] += 1
        return data[:7] + b"#" + data[8:] if count[0] % 10 == 0 else data

    with served(host, spoil) as port:
        rig = LineDriver(LinePort(port=port), patience=5.0)
        for _ in range(30):
            assert rig.exchange(0.5).plate > 290.0
        rig.close()
    assert count[0] >= 33


def test_the_check_sum_equals_the_published_value() -> None:
    assert crc(b"123456789") == 0x29B1  # the catalogue's check value
    assert unseal_2(seal_2("I 1 2.5")) == "I 1 2.5"
    assert unseal(seal_2("I 1 2.5")) is None


@example(b"c", 13, 1.5)
@example(b"\n\n", 17, 0.0)
@given(st.binary(min_size=1, max_size=3), st.integers(0, 20), st.floats(-3, 3))
def test_a_burst_of_three_bytes_at_most_is_always_seen(burst: bytes, at: int, amps: float) -> None:
    """A CRC of 16 bits sees every burst of 16 bits; a letter of the sum may be small, as some rigs write it."""
    line = bytearray(seal_2(f"I 12 {amps:.5f}"))
    before = bytes(line)
    line[at : at + min(len(burst), 2)] = burst[:2]
    # one more empty line after it is none of it
    if bytes(line[: len(before) - 5]) != before[:-5] or bytes(line).rstrip().upper() != before.rstrip().upper():
        assert unseal_2(bytes(line)) != f"I 12 {amps:.5f}"


GOOD = StatedLimits(3.0, (10.0, 43.0), 44.0, 0.2, "power", "none")


@given(
    st.floats(0.1, 10), st.floats(-20, 30), st.floats(30, 90), st.floats(20, 90), st.floats(0, 2),
    st.floats(0.1, 10), st.floats(285, 300), st.floats(300, 315),
)  # fmt: skip
def test_promises_fit_the_limits_or_are_told(
    amps: float, low: float, high: float, sink: float, silence: float, asked: float, least: float, most: float
) -> None:
    found = unmet_limits(StatedLimits(amps, (low, high), sink, silence, "power", "none"),
                     {"current": asked, "temperature": (least, most)})  # fmt: skip
    fits = (
        low >= 8 and high <= 45 and sink <= 58 and silence <= 0.5
        and low < least - 273.15 and most - 273.15 < high and asked <= amps * (1 + 1e-6)
    )  # fmt: skip
    assert (found == []) == fits


def test_a_scene_that_asks_for_more_is_refused_with_what_to_write(start: Start) -> None:
    host = start()
    with served(host) as port, pytest.raises(DeviceError, match=r'write <limits current="3 A"/>'):
        LineDriver(LinePort(port=port), patience=PATIENT, limits={"current": 6.4, "temperature": (288.15, 313.15)})


@pytest.mark.parametrize("words", ["", "amps=3 plate=10:43 sink=44", "amps=x plate=1:2 sink=3 silence=4 reset=a cut=b",
                                   "amps=nan plate=10:43 sink=44 silence=0.2 reset=power cut=none"])  # fmt: skip
def test_a_greeting_without_limits_is_refused(words: str) -> None:
    with pytest.raises(DeviceError):
        StatedLimits.read(f"itouch-line 2 x {words}")
