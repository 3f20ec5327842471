"""A session in a browser: the running session is shown through the library `viser`, and can't be controlled there."""

from itouch_tools.viewer.web.access import Access
from itouch_tools.viewer.web.session_stream import show

__all__ = ["Access", "show"]
