"""The reference of channels is made of what is declared: everything has a meaning, and a unit that recordings have."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
sys.path.insert(0, str(DOCS))

from channels import OWNERS, found, page  # noqa: E402

from itouch.plugin.declaration_rules import unit_fault  # noqa: E402
from itouch.plugin.discovery import Catalog  # noqa: E402


@pytest.fixture(scope="module")
def listed():
    """Return what the page lists; compiling the scenes that have it takes a while, so not while tests are collected."""
    return found()


def test_every_owner_has_a_table(listed) -> None:
    names, titles = listed
    assert set(OWNERS) < set(titles)
    assert {"heat", "flux-control"} <= set(titles)
    assert all(names[owner] for owner in titles)


def test_every_field_says_its_unit_and_what_it_is(listed) -> None:
    names, titles = listed
    wanting = [f"{owner}.{name}" for owner in titles for name, row in names[owner].items() if not row.meaning]
    assert not wanting, "say what it is by doc="
    units = {f"{owner}.{name}": row.unit for owner in titles for name, row in names[owner].items() if row.unit}
    assert not {name: unit for name, unit in units.items() if unit_fault(unit)}


def test_every_channel_of_the_installed_devices_says_its_unit_and_what_it_is() -> None:
    catalog = Catalog()
    for name in catalog.device_names:
        device = catalog.device(name)
        assert device is not None
        for channel in (*device.reads, *device.commands):
            assert channel.doc and not unit_fault(channel.unit), f"{name}: {channel.name}"


def test_the_page_shows_them(listed) -> None:
    text = page()
    assert "| `tracking` | 1 | m | distance of the plate from its command |" in text
    assert "| `pose` | 7 | m |" in text
    assert text.count("\n## ") == len(listed[1])
