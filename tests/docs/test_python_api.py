"""The Python reference describes every public name, once, and each has a sentence to say."""

from __future__ import annotations

import inspect
import sys
from importlib import import_module
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
sys.path.insert(0, str(DOCS))

from python_api import PAGES, pages, public  # noqa: E402


@pytest.mark.parametrize("module", [module for page in PAGES.values() for module in page.modules])
def test_every_public_name_says_what_it_is(module: str) -> None:
    for name in public(module):
        thing = getattr(import_module(module), name)
        if not inspect.isclass(thing) and not inspect.isfunction(thing):
            continue  # numbers
        assert len(inspect.getdoc(thing) or "") > 10, f"{module}.{name}"
        for member, value in vars(thing).items() if inspect.isclass(thing) else ():
            code = value.fget if isinstance(value, property) else getattr(value, "__func__", value)
            if not member.startswith("_") and inspect.isfunction(code):
                assert inspect.getdoc(code), f"{module}.{name}.{member}"


def test_each_name_is_described_once() -> None:
    text = "\n".join(make() for make in pages().values())
    for page in PAGES.values():
        for module in page.modules:
            for name in public(module):
                described = text.count(f":: {module}.{name}\n")
                elsewhere = text.count(f".{name}`")
                assert described == 1 or (described == 0 and elsewhere), f"{module}.{name}"


def test_what_the_program_offers_is_in_the_reference() -> None:
    import itouch
    import itouch.plugin

    assert set(itouch.__all__) == set(public("itouch"))
    assert {"Device", "Twin", "Modality", "Channel", "Record"} <= set(public("itouch.plugin"))
    assert "quantity" in public("itouch.schema")
    assert "Falcon" in public("itouch_usb_arm")
    assert {"solve", "Stepper"} <= set(public("itouch_thermal"))


def test_what_a_device_writes_is_shown_before_what_has_a_default() -> None:
    from python_api import asked

    from itouch.plugin import Device, Twin

    assert asked(Device) == ["open", "close", "read", "write"]
    assert asked(Twin) == ["step", "read"]
    page = pages()["python-plugin.md"]()
    block = page.split(".. autoclass:: itouch.plugin.Device\n")[1].split("```")[0]
    assert ":exclude-members: open, close, read, write" in block  # or they would stand there twice
    shown = [line.split("::")[1].strip() for line in block.splitlines() if "automethod" in line]
    assert shown == [f"itouch.plugin.Device.{name}" for name in ("open", "close", "read", "write")]
