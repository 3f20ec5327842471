"""The harness of a device plugin under test: its class and parameters, a catalog that knows it, and a bench."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Channel, Device, DeviceError, Field, IdealTwin, Record, Role, Twin, TwinInputs
from itouch.plugin.bound_twin import BoundTwin
from itouch.plugin.discovery import Catalog
from itouch.plugin.ideal import ROOM
from itouch.scene import Scene
from itouch.scene.elements import DeviceElement, PluginPart, Probe
from itouch.schema.fields import REQUIRED, default_of, specs, xml_name
from itouch.testing.checks import CheckError, NotApplicableError

#: Temperature of the skin in every check [K]; that of the room is `ROOM`.
SKIN = 306.15
#: Period of the servo loop in every check [s].
PERIOD = 1e-3


class KnownCatalog(Catalog):
    """The plugins of this environment, and the one under examination."""

    def __init__(self, devices: Mapping[str, type[Device]]) -> None:
        super().__init__()
        self._known = dict(devices)

    @property
    def device_names(self) -> list[str]:
        """Names of the device plugins."""
        return sorted({*super().device_names, *self._known})

    @property
    def plugin_names(self) -> list[str]:
        """Names of all plugins."""
        return sorted({*super().plugin_names, *self._known})

    def device(self, name: str) -> type[Device] | None:
        """Return a device class."""
        return self._known.get(name) or super().device(name)

    def element_class(self, plugin: str, host: str, local: str) -> type | None:
        """Return the dataclass of an element."""
        if plugin in self._known and host == "device" and local == "hardware":
            return self._known[plugin].Params
        return super().element_class(plugin, host, local)

    def locals(self, plugin: str, host: str) -> list[str]:
        """Return the local names inside an element."""
        return ["hardware"] if plugin in self._known and host == "device" else list(super().locals(plugin, host))

    def version(self, plugin: str) -> str:
        """Return the version of the plugin's distribution; "0" for the examined one if it is not installed."""
        return super().version(plugin) or ("0" if plugin in self._known else "")


@dataclass(frozen=True, slots=True)
class DeviceHarness:
    """The harness in which a device class is tested.

    Attributes
    ----------
    cls, name
        The class, and the plugin's name in XML.
    params
        An instance of ``cls.Params``; None: the defaults.
    hardware
        Whether ``open`` works here: on the device, a loop-back, or a port with an emulator behind it.
    transcript
        A golden trace of the wire to compare with, or None.
    emulated
        Whether the driver is examined on the device's emulator.
    shared
        The open device that several checks use in turn (`itouch.testing.open_device.Shared`); None: each opens its own.
    """

    cls: type[Device]
    name: str
    params: Any = None
    hardware: bool = False
    transcript: Path | None = None
    emulated: bool = False
    shared: Any = None

    def __post_init__(self) -> None:
        kind = getattr(self.cls, "Params", None)
        if self.params is None and is_dataclass(kind) and isinstance(kind, type) and not self.needed:
            with contextlib.suppress(Exception, SystemExit):  # the checks find it: see `require_params`
                object.__setattr__(self, "params", kind())

    @property
    def needed(self) -> list[str]:
        """Names of the parameters that have no default."""
        return [xml_name(n) for n in specs(self.cls.Params) if default_of(self.cls.Params, n) is REQUIRED]

    @property
    def catalog(self) -> KnownCatalog:
        """A catalog that knows the class under its name."""
        return KnownCatalog({self.name: self.cls})

    def require_params(self) -> Any:
        """Return the parameters.

        Raises
        ------
        CheckError
            If some have no default and none were given.
        BaseException
            What the plugin raises when they are made from their defaults.
        """
        if self.params is None and not self.needed:
            return self.cls.Params()
        if self.params is None:
            raise CheckError(
                f"the parameters {', '.join(self.needed)} have no default, and none were given",
                cause="the suite does not know a valid set",
                advice="set `params` in the suite, or give `itouch-py test-plugin` a scene with --scene",
            )
        return self.params

    def bench(self, *, seed: int = 7) -> TwinBench:
        """Return a fresh twin on a bench."""
        return TwinBench(self, seed)

    def require_hardware(self) -> None:
        """Leave the check out if the hardware cannot be opened here."""
        if self.emulated and self.cls.Emulator is None:
            raise NotApplicableError("the device class names no Emulator")
        if not self.hardware and not self.emulated:
            raise NotApplicableError("needs the device, a loop-back or an emulator")

    def unlucky(self, error: BaseException) -> bool:
        """Tell whether an error may be due to a busy machine, on which an emulated device was not served in time."""
        if not self.emulated or not isinstance(error, DeviceError):
            return False
        if self.shared is not None:
            self.shared.end()
        return True

    def scene(self, *, twin: bool = True, params: Any = None) -> Scene:
        """Return a scene with the device alone, and a probe if the device tracks a finger."""
        chosen = self.require_params() if params is None else params
        part = PluginPart(self.name, "hardware", chosen)
        device = DeviceElement(name="unit", plugin=self.name, twin=twin, parts=(part,))
        reads, commands = self.cls.channels(chosen)
        tracks = follows(reads, commands)
        force = "unit" if tracks and any(c.role is Role.FORCE_ON_OPERATOR for c in commands) else ""
        probes = (Probe(name="tip", radius=0.008, pose_from="unit", force_to=force),) if tracks else ()
        return Scene(devices=(device,), probes=probes)


def follows(reads: Iterable[Channel], commands: Iterable[Channel]) -> bool:
    """Tell whether a device with these channels follows the finger rather than bringing a surface to it."""
    return any(c.role is Role.TRACKED_POSE for c in reads) and not any(c.role is Role.SURFACE_POSE for c in commands)


class TwinBench:
    """A twin with its State, driven by inputs and commands that depend only on the tick."""

    def __init__(self, harness: DeviceHarness, seed: int) -> None:
        params = harness.require_params()
        self.reads, self.commands = harness.cls.channels(params)
        self.twin: Twin = IdealTwin(params, harness.cls) if harness.cls.Twin is None else harness.cls.Twin(params)
        self.twin.set_environment(ROOM, SKIN)
        self._bound = BoundTwin(self.twin)  # as a session calls it; `itouch.testing.joined` compares it with Python's
        #: Name of the reading that is the pose of its end; empty: there is none.
        self.pose = next((c.name for c in self.reads if c.role is Role.TRACKED_POSE), "")
        self.state = Record.of(self.twin.fields())
        self.reading = Record.of(Field.of(c) for c in self.reads)
        self.command = Record.of(Field.of(c) for c in self.commands)
        self.touch = TwinInputs(ambient=ROOM)
        self.tick = 0
        self.twin.reset(self.state, np.random.default_rng(seed))
        self.fresh = self.twin.read(self.state, self.reading)
        self.start = {name: view.copy() for name, view in self.reading.items()}
        self.be_safe()

    def be_safe(self) -> None:
        """Set every command to its safe value; a surface with HOLD or RETRACT stays where the device started."""
        for channel in self.commands:
            if isinstance(channel.safe, tuple):
                self.command[channel.name] = channel.safe
            elif channel.role is Role.SURFACE_POSE and self.pose:
                self.command[channel.name] = self.start[self.pose]
            else:
                self.command[channel.name] = np.zeros(channel.size)

    def drive(self) -> None:
        """Set command and inputs of this tick: slow swings within half of the limits, a finger that comes and goes."""
        phase = 2 * math.pi * self.tick * PERIOD
        for channel in self.commands:
            low, high = limits(channel.low, channel.size), limits(channel.high, channel.size)
            middle, half = (low + high) / 2, (high - low) / 2
            target = middle + 0.5 * half * np.sin(phase * 0.7 + np.arange(channel.size))
            if channel.role is Role.SURFACE_POSE:
                target[3:] = (1.0, 0.0, 0.0, 0.0)
                step = 0.1 * PERIOD * self.tick
                start = self.start[self.pose][:3] if self.pose else middle[:3]
                away = target[:3] - start
                distance = float(np.linalg.norm(away))
                target[:3] = start + away * min(1.0, step / distance) if distance > 0 else start
            self.command[channel.name] = target
        finger = 0.01 * np.array([math.sin(phase), math.cos(phase) - 1.0, math.sin(2 * phase)])
        self.touch.finger_attached = True
        self.touch.finger_pose[:3] = finger
        self.touch.finger_twist[:3] = (
            0.01 * 2 * math.pi * np.array([math.cos(phase), -math.sin(phase), 2 * math.cos(2 * phase)])
        )
        press = max(0.0, math.sin(0.5 * phase))
        self.touch.force, self.touch.gap = press, -1e-4 if press > 0.0 else 1e-3
        self.touch.wrench[:3] = (0.0, 0.0, -press)

    def step(self, count: int = 1, *, driven: bool = True) -> None:
        """Step and read ``count`` times; ``driven``: with the command and inputs of each tick."""
        for _ in range(count):
            if driven:
                self.drive()
            self._bound.step(self.state, self.command, self.touch, PERIOD)
            self.fresh = self._bound.read(self.state, self.reading)
            self.tick += 1


def limits(values: tuple[float, ...], size: int) -> NDArray[np.float64]:
    """Return limits, shape (size,): zeros if there are none, and +-1 in place of infinite ones."""
    if not values:
        return np.zeros(size)
    return np.array([value if math.isfinite(value) else math.copysign(1.0, value) for value in values])
