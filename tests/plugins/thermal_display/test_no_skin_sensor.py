"""A display with which nobody looks at the skin begins a touch as if somebody did: the computed finger remembers."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from display_scenes import start_of

from itouch_thermal.drivers.virtual import VirtualLine
from itouch_thermal.flux.flux_model import FluxModel
from itouch_tools.cli.lockstep import Lockstep

#: A touch of aluminium that cools the skin by two kelvins, and the way to foam.
MOTION = """<motion>
    <to pos="-33 0 40 mm" in="0.5 s" hold="1 s"/>
    <to pos="-33 0 16 mm" in="0.5 s" hold="1.5 s"/>
    <to pos="-33 0 40 mm" in="0.5 s"/>
    <to pos="33 0 48 mm" in="0.8 s" hold="0.4 s"/>
</motion>"""


def scene_of(scenes: Path) -> Path:
    """Return the wire scene with that motion and without touch-off and thermometer."""
    rig = scenes / "rigs" / "wire.xml"
    text = rig.read_text().replace('<calibration method="touch-off"/>', "").replace(' mount-error="2 -1.5 3 mm"', "")
    rig.write_text(re.sub(r"<thermal:infrared[^>]*/>", "", text))
    path = scenes / "four_materials_wire.xml"
    text = path.read_text()
    begin, end = text.index("<motion>"), text.index("</motion>") + len("</motion>")
    path.write_text(text[:begin] + MOTION + text[end:])
    return path


def own_rig(scenes: Path, patch: pytest.MonkeyPatch) -> None:
    """Put a rig of one's own without a thermometer for the skin in place of controller and LabJack."""
    rig = scenes / "rigs" / "wire.xml"
    line = '<thermal:line port="/tmp/itouch-own"/>'
    rig.write_text(re.sub(r"<thermal:mecom.*</thermal:labjack>", line, rig.read_text(), flags=re.DOTALL))
    answer = VirtualLine._answer

    def blind(self: VirtualLine, body: str, now: float) -> str:
        words = answer(self, body, now).split()
        return " ".join([*words[:4], "nan", *words[5:]] if words[0] == "R" else words)

    patch.setattr(VirtualLine, "_answer", blind)


@pytest.mark.parametrize("own", [False, True])
def test_the_start_is_that_of_the_skin_as_it_is_and_not_of_one_at_rest(
    scenes: Path, monkeypatch: pytest.MonkeyPatch, own: bool
) -> None:
    path = scene_of(scenes)
    if own:
        own_rig(scenes, monkeypatch)
    both = Lockstep(str(path), only=["peltier"])
    report = both.run()
    assert report["faults"] == []
    assert [contact["object"] for contact in report["contacts"]] == ["aluminium"]
    (model,) = [one.model for one in both.host.model.modalities if isinstance(one.model, FluxModel)]
    state, skin = both.host.state, both.world.state["peltier.twin.true_skin"].item()
    assert state["peltier.skin_valid"].item() == 0.0
    index = model.objects.index("polystyrene")
    assert state["flux-control.approached"].item() == index
    assert skin < model.skin - 0.7
    ready, wanted = state["flux-control.start_temperature"].item(), start_of(model, index, skin)
    assert ready == pytest.approx(wanted, abs=0.15)
    assert abs(ready - model.starts[index][1]) > 0.5  # type: ignore[index]


@pytest.mark.parametrize("phase", [0.0, 0.019])
@pytest.mark.parametrize("seed", [1, 2])
def test_over_a_wire_infrared_brings_the_finger_to_its_true_temperature(scenes: Path, phase: float, seed: int) -> None:
    """Of a tenth of a second over a slow wire come five noisy readings: 0.02 K, which are 10 W/m2 of a foam's 100."""
    path = scene_of(scenes)
    rig = scenes / "rigs" / "wire.xml"
    thermometer = '<thermal:infrared channel="2" slope="20 K/V" zero="0 degC"/>'
    rig.write_text(rig.read_text().replace("</thermal:labjack>", f"{thermometer}</thermal:labjack>"))
    both, apart = Lockstep(str(path), only=["peltier"], phase=phase, seed=seed), list[float]()
    state, twin = both.host.state, both.world.state

    def note(tick: int) -> None:
        if 1000 < state["heat.skin_count"].item() == tick + 1:  # before the first touch, and while it is seen
            seen = state["heat.skin_temperature"].item() + state["heat.skin_change"].item()
            apart.append(seen - twin["peltier.twin.true_skin"].item())

    both.host.taps.append(note)
    assert both.run(2.0)["faults"] == []
    assert len(apart) > 500
    assert max(map(abs, apart)) < 0.02
