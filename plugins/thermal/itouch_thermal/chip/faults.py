"""Random faults of the reference display: how its chip reacts to each, and the temperatures of the true plate."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from itouch_thermal.chip.display import REFERENCE, SimulatedDisplay
from itouch_thermal.chip.host import SimulatedHost
from itouch_thermal.chip.pins import KELVIN, thermistor
from itouch_thermal.chip.program import Built
from itouch_thermal.display.params import Mismatch

#: Allowed temperatures of the true plate at all times [degC].
PLATE = (8.0, 45.0)
#: Durations [s] of a fault, of a fault of the sink, and of the soak of plate and sink without current afterwards.
FAULT_SECONDS, SINK_SECONDS, SOAK_SECONDS = 3.0, 10.0, 90.0
_MEASURED = ("plate", "guard", "sink", "flux", "current")

Rng = np.random.Generator


class Scene(NamedTuple):
    """What a fault acts on: the display, its host, and a random generator."""

    display: SimulatedDisplay
    host: SimulatedHost
    rng: Rng


Fault = Callable[[Scene], None]


def _driven(scene: Scene, seconds: float = FAULT_SECONDS, sign: float | None = None) -> None:
    """Continue with a host that commands a large current in one direction, whatever the readings."""
    sign = sign or float(scene.rng.choice((-1.0, 1.0)))
    scene.host.hold(sign * float(scene.rng.uniform(1.5, 3.0)), seconds)


def _stuck(name: str, volts: Callable[[Scene], float]) -> Fault:
    def fault(scene: Scene) -> None:
        scene.display.forced[name] = volts(scene)
        _driven(scene, SINK_SECONDS if name == "sink" else FAULT_SECONDS)

    return fault


def _as_shown(name: str) -> Callable[[Scene], float]:
    """Return a function for the voltage that a thermistor has now: its reading is then stuck."""

    def volts(scene: Scene) -> float:
        kelvin = scene.display.sink if name == "sink" else scene.display.plate
        return thermistor(kelvin, scene.display.numbers)

    return volts


def _drifting(name: str) -> Fault:
    def fault(scene: Scene) -> None:
        rate = float(scene.rng.uniform(0.5, 5.0)) * float(scene.rng.choice((-1.0, 1.0)))
        sign = float(scene.rng.choice((-1.0, 1.0)))
        for step in range(round((SINK_SECONDS if name == "sink" else FAULT_SECONDS) / 0.02)):
            scene.display.offsets[name] = rate * step * 0.02
            scene.host.order(2.5 * sign)

    return fault


def _loose(name: str) -> Fault:
    """Return a fault in which a contact opens and closes."""

    def fault(scene: Scene) -> None:
        sign = float(scene.rng.choice((-1.0, 1.0)))
        for _ in range(round(FAULT_SECONDS / 0.02)):
            scene.display.forced.pop(name, None)
            if scene.rng.random() < 0.3:
                scene.display.forced[name] = 5.0
            scene.host.order(2.5 * sign)

    return fault


def _hang(interrupts: bool) -> Fault:
    def fault(scene: Scene) -> None:
        scene.host.hold(float(scene.rng.choice((-3.0, 3.0))), 0.2)
        scene.display.chip.hang(interrupts=interrupts)
        _driven(scene)

    return fault


def _reset(how: str) -> Fault:
    def fault(scene: Scene) -> None:
        scene.host.hold(float(scene.rng.choice((-3.0, 3.0))), 0.2)
        for _ in range(int(scene.rng.integers(1, 4))):
            scene.display.chip.reset(how)
            scene.host.wait(int(scene.rng.integers(1, 200)))
        _driven(scene)

    return fault


def _silence(scene: Scene) -> None:
    scene.host.hold(float(scene.rng.choice((-3.0, 3.0))), 0.5)
    scene.host.wait(round(FAULT_SECONDS * 1e3))


def _noise(scene: Scene) -> None:
    rng = scene.rng
    share = 10.0 ** float(rng.uniform(-3.0, 0.0))

    def spoil(line: bytes) -> bytes:
        spoilt = bytearray(line)
        for index in range(len(spoilt)):
            if rng.random() < share:
                spoilt[index] = int(rng.integers(0, 256))
        return bytes(spoilt)

    host = SimulatedHost(scene.display, noise=spoil)
    host.hold(float(rng.choice((-3.0, 3.0))), FAULT_SECONDS)


def _garbage(scene: Scene) -> None:
    rng = scene.rng
    words = (
        b"I 1 nan",
        b"I 1 9999",
        b"I 1 -3.00001",
        b"I 1 1e30",
        b"I 1 3.0*",
        b"I  3",
        b"C",
        b"\x00" * 80,
        b"I 1 3.0*0000",
    )
    for _ in range(round(FAULT_SECONDS * 100)):
        junk = bytes(rng.integers(0, 256, int(rng.integers(1, 60))).astype(np.uint8)) if rng.random() < 0.5 else b""
        scene.display.step(junk + words[int(rng.integers(len(words)))] + b"\n")
        scene.host.wait(9)


def _wild_host(scene: Scene) -> None:
    for _ in range(round(FAULT_SECONDS / 0.02)):
        scene.host.order(float(scene.rng.uniform(-3.0, 3.0)) if scene.rng.random() < 0.5 else 3.0)


def _supply(scene: Scene) -> None:
    scene.display.supply = float(scene.rng.choice((0.0, 3.0, 6.0, 9.0, 15.0)))
    _driven(scene)


def _module(scene: Scene) -> None:
    """Open the module's wires, or short a part of the module."""
    scene.display.leads = float(scene.rng.choice((1e3, 10.0, 1.0, -0.9)))
    _driven(scene)


def _converter(scene: Scene) -> None:
    scene.host.hold(float(scene.rng.choice((-3.0, 3.0))), 0.2)
    scene.display.chip.stop_converter()
    _driven(scene)


def _sense_gain(scene: Scene) -> None:
    scene.display.sense *= float(scene.rng.choice((0.0, 0.5, 0.7, 1.5, -1.0)))
    _driven(scene)


def _fan(scene: Scene) -> None:
    _driven(scene, SINK_SECONDS, sign=1.0)


def _none(scene: Scene) -> None:
    _driven(scene)


#: Faults by name.
FAULTS: dict[str, Fault] = {
    "none but a host that asks for all": _none,
    "wild host": _wild_host,
    "host silent": _silence,
    "noise on the line": _noise,
    "garbage on the line": _garbage,
    "program hangs": _hang(True),
    "program hangs without interrupts": _hang(False),
    "brown-out": _reset("brown-out"),
    "reset by the host's port": _reset("reset"),
    "power lost and back": _reset("power"),
    "converter stops": _converter,
    "bridge's supply": _supply,
    "module open or half short": _module,
    "current's amplifier": _sense_gain,
    "fan stops": _fan,
    **{f"{name} open": _stuck(name, lambda _: 5.0) for name in _MEASURED},
    **{f"{name} short": _stuck(name, lambda _: 0.0) for name in _MEASURED},
    **{f"{name} stuck": _stuck(name, _as_shown(name)) for name in ("plate", "guard", "sink")},
    **{f"{name} drifts": _drifting(name) for name in ("plate", "guard", "sink")},
    **{f"{name} loose": _loose(name) for name in ("plate", "guard", "sink")},
    "plate at 80 degC": _stuck("plate", lambda scene: thermistor(353.15, scene.display.numbers)),
    "plate at 0 degC": _stuck("plate", lambda scene: thermistor(273.15, scene.display.numbers)),
}


def _blind(scene: Scene) -> None:
    for name in ("plate", "guard"):
        scene.display.forced[name] = _as_shown(name)(scene)
    _driven(scene, 3.0 * FAULT_SECONDS, sign=-1.0)


#: Faults that the firmware cannot detect, by name: two sensors fail in the same way.
BEYOND: dict[str, Fault] = {"plate and guard stuck": _blind}


@dataclass(frozen=True, slots=True)
class Outcome:
    """The result of a fault: extreme temperatures [degC] of the true plate with the soak, and the chip's last state."""

    name: str
    seed: int
    lowest: float
    highest: float
    state: str
    resets: int

    @property
    def safe(self) -> bool:
        """Whether the plate stayed within its allowed temperatures."""
        return PLATE[0] <= self.lowest and self.highest <= PLATE[1]


def run_fault(name: str, seed: int, program: Built | None = None) -> Outcome:
    """Run one fault with a random plate, sink and module, then the soak without current."""
    rng = np.random.default_rng((seed, *name.encode()))
    display = _display(rng, seed, name, program)
    host = SimulatedHost(display)
    low, high = [math.inf], [-math.inf]

    def watch(display: SimulatedDisplay) -> None:
        low[0], high[0] = min(low[0], display.plate), max(high[0], display.plate)

    display.taps.append(watch)
    try:
        host.begin()
        host.hold(float(rng.uniform(-1.0, 1.0)), 0.3)
        {**FAULTS, **BEYOND}[name](Scene(display, host, rng))
        display.forced.clear()
        answer = host.order(0.0)
        soaked = display.soak(SOAK_SECONDS)
    finally:
        display.close()
    return Outcome(
        name, seed, min(low[0], soaked[0]) - KELVIN, max(high[0], soaked[1]) - KELVIN,
        answer.state if answer is not None else "restarted or silent", display.last.resets,
    )  # fmt: skip


def _display(rng: Rng, seed: int, name: str, program: Built | None) -> SimulatedDisplay:
    """Return a display with random module, lags and temperatures, within what its firmware tolerates."""
    off = Mismatch(
        seebeck=float(rng.uniform(-0.1, 0.1)), resistance=float(rng.uniform(-0.1, 0.2)),
        conductance=float(rng.uniform(-0.1, 0.1)), sensor_lag=float(rng.uniform(-0.3, 0.3)),
    )  # fmt: skip
    fan = 3.0 if name == "fan stops" else float(rng.uniform(0.3, 0.7))
    params = replace(REFERENCE, mismatch=off, sink_resistance=fan, sink_capacity=float(rng.uniform(100.0, 300.0)))
    room = float(rng.uniform(288.15, 303.15))
    plate, sink = float(rng.uniform(285.15, 315.15)), float(rng.uniform(room, 316.15))
    display = SimulatedDisplay(
        params, begin=(plate, sink), room=room, guard_lag=0.2 * float(rng.uniform(0.7, 1.3)), seed=seed, program=program
    )
    for input_ in ("plate", "guard", "sink"):
        display.offsets[input_] = float(rng.uniform(-0.3, 0.3))
    return display


def campaign(count: int, first: int = 1) -> list[tuple[str, int]]:
    """Return the faults to run, every kind in turn, each with its own seed."""
    names = list(FAULTS)
    return [(names[index % len(names)], first + index) for index in range(count)]
