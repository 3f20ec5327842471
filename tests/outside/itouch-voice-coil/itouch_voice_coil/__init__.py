"""The plugin `voice-coil` of itouch-py."""

from itouch_voice_coil.device import VoiceCoil
from itouch_voice_coil.modality import VoiceCoilRender

__all__ = ["VoiceCoil", "VoiceCoilRender"]
