"""The canonical XML of a Scene: fixed order, SI units, defaults left out; reading it gives an equal scene."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any
from xml.sax.saxutils import quoteattr

from itouch.scene.description import Scene
from itouch.scene.elements import PluginPart
from itouch.schema.fields import PLUGIN_NAMESPACE, Spec, default_of, specs, tag_of, xml_name
from itouch.schema.quantities import format_quantity


def write(scene: Scene) -> str:
    """Return the scene as one XML document."""
    plugins = sorted({part.plugin for part in _parts(scene)})
    namespaces = "".join(f' xmlns:{plugin}="{PLUGIN_NAMESPACE}{plugin}"' for plugin in plugins)
    lines = ['<?xml version="1.0" encoding="utf-8"?>', f"<itouch version={quoteattr(scene.version)}{namespaces}>"]
    lines += _section("materials", (_element(m, "material") for m in scene.materials))
    lines += _indent(_element(scene.world, "world"))
    lines += _section("devices", (_element(d, "device") for d in scene.devices))
    interaction = [_element(p, "probe") for p in scene.probes] + [_element(o, "operator") for o in scene.operators]
    lines += _section("interaction", [*interaction, *(_part(part) for part in scene.modalities)])
    lines += _indent(_element(scene.rates, "rates"))
    lines += _indent(_element(scene.safety, "safety"))
    lines += [line for fault in scene.faults for line in _indent(_element(fault, "fault"))]
    lines += _indent(_element(scene.record, "record")) if scene.record is not None else []
    return "\n".join([*lines, "</itouch>", ""])


def _parts(scene: Scene) -> Iterable[PluginPart]:
    for material in scene.materials:
        yield from material.parts
    for device in scene.devices:
        yield from device.parts
    yield from scene.modalities


def _section(tag: str, content: Iterable[list[str]]) -> list[str]:
    lines = [line for element in content for line in _indent(element)]
    return _indent([f"<{tag}>", *lines, f"</{tag}>"]) if lines else []


def _indent(lines: Iterable[str]) -> list[str]:
    return ["  " + line for line in lines]


def _part(part: PluginPart) -> list[str]:
    name = [("name", part.name)] if part.name and part.name != part.local else []
    return _element(part.params, f"{part.plugin}:{part.local}", name, prefix=f"{part.plugin}:")


def _element(element: Any, tag: str, extra: Iterable[tuple[str, str]] = (), *, prefix: str = "") -> list[str]:
    """Return the lines of one element; ``prefix`` is a plugin's namespace prefix, which its children share."""
    attributes, inner = list(extra), []
    for name, spec in specs(type(element)).items():
        value = getattr(element, name)
        if spec.kind in ("child", "children", "plugin"):
            inner += _inner(value, spec, prefix)
        elif value is not None and value != default_of(type(element), name):
            attributes.append((xml_name(name), _text(value, spec)))
    if hasattr(element, "OPEN"):
        attributes += [(name, format_quantity(value, "Hz")) for name, value in getattr(element, element.OPEN)]
    written = "".join(f" {name}={quoteattr(text)}" for name, text in attributes)
    if not inner:
        return [f"<{tag}{written}/>"]
    return [f"<{tag}{written}>", *_indent(inner), f"</{tag}>"]


def _inner(value: Any, spec: Spec, prefix: str) -> list[str]:
    if spec.kind == "plugin":
        return [line for part in value for line in _part(part)]
    listed = value if spec.kind == "children" else (value,)
    present = [element for element in listed if element is not None]
    return [
        line for element in present for line in _element(element, prefix + tag_of(type(element), spec), prefix=prefix)
    ]


def _text(value: Any, spec: Spec) -> str:
    if spec.kind == "quantity" or (spec.kind == "hold" and isinstance(value, int | float)):
        return format_quantity(value, spec.unit)
    if spec.kind == "flag":
        return value if isinstance(value, str) else "yes" if value else "no"
    return str(value)
