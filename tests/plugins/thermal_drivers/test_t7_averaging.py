"""The T7's own averaging: fewer samples' noise, its time in the middle of the samples, and what stands in for it."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest
from test_thermal_drivers import SENSOR, served

from itouch.plugin import DeviceError, Timestamps
from itouch.session import build, load_scene
from itouch_thermal import ThermalDisplay, bench_wire
from itouch_thermal.display.params import DisplayParams
from itouch_thermal.drivers import Infrared, LabJack, Mecom
from itouch_thermal.drivers import labjack as registers
from itouch_thermal.drivers.emulator import ModbusServer
from itouch_thermal.drivers.labjack import LabJackDriver
from itouch_thermal.drivers.virtual import VirtualT7
from itouch_thermal.flux import observer
from itouch_thermal.flux.flux_model import FluxModel
from itouch_tools.cli.lockstep import Lockstep

PLATE = 300.0
VOLTS = {0: SENSOR.voltage(500.0, PLATE), 2: 1.65}
T = TypeVar("T", bound=VirtualT7)


class Noisy(VirtualT7):
    """Another sample for every request."""

    samples = 0

    def answer(self, request: bytes) -> bytes | None:
        """Answer with a voltage of now."""
        if request == struct.pack(">BHH", 3, 0, 2):
            self.samples += 1
            self.volts[0] = SENSOR.voltage(500.0 + 30.0 * (-1.0) ** self.samples, PLATE)
        return VirtualT7.answer(self, request)


@contextmanager
def t7(device: T | None = None, averaging: float = 20e-3) -> Iterator[tuple[T, LabJack]]:
    """Serve a T7 whose burst takes no time here."""
    device = device or VirtualT7(VOLTS.copy())  # type: ignore[assignment]
    assert device is not None
    device.see(0.0)
    server = ModbusServer("127.0.0.1", 0, device, speed=1e6)
    with served(server.serve):
        yield (
            device,
            LabJack(host=f"127.0.0.1:{server.port}", averaging=averaging, flux_sensor=SENSOR, infrared=Infrared()),
        )
    server.close()


class Told(Timestamps):
    """Remembers what a driver says of when it measured each channel."""

    def __init__(self) -> None:
        super().__init__(["heat_flux", "skin_temperature", "skin_valid"])
        self.said: dict[str, tuple[float, float]] = {}

    def measured(self, *channels: str, ago: float = 0.0, inside: float = 0.0) -> None:
        """Remember."""
        self.said.update(dict.fromkeys(channels, (ago, inside)))


def word(device: VirtualT7, address: int) -> int:
    return device.words[address] << 16 | device.words[address + 1]


def test_it_is_set_by_the_published_registers() -> None:
    with t7() as (device, params):
        driver = LabJackDriver(replace(params, resolution=3), patience=8.0)
        assert word(device, 9000) == 3  # AIN0_EF_INDEX: average, minimum and maximum
        assert word(device, 9300) == 20  # AIN0_EF_CONFIG_A: samples
        assert struct.pack(">I", word(device, 10200)) == struct.pack(">f", 1000.0)  # AIN0_EF_CONFIG_D: a second
        assert word(device, 4010) == 3  # STREAM_RESOLUTION_INDEX
        assert driver.exchange(PLATE).flux == pytest.approx(500.0, rel=1e-5)
        driver.close()


def test_a_reading_is_the_mean_of_its_samples_at_their_middle() -> None:
    """Under a ramp the mean is what the sensor said half of the window before, to the half millisecond."""
    with t7() as (device, params):
        driver, stamps, slope = LabJackDriver(params, patience=8.0), Told(), 4e3
        for tick in range(100):
            device.volts[0] = SENSOR.voltage(slope * 1e-3 * tick, PLATE)
            device.see(1e-3 * tick)
        found = driver.exchange(PLATE)
        driver.stamp(stamps)
        assert stamps.said["heat_flux"][1] == pytest.approx(9.5e-3)
        assert found.flux == pytest.approx(slope * (99e-3 - 9.5e-3), rel=1e-4)
        assert found.skin == pytest.approx(273.15 + 33.0, abs=1e-3)
        assert stamps.said["skin_temperature"][1] == 0.0
        driver.close()


def test_twenty_samples_have_less_noise_than_one() -> None:
    rng = np.random.default_rng(5)
    with t7() as (device, params):
        single, mean = LabJackDriver(replace(params, averaging=0.0), patience=8.0), LabJackDriver(params, patience=8.0)
        read: list[list[float]] = [[], []]
        for tick in range(20 * 150):
            device.volts[0] = SENSOR.voltage(rng.normal(0.0, 20.0), PLATE)
            device.see(1e-3 * tick)
            if tick % 20 == 19:
                for found, driver in zip(read, (single, mean), strict=True):
                    found.append(driver.exchange(PLATE).flux)
        assert np.std(read[0]) == pytest.approx(20.0, rel=0.2)
        assert np.std(read[1]) == pytest.approx(20.0 / math.sqrt(20.0), rel=0.2)
        single.close()
        mean.close()


def test_the_mean_is_taken_while_the_controller_is_talked_to() -> None:
    with t7() as (device, params):
        driver = LabJackDriver(params, patience=8.0)
        driver.begin()
        device.volts[2] = 0.0  # the thermometer was read before
        assert not math.isnan(driver.exchange(PLATE).skin)
        driver.begin()
        driver.begin()  # the answer to the first one is nobody's
        device.volts[0] = SENSOR.voltage(-40.0, PLATE)
        device.see(1.0)
        assert math.isnan(driver.exchange(PLATE).skin)
        for tick in range(20):
            device.see(1.0 + 1e-3 * tick)
        assert driver.exchange(PLATE).flux == pytest.approx(-40.0, rel=1e-4)
        driver.close()


@pytest.mark.parametrize(("lapse", "words"), [("busy", "refuses register 7000"), ("lost", "does not answer")])
def test_an_answer_that_does_not_come_is_asked_for_again(lapse: str, words: str) -> None:
    with t7() as (device, params):
        driver, stamps = LabJackDriver(replace(params, infrared=None), patience=2.0), Told()
        driver.exchange(PLATE)
        setattr(device.injected, lapse, 1)
        assert driver.exchange(PLATE).flux == pytest.approx(500.0, rel=1e-4)
        assert getattr(device.injected, lapse) == 0
        driver.stamp(stamps)
        assert stamps.said["heat_flux"][1] == pytest.approx(9.5e-3)
        setattr(device.injected, lapse, 9)
        with pytest.raises(DeviceError, match=words):
            driver.exchange(PLATE)
        driver.close()


def test_one_overloaded_sample_is_told_and_so_is_a_restart(monkeypatch: pytest.MonkeyPatch) -> None:
    with t7() as (device, params):
        driver = LabJackDriver(params, patience=8.0)
        driver.exchange(PLATE)
        device.volts[0] = -9999.0
        device.see(1e-3)
        device.volts[0] = SENSOR.voltage(500.0, PLATE)
        for tick in range(2, 15):
            device.see(1e-3 * tick)
        with pytest.raises(DeviceError, match="AIN0 is overloaded"):
            driver.exchange(PLATE)
        monkeypatch.setattr(registers, "_LOOK", 1)
        device.restart()
        with pytest.raises(DeviceError, match="restarted: it no longer averages its input AIN0"):
            driver.exchange(PLATE)
        driver.close()


def test_a_t7_that_cannot_average_is_asked_for_samples() -> None:
    with t7(Noisy(VOLTS.copy(), averages=False)) as (device, params):
        driver, stamps = LabJackDriver(replace(params, averaging=0.15), patience=1000.0), Told()
        asked = device.samples
        found = [driver.exchange(PLATE).flux for _ in range(4)]
        assert device.samples - asked >= 4 * 8  # however busy the machine is
        assert np.mean(found) == pytest.approx(500.0, abs=5.0)
        driver.stamp(stamps)
        ago, inside = stamps.said["heat_flux"]
        assert ago > 0.0
        assert inside == 0.0
        driver.close()


def test_one_that_cannot_and_is_slow_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registers, "_FEW", 0.0)
    with (
        t7(VirtualT7(VOLTS.copy(), averages=False)) as (_, params),
        pytest.raises(DeviceError, match="cannot average AIN0 by itself"),
    ):
        LabJackDriver(params)


def test_what_the_sampling_converter_cannot_do_is_refused() -> None:
    assert LabJack(host="h", resolution=12).samples == 1
    with pytest.raises(ValueError, match="at most 8 with averaging"):
        LabJack(host="h", resolution=9, averaging=20e-3)
    assert LabJack(host="h", averaging=1.6e-3, flux_sensor=SENSOR).samples == 2
    for single in (0.1e-3, 1e-3, 1.4e-3):
        with pytest.raises(ValueError, match="is a single sample, one a millisecond: write 2 ms or more, or 0"):
            LabJack(host="h", averaging=single)


def test_an_exchange_lasts_as_long_as_its_samples() -> None:
    def takes(averaging: float, session_baud: int = 0) -> float:
        sensors = LabJack(host="h", averaging=averaging, flux_sensor=SENSOR)
        return ThermalDisplay.exchange_time_for(
            DisplayParams(mecom=Mecom(port="p", session_baud=session_baud), labjack=sensors)
        )

    assert takes(0.0) == takes(10e-3) == 0.02
    assert takes(20e-3) == pytest.approx(0.022)
    assert takes(4e-3, 460800) == pytest.approx(0.006)
    assert takes(20e-3, 460800) == pytest.approx(0.022)


@pytest.fixture
def averaging(scenes: Path) -> Path:
    """The wire scene with an input that averages for 20 ms."""
    assert bench_wire.rewire(scenes / "rigs" / "wire.xml", bench_wire.FASTER["flux averaged for 20 ms"])
    return scenes / "four_materials_wire.xml"


def test_the_estimator_gets_the_mean_its_noise_and_its_time(averaging: Path) -> None:
    """In step: each reading is the mean of what the twin's sensor said in the 20 ticks before it was asked for."""
    both = Lockstep(str(averaging), only=["peltier"])
    samples, found = list[float](), list[tuple[int, float, int]]()  # how many samples there were, mean, age
    (host,) = [runner for runner in both.host.runners if runner.model.name == "peltier"]
    reads = [channel.name for channel in host.model.reads]
    (world,) = [runner for runner in both.world.runners if runner.model.name == "peltier"]

    def look(tick: int) -> None:
        state = both.host.state
        value, when = state["peltier.heat_flux"].item(), int(state["peltier.measured"][reads.index("heat_flux")])
        samples.append(world.reading["heat_flux"].item())
        if not found or found[-1][1] != value:
            found.append((len(samples), value, tick - when))

    both.host.taps.insert(0, look)
    both.run(0.5)
    assert len(found) > 12
    for at, value, age in found[3:]:
        assert age == 10
        assert value == pytest.approx(np.mean(samples[at - 20 : at]), rel=1e-3, abs=0.05)
    (law,) = [one.model.law for one in both.host.model.modalities if isinstance(one.model, FluxModel)]
    assert law.constants[observer.O_FLUX_NOISE] == pytest.approx(20.0 / math.sqrt(20.0), rel=0.02)


def test_a_twin_without_its_wire_has_the_noise_of_single_samples(averaging: Path) -> None:
    laws = [
        one.model.law
        for one in build(load_scene(averaging, twin="all")).model.modalities
        if isinstance(one.model, FluxModel)
    ]
    (law,) = laws
    assert law.constants[observer.O_FLUX_NOISE] == pytest.approx(20.0, rel=0.01)
