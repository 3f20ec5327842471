"""The Python reference: a page for each group of modules, with every public name, its signature and its docstring."""

from __future__ import annotations

import inspect
import types
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib import import_module

from itouch.plugin import Device


@dataclass(frozen=True, slots=True)
class Page:
    """A page of the reference: its title, what it is for, and the modules whose public names it holds."""

    title: str
    purpose: str
    modules: tuple[str, ...]


PAGES = {
    "python.md": Page(
        "Python: sessions", "Build, run, save, restore, record and read sessions.", ("itouch", "itouch.servo")
    ),
    "python-plugin.md": Page(
        "Python: plugins",
        "All that a plugin may import; the scene language is made of the fields of `itouch.plugin.schema`.",
        ("itouch.plugin", "itouch.plugin.geometry", "itouch.plugin.poses", "itouch.schema"),
    ),
    "python-testing.md": Page(
        "Python: testing plugins",
        "The conformance suite; `itouch-py test-plugin NAME` runs it too.",
        ("itouch.testing",),
    ),
    "python-contact.md": Page(
        "Python: contact",
        "Surfaces and probes without a scene; [a guide with figures](contact-api.md).",
        ("itouch.contact", "itouch.contact.meshfile"),
    ),
    "python-thermal.md": Page(
        "Python: heat",
        "The contact-heat solver and the thermal display; [a guide](thermal-solver.md).",
        ("itouch_thermal", "contact_heat.resistance", "contact_heat.analytic",
         "contact_heat.energy"),
    ),
    "python-devices.md": Page(
        "Python: devices", "The drivers of the bundled devices, and what brings a surface.",
        ("itouch_usb_arm", "itouch_xyz_table", "itouch_encountered"),
    ),
}  # fmt: skip


def pages() -> dict[str, Callable[[], str]]:
    """Return what makes each page."""
    return {name: partial(_text, page) for name, page in PAGES.items()}


def public(module: str) -> list[str]:
    """Return the public names of a module that are no modules themselves, in alphabetical order."""
    home = import_module(module)
    listed = getattr(home, "__all__", None) or [
        name for name, thing in vars(home).items()
        if not name.startswith("_") and getattr(thing, "__module__", "") == module
    ]  # fmt: skip
    return sorted((name for name in listed if not isinstance(getattr(home, name), types.ModuleType)), key=str.lower)


def asked(home: type) -> list[str]:
    """Return the methods that whoever derives from a class of a plugin's contract writes, in the order of the source.

    They are shown before all that has a default: what is abstract, and of a device `write`, too, which one that only
    measures leaves out.
    """
    wanted = set(getattr(home, "__abstractmethods__", ()))
    if home is Device:
        wanted.add("write")
    return [name for name in vars(home) if name in wanted]


def _homes() -> dict[int, str]:
    """Return where each class and function is described: the first module that offers it."""
    found: dict[int, str] = {}
    for page in PAGES.values():
        for module in page.modules:
            for name in public(module):
                found.setdefault(id(getattr(import_module(module), name)), module)
    return found


def _text(page: Page) -> str:
    return "\n".join(_lines(page)) + "\n"


def _lines(page: Page) -> Iterator[str]:
    homes = _homes()
    yield f"# {page.title}\n\n{page.purpose} Generated from the source.\n"
    for module in page.modules:
        about = (inspect.getdoc(import_module(module)) or "").split("\n\n")[0].replace("``", "`")
        yield f"## {module}\n\n{' '.join(about.split())}\n"
        elsewhere = []
        for name in public(module):
            thing = getattr(import_module(module), name)
            if homes[id(thing)] != module:
                elsewhere.append(f"{{py:obj}}`~{homes[id(thing)]}.{name}`")
                continue
            yield f"### {name}\n\n```{{eval-rst}}\n{_directive(f'{module}.{name}', thing)}\n```\n"
        if elsewhere:
            yield f"Also here: {', '.join(elsewhere)}.\n"


def _directive(path: str, thing: object) -> str:
    if inspect.isclass(thing):
        first = asked(thing)
        lines = [f".. autoclass:: {path}", "   :members:", "   :undoc-members:", "   :show-inheritance:",
                 "   :member-order: bysource"]  # fmt: skip
        if first:
            lines += [f"   :exclude-members: {', '.join(first)}", ""]
            lines += [f"   .. automethod:: {path}.{name}" for name in first]
        return "\n".join(lines)
    return f".. autofunction:: {path}" if callable(thing) else f".. autodata:: {path}"
