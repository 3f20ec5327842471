"""What trips at what, with the numbers that are in force in one scene (T, K and W of the reference of the limits)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from itouch.world import DeviceModel, Model
from itouch.world import limits as default
from itouch.world.limits import CEILING, DEFAULT
from itouch.world.supervision import heats

K0 = 273.15


class Rule(NamedTuple):
    """One limit: its number, whose it is, what is limited, where, what stops, what never passes, and who set it."""

    number: str
    device: str
    quantity: str
    limit: str
    trip: str
    absolute: str
    source: str


def rules(model: Model) -> Iterator[Rule]:
    """Yield every limit in force in a scene."""
    for device in model.devices.values():
        if heats(device.reads):
            yield from _heat(device)
        if device.command("pose_target") is not None:
            yield from _carried(device)
        if device.command("wrench") is not None:
            yield from _arm(device)
        yield from _every(device)
    yield from _all(model)


def _source(device: DeviceModel, name: str) -> str:
    return device.limits.sources.get(name, DEFAULT)


def _heat(device: DeviceModel) -> Iterator[Rule]:
    limits = device.limits
    low, high = limits.temperature or default.PLATE_TEMPERATURE
    least, most = limits.temperature_trip
    name, by = device.name, _source(device, "temperature")
    yield Rule("T1", name, "plate, high", _c(high), _c(most), _c(default.PLATE_ABSOLUTE[1]), by)
    yield Rule("T2", name, "plate, low", _c(low), _c(least), _c(default.PLATE_ABSOLUTE[0]), by)
    dose = f"{(limits.dose or default.DOSE) / 60:.3g} CEM43"
    yield Rule("T3", name, "thermal dose of a session", f"told at {default.DOSE_WARNING / 60:g} CEM43", dose, dose,
               _source(device, "dose"))  # fmt: skip
    rate = limits.plate_rate or default.PLATE_RATE
    yield Rule("T5", name, "rate of the plate in contact, mean of 0.5 s", f"{rate:g} K/s", f"{2 * rate:g} K/s", "",
               _source(device, "plate_rate"))  # fmt: skip
    if device.reading("heat_flux") is not None:
        flux = limits.flux or default.FLUX
        yield Rule("T6", name, "heat flux, mean of 1 s", f"{flux / 1e3:g} kW/m²", f"{flux / 750:.3g} kW/m²", "",
                   _source(device, "flux"))  # fmt: skip
    if device.reading("sink_temperature") is not None:
        yield Rule("T7", name, "heat sink", _c(default.SINK), _c(default.SINK_TRIP), _c(default.SINK_ABSOLUTE), DEFAULT)
    sane = "no number, outside -10 to 80 °C, jump of 20 K, step of 5 K in 50 ms, frozen for 1 s while the drive changes"
    yield Rule("T8", name, "sanity of its sensors", "", sane, "", DEFAULT)
    if device.command("current") is not None:
        away = "2 K against a drive above 50 %, or none of its effect for 2 s"
        yield Rule("T9", name, "runaway", "", away, "", DEFAULT)
        yield Rule("", name, "current", f"{limits.current or 0.0:.3g} A", "", "", _source(device, "current"))


def _carried(device: DeviceModel) -> Iterator[Rule]:
    limits, name = device.limits, device.name
    yield Rule("T4", name, "time of one contact", f"withdraws after {limits.contact_time or 0:g} s",
               f"{limits.contact_time_trip:g} s", "120 s", _source(device, "contact_time"))  # fmt: skip
    yield Rule("K4", name, "force of the plate on the finger", f"yields above {limits.plate_force or 0:g} N",
               f"{limits.plate_force_trip:g} N", f"{default.PLATE_FORCE_ABSOLUTE:g} N",
               _source(device, "plate_force"))  # fmt: skip
    yield Rule("K5", name, "speed towards a finger nearer than 20 mm", f"{limits.speed_near or 0:g} m/s",
               f"{default.SPEED_NEAR_TRIP:g} m/s", "", _source(device, "speed"))  # fmt: skip
    yield Rule("K5", name, "speed otherwise", f"{limits.speed or 0:g} m/s", f"{default.SPEED_TRIP:g} m/s", "",
               _source(device, "speed"))  # fmt: skip
    stray = f"{default.TRACKING_TRIP * 1e3:g} mm for {default.TRACKING_TIME * 1e3:g} ms"
    yield Rule("K6", name, "distance from its command", f"approach stops at {default.TRACKING * 1e3:g} mm", stray, "",
               DEFAULT)  # fmt: skip
    channel = device.command("pose_target")
    if channel is not None and channel.low:
        corners = zip(channel.low[:3], channel.high[:3], strict=True)
        box = " × ".join(f"{low * 1e3:g}..{high * 1e3:g}" for low, high in corners)
        yield Rule("K6", name, "travel", f"{box} mm", "", "", CEILING)


def _arm(device: DeviceModel) -> Iterator[Rule]:
    channel, limits, name = device.command("wrench"), device.limits, device.name
    most = f"{channel.magnitude:g} N" if channel is not None and channel.magnitude else ""
    yield Rule("K1", name, "force on the finger", f"{limits.force or 0:g} N", "", most, _source(device, "force"))
    yield Rule("K2", name, "speed of the finger", f"forces fade above {default.ARM_SPEED:g} m/s",
               f"{default.ARM_SPEED_TRIP:g} m/s", "", DEFAULT)  # fmt: skip
    yield Rule("K3", name, "increase of force", f"{default.FORCE_SLEW:g} N/s", "", "", DEFAULT)


def _every(device: DeviceModel) -> Iterator[Rule]:
    limits, name = device.limits, device.name
    yield Rule("W1", name, "age of its reading", "", f"{limits.watchdog * 1e3:g} ms", "", _source(device, "watchdog"))
    ramp = f"{limits.ramp:g} s" if limits.ramp else "none on this twin"
    yield Rule("K3", name, "ramp-in", f"{ramp}; {limits.ramp or default.RAMP:g} s after re-arming", "", "",
               _source(device, "ramp"))  # fmt: skip


def _all(model: Model) -> Iterator[Rule]:
    dies = "outputs safe within 200 ms, by the guardian process or the device's own watchdog"
    yield Rule("W2", "all", "death of the servo process", "", dies, "", DEFAULT)
    hardware = any(not device.twin for device in model.devices.values())
    source = "hold-to-run of the scene" if model.scene.safety.hold_to_run else DEFAULT
    asked = hardware or model.scene.safety.hold_to_run
    switch = "letting go, or no word for 80 ms: retracts in the same tick" if asked else "not asked for on twins"
    yield Rule("W3", "all", "hold-to-run", "", switch, "", source)
    yield Rule("W4", "all", "re-arming", "by an operator only, from the measured state, with a ramp", "", "", DEFAULT)


def _c(kelvin: float) -> str:
    return f"{kelvin - K0:.4g} °C"
