"""Before each script: a window that plays the recording, whose time the script turns."""

import sys

from driven_window import Driven, changed  # noqa: F401 - for the scripts

import itouch
from itouch_tools.viewer.played_session import Playback
from itouch_tools.viewer.player_window import Player
from itouch_tools.viewer.recording_seek import SeekableRecording

clock = [0.0]
reel = SeekableRecording(itouch.read(sys.argv[2]))
playback = Playback(reel)
window = Player(playback, lambda: clock[0], width=640, height=360)
line, state = playback.line, playback.state


driven = Driven(window, clock)
tell, press, pixels = driven.tell, driven.press, driven.pixels


def turn(frames=1, period=1 / 60):
    for _ in range(frames):  # it waits where the recording has not been read yet, on a busy machine at any frame
        driven.turn(1, period)
        while line.reading:
            window.frame()


def at(share):
    left, bottom, width, height = window.picture.bar
    return int(left + share * width), int(bottom + height / 2)


turn()
