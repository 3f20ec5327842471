"""The sound of a session: taps, sliding and a warning tone, from published State alone.

``Synth`` turns States into samples; ``write_wav`` writes them to a file, ``itouch_tools.sound.player`` plays them.
"""

from itouch_tools.sound.modal import ModeBank
from itouch_tools.sound.synth import Synth
from itouch_tools.sound.wav import SoundTrack, write_wav

__all__ = ["ModeBank", "SoundTrack", "Synth", "write_wav"]
