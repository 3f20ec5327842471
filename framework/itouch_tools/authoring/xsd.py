"""The scene language as XML Schema 1.0, for editors: completion, hover texts, first checks while typing.

The loader checks more, and explains it better.  What XML Schema can't express (units, the order of rules) is left open,
so that every scene which the loader accepts is valid.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any
from xml.sax.saxutils import escape, quoteattr

from itouch.scene import elements
from itouch.scene.documents import SECTIONS
from itouch.scene.extensions import Extensions
from itouch.scene.loader import DEFAULTABLE
from itouch.schema.fields import PLUGIN_NAMESPACE, REQUIRED, Spec, default_of, specs, tag_of, xml_name
from itouch.schema.hold_until import SKIN, WORD
from itouch.schema.quantities import describe, format_quantity

_ROOTS: dict[str, type] = {
    "include": elements.Include,
    "materials": elements.Materials,
    "world": elements.WorldElement,
    "devices": elements.Devices,
    "interaction": elements.Interaction,
    "rates": elements.Rates,
    "safety": elements.Safety,
    "fault": elements.Fault,
    "record": elements.RecordElement,
}
#: The classes of elements in which plugins may put elements of their own, and their names as hosts.
_HOSTS: dict[type, str] = {
    elements.DeviceElement: "device",
    elements.Material: "material",
    elements.Interaction: "interaction",
}
_HEAD = '<?xml version="1.0" encoding="utf-8"?>'


def schemas(extensions: Extensions) -> dict[str, str]:
    """Return the schemas by file name: ``itouch.xsd``, and one for each plugin, which the former imports."""
    plugins = [p for p in extensions.plugin_names if any(_offers(extensions, p, host) for host in _HOSTS.values())]
    found = {"itouch.xsd": _main(extensions, plugins)}
    for plugin in plugins:
        found[f"{plugin}.xsd"] = _plugin(extensions, plugin)
    return found


def standalone(cls: type) -> str:
    """Return the schema of another language, such as that of sweeps, given the class of its outermost element."""
    lines = [_HEAD, '<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema" elementFormDefault="qualified">']
    lines += _Writer({}).element(tag_of(cls), cls, 2)
    return "\n".join([*lines, "</xs:schema>", ""])


def _offers(extensions: Extensions, plugin: str, host: str) -> list[tuple[str, type]]:
    listed = ((local, extensions.element_class(plugin, host, local)) for local in extensions.locals(plugin, host))
    return [(local, cls) for local, cls in listed if cls is not None]


def _main(extensions: Extensions, plugins: Sequence[str]) -> str:
    spaces = "".join(f' xmlns:{plugin}="{PLUGIN_NAMESPACE}{plugin}"' for plugin in plugins)
    lines = [_HEAD, f'<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema"{spaces} elementFormDefault="qualified">']
    lines += [f'  <xs:import namespace="{PLUGIN_NAMESPACE}{p}" schemaLocation="{p}.xsd"/>' for p in plugins]
    guests = {
        host: [f"{plugin}:{local}" for plugin in plugins for local, _ in _offers(extensions, plugin, host)]
        for host in _HOSTS.values()
    }
    writer = _Writer(guests)
    lines += writer.root()
    return "\n".join([*lines, "</xs:schema>", ""])


def _plugin(extensions: Extensions, plugin: str) -> str:
    space = f"{PLUGIN_NAMESPACE}{plugin}"
    lines = [
        _HEAD,
        f'<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema" targetNamespace="{space}" '
        'elementFormDefault="qualified" attributeFormDefault="unqualified">',
    ]
    writer, seen = _Writer({}), set()
    for host in _HOSTS.values():
        for local, cls in _offers(extensions, plugin, host):
            if local in seen:
                continue
            seen.add(local)
            more = [_attribute("name", Spec("name", "its name; default: the element's"), None, 6)]
            own = more if host == "interaction" else []
            lines += writer.element(local, cls, 2, own, whole=host != "material")
    return "\n".join([*lines, "</xs:schema>", ""])


class _Writer:
    """Writes the declarations of elements and of what may stand inside; ``guests`` are plugins' elements by host."""

    def __init__(self, guests: dict[str, list[str]]) -> None:
        self._guests = guests

    def root(self) -> Iterator[str]:
        """Yield ``<itouch>`` with its sections."""
        yield '  <xs:element name="itouch">'
        yield "    " + _documented("A scene: what is touched, with what, and how it feels.")
        yield "    <xs:complexType>"
        yield '      <xs:choice minOccurs="0" maxOccurs="unbounded">'
        for tag in SECTIONS:
            if tag == "defaults":
                yield from _defaults()
            elif tag in _ROOTS:
                yield from self.element(tag, _ROOTS[tag], 8)
        yield "      </xs:choice>"
        yield '      <xs:attribute name="version" type="xs:string" use="required"/>'
        yield "    </xs:complexType>"
        yield "  </xs:element>"

    def element(
        self, tag: str, cls: type, indent: int, more: Sequence[str] = (), *, whole: bool = True
    ) -> Iterator[str]:
        """Yield the declaration of an element, ``whole`` unless a base or ``<defaults>`` may supply its attributes."""
        pad = " " * indent
        inherits, whole = whole and cls is not elements.Material, whole and cls not in DEFAULTABLE.values()
        yield f'{pad}<xs:element name="{tag}">'
        yield f"{pad}  {_documented((cls.__doc__ or '').strip().splitlines()[0])}"
        yield f"{pad}  <xs:complexType>"
        inner = list(self._inside(cls, indent + 6, whole=inherits))
        if inner:
            yield f'{pad}    <xs:choice minOccurs="0" maxOccurs="unbounded">'
            yield from inner
            yield f"{pad}    </xs:choice>"
        for name, spec in specs(cls).items():
            if spec.kind not in ("child", "children", "plugin"):
                must = whole or spec.kind == "name"
                yield _attribute(xml_name(name), spec, default_of(cls, name), indent + 4, must=must)
        yield from more
        if hasattr(cls, "OPEN"):
            yield f'{pad}    <xs:anyAttribute processContents="skip"/>'
        yield f"{pad}  </xs:complexType>"
        yield f"{pad}</xs:element>"

    def _inside(self, cls: type, indent: int, *, whole: bool) -> Iterator[str]:
        for spec in specs(cls).values():
            for child in spec.elements:
                yield from self.element(tag_of(child, spec), child, indent, whole=whole)
        for name in self._guests.get(_HOSTS.get(cls, ""), ()):
            yield f'{" " * indent}<xs:element ref="{name}"/>'


def _defaults() -> Iterator[str]:
    yield '        <xs:element name="defaults">'
    yield "          " + _documented("Attributes that hold for the elements of a tag, here and in what includes this.")
    yield "          <xs:complexType>"
    yield '            <xs:sequence><xs:any minOccurs="0" maxOccurs="unbounded" processContents="skip"/></xs:sequence>'
    yield "          </xs:complexType>"
    yield "        </xs:element>"


def _attribute(name: str, spec: Spec, default: Any, indent: int, *, must: bool = False) -> str:
    pad = " " * indent
    use = ' use="required"' if must and default is REQUIRED else ""
    words = _words(spec, default)
    kind = _type(spec, indent + 2)
    return f"{pad}<xs:attribute name={quoteattr(name)}{use}>\n{pad}  {_documented(words)}\n{kind}\n{pad}</xs:attribute>"


def _words(spec: Spec, default: Any) -> str:
    parts = [spec.doc] if spec.doc else []
    if spec.kind == "quantity":
        limits = spec.range_text()
        parts.append(describe(spec.unit, spec.size, spec.absolute) + (f", {limits}" if limits else ""))
    elif spec.kind == "hold":
        parts.append(f"{describe(spec.unit)}, {spec.range_text()}, or '{WORD} {SKIN}' and a difference in K")
    elif spec.kind == "integer":
        parts.append(f"whole number, {spec.range_text()}" if spec.range_text() else "whole number")
    elif spec.kind == "ref":
        parts.append(f"name of a {spec.target}")
    if default is REQUIRED:
        parts.append("required")
    elif default not in (None, ""):
        shown = format_quantity(default, spec.unit) if spec.kind in ("quantity", "hold") else _plain(default)
        parts.append(f"default: {shown}")
    return "; ".join(parts)


def _plain(value: Any) -> str:
    return ("yes" if value else "no") if isinstance(value, bool) else str(value)


def _type(spec: Spec, indent: int) -> str:
    pad = " " * indent
    if spec.kind in ("choice", "flag"):
        also = getattr(spec, "values", ())
        words = [*(("yes", "no") if spec.kind == "flag" else ()), *also]
        inner = "".join(f"<xs:enumeration value={quoteattr(word)}/>" for word in dict.fromkeys(words))
        return f'{pad}<xs:simpleType><xs:restriction base="xs:token">{inner}</xs:restriction></xs:simpleType>'
    if spec.kind == "integer":
        return f'{pad}<xs:simpleType><xs:restriction base="xs:integer"/></xs:simpleType>'
    if spec.kind in ("quantity", "hold"):
        pattern = r"\s*[-+.0-9](.|\s)*" + (rf"|\s*{WORD}\s+{SKIN}\s+[-+.0-9](.|\s)*" if spec.kind == "hold" else "")
        return (
            f'{pad}<xs:simpleType><xs:restriction base="xs:string">'
            f'<xs:pattern value="{pattern}"/></xs:restriction></xs:simpleType>'
        )
    return f'{pad}<xs:simpleType><xs:restriction base="xs:string"/></xs:simpleType>'


def _documented(words: str) -> str:
    return f"<xs:annotation><xs:documentation>{escape(words)}</xs:documentation></xs:annotation>"
