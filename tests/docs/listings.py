"""The listings of the documentation, and the scene into which a fragment of XML is put to be checked."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from itouch.plugin.discovery import Catalog

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
#: Pages that the program writes itself when the site is built: their listings are what it prints.
GENERATED = ("scene.md", "sweep-language.md", "command-line.md", "errors.md", "channels.md", "units.md")

#: Pages that another test follows from their first line to their last, and that test.
WALKED = {"docs/tutorials/plugin-in-a-day.md": "tests/scaffold/test_tutorial.py"}

_FENCE = re.compile(r"^(?P<indent> *)(?P<fence>`{3,}|:{3,})(?P<info>.*)$")


@dataclass(frozen=True, slots=True)
class Listing:
    """A fenced block: its page, line, the word behind the fence, its text, and the lines before it."""

    page: str
    line: int
    language: str
    text: str
    before: str

    @property
    def name(self) -> str:
        return f"{self.page}:{self.line}"


def pages() -> list[Path]:
    """Return the pages that people write."""
    found = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
    return [
        page for page in found
        if page.name not in GENERATED and not page.name.startswith("python")
        and not {"_build", "_generated", "reproduced"} & set(page.parts)
    ]  # fmt: skip


def listings() -> list[Listing]:
    """Return all fenced blocks of all pages."""
    return [listing for page in pages() for listing in _of(page)]


def _of(page: Path) -> Iterator[Listing]:
    lines = page.read_text(encoding="utf-8").splitlines()
    at = 0
    while at < len(lines):
        found = _FENCE.match(lines[at])
        if found is None:
            at += 1
            continue
        end = next(k for k in range(at + 1, len(lines)) if lines[k].strip() == found["fence"])
        text = "".join(f"{line.removeprefix(found['indent'])}\n" for line in lines[at + 1 : end])
        before = "\n".join(lines[max(0, at - 14) : at])
        yield Listing(page.relative_to(ROOT).as_posix(), at + 1, found["info"].strip(), text, before)
        at = end + 1


_NAMESPACES = {name: f"urn:itouch:plugin:{name}" for name in Catalog().plugin_names}
_DECLARED = " ".join(f'xmlns:{name}="{uri}"' for name, uri in _NAMESPACES.items())
#: What stands in a scene of its own accord, by the section and the name of the attribute that a fragment may take over.
_HOST = {
    "materials": {"wood": '<material name="wood"><contact stiffness="1 N/mm"/></material>'},
    "world": {},
    "devices": {
        "arm": '<device name="arm" plugin="usb-arm"/>',
        "left-arm": '<device name="left-arm" plugin="usb-arm"/>',
        "table": '<device name="table" plugin="xyz-table"/>',
        "peltier": '<device name="peltier" plugin="thermal"/>',
    },
    "interaction": {
        "finger": '<probe name="finger" radius="8 mm" pose-from="arm" surface-to="table"/>',
        "heat": '<thermal:heat probe="finger"/>',
    },
}  # fmt: skip
_SECTION = {
    "material": "materials", "device": "devices", "probe": "interaction", "operator": "interaction",
    **dict.fromkeys(("box", "sphere", "plane", "capsule", "cylinder", "mesh"), "world"),
}  # fmt: skip
_TOP = {"include", "record", "fault", "safety", "rates", "world", "materials", "devices", "interaction", "defaults"}


def scene_around(text: str) -> str:
    """Return the scene document that a fragment of XML is part of; a whole document is returned as it is."""
    if re.match(r"\s*(<\?xml|<!--|<itouch)", text):
        return text
    parts = [(element, _tag(element)) for element in ElementTree.fromstring(f"<x {_DECLARED}>{text}</x>")]
    host: dict[str, dict[str, str]] = {section: dict(known) for section, known in _HOST.items()}
    top: list[str] = []
    for (element, tag), written in zip(parts, _pieces(text, len(parts)), strict=True):
        if tag in ("materials", "devices", "interaction", "world"):
            inside = _pieces(written.partition(">")[2].rpartition("</")[0], len(element))
            host[tag] |= {_key(inner, _tag(inner)): text for inner, text in zip(element, inside, strict=True)}
        elif tag in _TOP:
            top.append(written)
            for section, file in (("devices", 'file="rigs/'), ("materials", 'file="materials.xml"')):
                if file in written:
                    host[section] = {}
        elif tag.endswith(":hardware"):
            host["devices"] = {**host["devices"], "": f'<device name="one" plugin="{tag[:-9]}">{written}</device>'}
        else:
            host[_SECTION.get(tag, "interaction")][_key(element, tag)] = written
    body = "\n".join(f"<{section}>\n{chr(10).join(inside.values())}\n</{section}>" for section, inside in host.items())
    return f'<itouch version="1.0" {_DECLARED}>\n{body}\n{chr(10).join(top)}\n</itouch>\n'


def _tag(element: ElementTree.Element) -> str:
    uri, _, local = element.tag.rpartition("}")
    prefix = next((name for name, known in _NAMESPACES.items() if "{" + known == uri), "")
    return f"{prefix}:{local}" if prefix else local


def _key(element: ElementTree.Element, tag: str) -> str:
    return element.get("name") or tag.rpartition(":")[2]


def _pieces(text: str, count: int) -> list[str]:
    """Return the text of each outermost element."""
    found, depth, start = [], 0, 0
    for match in re.finditer(
        r"<!--.*?-->|<(?P<end>/)?[\w:-]+(?:\s+[\w:-]+\s*=\s*\"[^\"]*\")*\s*(?P<empty>/)?>", text, re.S
    ):
        if match[0].startswith("<!--"):
            continue
        if match["end"]:
            depth -= 1
        else:
            start = match.start() if depth == 0 else start
            depth += not match["empty"]
        if depth == 0:
            found.append(text[start : match.end()])
    if len(found) != count:
        raise ValueError(f"{len(found)} pieces of {count} in\n{text}")
    return found
