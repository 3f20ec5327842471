"""Objects that show themselves in a notebook: they name the function that draws them, imported when a notebook asks."""

from __future__ import annotations

from importlib import import_module
from typing import ClassVar


class Shown:
    """A base class whose subclasses have a picture, tables and curves in a notebook; elsewhere it changes nothing."""

    __slots__ = ()

    #: ``module:function`` that takes the object and returns HTML.
    PAGE: ClassVar[str]

    def _repr_html_(self) -> str:
        """Return what a notebook shows in place of ``repr``."""
        module, _, name = self.PAGE.partition(":")
        page: str = getattr(import_module(module), name)(self)
        return page
