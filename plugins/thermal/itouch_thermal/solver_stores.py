"""The framework's stores for the contact-heat solver: compiled functions by fingerprint, bases with a session.

This module must be imported before anything of `contact_heat`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from contact_heat import hosting
from itouch.plugin import building, kept


class Framework:
    """The framework's services for the solver."""

    def compiled(self, function: Any, nogil: bool) -> Any:
        """Compile a function, and store it under a fingerprint of all that it depends on."""
        from itouch.plugin.kernels import kernel, nogil_kernel

        return (nogil_kernel if nogil else kernel)(function)

    def kept(self, content: object, make: Callable[[], Any], pack: Callable[[Any], Any], load: Any) -> Any:
        """Return the basis stored with a session, or by an earlier build, or solve it."""
        return kept(content, make, pack, load)

    def building(self) -> bool:
        """Tell whether a session is being built."""
        return building()


hosting.use(Framework())
