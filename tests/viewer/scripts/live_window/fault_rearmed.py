"""a fault is told, R re-arms, Esc ends."""

from prepared import FAILING, begin, press, until
from pyglet.window import key

handle, window, situation = begin(FAILING)
until(lambda: any("an injected fault" in fault["cause"] for fault in situation.faults), "fault")
assert situation.faults[0]["device"] == "table" and handle.running
assert situation.late_us is not None and situation.tick_us > 0 and situation.overruns is not None
assert not situation.paused
tick = handle.link.tick
press(key.R)
until(lambda: not situation.faults, "no fault any more")
until(lambda: handle.link.tick > tick, "goes on")
press(key.ESCAPE)
assert window.closed and handle.wait(20)
assert handle.report()["faults"][0]["rearmed_s"] > 1.5
handle.close()
