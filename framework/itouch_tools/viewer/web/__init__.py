"""A session in a browser: what runs is shown by the library `viser`, and nothing can be asked of it."""

from itouch_tools.viewer.web.access import Access
from itouch_tools.viewer.web.serve import show

__all__ = ["Access", "show"]
