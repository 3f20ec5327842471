"""a fault that nobody re-arms is the end's error."""

from prepared import FAILING, begin, press, until
from pyglet.window import key

import itouch

handle, window, status = begin(FAILING)
until(lambda: status.faults, "fault")
press(key.ESCAPE)
try:
    handle.wait(300)
except itouch.DeviceFaultError as fault:
    assert fault.device == "table"
else:
    raise AssertionError("no error")
handle.close()
