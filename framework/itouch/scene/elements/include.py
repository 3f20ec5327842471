"""Element `<include>`, and the elements of plugins in their own namespaces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from itouch.schema.fields import text


@dataclass(frozen=True, slots=True)
class PluginPart:
    """An element of a plugin's namespace: ``<plugin:local>`` with the plugin's own parameters.

    ``name`` is the name of a modality (default: the local name), and empty for any other part.
    """

    plugin: str
    local: str
    params: Any
    name: str = ""


@dataclass(frozen=True, slots=True)
class Include:
    """Another complete scene document whose content joins this one."""

    TAG: ClassVar[str] = "include"
    file: str = text(doc="path relative to this file, inside the scene's folder")
    prefix: str = text(default="", doc="put before every name that the included file defines")
