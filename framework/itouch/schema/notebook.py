"""Things that show themselves in a notebook: they name what draws them, which is loaded when a notebook asks."""

from __future__ import annotations

from importlib import import_module
from typing import ClassVar


class Shown:
    """A base whose heirs have a picture, tables and curves in a notebook, and stay what they are elsewhere."""

    __slots__ = ()

    #: ``module:function`` that takes the thing and returns HTML.
    PAGE: ClassVar[str]

    def _repr_html_(self) -> str:
        """Return what a notebook shows in place of ``repr``."""
        module, _, name = self.PAGE.partition(":")
        page: str = getattr(import_module(module), name)(self)
        return page
