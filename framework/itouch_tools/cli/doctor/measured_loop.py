"""The loop that the doctor measures: its scene, a run in a servo process, and whether it may have priority."""

from __future__ import annotations

import os
import threading
import time

from itouch.loop.timing import Timing
from itouch.plugin.discovery import Catalog
from itouch.scene import Scene, loads
from itouch.servo import launch
from itouch_tools.cli.doctor.touch_scene import scene


def bench_scene() -> Scene:
    """Return the scene to measure: arm, table and display as twins, and a finger that touches again and again."""
    text = scene(touches=200, remote=False, hold=False)
    return loads(text.encode(), Catalog(), shown="bench-loop.xml")


def in_process(description: Scene, seconds: float, *, realtime: bool) -> Timing:
    """Run a scene in a servo process for some seconds, and return how long its ticks took."""
    with launch(description, realtime=realtime) as handle:
        while handle.running and handle.link.tick == 0:
            time.sleep(0.005)
        time.sleep(seconds)
        handle.stop()
        return handle.timing


def may_have_priority() -> bool:
    """Return whether this user may have real-time priority."""
    given = []

    def ask() -> None:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
            given.append(True)
        except OSError:
            return

    thread = threading.Thread(target=ask)  # the priority is the thread's own, and ends with it
    thread.start()
    thread.join()
    return bool(given)
