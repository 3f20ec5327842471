"""The framework's stores behind the contact-heat solver: compiled functions with a fingerprint, bases with a session.

This module is imported before anything of `contact_heat`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from contact_heat import hosting
from itouch.plugin import building, kept


class Framework:
    """What the framework does for the solver."""

    def compiled(self, function: Any, nogil: bool) -> Any:
        """Compile, and keep it under a fingerprint of all that it is made of."""
        from itouch.plugin.kernels import kernel, nogil_kernel

        return (nogil_kernel if nogil else kernel)(function)

    def kept(self, content: object, make: Callable[[], Any], pack: Callable[[Any], Any], load: Any) -> Any:
        """Return the stored basis of a session, or what an earlier build found, or solve."""
        return kept(content, make, pack, load)

    def building(self) -> bool:
        """Tell whether a session is being built."""
        return building()


hosting.use(Framework())
