"""The conformance suite of itouch-py on the modality."""

from pathlib import Path

from itouch.testing import ModalityTests

from itouch_voice_coil import VoiceCoilRender

SCENES = Path(__file__).parents[1] / "scenes"


class TestVoiceCoilRender(ModalityTests):
    modality, scene = VoiceCoilRender, SCENES / "voice-coil.xml"
