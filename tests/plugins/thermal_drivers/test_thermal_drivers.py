"""MeCom, LabJack T7 and line protocol: by hand, against virtual instruments over real ports, with injected and faults."""

from __future__ import annotations

import io
import math
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from free_ports import free_port
from hypothesis import given
from hypothesis import strategies as st
from requirements import not_here

from itouch.plugin import DeviceError, Field, Record, Terminal, Trace, TwinInputs
from itouch_thermal import ThermalDisplay
from itouch_thermal.display.params import DisplayParams
from itouch_thermal.drivers import FluxSensor, Infrared, LabJack, LinePort, Mecom
from itouch_thermal.drivers.emulator import DisplayEmulator, ModbusServer
from itouch_thermal.drivers.labjack import LabJackDriver
from itouch_thermal.drivers.lineport import LineDriver, seal, unseal
from itouch_thermal.drivers.mecom import MecomClient, MecomError, MecomRefusal, crc16
from itouch_thermal.drivers.modbus import ModbusLine
from itouch_thermal.drivers.tec import LONGEST_WATCHDOG, TecDriver
from itouch_thermal.drivers.virtual import Plate, VirtualLine, VirtualMecom, VirtualT7
from itouch_thermal.film import TouchFilm
from itouch_thermal.film.film_params import T7, FilmParams, ForceSensor, Thermometer
from itouch_thermal.film.twin import FilmTwin
from itouch_tools.cli import main as cli

pytestmark = pytest.mark.punctual  # what is driven is a thread or a process beside the driver

SENSOR = FluxSensor(sensitivity=1.2e-6, correction=0.002, offset=3e-6)


@contextmanager
def served(step: Callable[[], None]) -> Iterator[None]:
    """Call ``step`` again and again in a thread."""
    stop = threading.Event()

    def work() -> None:
        while not stop.is_set():
            step()
            time.sleep(2e-4)

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    made = Terminal()
    yield made
    made.close()


@contextmanager
def mecom(terminal: Terminal) -> Iterator[VirtualMecom]:
    device = VirtualMecom(Plate(plate=300.0, sink=301.5))

    def step() -> None:
        data = terminal.receive()
        if data:
            terminal.send(device.take(data))

    with served(step):
        yield device


# --- MeCom ------------------------------------------------------------------------------------------------------------


def test_the_check_sum_of_a_request_equals_the_protocols_example() -> None:
    """The protocol's own example: address 2, number 1, read parameter 0x0803 instance 1."""
    assert b"%04X" % crc16(b"#020001?VR080301") == b"90B1"


def test_an_acknowledgement_repeats_the_requests_check() -> None:
    device = VirtualMecom(Plate())
    body = b"#020007VSC35101" + struct.pack(">f", 1.5).hex().upper().encode()
    check = b"%04X" % crc16(body)
    assert device.take(body + check + b"\r") == b"!020007" + check + b"\r"
    assert device.floats[50001] == 1.5


def test_reading_writing_and_refusals(terminal: Terminal) -> None:
    with mecom(terminal) as device:
        client = MecomClient(terminal.path, address=2, patience=5.0)
        assert client.identity().startswith("TEC-1091")
        assert client.read_float(1000) == pytest.approx(26.85, abs=1e-4)
        client.write_float(50001, -1.25)
        assert device.floats[50001] == -1.25
        assert client.read_float(50001) == -1.25
        assert client.read_int(104) == 2
        for act, code, words in (
            (lambda: client.write_float(1000, 1.0), 6, "read only"),
            (lambda: client.read_int(4711), 5, "no such parameter"),
            (lambda: client.write_float(50001, 99.0), 7, "out of range"),
            (lambda: client.read_float(1000, 2), 8, "no such instance"),
        ):
            with pytest.raises(MecomRefusal, match=words) as refusal:
                act()
            assert refusal.value.code == code
        client.close()


@pytest.mark.parametrize(("lapse", "most"), [("lost", 2), ("damaged", 7), ("busy", 2), ("late", 2)])
def test_a_lapse_is_tried_again_and_one_more_is_an_error(terminal: Terminal, lapse: str, most: int) -> None:
    """One that answers damaged is there, and asked more often than one that is silent."""
    with mecom(terminal) as device:
        client = MecomClient(terminal.path, patience=5.0)
        for times in (1, 2, most):
            setattr(device.injected, lapse, times)
            assert client.read_float(1001) == pytest.approx(28.35, abs=1e-4)
        setattr(device.injected, lapse, most + 1)
        begin = time.monotonic()
        with pytest.raises(MecomError):
            client.read_float(1001)
        assert time.monotonic() - begin < 60.0  # it ends
        assert client.read_float(1001) == pytest.approx(28.35, abs=1e-4)
        client.close()


def test_a_controller_is_armed_and_opens_its_voltage(terminal: Terminal) -> None:
    with mecom(terminal) as device:
        device.floats[4010], device.floats[2060] = -10.0, 30.0
        tec = TecDriver(Mecom(port=terminal.path), patience=8.0, ceiling=2.0)
        assert device.floats[50002] == device.floats[2031] == 19.0
        assert (device.floats[2030], device.floats[2032]) == (2.0, 2.5)
        assert (device.floats[4010], device.floats[4011], device.floats[2060]) == (8.0, 45.0, 0.5)
        assert (device.integers[6301], device.integers[6302]) == (1, 2)
        assert tec.missing == []
        for _ in range(10):
            reading = tec.exchange(1.5)
        assert reading.current == 1.5
        device.now = 0.6  # nobody has talked to it for longer than its watchdog
        assert not device.driven() and device.error == 183
        with pytest.raises(DeviceError, match="error 183"):
            for _ in range(8):
                tec.exchange(1.5)


@pytest.mark.parametrize("bulk", [True, False])
@pytest.mark.parametrize("current", [0.0, 1.5])
def test_a_controller_that_has_started_anew_is_noticed(terminal: Terminal, bulk: bool, current: float) -> None:
    with mecom(terminal) as device:
        device.bulk = bulk
        tec = TecDriver(Mecom(port=terminal.path), patience=8.0)
        for _ in range(5):
            tec.exchange(current)
        device.restart()
        with pytest.raises(DeviceError, match="restarted"):
            for _ in range(8):
                tec.exchange(current)


def test_a_current_that_does_not_follow_is_told(terminal: Terminal) -> None:
    with mecom(terminal) as device:
        tec = TecDriver(Mecom(port=terminal.path), patience=8.0)
        device.resistance = 100.0  # a broken wire: the voltage is not enough
        with pytest.raises(DeviceError, match="gives 0.19 A where 2.00 A was asked for"):
            for _ in range(60):
                tec.exchange(2.0)


def test_a_watchdog_that_stays_off_is_refused_and_one_that_is_not_there_is_remembered(terminal: Terminal) -> None:
    with mecom(terminal) as device:
        written = device._write
        device_type = type(device)

        def deaf(self: VirtualMecom, parameter: int, instance: int, data: bytes) -> bytes:
            return b"" if parameter == 2060 else written(parameter, instance, data)

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(device_type, "_write", deaf)
            with pytest.raises(DeviceError, match="own watchdog is off"):
                TecDriver(Mecom(port=terminal.path), patience=8.0)
    with mecom(terminal) as other:
        real = other._read

        def without(self: VirtualMecom, parameter: int, instance: int) -> bytes:
            return b"+05" if parameter in (2060, 6302) else real(parameter, instance)

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(type(other), "_read", without)
            with pytest.raises(
                DeviceError, match='no parameter 2060: .*; watchdog="no" in <thermal:mecom> lets it run'
            ):
                TecDriver(Mecom(port=terminal.path), patience=8.0)
            assert TecDriver(Mecom(port=terminal.path, watchdog=False), patience=8.0).missing == [2060, 6302]


def test_a_watchdog_longer_than_the_drivers_is_set_shorter(terminal: Terminal) -> None:
    with mecom(terminal) as device:
        for found, kept in ((0.8, 0.5), (0.2, 0.2)):
            device.floats[2060] = found
            TecDriver(Mecom(port=terminal.path), patience=8.0).close()
            assert device.floats[2060] == kept


@pytest.mark.parametrize(
    ("rig", "changed", "alone"),
    [
        ("wire", ("", ""), False),
        ("wire", ("<thermal:mecom", '<thermal:mecom watchdog="no"'), True),
        ("diy", ("", ""), False),
        ("diy", ('firmware="reference"', 'firmware="own"'), True),
    ],
)
def test_check_and_safety_report_say_of_which_display_no_watchdog_is_known(
    scenes: Path, capsys: pytest.CaptureFixture[str], rig: str, changed: tuple[str, str], alone: bool
) -> None:
    path = scenes / "rigs" / f"{rig}.xml"
    path.write_text(path.read_text().replace(*changed, 1))
    scene = str(scenes / f"four_materials_{rig}.xml")
    assert cli(["check", scene]) == 0
    assert ("device 'peltier' has no watchdog of its own" in capsys.readouterr().out) is alone
    assert cli(["safety-report", scene, "--no-run"]) == 0
    rows = [line for line in capsys.readouterr().out.splitlines() if "peltier" in line and "W2" in line]
    assert any("it runs with guardian and hold-to-run only" in row for row in rows) is alone


def test_the_loop_writes_live_parameters_only(terminal: Terminal) -> None:
    with mecom(terminal) as device:
        tec = TecDriver(Mecom(port=terminal.path), patience=8.0)
        once = device.flash
        assert once == 6  # what stood otherwise: input and output, hot plate, watchdog, and how the plate is measured
        for step in range(30):
            reading = tec.exchange(0.01 * step)
        assert device.flash == once
        assert device.driven()
        assert reading.current == pytest.approx(0.29, abs=1e-6)
        assert (reading.plate, reading.sink) == pytest.approx((300.0, 301.5), abs=1e-4)
        tec.close()
        assert device.output() == 0.0
        assert not device.driven()
        again = TecDriver(Mecom(port=terminal.path), patience=8.0)
        assert device.flash == once  # they stand so now
        again.close()


def test_a_controller_in_error_is_told(terminal: Terminal) -> None:
    with mecom(terminal) as device:
        device.error = 108
        with pytest.raises(DeviceError, match="in error 108: see its manual, then reset it: switch it off and on"):
            TecDriver(Mecom(port=terminal.path), patience=8.0)
        device.error = 0
        tec = TecDriver(Mecom(port=terminal.path), patience=8.0)
        device.error = 61
        with pytest.raises(DeviceError, match="in error 61"):
            for _ in range(10):
                tec.exchange(1.0)
        tec.close()
    with pytest.raises(DeviceError, match="did not answer 3 times"):
        TecDriver(Mecom(port=terminal.path), patience=8.0)
    with pytest.raises(DeviceError) as caught:
        MecomClient("/dev/no-such-port")
    said = "serial port '/dev/no-such-port' cannot be opened: No such file or directory: check its plug"
    assert str(caught.value) == said


@given(st.binary(max_size=80))
def test_the_virtual_controller_survives_any_bytes(data: bytes) -> None:
    VirtualMecom(Plate()).take(data + b"\r")


# --- LabJack T7 -------------------------------------------------------------------------------------------------------


@contextmanager
def labjack(**changed: object) -> Iterator[tuple[VirtualT7, LabJack]]:
    device = VirtualT7({0: SENSOR.voltage(500.0, 300.0), 2: 1.65})
    server = ModbusServer("127.0.0.1", 0, device)
    with served(server.serve):
        parts = {"flux_sensor": SENSOR, "infrared": Infrared()} | changed
        yield device, LabJack(host=f"127.0.0.1:{server.port}", **parts)  # type: ignore[arg-type]
    server.close()


def test_the_calibration_sheet() -> None:
    assert SENSOR.flux(1000.0 * 1.2e-6 + 3e-6, 296.15) == pytest.approx(1000.0)
    assert SENSOR.flux(SENSOR.voltage(-730.0, 306.15), 306.15) == pytest.approx(-730.0)
    assert SENSOR.voltage(100.0, 306.15) - 3e-6 == pytest.approx(100.0 * 1.2e-6 * 1.02)
    turned = FluxSensor(sensitivity=1.2e-6, sign=-1.0)
    assert turned.flux(1.2e-6, 296.15) == pytest.approx(-1.0)
    with pytest.raises(ValueError, match="sign"):
        FluxSensor(sensitivity=1e-6, sign=0.5)


def test_voltages_by_the_published_registers() -> None:
    with labjack() as (device, params):
        driver = LabJackDriver(params)
        seen = driver.exchange(300.0)
        assert seen.flux == pytest.approx(500.0, rel=1e-5)
        assert seen.skin == pytest.approx(273.15 + 33.0, abs=1e-4)
        assert struct.pack(">2H", device.words[40000], device.words[40001]) == struct.pack(">f", 0.01)
        assert device.words[41000] == 1  # AIN0 against AIN1
        assert device.words[41002] == 199  # single-ended
        device.volts[2] = 0.0
        assert math.isnan(driver.exchange(300.0).skin)  # 0 degC is no finger
        device.volts[0] = -9999.0
        with pytest.raises(DeviceError, match="overloaded"):
            driver.exchange(300.0)
        driver.close()


def test_another_product_a_lost_answer_and_no_answer_are_told() -> None:
    with labjack() as (device, params):
        device.product = 4.0
        with pytest.raises(DeviceError, match="product 4, not a LabJack T7"):
            LabJackDriver(params)
        device.product = 7.0
        driver = LabJackDriver(params)
        device.injected.lost = 1
        with pytest.raises(DeviceError, match="does not answer"):
            device.injected.lost = 5
            driver.exchange(300.0)
        device.injected.lost = 0
        driver.close()
        driver = LabJackDriver(params)
        device.injected.busy = 5  # it is asked again three times
        with pytest.raises(DeviceError, match="refuses register"):
            driver.exchange(300.0)
        driver.close()
    with pytest.raises(DeviceError, match="no LabJack answers"):
        LabJackDriver(LabJack(host="127.0.0.1:1"))
    for host in ("127.0.0.1:x", "127.0.0.1:²", "127.0.0.1:", "127.0.0.1:70000", "", "a b"):
        with pytest.raises(ValueError, match="^host = .* must be HOST or HOST:PORT"):
            LabJack(host=host)
        with pytest.raises(DeviceError, match="^host = .* must be HOST or HOST:PORT"):
            ModbusLine("T7", host)


def test_garbage_does_not_end_the_server() -> None:
    with labjack() as (_, params):
        for garbage in (b"GET / HTTP/1.0\r\n\r\n", b"\0" * 64, b"\x00\x01\x00\x00\x00\x02\x01\x63"):
            with socket.create_connection(("127.0.0.1", int(params.host.split(":")[1])), timeout=2) as line:
                line.sendall(garbage)
                time.sleep(0.01)
        driver = LabJackDriver(params)
        assert driver.exchange(300.0).flux == pytest.approx(500.0, rel=1e-5)
        driver.close()


# --- line protocol ------------------------------------------------------------------------------------------------------


@contextmanager
def own_rig(terminal: Terminal) -> Iterator[VirtualLine]:
    device = VirtualLine(Plate(plate=299.0, sink=300.0, flux=-42.0, skin=305.0))

    def step() -> None:
        data = terminal.receive()
        if data:
            terminal.send(device.take(data, time.monotonic()))

    with served(step):
        yield device


@pytest.mark.parametrize(
    ("parameter", "answer"),
    [(104, b"+06"), (105, b"+06"), (1000, b"+06"), (1001, b"+06"), (1020, b"+06"), (1021, b"+06"), (1200, b"+06"),
     (1002, b"+05"), (9999, b"+05")],
)  # fmt: skip
def test_what_is_measured_can_not_be_written_to_a_virtual_controller(parameter: int, answer: bytes) -> None:
    """As the real one answers: read only (6), or no such parameter (5)."""
    assert VirtualMecom(Plate())._write(parameter, 1, bytes(4)) == answer


def test_the_check_sum_of_a_line_equals_one_by_hand() -> None:
    assert seal("I 1") == b"I 1*58\n"  # 0x49 ^ 0x20 ^ 0x31
    assert unseal(b"I 1*58\r\n") == "I 1"
    for wrong in (b"I 1*59", b"I 1", b"", b"*", b"I 1*5", b"\xff*00"):
        assert unseal(wrong) is None


@given(st.text(st.characters(codec="ascii", exclude_characters="\n\r"), max_size=40))
def test_sealed_lines_are_read_back(text: str) -> None:
    assert unseal(seal(text)) == text


def test_a_line_protocol_rig_is_driven_and_its_faults_are_told(terminal: Terminal) -> None:
    with own_rig(terminal) as device:
        rig = LineDriver(LinePort(port=terminal.path), patience=15.0)
        seen = rig.exchange(-1.5)
        assert seen == pytest.approx((299.0, 300.0, -42.0, 305.0, -1.5), abs=1e-3)
        for lapse in ("lost", "damaged"):
            setattr(device.injected, lapse, 2)
            assert rig.exchange(0.5).current == 0.5
        with pytest.raises(DeviceError, match="refuses 'I 11.00000': out of range"):
            rig.exchange(11.0)
        device.plate.plate = math.nan
        with pytest.raises(DeviceError, match="lost its plate"):
            rig.exchange(0.5)
        device.plate.plate = 299.0
        rig.exchange(2.0)
        assert device.output(time.monotonic()) == 2.0
        assert device.output(time.monotonic() + 0.3) == 0.0  # its own watchdog
        rig.close()
        assert device.current == 0.0


def test_something_else_on_the_port_is_told(terminal: Terminal) -> None:
    def parrot() -> None:
        data = terminal.receive()
        if data:
            terminal.send(data)

    with served(parrot), pytest.raises(DeviceError, match="did not answer"):
        LineDriver(LinePort(port=terminal.path), patience=5.0)


# --- the device, closed over real bytes with the plant behind ------------------------------------------------------------


def params(terminal_name: str, port: int) -> DisplayParams:
    return DisplayParams(
        mecom=Mecom(port=terminal_name),
        labjack=LabJack(host=f"127.0.0.1:{port}", flux_sensor=SENSOR, infrared=Infrared()),
    )


def test_a_loop_through_the_real_bytes_holds_a_flux(tmp_path: object) -> None:
    """The plant behind MeCom and Modbus, a plain PI at the exchange's own rate: 300 W/m2 out of the finger."""
    given_ = params(f"{tmp_path}/tec", free_port())
    emulator = DisplayEmulator(given_)
    twin = ThermalDisplay.Twin(given_)  # type: ignore[misc]
    reads, commands = ThermalDisplay.channels(given_)
    state = Record.of(twin.fields())
    reading, command = (Record.of(Field.of(c) for c in side) for side in (reads, commands))
    twin.reset(state, np.random.default_rng(1))
    touch, clock = TwinInputs(force=1.0, gap=-1e-3), {"last": time.monotonic(), "now": 0.0, "twin": 0.0}

    def step() -> None:
        last, clock["last"] = clock["last"], time.monotonic()
        clock["now"] += min(0.02, clock["last"] - last)  # of time that this thread was held up nothing else is known
        while clock["twin"] < clock["now"]:
            twin.step(state, command, touch, 1e-3)
            clock["twin"] += 1e-3
        twin.read(state, reading)
        emulator.serve(clock["now"], reading, command)

    emulator.open()
    twin.step(state, command, touch, 1e-3)  # compiles, or loads what is compiled
    clock["last"] = time.monotonic()
    stream = io.StringIO()
    display = ThermalDisplay(given_)
    display.timeout_factor = 10.0
    display.trace = Trace(stream, "peltier")
    with closing(emulator), served(step), closing(display):
        display.open()
        seen, wanted = (Record.of(Field.of(c) for c in side) for side in (reads, commands))
        integral, exchanges, begin = 0.0, 0, time.monotonic()
        errors, last = [], begin
        while exchanges < 150 and time.monotonic() - begin < 60.0:  # 3 s; on a busy machine exchanges take longer
            now = time.monotonic()
            try:
                display.read(seen)
                exchanges, last = exchanges + 1, now
                error = 300.0 - seen["heat_flux"].item()
                integral = float(np.clip(integral + 2e-4 * error, -3.0, 3.0))
                wanted["current"] = np.clip(integral + 3e-3 * error, -3.0, 3.0)
                display.write(wanted)
            except DeviceError:
                stood = time.monotonic() - last
                if stood < LONGEST_WATCHDOG:
                    raise
                not_here(f"this machine stood still for {1e3 * stood:.0f} ms: the controller's own watchdog has let go")
            if exchanges > 100:
                errors.append(abs(error))
            time.sleep(max(0.0, begin + 0.02 * exchanges - time.monotonic()))
    assert exchanges == 150
    assert sum(errors) / len(errors) < 60.0
    assert emulator.tec is not None
    assert emulator.tec.output() == 0.0
    assert 'peltier > "#02' in stream.getvalue()
    assert "read 0 x 3" in stream.getvalue()


def test_a_display_without_hardware_named_says_what_to_write() -> None:
    with pytest.raises(DeviceError, match="<thermal:mecom> and <thermal:line>"):
        ThermalDisplay(DisplayParams()).open()
    with pytest.raises(DeviceError, match='command="current"'):
        ThermalDisplay(DisplayParams(command="temperature")).open()


def test_no_flux_sensor_is_told(terminal: Terminal) -> None:
    with mecom(terminal) as device, pytest.raises(DeviceError, match="no flux sensor"):
        ThermalDisplay(DisplayParams(mecom=Mecom(port=terminal.path))).open()
    assert device.output() == 0.0


def test_an_instrumented_sample_is_read_by_its_sheets() -> None:
    with labjack() as (device, params):
        device.volts |= {3: 0.75, 4: 1.2}
        sensors = T7(
            host=params.host, flux_sensor=SENSOR, thermometer=Thermometer(), force_sensor=ForceSensor(zero=0.25),
            infrared=Infrared(),
        )  # fmt: skip
        bench = TouchFilm(FilmParams(labjack=sensors))
        bench.open()
        reading = Record.of(Field.of(channel) for channel in TouchFilm.reads)
        assert bench.read(reading)
        assert reading["wrench"].tolist() == pytest.approx([0, 0, -1.0, 0, 0, 0], abs=1e-6)
        assert reading["film_temperature"].item() == pytest.approx(273.15 + 24.0, abs=1e-4)
        assert reading["heat_flux"].item() == pytest.approx(SENSOR.flux(SENSOR.voltage(500.0, 300.0), 297.15), rel=1e-5)
        assert reading["skin_valid"].item() == 1.0
        device.volts[2] = 0.0
        bench.read(reading)
        assert reading["skin_valid"].item() == 0.0 and reading["skin_temperature"].item() == pytest.approx(306.15)
        bare = TouchFilm(FilmParams(labjack=replace(sensors, thermometer=None)))
        bare.open()
        seen = Record.of(Field.of(channel) for channel in TouchFilm.channels(bare.params)[0])
        assert bare.read(seen) and "film_temperature" not in list(seen)
        bare.close()
        device.volts[3] = -9999.0
        with pytest.raises(DeviceError, match="AIN3 is overloaded"):
            bench.read(reading)
        bench.close()
        with pytest.raises(DeviceError, match="not open"):
            bench.read(reading)


def test_a_film_without_a_thermometer_has_no_temperature() -> None:
    with_one, without = (T7(host="h", flux_sensor=SENSOR, thermometer=t) for t in (Thermometer(), None))
    names = [[c.name for c in TouchFilm.channels(FilmParams(labjack=given))[0]] for given in (None, with_one, without)]
    assert names[0] == names[1] and set(names[0]) - set(names[2]) == {"film_temperature"}
    twin = FilmTwin(FilmParams(labjack=without))
    state = Record.of(twin.fields())
    twin.reset(state, np.random.default_rng(0))
    reading = Record.of(Field.of(channel) for channel in TouchFilm.channels(twin.params)[0])
    assert twin.read(state, reading) and reading["skin_valid"].item() == 1.0


def test_a_sample_without_an_instrument_is_told() -> None:
    with pytest.raises(DeviceError, match="<touch-film:labjack>"):
        TouchFilm(FilmParams()).open()
