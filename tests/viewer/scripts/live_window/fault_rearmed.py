"""a fault is told, R re-arms, Esc ends."""

from prepared import FAILING, begin, press, until
from pyglet.window import key

handle, window, status = begin(FAILING)
until(lambda: any("an injected fault" in fault["cause"] for fault in status.faults), "fault")
assert status.faults[0]["device"] == "table" and handle.running
assert status.late_us is not None and status.tick_us > 0 and status.overruns is not None
assert not status.paused
tick = handle.link.tick
press(key.R)
until(lambda: not status.faults, "no fault any more")
until(lambda: handle.link.tick > tick, "goes on")
press(key.ESCAPE)
assert window.closed and handle.wait(300)
assert handle.report()["faults"][0]["rearmed_s"] > 1.5
handle.close()
