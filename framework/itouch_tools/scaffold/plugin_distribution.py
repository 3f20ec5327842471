"""A complete distribution for a new plugin, unfinished only where its author must decide."""

from __future__ import annotations

import keyword
import os
from importlib.metadata import version
from importlib.util import find_spec

from itouch import plugin
from itouch.plugin.discovery import Catalog
from itouch.schema import ItouchError
from itouch_tools.scaffold.files import check_name, fill, write

KINDS = ("device", "modality", "both")
TRANSPORTS = ("serial", "usb", "tcp", "none")
#: Names that the templates' modules use for something else.
_TAKEN = frozenset(
    {*plugin.__all__, "Line", "Path", "SimpleNamespace", "DeviceTests", "EmulatorTests", "ModalityTests"}
)


def make_plugin(name: str, *, kind: str = "device", transport: str = "none", folder: str = ".") -> list[str]:
    """Write ``itouch-NAME`` into a folder and return the paths of its files.

    Parameters
    ----------
    name
        Name of the plugin in XML: small letters, digits, dashes.
    kind
        ``device``, ``modality`` or ``both``.
    transport
        How its device is connected: ``serial``, ``usb``, ``tcp`` or ``none``.

    Raises
    ------
    ItouchError
        If the name is not valid, or the folder exists already.
    """
    words = _words(check_plugin_name(name), kind, transport)
    package = words["package"]
    contents = {
        "pyproject.toml": fill("pyproject.toml.in", words),
        "README.md": _readme(words, kind, transport),
        ".github/workflows/tests.yml": fill("tests.yml.in", words),
        ".gitignore": "__pycache__/\n*.egg-info/\n.venv/\n.pytest_cache/\n",
        f"{package}/__init__.py": _init(words, kind),
        "tests/test_steps.py": fill("test_steps.py.in", words),
    }
    if kind != "modality":
        contents["tests/test_device.py"] = fill("test_device.py.in", words)
        contents[f"{package}/device.py"] = fill(f"device_{_wire(transport)}.py.in", words)
        contents[f"scenes/{name}.xml"] = fill("device.xml.in", words)
        if transport != "none":
            contents[f"{package}/line.py"] = fill(f"line_{transport}.py.in", words)
        if transport in ("serial", "tcp"):
            contents[f"{package}/emulator.py"] = fill(f"emulator_{transport}.py.in", words)
            contents["tests/test_emulator.py"] = fill(f"test_emulator_{transport}.py.in", words)
    if kind != "device":
        contents[f"{package}/modality.py"] = fill("modality.py.in", words)
        contents[f"scenes/{name}-render.xml"] = fill("modality.xml.in", words)
        contents["tests/test_modality.py"] = fill("test_modality.py.in", words)
    return write(os.path.join(folder, f"itouch-{name}"), contents)


def check_plugin_name(name: str) -> str:
    """Return the name if it is valid for a new plugin.

    Raises
    ------
    ItouchError
        If it is not, or if an installed plugin or package has it.
    """
    check_name(name)
    if name.startswith("xml") or name == "py":
        reason = "names that begin with xml belong to XML" if name != "py" else "itouch-py is the framework itself"
        raise ItouchError(f"'{name}' can't be the name: {reason}; take another, such as force-lever")
    catalog = Catalog()
    package = f"itouch_{name.replace('-', '_')}"
    if name in catalog.plugin_names:
        raise ItouchError(f"there is a plugin '{name}' already (version {catalog.version(name)}): take another name")
    if find_spec(package) is not None:
        raise ItouchError(f"there is a Python package '{package}' already: take another name")
    return name


def _title(name: str) -> str:
    """Return the name of the class, with ``Plugin`` added if Python or the templates use it for something else."""
    title = "".join(part.capitalize() for part in name.split("-"))
    return f"{title}Plugin" if keyword.iskeyword(title) or title in _TAKEN else title


def _wire(transport: str) -> str:
    return "plain" if transport == "none" else "wire"


def _words(name: str, kind: str, transport: str) -> dict[str, str]:
    title = _title(name)
    needs = {"serial": '"serialx>=1.15,<2"', "usb": '"pyusb>=1.3,<2"'}
    own = needs.get(transport, "") if kind != "modality" else ""
    entries = []
    if kind != "modality":
        entries += [
            '[project.entry-points."itouch.devices"]',
            f'{name} = "itouch_{name.replace("-", "_")}:{title}"',
            "",
        ]
    if kind != "device":
        entries += [
            '[project.entry-points."itouch.modalities"]',
            f'"{name}.render" = "itouch_{name.replace("-", "_")}:{title}Render"',
            "",
        ]
    emulated, package = transport in ("serial", "tcp"), f"itouch_{name.replace('-', '_')}"
    return {
        "name": name, "package": f"itouch_{name.replace('-', '_')}", "Name": title, "version": version("itouch-py"),
        "needs": ", ".join(part for part in (f'"itouch-py>={_base()}"', own) if part), "entries": "\n".join(entries),
        "address": {"serial": "/dev/ttyUSB0", "usb": "1234:5678", "tcp": "192.168.0.10:4001"}.get(transport, ""),
        "address_doc": {"serial": "serial port", "usb": "vendor:product", "tcp": "host:port"}.get(transport, ""),
        "emulator_import": f"from {package}.emulator import {title}Emulator\n" if emulated else "",
        "emulator_line": f"    emulation = Emulation(Emulator={title}Emulator)\n" if emulated else "",
        "emulation": "Emulation, " if emulated else "",
        "transport": transport, **_modality_steps(kind, transport),
    }  # fmt: skip


def _modality_steps(kind: str, transport: str) -> dict[str, str]:
    """Return the numbers of the modality's steps, which follow those of the device if there is one."""
    device = {"none": 4, "usb": 6}.get(transport, 7) if kind == "both" else 0
    return {f"step{number}": str(device + number) for number in (1, 2, 3)}


def _base() -> str:
    major, minor, *_ = version("itouch-py").split(".")
    return f"{major}.{minor}"


def _init(words: dict[str, str], kind: str) -> str:
    names = {"device": ("device",), "modality": ("modality",), "both": ("device", "modality")}[kind]
    classes = {"device": words["Name"], "modality": f"{words['Name']}Render"}
    lines = [f'"""The plugin `{words["name"]}` of itouch-py."""', ""]
    lines += [f"from {words['package']}.{part} import {classes[part]}" for part in names]
    listed = ", ".join(f'"{classes[part]}"' for part in names)
    return "\n".join([*lines, "", f"__all__ = [{listed}]", ""])


def _readme(words: dict[str, str], kind: str, transport: str) -> str:
    parts = [fill("README.md.in", words)]
    if kind != "modality":
        parts.append(fill(f"steps_device_{_wire(transport)}.md.in", words))
        if transport != "none":
            parts.append(fill(f"steps_emulator_{transport}.md.in", words))
    if kind != "device":
        parts.append(fill("steps_modality.md.in", words))
    return "\n".join(parts)
