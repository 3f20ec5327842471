"""A session in a browser: what runs is shown by the library `viser`, and nothing can be asked of it."""

from itouch.viewer.web.gate import Access
from itouch.viewer.web.serve import show

__all__ = ["Access", "show"]
