"""The shipped scene of the display's features: driven by temperatures at 50 Hz, a plant that differs, equal approaches."""

from __future__ import annotations

from pathlib import Path

import itouch


def test_the_scene_of_the_display(scenes: Path) -> None:
    engine = itouch.build(scenes / "thermal_display.xml", seed=1)
    engine.run()
    report = engine.report()
    assert [entry["material"] for entry in report["contacts"]] == ["wood", "polystyrene", "aluminium"]
    assert all(entry["plate_ready"] for entry in report["contacts"])
    assert all(entry["flux_error_rms"] < 0.1 for entry in report["contacts"])
    fluxes = {entry["material"]: entry["mean_flux_W_m2"] for entry in report["contacts"]}
    assert fluxes["aluminium"] > 1.5 * fluxes["wood"] > 4.0 * fluxes["polystyrene"]
    told = report["modalities"]["flux-control"]
    assert told["command"] == "temperature"
    assert told["preset_s"] > 0.8
    assert told["contacts_before_ready"] == 0
    assert len(told["switching"]) == 6
    assert report["faults"] == []


def test_more_force_than_expected_is_followed_too(scenes: Path) -> None:
    """The finger presses twice as hard as the scene expects: the resistance is below what was planned with."""
    path = scenes / "thermal_display.xml"
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace('expected-force="0.9 N"', 'expected-force="0.4 N"'), encoding="utf-8")
    engine = itouch.build(path, seed=2, rig=scenes / "rigs" / "twin.xml")
    while int(engine.state["finger.contact.object"]) < 0:
        engine.tick()
    engine.run(2.5)
    (entry,) = engine.report()["contacts"]
    assert entry["flux_error_rms"] < 0.06
    assert abs(engine.state["flux-control.theta"]).max() < 100.0
