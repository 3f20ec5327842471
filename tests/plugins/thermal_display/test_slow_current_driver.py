"""A scene whose module's driver changes its current slowly, as a user writes it, and one that is not as it is written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
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


def test_a_very_slow_driver_does_not_swing_in_a_touch(scenes: Path) -> None:
    """It needs longer to bring its current back than the controller plans ahead."""
    given = {"servo": "4 kHz", "wait": "1.5 s", "near": "1.5 s", "hold": "1.5 s"}
    session = itouch.build(Display(hardware='<thermal:hardware slew="5 A/s"/>', **given).write(scenes))
    session.run(until=lambda: bool(session.state["flux-control.on_plate"]))
    found = []
    session.run(1.4, each=lambda: found.append(float(session.state["peltier.command.current"][0])), every=40)
    most = int(np.argmax(found))
    assert found[most] > 1.0, "the driver was never hurried, so nothing was shown"
    assert min(found[most:]) > 0.0


def test_a_very_slow_driver_renders_what_it_can(scenes: Path) -> None:
    hardware = '<thermal:hardware slew="1 A/s"/>'
    session = itouch.build(Display(hardware=hardware, wait="2.5 s", near="2.5 s", hold="1.5 s").write(scenes))
    session.run()
    found = {contact["object"]: contact["flux_error_rms"] for contact in session.report()["contacts"]}
    assert found["left"] < 0.09 and found["right"] < 0.125, found
