"""The reference of channels says what every channel of a device means, and names no field that there is not."""

from __future__ import annotations

import sys
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"
sys.path.insert(0, str(DOCS))

from channels import MEANINGS, OWNERS, found, page  # noqa: E402

from itouch.plugin.discovery import Catalog  # noqa: E402
from itouch.recording.units import unit_of  # noqa: E402

NAMES = found()


def test_every_field_that_is_described_exists() -> None:
    assert set(NAMES) == set(OWNERS) == set(MEANINGS)
    for owner, fields in MEANINGS.items():
        assert not set(fields) - set(NAMES[owner]), owner


def test_every_channel_of_the_installed_devices_is_described() -> None:
    catalog = Catalog()
    for name in catalog.device_names:
        device = catalog.device(name)
        assert device is not None
        for channel in device.reads:
            assert channel.name in MEANINGS["DEV"], f"{name}: say in docs/channels.py what '{channel.name}' is"
        for channel in device.commands:
            assert f"command.{channel.name}" in MEANINGS["DEV"], f"{name}: say in docs/channels.py what it obeys"


def test_the_units_are_those_of_recordings() -> None:
    for owner, fields in MEANINGS.items():
        for field, (unit, meaning) in fields.items():
            assert meaning
            recorded = "" if field == "touch_off.point" else unit_of(field)
            assert not recorded or unit.startswith(recorded), f"{owner}.{field}"


def test_the_page_shows_them() -> None:
    text = page()
    assert "| `tracking` | 1 | m | distance of the plate from its command |" in text
    assert "| `pose` | 7 | m |" in text
    assert text.count("\n## ") == len(OWNERS)
