"""Before each script: a window that plays the recording, whose time the script turns."""

import sys

import numpy as np

import itouch
from itouch_tools.viewer.playback import Playback
from itouch_tools.viewer.player import Player
from itouch_tools.viewer.recording_seek import SeekableRecording

clock = [0.0]
reel = SeekableRecording(itouch.read(sys.argv[2]))
playback = Playback(reel)
window = Player(playback, lambda: clock[0], width=640, height=360)
line, state = playback.line, playback.state


def turn(frames=1, period=1 / 60):
    for _ in range(frames):
        clock[0] += period
        window.dispatch_events()
        window.frame()
    while line.reading:
        window.frame()


def tell(*event):
    window.dispatch_event(*event)
    window.dispatch_events()


def press(symbol, modifiers=0):
    tell("on_key_press", symbol, modifiers)
    if not window.closed:
        tell("on_key_release", symbol, modifiers)


def pixels():
    window.switch_to()
    return window._target.read().astype(int)


def changed(a, b):
    return int((np.abs(a - b).max(2) > 24).sum())


def at(share):
    left, bottom, width, height = window.picture.bar
    return int(left + share * width), int(bottom + height / 2)


turn()
