"""Finds plugins by their entry points: loaded only when needed, and with the reason for each that fails to load."""

from __future__ import annotations

import dataclasses
import importlib.metadata as metadata
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from itouch.plugin.contact_events import Contact
from itouch.plugin.device import Device, Twin
from itouch.plugin.measured import Measured
from itouch.plugin.modality import Modality
from itouch.plugin.monitor import Monitor
from itouch.schema import ItouchError
from itouch.schema.diagnostics import named

DEVICES, MODALITIES, COMMANDS, BENCHES = "itouch.devices", "itouch.modalities", "itouch.commands", "itouch.benches"
MONITORS = "itouch.monitors"
#: Entry points of modalities that bring a surface to a finger if no modality of the scene does.
CARRIERS = "itouch.carriers"
#: The distribution of this program.
PROGRAM = "itouch-py"


class PluginError(ItouchError):
    """A plugin is installed but cannot be loaded."""

    def __init__(self, plugin: str, distribution: str, cause: str) -> None:
        super().__init__(f"plugin '{plugin}' ({distribution}) failed to load: {cause}")
        self.plugin, self.distribution, self.cause = plugin, distribution, cause


@dataclass(frozen=True, slots=True)
class Found:
    """An entry point: its name, where it comes from, and how to load it."""

    name: str
    distribution: str
    version: str
    entry: metadata.EntryPoint

    def load(self) -> Any:
        """Import the object that it names.

        Raises
        ------
        PluginError
            With the cause, whatever exception the plugin's import raises.
        """
        try:
            return self.entry.load()
        except (Exception, SystemExit) as error:  # a plugin's import may raise anything; the others go on
            cause = named(error) + self._advice(error)
            raise PluginError(self.name, f"{self.distribution} {self.version}", cause) from error

    def _advice(self, error: BaseException) -> str:
        """Return what to do where what was installed names a module, or a name in it, that is not there any more."""
        module, _, rest = self.entry.value.partition(":")  # it may be anything
        module, first = module.strip(), rest.partition("[")[0].partition(".")[0].strip()
        absent = isinstance(error, ModuleNotFoundError) and f"{module}.".startswith(f"{error.name}.")
        moved = isinstance(error, AttributeError) and (known := sys.modules.get(module)) and not hasattr(known, first)
        return f"; correct its entry point, or install {self.distribution} again" if absent or moved else ""


def find(group: str) -> dict[str, Found]:
    """Return the entry points of a group by name; of two with one name, the alphabetically first distribution wins.

    Installed distributions are listed again when a folder of ``sys.path`` was added or has changed, as installing adds
    a folder to one of them.
    """
    found: dict[str, Found] = {}
    for one in _installed(group, _places()):
        found.setdefault(one.name, one)
    return found


@lru_cache(maxsize=32)
def _installed(group: str, places: tuple[tuple[str, int], ...]) -> tuple[Found, ...]:
    """Return the entry points of a group, those that win first; cached, as reading them takes milliseconds."""
    found: list[Found] = []
    for entry in _offered(places).select(group=group):
        dist = entry.dist
        name, version = (dist.name, dist.version) if dist else ("unknown", "0")
        found.append(Found(entry.name, name, version, entry))
    return tuple(sorted(found, key=lambda one: (one.name, one.distribution if one.entry.dist else "")))


@lru_cache(maxsize=4)
def _offered(places: tuple[tuple[str, int], ...]) -> Any:
    """Return the entry points of all groups, so that distributions are read once for all."""
    return metadata.entry_points()


def _places() -> tuple[tuple[str, int], ...]:
    """Return the folders of ``sys.path``, each with the time of its last change [ns], or -1 if it does not exist."""
    found: list[tuple[str, int]] = []
    for place in sys.path:
        try:
            found.append((place, os.stat(place or ".").st_mtime_ns))
        except (OSError, ValueError):
            found.append((place, -1))
    return tuple(found)


class Catalog:
    """The plugins of this environment; those that fail to load are recorded with the reason, and the rest go on."""

    def __init__(self, finder: Callable[[str], dict[str, Found]] = find) -> None:
        self._devices = finder(DEVICES)
        self._modalities = finder(MODALITIES)
        self._monitors = finder(MONITORS)
        self._carriers = finder(CARRIERS) or find(CARRIERS)
        self.failures: dict[str, PluginError] = {}

    @property
    def device_names(self) -> Sequence[str]:
        """Names of the device plugins, loadable or not."""
        return sorted(self._devices)

    @property
    def plugin_names(self) -> Sequence[str]:
        """Names of all plugins: what may follow ``urn:itouch:plugin:``."""
        return sorted(set(self._devices) | {_plugin_of(name) for name in self._modalities})

    def found(self, name: str) -> Found:
        """Return the entry point of a device plugin."""
        return self._devices[name]

    def offered(self, plugin: str) -> Sequence[Found]:
        """Return the entry points of a plugin's devices, modalities and carriers."""
        every = {**self._carriers, **self._modalities, **self._devices}
        return [found for name, found in sorted(every.items()) if _plugin_of(name) == plugin]

    def offered_monitors(self) -> Sequence[Found]:
        """Return the entry points of the monitors."""
        return [found for _, found in sorted(self._monitors.items())]

    def version(self, plugin: str) -> str:
        """Return the version of the distribution that offers a plugin, or an empty string."""
        every = {**self._carriers, **self._modalities, **self._devices}
        return next((found.version for name, found in every.items() if _plugin_of(name) == plugin), "")

    def device(self, name: str) -> type[Device] | None:
        """Return a device class, or None if there is none or it failed to load (see ``failures``)."""
        cls: type[Device] | None = self._load(self._devices.get(name), Device)
        return cls

    def modality(self, plugin: str, local: str) -> type[Modality] | None:
        """Return a modality class, or None if there is none or it failed to load."""
        cls: type[Modality] | None = self._load(self._modality(plugin, local), Modality)
        return cls

    @property
    def carrier_names(self) -> Sequence[str]:
        """Names of the modalities that bring a surface to a finger without an element in the scene, loadable or not."""
        return sorted(self._carriers)

    def carrier(self, name: str = "") -> tuple[str, type[Modality] | None]:
        """Return name and class of a modality that brings surfaces to fingers; the class is None if it failed to load.

        Without a name it is the program's own: a scene must name another one, which is never used merely because it is
        installed.
        """
        offered = self._carriers.values()
        own = next((one for one in offered if one.distribution == PROGRAM), next(iter(offered), None))
        found = self._carriers.get(name) if name else own
        cls: type[Modality] | None = self._load(found, Modality)
        return ("" if found is None else found.name), cls

    def monitors(self) -> tuple[type[Monitor], ...]:
        """Return the monitors that plugins offer, in the order of their names; see ``monitor_failures``."""
        loaded = (self._load(found, Monitor) for _, found in sorted(self._monitors.items()))
        return tuple(kind for kind in loaded if kind is not None)

    @property
    def monitor_failures(self) -> tuple[PluginError, ...]:
        """The errors of offered monitors that failed to load."""
        return tuple(self.failures[name] for name in self._monitors if name in self.failures)

    def modality_names(self, plugin: str) -> Sequence[str]:
        """Return the local names of a plugin's modalities."""
        return sorted(_local_of(name) for name in self._modalities if _plugin_of(name) == plugin)

    def material(self, plugin: str) -> type | None:
        """Return the class of a plugin's material part, or None."""
        for local in self.modality_names(plugin):
            cls = self.modality(plugin, local)
            if cls is not None and cls.Material is not None:
                return cls.Material
        return None

    def element_class(self, plugin: str, host: str, local: str) -> type | None:
        """Return the dataclass of ``<plugin:local>`` inside the element ``host`` of a scene, or None."""
        if host == "device" and local == "hardware":
            device = self.device(plugin)
            return device.Params if device else None
        if host == "material" and local == "material":
            return self.material(plugin)
        modality = self.modality(plugin, local) if host == "interaction" else None
        return modality.Params if modality else None

    def locals(self, plugin: str, host: str) -> Sequence[str]:
        """Return the local names that a plugin offers inside the element ``host``."""
        if host == "device":
            return ["hardware"] if plugin in self._devices else []
        if host == "material":
            return ["material"] if self.material(plugin) else []
        return self.modality_names(plugin)

    def failure(self, plugin: str) -> str:
        """Return why a plugin failed to load, or an empty string."""
        return next((str(e) for name, e in self.failures.items() if _plugin_of(name) == plugin), "")

    def _modality(self, plugin: str, local: str) -> Found | None:
        for name, found in self._modalities.items():
            if (_plugin_of(name), _local_of(name)) == (plugin, local):
                return found
        return None

    def _load(self, found: Found | None, kind: type) -> Any:
        if found is None or found.name in self.failures:
            return None
        try:
            loaded = found.load()
            if not (isinstance(loaded, type) and issubclass(loaded, kind)):
                cause = f"'{found.entry.value}' is not a subclass of itouch.plugin.{kind.__name__}"
                raise PluginError(found.name, f"{found.distribution} {found.version}", cause)
            if cause := _undeclared(loaded):
                raise PluginError(found.name, f"{found.distribution} {found.version}", cause)
        except PluginError as error:
            self.failures[found.name] = error
            return None
        return loaded


def _undeclared(loaded: type) -> str:
    """Return what is missing in a plugin's class so that no scene can use it; empty if nothing is."""
    if missing := sorted(getattr(loaded, "__abstractmethods__", ())):
        return f"class '{loaded.__name__}' does not define {', '.join(missing)}: each needs a method, however short"
    twin = getattr(loaded, "Twin", None) if issubclass(loaded, Device) else None
    if twin is not None and not (isinstance(twin, type) and issubclass(twin, Twin)):
        return f"class '{loaded.__name__}' declares Twin = {twin!r:.80}: write the name of a subclass of Twin, or None"
    if issubclass(loaded, Modality) and (wrong := _misdeclared(loaded)):
        return f"class '{loaded.__name__}' {wrong}"
    if issubclass(loaded, Monitor) or dataclasses.is_dataclass(getattr(loaded, "Params", None)):
        return ""
    advice = "write 'Params = NAME' in it, the class of its parameters: a frozen dataclass, an empty one if it has none"
    return f"class '{loaded.__name__}' declares no Params: {advice}"


def _misdeclared(loaded: type[Modality]) -> str:
    """Return which attribute of a modality is not what it must be; empty: all are."""
    for name, kind, wanted in (
        ("subscribes_to", Contact, "frozenset((Contact.BEGIN, Contact.END)), an empty one if it subscribes to nothing"),
        ("measured", Measured, "(Measured(...),), () if it measures nothing"),
        ("persistent_fields", str, "('field',), () if there is none"),
        ("removed_fields", str, "frozenset(('field',)), an empty one if there is none"),
        ("extended_fields", str, "frozenset(('field',)), an empty one if there is none"),
        ("probe_attributes", str, "frozenset(('clearance',)), an empty one if it respects none"),
    ):
        told: Any = getattr(loaded, name)
        if not isinstance(told, tuple | list | set | frozenset) or not all(isinstance(one, kind) for one in told):
            return f"declares {name} = {told!r:.80}: write {name} = {wanted}"
    return ""


def _plugin_of(entry: str) -> str:
    return entry.split(".", 1)[0]


def _local_of(entry: str) -> str:
    return entry.split(".", 1)[-1]
