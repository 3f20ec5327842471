"""Deprecation warnings for a person who runs a scene: what its plugins do not declare."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from itouch.world import Model


def warn(model: Model) -> None:
    """Warn of units and sentences that the plugins of a scene do not declare: it runs, but ``test-plugin`` fails.

    The warnings are shown whatever filters are set, because they are for the person who runs the scene.
    """
    from itouch.world import undeclared

    with warnings.catch_warnings():
        warnings.simplefilter("always", DeprecationWarning)
        for sentence in undeclared(model):
            warnings.warn(sentence, DeprecationWarning, stacklevel=2)
