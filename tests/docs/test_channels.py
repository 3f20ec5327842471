"""The reference of channels is made of what is declared: everything has a meaning, and a unit that recordings have."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
sys.path.insert(0, str(DOCS))

from channels import OWNERS, found, page  # noqa: E402

from itouch.plugin.declared import unit_fault  # noqa: E402
from itouch.plugin.discovery import Catalog  # noqa: E402

NAMES, TITLES = found()


def test_every_owner_has_a_table() -> None:
    assert set(OWNERS) < set(TITLES)
    assert {"heat", "flux-control"} <= set(TITLES)
    assert all(NAMES[owner] for owner in TITLES)


@pytest.mark.parametrize("owner", TITLES)
def test_every_field_says_its_unit_and_what_it_is(owner: str) -> None:
    for name, row in NAMES[owner].items():
        assert row.meaning, f"{owner}.{name}: say what it is by doc="
        assert not row.unit or not unit_fault(row.unit), f"{owner}.{name}: {row.unit}"


def test_every_channel_of_the_installed_devices_says_its_unit_and_what_it_is() -> None:
    catalog = Catalog()
    for name in catalog.device_names:
        device = catalog.device(name)
        assert device is not None
        for channel in (*device.reads, *device.commands):
            assert channel.doc and not unit_fault(channel.unit), f"{name}: {channel.name}"


def test_the_page_shows_them() -> None:
    text = page()
    assert "| `tracking` | 1 | m | distance of the plate from its command |" in text
    assert "| `pose` | 7 | m |" in text
    assert text.count("\n## ") == len(TITLES)
