"""Where plugins extend the scene language, and what to say when an extension is missing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from itouch.scene.source import Node
from itouch.schema.diagnostics import Problem, did_you_mean


class Extensions(Protocol):
    """The plugins that extend the scene language, as the binder sees them."""

    @property
    def plugin_names(self) -> Sequence[str]:
        """Names of the installed plugins."""

    def element_class(self, plugin: str, host: str, local: str) -> type | None:
        """Return the dataclass of ``<plugin:local>`` inside ``host``, or None."""

    def locals(self, plugin: str, host: str) -> Sequence[str]:
        """Return the local names that a plugin offers inside ``host``."""

    def failure(self, plugin: str) -> str:
        """Return why an installed plugin cannot be loaded, or an empty string."""


def missing_part(extensions: Extensions, host: Node, node: Node, plugin: str) -> Problem:
    """Return the problem that says why an element of a plugin's namespace has no class."""
    if failure := extensions.failure(plugin):
        return Problem("plugin-failed", failure, node.place, "`itouch-py devices` shows the whole reason")
    if plugin not in extensions.plugin_names:
        near = did_you_mean(plugin, extensions.plugin_names, "installed plugins are")
        install = f"install the distribution that offers it, for example `pip install itouch-{plugin}`"
        advice = f"{near} If not, {install}" if near.endswith("?") else f"{near}; else {install}" if near else install
        return Problem("unknown-plugin", f"there is no plugin named '{plugin}'", node.place, advice)
    names = [f"{plugin}:{local}" for local in extensions.locals(plugin, host.tag)]
    advice = did_you_mean(f"{plugin}:{node.tag}", names, "it offers") or f"it offers nothing inside <{host.written}>"
    sentence = f"plugin '{plugin}' has no element <{node.written}> inside <{host.written}>"
    return Problem("unknown-element", sentence, node.place, advice)
