"""The conformance suite of itouch-py on the device, and a touch on its twin."""

from pathlib import Path

import itouch
from itouch.testing import DeviceTests

from itouch_voice_coil import VoiceCoil

SCENE = Path(__file__).parents[1] / "scenes" / "voice-coil.xml"


def test_the_coil_shakes_as_the_ridges_would():
    """Sliding at 80 mm/s or so over ridges of 2 mm and 60 um, the mass is accelerated by height times (2 pi f)^2."""
    with itouch.build(SCENE) as session:
        session.run(1.8)
        state, greatest, asked = session.state, 0.0, []
        for _ in range(100):
            session.tick()
            greatest = max(greatest, abs(float(state["coil.acceleration"][0])))
            asked.append(float(state["render.acceleration"]))
        wanted = sorted(asked)[50]
        assert 3.0 < wanted < 5.0
        assert abs(greatest - wanted) < 0.1 * wanted
        session.run()
        fine, coarse, smooth = session.report()["contacts"]
    assert fine["vibration_m_s2"] > 1.0 and coarse["vibration_m_s2"] > 1.0
    assert smooth["vibration_m_s2"] == 0.0


class TestVoiceCoil(DeviceTests):
    device, name = VoiceCoil, "voice-coil"
