"""The conformance suite of itouch-py on the driver, over the emulator's port."""

import pytest
from itouch.testing import EmulatorTests

from itouch_voice_coil import VoiceCoil


class TestVoiceCoilOnItsEmulator(EmulatorTests):
    device, name = VoiceCoil, "voice-coil"

    @pytest.fixture(autouse=True)
    def _port(self, tmp_path):
        type(self).params = VoiceCoil.Params(port=str(tmp_path / "port"))
