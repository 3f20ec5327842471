"""The reference of the scene language, generated from the dataclasses that are its grammar."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from typing import Any

from itouch.scene import elements
from itouch.scene.extensions import Extensions
from itouch.schema.fields import REQUIRED, Spec, default_of, specs, tag_of, xml_name
from itouch.schema.hold_until import SKIN, WORD
from itouch.schema.quantities import describe, format_quantity

_SECTIONS: tuple[tuple[type, str], ...] = (
    (elements.Include, "inside `<itouch>`, any number of times"),
    (elements.Materials, "inside `<itouch>`"),
    (elements.WorldElement, "inside `<itouch>`"),
    (elements.Devices, "inside `<itouch>`"),
    (elements.Interaction, "inside `<itouch>`"),
    (elements.Rates, "inside `<itouch>`"),
    (elements.Safety, "inside `<itouch>`"),
    (elements.Fault, "inside `<itouch>`, any number of times"),
    (elements.RecordElement, "inside `<itouch>`"),
)


def reference(extensions: Extensions) -> str:
    """Return the reference of all elements as Markdown."""
    lines = [_HEAD]
    seen: set[tuple[type, str]] = set()
    for cls, where in _SECTIONS:
        lines += _element(cls, tag_of(cls), where, seen)
    for plugin in extensions.plugin_names:
        lines += _plugin(extensions, plugin, seen)
    return "\n".join(lines) + "\n"


def elements_of(cls: type, where: str) -> str:
    """Return the reference of one element and of all that may stand inside it, as Markdown."""
    return "\n".join(_element(cls, tag_of(cls), where, set())) + "\n"


_HEAD = """# Scene elements

Generated from the classes that read the files; each element says which file declares it. A number may carry one unit
at its end; without one it is in SI.
`<itouch version="1.0">` is the outermost element; `<defaults>` holds attributes for the elements of a tag in this file
and in the files that include it.
"""


def _element(cls: type, tag: str, where: str, seen: set[tuple[type, str]], prefix: str = "") -> Iterator[str]:
    if (cls, tag) in seen:
        return
    seen.add((cls, tag))
    yield f"\n## `<{tag}>`\n"
    yield f"{(cls.__doc__ or '').strip().splitlines()[0]} Place: {where}. Declared in `{_file_of(cls)}`.\n"
    rows = [
        _row(cls, name, spec) for name, spec in specs(cls).items() if spec.kind not in ("child", "children", "plugin")
    ]
    if rows:
        yield "| attribute | what | default | meaning |"
        yield "|---|---|---|---|"
        yield from rows
    if hasattr(cls, "OPEN"):
        yield f"\nBesides, the names of {cls.OPEN}, each with a value in Hz.\n"
    inner = [(element, spec) for spec in specs(cls).values() for element in spec.elements]
    if inner:
        names = ", ".join(f"`<{prefix}{tag_of(element, spec)}>`" for element, spec in inner)
        yield f"\nInside: {names}.\n"
    for element, spec in inner:
        yield from _element(element, prefix + tag_of(element, spec), f"inside `<{tag}>`", seen, prefix)


def _file_of(cls: type) -> str:
    """Return the path of the file that declares an element, from its top-level package on."""
    name = cls.__module__.replace(".", "/")
    return f"{name}/__init__.py" if hasattr(sys.modules[cls.__module__], "__path__") else f"{name}.py"


def _plugin(extensions: Extensions, plugin: str, seen: set[tuple[type, str]]) -> Iterator[str]:
    for host in ("device", "material", "interaction"):
        for local in extensions.locals(plugin, host):
            cls = extensions.element_class(plugin, host, local)
            if cls is not None:
                yield from _element(cls, f"{plugin}:{local}", f"inside `<{host}>`", seen, f"{plugin}:")


def _row(cls: type, name: str, spec: Spec) -> str:
    return f"| `{xml_name(name)}` | {_what(spec)} | {_default(default_of(cls, name), spec)} | {spec.doc} |"


def _what(spec: Spec) -> str:
    if spec.kind == "quantity":
        limits = spec.range_text()
        return describe(spec.unit, spec.size, spec.absolute) + (f", {limits}" if limits else "")
    if spec.kind == "hold":
        return f"{describe(spec.unit)}, {spec.range_text()}, or `{WORD} {SKIN}` and a difference in K"
    if spec.kind == "choice":
        return " or ".join(f"`{value}`" for value in spec.values)
    if spec.kind == "ref":
        return f"name of a {spec.target}"
    return {
        "flag": ", ".join(("yes or no", *spec.values)),
        "integer": f"whole number, {spec.range_text()}",
        "name": "name",
        "text": "text",
        "file": "file",
    }[spec.kind]


def _default(value: Any, spec: Spec) -> str:
    if value is REQUIRED:
        return "required"
    if value is None or value == "":
        return "none"
    if spec.kind in ("quantity", "hold"):
        return f"`{_rounded(format_quantity(value, spec.unit))}`"
    return f"`{'yes' if value else 'no'}`" if spec.kind == "flag" else f"`{_rounded(str(value))}`"


def _rounded(text: str) -> str:
    """Return a text with its long numbers, such as a third or 25 degrees in radians, rounded to six digits."""
    return re.sub(r"\d+\.\d{9,}", lambda found: f"{float(found[0]):.6g}", text)
