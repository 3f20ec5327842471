"""the window's cross does, too."""

from prepared import source, tell, window

tell("on_close")
assert window.closed and source.stopped
