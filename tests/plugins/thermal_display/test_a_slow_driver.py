"""A scene whose module's driver changes its current slowly, as a user writes it, and one that is not as it is written."""

from __future__ import annotations

from pathlib import Path

import pytest

import itouch

from display_scenes import Display  # isort: skip


@pytest.mark.parametrize(
    ("slew", "off", "most"),
    [
        ("200 A/s", 0.0, 0.01),
        ("20 A/s", 0.0, 0.08),
        ("50 A/s", 3.0, 0.01),
        ("100 A/s", 0.5, 0.01),
        ("100 A/s", -0.2, 0.03),
    ],
)
def test_a_slow_driver_renders_the_flux(scenes: Path, slew: str, off: float, most: float) -> None:
    """Also where it is faster than the scene says by any amount, or a fifth slower."""
    hardware = f'<thermal:hardware slew="{slew}"><thermal:mismatch slew="{off}"/></thermal:hardware>'
    session = itouch.build(Display(hardware=hardware, wait="3 s", near="3 s", hold="2 s").write(scenes))
    session.run()
    found = {contact["object"]: contact["flux_error_rms"] for contact in session.report()["contacts"]}
    assert len(found) == 2
    assert max(found.values()) < most, found


@pytest.mark.parametrize(("slew", "resistance", "most"), [("100 A/s", "6 ohm", 0.01), ("20 A/s", "12 ohm", 0.04)])
def test_a_module_of_high_resistance_heats_as_fast_as_its_driver_can(
    scenes: Path, slew: str, resistance: str, most: float
) -> None:
    """What its current costs helps to heat: it is not to be held back as where it cools."""
    hardware = f'<thermal:hardware slew="{slew}" resistance="{resistance}"/>'
    session = itouch.build(Display(hardware=hardware, wait="2.5 s", near="2.5 s", hold="1.5 s").write(scenes))
    session.run()
    found = {contact["object"]: contact["flux_error_rms"] for contact in session.report()["contacts"]}
    assert found["right"] < most, found
