"""The reference of channels: what every name of State means, beside the shape and type that the program gives it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

SCENES = Path(__file__).parents[1] / "scenes"
#: Scenes and rigs that together have every kind of field.
LOOKED_AT = (
    ("four_materials.xml", None), ("faults.xml", None), ("texture.xml", None), ("moving.xml", None),
    ("two_fingers.xml", None), ("thermal_display.xml", "rigs/temperature_display.xml"),
    ("four_materials_wire.xml", None),
)  # fmt: skip

#: Owner -> what stands above its table.
OWNERS = {
    "": "the session",
    "objects": "`objects.*`: the objects, in the order of the scene",
    "events": "`events.*`: contact events",
    "marks": "`marks.*`: what the operator noted",
    "PROBE": "`PROBE.*`: every probe, by its name",
    "DEV": "`DEV.*`: every device, by its name",
    "heat": "`heat.*`: the modality `thermal:heat`",
    "flux-control": "`flux-control.*`: the modality `thermal:flux-control`",
}

#: Owner -> name -> (unit, meaning).
MEANINGS: dict[str, dict[str, tuple[str, str]]] = {
    "": {
        "tick": ("", "ticks since the begin; a tick lasts 1 / `<rates servo>`"),
        "seed": ("", "seed of all noise"),
        "ready": ("", "1 when calibration at the start is done and the motion has begun"),
        "hold": ("tick", "until when the dead-man's switch counts as held"),
    },
    "objects": {
        "pose": ("m", "position and quaternion w x y z of each object in the world"),
        "twist": ("m/s, rad/s", "linear and angular velocity of each object"),
        "ticks": ("tick", "how long the scripts of moving objects have run"),
        "physics": ("", "state of the rigid bodies, as MuJoCo integrates it"),
    },
    "events": {
        "count": ("", "contact events so far; the newest is at (count - 1) mod 64 of the table"),
        "table": ("", "the last 64: kind (0 near, 1 begin, 2 move, 3 end), tick, probe, object, point [m], normal, "
                  "distance [m], speed [m/s], tangential_velocity [m/s], penetration [m], force [N], "
                  "time_to_contact [s], area [m2]"),
    },
    "marks": {
        "count": ("", "marks so far"),
        "table": ("", "the last eight: tick, name, payload"),
    },
    "PROBE": {
        "hip": ("m", "position of the fingertip's centre (haptic interface point), from `pose-from`"),
        "velocity": ("m/s", "its velocity, filtered over 2 ms"),
        "proxy": ("m", "where the fingertip would be if objects were impenetrable"),
        "force": ("N", "force of the virtual coupling, stiffness x (proxy - hip); zero in free space"),
        "contact_force": ("N", "`force` with damping and the surface's effects: the virtual force on the finger"),
        "effect_force": ("N", "what textures, stick-slip, viscosity, magnets and vibration add"),
        "normal": ("", "outward normal of the touched surface"),
        "point": ("m", "touched point of the surface"),
        "penetration": ("m", "depth of the hip below where the surface stops the probe"),
        "normal_force": ("N", "share of the contact force along the normal, at least 0"),
        "area": ("m^2", "contact area by Hertz's law"),
        "object": ("", "number of the touched object, -1: none"),
        "near_object": ("", "number of the nearest object, -1: none within `near`"),
        "near_distance": ("m", "distance to it, infinite if none is near"),
        "time_to_contact": ("s", "distance over approach speed, infinite unless approaching"),
        "plate": ("", "1 if the plate renders the contact's normal force"),
        "surface_height": ("m", "height of the highest virtual surface under the finger"),
        "plate_top": ("m", "height of the plate's top, by the table's reading"),
        "plate_gap": ("m", "surface height less plate top; above 0 the plate is too low"),
        "plate_yield": ("m", "how far the plate yields to a force above its limit"),
        "tracking": ("m", "distance of the plate from its command"),
        "plate_force": ("N", "force of the plate on the finger (of twins: the true one)"),
        "plate_true_top": ("m", "true height of the plate's top (twins)"),
        "plate_distance": ("m", "true distance of finger and plate (twins); below 0 the pad is pressed"),
        "plate_touched": ("tick", "when the finger began to touch the true plate, -1: it does not"),
        "total_force": ("N", "greatest of what acts on the finger: magnitude of arm force + plate force"),
        "contact.object": ("", "object of the open contact, -1: none"),
        "contact.begin": ("tick", "when it began"),
        "contact.separated": ("tick", "for how long the probe has been clear of it"),
        "contact.plate": ("", "1 if the plate rendered it at the begin"),
        "contact.plate_gap": ("m", "`plate_gap` at the begin, along the normal"),
        "contact.peak_force": ("N", "greatest `total_force` so far"),
        "contact.peak_penetration": ("m", "greatest depth so far"),
        "contact.peak_area": ("m^2", "greatest area so far"),
        "contact.impact_speed": ("m/s", "approach speed at the begin"),
        "contact.physical_begin": ("tick", "when the finger met the true plate"),
        "hand.position": ("m", "where the operator's finger twin is"),
        "hand.velocity": ("m/s", "its velocity"),
        "hand.target": ("m", "where the hand wants it to be: the scripted or recorded motion"),
        "hand.ticks": ("tick", "how long the motion has run"),
        "hand.offset": ("m", "what the operator has added to the motion by hand"),
        "hand.steered": ("", "1 while somebody steers the finger"),
        "hand.wanted": ("m/s", "where they steer it to"),
    },
    "DEV": {
        "pose": ("m", "reading: position and quaternion w x y z of the device's end in its own frame"),
        "wrench": ("N, N*m", "reading: force and torque that the device feels"),
        "deadman": ("", "reading: 1 while the switch is held"),
        "skin_temperature": ("K", "reading: infrared, valid with the finger clear of the plate"),
        "skin_valid": ("", "reading: 1 if `skin_temperature` is to be believed"),
        "plate_temperature": ("K", "reading: bulk of the plate"),
        "sink_temperature": ("K", "reading: hot side of the module"),
        "heat_flux": ("W/m^2", "reading: out of the finger is positive"),
        "actual_current": ("A", "reading: current that a TEC controller gives"),
        "command.wrench": ("N, N*m", "command: wrench on the operator"),
        "command.pose_target": ("m", "command: pose to go to, in the device's own frame"),
        "command.current": ("A", "command: current of the module, positive cools the plate"),
        "command.temperature_target": ("K", "command: temperature that a TEC controller shall hold"),
        "command.output": ("", "command: 1 switches the TEC controller's output on"),
        "status": ("", "0 CLOSED, 1 OPEN (measures), 2 ENABLED (obeys), 3 FAULT"),
        "trip": ("", "number of the [trip](errors.md#while-running) that stopped it, 0: none"),
        "tripped": ("tick", "when"),
        "ramp": ("", "share of its limits that it may use; grows to 1 after it was enabled"),
        "age": ("tick", "age of the reading"),
        "sequence": ("", "number of the reading: changes when there is a new one"),
        "clamped": ("", "how often a command was limited"),
        "dropped": ("", "how many commanded components of locked directions were zeroed"),
        "strayed": ("", "for how many checks it has been too far from its command"),
        "calibration": ("m", "correction of the mount that calibration found: position, quaternion"),
        "contact_time": ("s", "how long what it carries has been touched (T4)"),
        "withdrawn": ("", "1 while it is withdrawn because of T4"),
        "stopped": ("", "1 held, 2 driven back, in the safe sequence"),
        "touched": ("", "what has been touched: heat is supervised as in contact"),
        "heat.dose": ("s", "thermal dose so far, in seconds at 43 degC (T3)"),
        "heat.share": ("", "share of the drive that T1 to T7 leave"),
        "touch_off.stage": ("", "0 place, 1 rise, 2 release, 3 done"),
        "touch_off.point": ("", "which of the points is being felt"),
        "touch_off.offsets": ("m", "what was found at each"),
        "twin.true_flux": ("W/m^2", "true flux out of the finger (display)"),
        "twin.true_skin": ("K", "true temperature of the skin's surface (display)"),
        "twin.true_plate": ("K", "true temperature of the plate's face (display)"),
    },
    "heat": {
        "desired": ("W/m^2", "flux that the real object would draw from the bare finger"),
        "in_contact": ("", "1 between BEGIN and END"),
        "object": ("", "number of the object, -1: none"),
        "skin_temperature": ("K", "skin of the model finger"),
        "resistance": ("m^2*K/W", "contact resistance at the virtual force; infinite in air"),
        "contact_area": ("m^2", "contact area at that force"),
        "since": ("tick", "time since BEGIN"),
        "touched": ("", "1 for each object that was touched: its own heat goes on"),
    },
    "flux-control": {
        "readiness": ("", "1 when the plate is at the start temperature within 0.1 K, falls to 0 at 0.2 K"),
        "plate_ready": ("", "1 when `readiness` is"),
        "start_temperature": ("K", "where the plate goes before the touch of the near object"),
        "plate_limited": ("", "1 if that lies outside the plate's band and was clipped"),
        "desired": ("W/m^2", "flux that is wanted: of `desired-from`, or of a recorded curve"),
        "obtained": ("W/m^2", "flux out of the finger: the twin's true one, on hardware the sensor's, corrected"),
        "flux": ("W/m^2", "flux at the plate's face that the controller reckons with"),
        "approached": ("", "number of the object that is near, -1: none"),
        "object": ("", "number of the object that is touched, -1: none"),
        "touching": ("", "1 in contact with an object that has a flux"),
        "unready": ("", "touches that began before the plate was ready"),
        "condensation_time": ("s", "how long the plate has been below the room's dew point"),
    },
}  # fmt: skip

_HEAD = """# Channels

Everything that changes in a session is *State*: one record of named fields. Any of them can be recorded
(`<record channels="...">`), plotted, exported, and read in Python as `engine.state["NAME"]`, a view that is always
current. `itouch-py inspect SCENE` lists those of a scene. Generated from the shipped scenes; shapes with a number that
depends on the scene are those of `four_materials.xml`.

A device's *command* is what the scene wants; `DEV.sent.CHANNEL` is what the supervisor let through, in the same shape.
Poses and forces of probes are in the world, those of devices in the device's own frame. Temperatures are kelvin in
State and degrees Celsius in files. Timing (lateness, tick times, overruns) is no State; the report has it.
"""


def page() -> str:
    """Return the reference of channels as Markdown."""
    return "\n".join([_HEAD, *_lines(found())]) + "\n"


def found() -> dict[str, dict[str, tuple[str, str]]]:
    """Return owner -> name -> (shape, type) over the looked-at scenes; owners as in OWNERS."""
    import itouch
    from itouch.plugin.discovery import Catalog
    from itouch.world import compile_scene, make_state

    names: dict[str, dict[str, tuple[str, str]]] = {owner: {} for owner in OWNERS}
    for file, rig in LOOKED_AT:
        scene = itouch.load(SCENES / file, rig=SCENES / rig if rig else None)
        model, problems = compile_scene(scene, Catalog())
        if model is None:
            raise RuntimeError(f"{file}: {problems}")
        owners = {d.name: "DEV" for d in scene.devices} | {p.name: "PROBE" for p in scene.probes}
        state = make_state(model)
        for name in state:
            owner, _, field = name.partition(".") if "." in name else ("", "", name)
            names[owners.get(owner, owner)].setdefault(field, _shape(state[name]))
    return names


def _shape(view: np.ndarray) -> tuple[str, str]:
    kind = {"f": "number", "i": "whole", "u": "bits", "V": "table", "b": "flag"}[view.dtype.kind]
    return " x ".join(map(str, view.shape)) or "1", kind


def _lines(names: Mapping[str, Mapping[str, tuple[str, str]]]) -> Iterator[str]:
    for owner, title in OWNERS.items():
        yield f"## {title[0].upper() + title[1:]}\n"
        yield "| name | shape | unit | meaning |\n|---|---|---|---|"
        for field, (unit, meaning) in MEANINGS[owner].items():
            shape, kind = names[owner][field]
            yield f"| `{field}` | {shape}{'' if kind == 'number' else ' ' + kind} | {unit} | {meaning} |"
        own = sorted(set(names[owner]) - set(MEANINGS[owner]) - _sent(names[owner]))
        if own:
            yield f"\nBesides, memory that only its owner reads: {', '.join(f'`{name}`' for name in own)}.\n"
        yield ""


def _sent(fields: Mapping[str, object]) -> set[str]:
    return {field for field in fields if field.startswith("sent.")}
