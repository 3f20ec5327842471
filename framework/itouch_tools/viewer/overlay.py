"""The text over the picture: clock, devices, contact, heat, faults and keys; needs no graphics."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from itouch.loop import Status, contact_report
from itouch.plugin import Channel, Record, Role
from itouch.plugin.quantity import PLAIN
from itouch.world import Model, declared
from itouch_tools.viewer.fault_messages import is_loss, what
from itouch_tools.viewer.scales import scale_of
from itouch_tools.viewer.temperatures import plate_temperature

if TYPE_CHECKING:
    from itouch_tools.viewer.timeline import Timeline

#: What each key does, in the order of the help.
KEYS = {
    "H": "show or hide this menu",
    "P": "pause and go on (simulated sessions)",
    "Space": "hold to run, where the machine asks for it",
    "S": "save the session",
    "R": "re-arm after a fault",
    "T": "colour objects by temperature or by material",
    "G": "show or hide grid and workspace",
    "C": "show or hide the curves",
    "D": "curves beside the scene or below it",
    "N": "show or hide the names of objects",
    "L": "light or dark",
    "U": "sound on or off",
    "+ -": "larger, smaller text (100 to 250 %)",
    "1 2 3 4 5": "views: operator, front, side, top, corner",
    "F": "frame everything",
    "M": "move the finger with the mouse or the arrow keys (simulated sessions)",
    "Esc": "stop safely and close",
    "Drag": "orbit; with Shift or the middle button: pan",
    "Wheel": "zoom",
    "Click": "properties of an object or a device",
    "Point": "at a curve: the values of that time",
}


@dataclass(frozen=True, slots=True)
class TextLines:
    """Lines of text, each with its weight: "plain", "good", "warn" or "bad"."""

    lines: tuple[tuple[str, str], ...]


@dataclass(slots=True)
class SessionStatus:
    """What a viewer knows besides State: the timing of the loop, messages, and faults in words."""

    pace: str = "fast"
    paused: bool = False
    waiting: bool = False
    tick_us: float | None = None
    late_us: float | None = None
    overruns: int | None = None
    faults: list[dict[str, Any]] = field(default_factory=list)
    #: What of the session is no longer being kept, in words.
    losses: list[str] = field(default_factory=list)
    message: str = ""
    picked: str = ""
    #: The time line of a recording that is played; None in a running session.
    timeline: Timeline | None = None


#: Keys of a recording that is played, in place of those that command a session.
PLAYBACK_KEYS = {
    "H": KEYS["H"],
    "P, Space": "play and pause",
    "Left, Right": "the tick before, the next tick; with Shift 0.1 s",
    "Up, Down": "play faster, slower",
    "Page up, down": "the contact, mark or fault before, the next one",
    "Home, End": "the start, the end",
    **{key: KEYS[key] for key in ("T", "G", "C", "D", "N", "L", "+ -", "1 2 3 4 5", "F")},
    "Time line": "click or drag: go to that time",
    **{key: KEYS[key] for key in ("Drag", "Wheel", "Click", "Point")},
    "Esc": "close",
}


def headline(model: Model, state: Record) -> str:
    """Return the one line that says what is felt: the object, the force, and the heat flux."""
    for probe in model.probes:
        index = int(state[f"{probe.name}.object"])
        if index < 0:
            continue
        parts = [f"{probe.name} on {_named(model, index)}", f"{_felt(state, probe.name):.1f} N felt"]
        return ", ".join([*parts, *_flux(model, state)])
    near = [
        (float(state[f"{p.name}.near_distance"]), p) for p in model.probes if int(state[f"{p.name}.near_object"]) >= 0
    ]
    if near:
        distance, probe = min(near, key=lambda pair: pair[0])
        name = model.objects[int(state[f"{probe.name}.near_object"])]
        return f"{probe.name} {distance * 1e3:.0f} mm from {name}"
    return ", ".join(f"{probe.name} free" for probe in model.probes[:2])


def _named(model: Model, index: int) -> str:
    """Return an object's name, with its material if that has another name."""
    name, material = model.objects[index], model.scene.objects[index].material
    return f"{name} ({material})" if material and material != name else name


def _felt(state: Record, probe: str) -> float:
    """Return the felt force [N]: that of arm and plate together on the finger."""
    return float(np.ravel(state[f"{probe}.total_force"])[0])


def _flux(model: Model, state: Record) -> list[str]:
    """Return the obtained heat flux and the desired one, if a device measures the one and a modality has the other."""
    wanted = [
        name for name, field in declared(model).items()
        if field.unit == "W/m^2" and field.show.startswith("wish") and name in state
        and name.partition(".")[0] in {modality.name for modality in model.modalities}
    ]  # fmt: skip
    obtained = [name for device in model.devices.values() if (name := device.field(Role.HEAT_FLUX))]
    if not wanted or not obtained:
        return []
    flux, wish = (float(np.ravel(state[names[-1]])[0]) for names in (obtained, wanted))
    if not (np.isfinite(flux) and np.isfinite(wish)):
        return []
    off = abs(flux - wish) > max(0.15 * abs(wish), 200.0)  # more than the sensor's noise
    short = f" ({100.0 * flux / wish:.0f} %)" if off and abs(wish) > 200.0 else ""
    return [f"{flux:.0f} W/m2{short}; desired {wish:.0f}"]


def status(model: Model, state: Record, now: SessionStatus) -> TextLines:
    """Return the lines of the status corner."""
    late = "plain" if now.overruns is None else "warn" if now.overruns else "good"  # colour of the timing's line
    lines = [(line, late if index else "plain") for index, line in enumerate(_clock(model, state, now))]
    for device in model.devices.values():
        lines.append(_device(device.name, device.twin, state))
    for probe in model.probes:
        lines.append((_probe(model, probe.name, state), "plain"))
    lines += [(line, "plain") for line in _heat(model, state)]
    if not int(state["ready"]) and not now.faults:
        lines.append(("calibrating: the machine finds its heights by touch", "warn"))
    if now.waiting:
        lines.append(("nothing moves yet: hold Space where the machine asks for it", "warn"))
    if now.paused:
        lines.append(("paused: P goes on", "warn"))
    if now.message:
        lines.append((now.message, "good"))
    return TextLines(tuple(lines))


def fitted(words: TextLines, width: int, lines: int) -> TextLines:
    """Return as many lines as there is room for, cut to a width [letters]; good news is left out first."""
    rank = {"bad": 0, "warn": 0, "plain": 1, "good": 2}
    order = sorted(range(len(words.lines)), key=lambda index: rank[words.lines[index][1]])
    kept = sorted(order[: max(0, lines)])
    cut = [words.lines[index] for index in kept]
    return TextLines(
        tuple((line if len(line) <= width else line[: max(0, width - 1)] + "…", weight) for line, weight in cut)
    )


def alarm(now: SessionStatus, width: int) -> TextLines | None:
    """Return the text about faults and losses, in lines of at most ``width`` letters; None if there are none."""
    lines = []
    for fault in now.faults:
        if is_loss(fault):
            continue  # it is among the losses below
        said = f"FAULT {fault['trip']}: {what(fault)}"
        lines += [(line, "bad") for line in textwrap.wrap(said, max(width, 20))]
    if lines:
        known = [fault["safe"] for fault in now.faults if isinstance(fault.get("safe"), dict)]
        reached = all(safe.get("reached") for safe in known)
        after = "all devices have been made safe" if reached else "not all devices could be seen to be safe"
        after += "; R re-arms" if now.pace == "real" else ""  # pictures, films and played recordings have no such key
        lines += [(line, "plain") for line in textwrap.wrap(after, max(width, 20))]
    for loss in now.losses:
        lines += [(line, "bad") for line in textwrap.wrap(loss, max(width, 20))]
    return TextLines(tuple(lines)) if lines else None


def _clock(model: Model, state: Record, now: SessionStatus) -> list[str]:
    first = f"{int(state['tick']) * model.period:.3f} s at {1.0 / model.period:.0f} Hz"
    figures = (("tick p99", now.tick_us), ("late p99", now.late_us))
    parts = [f"{name} {value:.0f} us" for name, value in figures if value is not None]
    if now.overruns is not None:
        parts.append(f"{now.overruns} overruns")
    return [first, "   ".join(parts)] if parts else [first]


def _device(name: str, twin: bool, state: Record) -> tuple[str, str]:
    status = Status(int(state[f"{name}.status"]))
    words = f"{name}: {status.name.lower()}{' (simulated)' if twin else ''}"
    age = int(state[f"{name}.age"])
    if age > 1:
        words += f", reading {age} ticks old"
    return words, {"ENABLED": "good", "FAULT": "bad"}.get(status.name, "warn")


def _probe(model: Model, name: str, state: Record) -> str:
    index, near = int(state[f"{name}.object"]), int(state[f"{name}.near_object"])
    if index >= 0:
        virtual, felt = float(np.linalg.norm(state[f"{name}.force"])), _felt(state, name)
        said = f"{name}: touches {model.objects[index]}, {felt:.2f} N felt"
        return said if abs(virtual - felt) < 0.05 else f"{said} ({virtual:.2f} N in the virtual world)"
    if near >= 0:
        return f"{name}: {float(state[f'{name}.near_distance']) * 1e3:.1f} mm from {model.objects[near]}"
    return f"{name}: free"


def _heat(model: Model, state: Record) -> list[str]:
    lines = []
    for device in model.devices.values():
        channel, kelvin = device.reading(Role.SKIN_CONTACT_TEMPERATURE), plate_temperature(state, device)
        if channel is not None and kelvin is not None:
            lines.append(f"{device.name}: {channel.name.replace('_', ' ')} {kelvin - 273.15:.2f} degC")
    for modality in model.modalities:
        if words := contact_report.status(modality, state):
            lines.append(f"{modality.name}: {words}")
    return lines


def properties(model: Model, state: Record, name: str) -> TextLines:
    """Return the properties of an object or a device, for the panel that opens when it is clicked."""
    if name in model.objects:
        return TextLines(tuple((line, "plain") for line in _object(model, state, name)))
    device = model.devices[name]
    lines = [f"device {name}: plugin {device.plugin}{', twin' if device.twin else ''}"]
    for channel in device.reads:
        numbers, unit = _shown(channel, state[f"{name}.{channel.name}"])
        meaning = f"({channel.doc})" if channel.doc else ""
        lines.append(" ".join(word for word in (f"{channel.name}:", numbers, unit, meaning) if word))
    return TextLines(tuple((line, "plain") for line in lines))


def _shown(channel: Channel, value: Any) -> tuple[str, str]:
    """Return the first numbers of a channel, three at most, and their unit as in the charts: degC, mm."""
    if channel.unit in PLAIN or not channel.unit:
        return " ".join(f"{number:.4g}" for number in np.ravel(value)[:3]), ""
    scale = scale_of(channel.unit)
    known = [scale.shown(float(number)) for number in np.ravel(value)[:3]]
    return " ".join(f"{number:.4g}" if np.isfinite(number) else "--" for number in known), scale.unit


def _object(model: Model, state: Record, name: str) -> list[str]:
    index = model.objects.index(name)
    element = model.scene.objects[index]
    kelvin = model.scene.world.temperature if element.temperature is None else element.temperature
    place = " ".join(f"{1e3 * value:.1f}" for value in state["objects.pose"][index][:3])
    lines = [f"object {name}", f"material: {element.material}", f"position: {place} mm", f"{kelvin - 273.15:.1f} degC"]
    material = next((m for m in model.scene.materials if m.name == element.material), None)
    if material is not None and material.contact is not None:
        contact = material.contact
        lines.append(f"stiffness: {contact.stiffness / 1e3:g} N/mm")
        lines.append(f"friction: {contact.static_friction:g} static, {contact.dynamic_friction:g} dynamic")
    return lines
