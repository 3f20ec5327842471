"""The servo process: the engine on absolute deadlines in a process of its own, and all that watches over it.

``launch`` starts a session and gives a ``Handle``; ``attach`` gives any process a ``Link`` to one that runs.
"""

from itouch.servo.attach import Link, SessionInfo, attach, sessions
from itouch.servo.handle import Handle, launch
from itouch.servo.segment import ServoError

__all__ = ["Handle", "Link", "ServoError", "SessionInfo", "attach", "launch", "sessions"]
