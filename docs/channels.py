"""The reference of channels: what the program and its plugins declare of every name of State."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

SCENES = Path(__file__).parents[1] / "scenes"
#: Scenes and rigs that together have every kind of field.
LOOKED_AT = (
    ("four_materials.xml", None), ("faults.xml", None), ("texture.xml", None), ("moving.xml", None),
    ("two_fingers.xml", None), ("thermal_display.xml", "rigs/temperature_display.xml"),
    ("four_materials_wire.xml", None),
)  # fmt: skip

#: Owner -> what stands above its table; those of modalities follow.
OWNERS = {
    "": "the session",
    "objects": "`objects.*`: the objects, in the order of the scene",
    "events": "`events.*`: contact events",
    "marks": "`marks.*`: what the operator noted",
    "PROBE": "`PROBE.*`: every probe, by its name",
    "DEV": "`DEV.*`: every device, by its name",
}

_HEAD = """# Channels

Everything that changes in a session is *State*: one record of named fields. Any of them but the two tables (their
events and marks are in every recording) can be recorded (`<record channels="...">`), plotted, exported, and read in
Python as `engine.state["NAME"]`, a view that is always current. `itouch-py inspect SCENE` lists those of a scene.
Generated from the shipped scenes; shapes with a number that depends on the scene are those of `four_materials.xml`.

Unit and meaning are what program and plugins declare (`itouch.plugin.Quantity`); numbers without a unit are plain ones,
`tick` counts ticks of the servo, `mixed` holds numbers in different units, which only their owner uses.
A device's *command* is what the scene wants; `DEV.sent.CHANNEL` is what the supervisor let through, in the same shape.
Poses and forces of probes are in the world, those of devices in the device's own frame. Temperatures are kelvin in
State and degrees Celsius in files. Timing (lateness, tick times, overruns) is no State; the report has it.
"""


def page() -> str:
    """Return the reference of channels as Markdown."""
    names, titles = found()
    return "\n".join([_HEAD, *_lines(names, titles)]) + "\n"


class Row(NamedTuple):
    """One field: its shape and type, its unit and what it is."""

    shape: str
    kind: str
    unit: str
    meaning: str


def found() -> tuple[dict[str, dict[str, Row]], dict[str, str]]:
    """Return owner -> name -> row over the looked-at scenes, and the title of each owner."""
    import itouch
    from itouch.plugin.discovery import Catalog
    from itouch.world import compile_scene, declared, make_state

    names: dict[str, dict[str, Row]] = {owner: {} for owner in OWNERS}
    titles = dict(OWNERS)
    for file, rig in LOOKED_AT:
        scene = itouch.load(SCENES / file, rig=SCENES / rig if rig else None)
        model, problems = compile_scene(scene, Catalog())
        if model is None:
            raise RuntimeError(f"{file}: {problems}")
        owners = {d.name: "DEV" for d in scene.devices} | {p.name: "PROBE" for p in scene.probes}
        own: dict[str, tuple[str, str]] = {}
        for modality in model.modalities:
            called = "PROBE.surface" if modality.default_of else modality.name
            titles.setdefault(called, f"`{called}.*`: the modality `{modality.plugin}`")
            names.setdefault(called, {})
            own |= {f"{modality.name}.{field}": (called, field) for field in modality.fields}
        state = make_state(model)
        for name, field in declared(model).items():
            owner, _, short = name.partition(".") if "." in name else ("", "", name)
            row = Row(*_shape(state[name]), field.unit if field.unit != "1" else "", _linked(field.doc))
            owner, short = own.get(name, (owners.get(owner, owner), short))
            names[owner].setdefault(short, row)
    return names, titles


def _linked(doc: str) -> str:
    """Return a meaning with what the page can link to; programs show the meanings as they are."""
    return doc.replace("number of the trip ", "number of the [trip](errors.md#while-running) ")


def _shape(view: np.ndarray) -> tuple[str, str]:
    kind = {"f": "number", "i": "whole", "u": "bits", "V": "table", "b": "flag"}[view.dtype.kind]
    return " x ".join(map(str, view.shape)) or "1", kind


def _lines(names: Mapping[str, Mapping[str, Row]], titles: Mapping[str, str]) -> Iterator[str]:
    for owner, title in titles.items():
        yield f"## {title[0].upper() + title[1:]}\n"
        yield "| name | shape | unit | meaning |\n|---|---|---|---|"
        for field, row in sorted(names[owner].items(), key=lambda item: _first(owner, item[0])):
            shape = row.shape if row.kind == "number" else f"{row.shape} {row.kind}"
            yield f"| `{field}` | {shape} | {row.unit} | {row.meaning} |"
        yield ""


def _first(owner: str, field: str) -> int:
    """Sort the parts of a device: readings, commands, what was sent, the rest, its twin."""
    if owner != "DEV":
        return 0
    kinds = ("command.", "sent.", "out.")
    if field.startswith(kinds):
        return 1 + [field.startswith(kind) for kind in kinds].index(True)
    return 5 if "." in field else 0
