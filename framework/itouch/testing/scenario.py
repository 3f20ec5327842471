"""The scene in which a modality is examined: a touch begins, slides and ends; one is made if none is given."""

from __future__ import annotations

import math
from collections.abc import Sequence, Set
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from itouch.loop import Engine
from itouch.plugin import Channel, Device, DeviceError, Modality, Record, Role, pose, schema, wrench
from itouch.plugin.discovery import Catalog
from itouch.scene import Scene, load, loads
from itouch.scene.elements import Motion, Operator, To
from itouch.schema.fields import PLUGIN_NAMESPACE, REQUIRED, Spec, default_of, specs, xml_name
from itouch.schema.quantities import format_quantity
from itouch.session import choose_twins
from itouch.testing.checks import CheckError, NotApplicableError
from itouch.testing.harness import KnownCatalog
from itouch.world import Model
from itouch.world.modalities import ModalityModel

#: Plugin name of the device that tracks the finger in a generated scene, and least length of a slide [m].
FINGER, _SLIDE = "suite-finger", 0.005
#: Simulated time in which a touch is looked for in a scene, at most [s].
_LONGEST = 40.0


@dataclass(frozen=True, slots=True)
class FingerParams:
    """Parameters of the suite's finger, which has none that matter."""

    note: str = schema.text(default="", doc="anything")


class Finger(Device):
    """The device that tracks and pushes the finger in the suite's own scenes."""

    Params = FingerParams
    reads = (pose(),)
    commands = (wrench(force=3.0),)
    twin_only = True

    def open(self) -> None:
        """Refuse: there is only the twin."""
        raise DeviceError("the suite's finger is simulated")

    def close(self) -> None:
        """Do nothing: there is nothing to release."""

    def read(self, reading: Record) -> bool:
        """Return that there is no reading."""
        return False


@dataclass(frozen=True)
class ModalityHarness:
    """The harness in which a modality class is tested: a scene that uses it, in which twins replace all hardware.

    Attributes
    ----------
    cls
        The class.
    scene
        A file, or the text of a scene; None: one is generated from the class's parameters.
    least
        Least simulated time of a check [s]; it lasts at least until a touch has begun, slid and ended.
    name
        ``plugin.local``, under which an installed modality is found, or the name under which a modality brings a
        surface without an element (entry-point group ``itouch.carriers``); needed if there is no scene.
    """

    cls: type[Modality]
    scene: str | Path | None = None
    least: float | None = None
    name: str = ""

    @property
    def catalog(self) -> KnownCatalog:
        """The plugins of this environment, and the suite's finger."""
        return KnownCatalog({FINGER: Finger})

    @cached_property
    def loaded(self) -> tuple[Scene, float]:
        """The scene without a recording, and a check's duration in it [s]; without a touch, its motion is replaced."""
        scene = choose_twins(replace(self._read(), record=None), "all")
        seconds, touched = self._seen(scene)
        if seconds is None:
            scene = _with_touch(scene)
            seconds, again = self._seen(scene)
            touched = touched or again
        if seconds is None:
            missing = "no touch in the scene begins, slides and ends" if touched else "nothing is touched in the scene"
            raise NotApplicableError(
                f"{missing}: give a scene whose operator touches an object, slides over it and lets go"
            )
        return scene, max(seconds, self.least or 0.0)

    @property
    def seconds(self) -> float:
        """Duration of a check in simulated time [s]."""
        return self.loaded[1]

    def engine(self, seed: int = 4) -> Engine:
        """Return a new engine of the scene."""
        return Engine(Model.of(self.loaded[0], self.catalog), seed=seed)

    def own(self, engine: Engine) -> list[ModalityModel]:
        """Return the modalities of this class in an engine.

        Raises
        ------
        CheckError
            If there is none.
        """
        found = [m for m in engine.model.modalities if isinstance(m.instance, self.cls)]
        if not found:
            raise CheckError(
                f"the scene does not use {self.cls.__name__}",
                cause="its element is missing under <interaction>",
                advice="write <NAME:local .../> there",
            )
        return found

    def _read(self) -> Scene:
        if self.scene is None:
            return loads(made(self.name, self.catalog).encode(), self.catalog)
        if isinstance(self.scene, Path) or not self.scene.lstrip().startswith("<"):
            return load(self.scene, self.catalog)
        return loads(self.scene.encode(), self.catalog)

    def _seen(self, scene: Scene) -> tuple[float | None, bool]:
        """Return the time until a touch has begun, slid and ended [s], and whether there was any touch.

        The time is None if there is no such touch.
        """
        engine = Engine(Model.of(scene, self.catalog), seed=4)
        self.own(engine)
        touches = [_Touch(engine.state, probe.name) for probe in engine.model.probes]

        def over() -> bool:
            whole = [touch.whole() for touch in touches]
            return any(whole) or engine.seconds > _LONGEST

        engine.run(None if engine.scripted else _LONGEST, until=over)
        seconds = engine.seconds + 0.1 if any(touch.done for touch in touches) else None
        return seconds, any(touch.touched for touch in touches)


class _Touch:
    """What has been observed of a probe's touch."""

    def __init__(self, state: Record, probe: str) -> None:
        self._object, self._proxy = state[f"{probe}.contact.object"], state[f"{probe}.proxy"]
        self._start: Any = None
        self.touched = self.slid = self.done = False

    def whole(self) -> bool:
        """Observe this tick; tell whether a touch has begun, slid and ended."""
        if int(self._object) >= 0:
            self.touched = True
            if self._start is None:
                self._start = self._proxy.copy()
            self.slid = self.slid or float(np.linalg.norm(self._proxy - self._start)) > _SLIDE
        elif self._start is not None:
            self.done = self.done or self.slid
            self._start = None
        return self.done


def _with_touch(scene: Scene) -> Scene:
    """Return the scene with a motion that presses on its first object, slides over it and lets go."""
    if not scene.objects or not scene.probes:
        return scene
    probe, thing = scene.probes[0], scene.objects[0]
    old = next((operator for operator in scene.operators if operator.probe == probe.name), Operator(probe=probe.name))
    x, y, z = thing.pos
    top, way = z + _height(thing) + probe.radius, min(0.02, _width(thing))
    # above all objects: one beside it that is higher must not be touched at the end
    clear = max(other.pos[2] + _height(other) for other in scene.objects) + probe.radius + 0.02
    places = [(x - way, y, clear), (x - way, y, top - 0.004), (x + way, y, top - 0.004), (x + way, y, clear)]
    targets = tuple(To(pos=place, in_=time) for place, time in zip(places, (0.3, 0.4, 0.6, 0.4), strict=True))
    operator = replace(old, motion=Motion(targets=targets))
    others = tuple(one for one in scene.operators if one is not old)
    return replace(scene, operators=(operator, *others))


def _height(thing: Any) -> float:
    size, radius = getattr(thing, "size", None), getattr(thing, "radius", 0.0)
    return float(size[2]) / 2 if size else float(radius)


def _width(thing: Any) -> float:
    size, radius = getattr(thing, "size", None), getattr(thing, "radius", math.inf)
    return 0.35 * float(size[0]) if size else 0.3 * float(radius)


_SCENE = """<itouch version="1.0" {namespaces}>
  <materials>
    <material name="plain">
      <contact stiffness="600 N/m" damping="1 N*s/m" static-friction="0.3" dynamic-friction="0.2"/>
    </material>
    <material name="own" base="plain">{material}</material>
  </materials>
  <defaults><box size="60 60 20 mm"/></defaults>
  <world temperature="23 degC">
    <box name="first" pos="-30 0 10 mm" material="own"/>
    <box name="second" pos="30 0 10 mm" material="plain"/>
  </world>
  <devices><device name="suite" plugin="{finger}"/>{devices}</devices>
  <interaction>
    <probe name="finger" radius="8 mm" pose-from="suite" force-to="suite"{carrier}/>
    <operator probe="finger"><motion>
      <to pos="-40 0 45 mm" in="0.2 s"/><to pos="-40 0 25 mm" in="0.4 s" hold="0.1 s"/>
      <to pos="25 0 25 mm" in="0.8 s"/><to pos="25 0 45 mm" in="0.4 s" hold="0.1 s"/>
    </motion></operator>
    {modalities}
  </interaction>
</itouch>
"""


def made(name: str, catalog: Catalog) -> str:
    """Return the text of a scene that uses an installed modality, and contains only what it needs.

    ``name`` is ``plugin.local``, or that of a modality which brings a surface without an element.

    Raises
    ------
    NotApplicableError
        If only its author can know the value of a parameter.
    """
    plugin, _, local = name.partition(".")
    maker, carrier = _Maker(catalog), ""
    if name in catalog.carrier_names:
        surface = maker.device({Role.TRACKED_POSE}, {Role.SURFACE_POSE}, plugin)
        carrier = f' surface-to="{surface}" carrier="{name}"'
    else:
        maker.modality(plugin, local)
    material = catalog.material(plugin)
    part = f"<{plugin}:material {maker.attributes(material, plugin, local)}/>" if material else ""
    spaces = " ".join(f'xmlns:{p}="{PLUGIN_NAMESPACE}{p}"' for p in sorted(maker.plugins | {plugin}))
    return _SCENE.format(
        namespaces=spaces, material=part, finger=FINGER, devices="".join(maker.devices.values()), carrier=carrier,
        modalities="\n    ".join(maker.modalities.values()),
    )  # fmt: skip


class _Maker:
    """Makes the elements of a generated scene, each with those that it refers to."""

    def __init__(self, catalog: Catalog) -> None:
        self._catalog = catalog
        self.devices: dict[str, str] = {}
        self.modalities: dict[str, str] = {}
        self.plugins: set[str] = set()

    def modality(self, plugin: str, local: str) -> str:
        """Add a modality and return its name."""
        cls = self._catalog.modality(plugin, local)
        if cls is None:
            raise NotApplicableError(f"there is no modality '{plugin}.{local}' to make a scene with")
        if local not in self.modalities:
            self.plugins.add(plugin)
            text = self.attributes(cls.Params, plugin, local)
            self.modalities[local] = f"<{plugin}:{local} {text}/>"
        return local

    def attributes(self, kind: type, plugin: str, local: str) -> str:
        """Return the attributes that must be given, and references of use."""
        required = {n for n in specs(kind) if default_of(kind, n) is REQUIRED}
        needed = {n: s for n, s in specs(kind).items() if n in required or self._of_use(s, plugin)}
        return " ".join(f'{xml_name(n)}="{self._value(n, s, plugin, local)}"' for n, s in needed.items())

    def _of_use(self, spec: Spec, plugin: str) -> bool:
        """Tell whether an optional reference can name another modality of the plugin."""
        return spec.kind == "ref" and spec.target == "modality" and len(self._catalog.modality_names(plugin)) > 1

    def _value(self, name: str, spec: Spec, plugin: str, local: str) -> str:
        if spec.kind == "ref" and spec.target == "probe":
            return "finger"
        if spec.kind == "ref" and spec.target == "object":
            return "first"
        if spec.kind == "ref" and spec.target == "material":
            return "own"
        if spec.kind == "ref" and spec.target == "device":
            return self.device(set(spec.reads), set(spec.commands), plugin)
        if spec.kind == "ref" and spec.target == "modality":
            others = [other for other in self._catalog.modality_names(plugin) if other != local]
            if others:
                return self.modality(plugin, others[0])
        if spec.kind == "quantity":
            return format_quantity(_middle(spec), spec.unit)
        if spec.kind == "integer":
            return str(round(_middle(replace(spec, size=1))))
        if spec.kind in ("choice", "flag"):
            return spec.values[0] if spec.values else "yes"
        raise NotApplicableError(
            f"no scene can be made for it: nobody but its author knows a good '{xml_name(name)}'; give a scene that "
            "uses it (test-plugin --scene FILE, or `scene` in the suite)"
        )

    def device(self, wanted: Set[str | Role], obeyed: Set[str | Role], plugin: str) -> str:
        """Add a device with these channels, the plugin's own if it has one; return its name."""
        if wanted <= {Role.TRACKED_POSE} and obeyed <= {Role.FORCE_ON_OPERATOR}:
            return "suite"
        names: Sequence[str] = sorted(self._catalog.device_names, key=lambda name: name != plugin)
        for name in names:
            cls = self._catalog.device(name)
            if cls is None or any(default_of(cls.Params, n) is REQUIRED for n in specs(cls.Params)):
                continue
            reads, commands = cls.channels(cls.Params())
            if wanted <= _offered(reads) and obeyed <= _offered(commands):
                self.devices.setdefault(name, f'<device name="{name}" plugin="{name}"/>')
                return name
        needed = f"reads {_listed(wanted)} and obeys {_listed(obeyed)}"
        raise NotApplicableError(f"no installed device {needed}: give a scene")


def _listed(channels: Set[str | Role]) -> str:
    """Return names and roles of channels in words."""
    return ", ".join(sorted(f"'{one.value if isinstance(one, Role) else one}'" for one in channels)) or "anything"


def _offered(channels: Sequence[Channel]) -> set[str | Role]:
    """Return the names and roles by which a reference can ask for channels."""
    return {channel.name for channel in channels} | {channel.role for channel in channels}


def _middle(spec: Spec) -> Any:
    low, high = spec.low, spec.high
    if math.isfinite(low) and math.isfinite(high):
        value = math.sqrt(low * high) if low > 0.0 else (low + high) / 2
    else:
        value = low + 1.0 if math.isfinite(low) else high - 1.0 if math.isfinite(high) else 1.0
    return value if spec.scalar else np.full(spec.size, value).tolist()
