"""Scene: what the XML says, whole and frozen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from itouch.scene.elements import (
    VERSION,
    DeviceElement,
    Fault,
    Material,
    Operator,
    PluginPart,
    Probe,
    Rates,
    RecordElement,
    Safety,
    WorldElement,
)
from itouch.scene.places import Places
from itouch.scene.uncertain_parts import NOTHING_UNCERTAIN, UncertainParts
from itouch.schema.notebook_display import Shown


@dataclass(frozen=True, slots=True)
class ReplacedRig:
    """The scene's own devices and ``<safety>``, if another rig was put under the scene.

    ``rig`` is the file whose devices replace these; empty: it brings no devices, and the scene keeps its own.
    ``brought`` is the rig's own ``<safety>``: of each limit the tighter one of both holds.
    ``notes`` say what else of them does not hold for the rig's.
    """

    devices: tuple[DeviceElement, ...]
    safety: Safety
    rig: str = ""
    brought: Safety = Safety()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Scene(Shown):
    """A scene in SI, with includes, defaults and bases resolved.

    Two scenes are equal if they describe the same; the places where it was written do not count. Files that it names
    (meshes) are in ``folder`` and below, or their content is in ``files`` by name, as in a scene taken from a session.
    ``swapped`` is what the scene says of its own rig, if another was put under it: its demands hold for that one too.
    ``notes`` are sentences on what was found, or not, as it was loaded; its sessions have them among their notices.
    """

    #: Imported by name when a notebook asks: the core imports nothing from the tools.
    PAGE: ClassVar[str] = "itouch_tools.report.notebook:scene"

    world: WorldElement = WorldElement()
    materials: tuple[Material, ...] = ()
    devices: tuple[DeviceElement, ...] = ()
    probes: tuple[Probe, ...] = ()
    operators: tuple[Operator, ...] = ()
    modalities: tuple[PluginPart, ...] = ()
    rates: Rates = Rates()
    safety: Safety = Safety()
    faults: tuple[Fault, ...] = ()
    record: RecordElement | None = None
    version: str = VERSION
    source: str = field(default="", compare=False)
    swapped: ReplacedRig | None = field(default=None, compare=False, repr=False)
    notes: tuple[str, ...] = field(default=(), compare=False, repr=False)
    folder: str = field(default=".", compare=False)
    files: Mapping[str, bytes] | None = field(default=None, compare=False, repr=False, hash=False)
    places: Places = field(default_factory=Places, compare=False, repr=False, hash=False)
    #: Of a scene with problems, what other checks must not count on.
    uncertain: UncertainParts = field(default=NOTHING_UNCERTAIN, compare=False, repr=False, hash=False)

    @property
    def objects(self) -> tuple[Any, ...]:
        """The virtual objects in file order."""
        return self.world.objects

    def material(self, name: str) -> Material:
        """Return a material by name."""
        return next(material for material in self.materials if material.name == name)

    def device(self, name: str) -> DeviceElement:
        """Return a device by name."""
        return next(device for device in self.devices if device.name == name)
