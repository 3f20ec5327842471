"""The devices of a scene with their plugins: channels, mounts and limits in force."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from itouch.contact.meshfile.faults import MeshError
from itouch.exchange import LateTwin, ThreadedDevice
from itouch.faults import FOREVER, FaultyTwin, Injection, Kind
from itouch.plugin import Channel, Device, Field, IdealTwin, Monitor, ParameterError, Role, Twin, poses, trace
from itouch.plugin.discovery import Catalog
from itouch.plugin.quantity import SIZES
from itouch.plugin.wire_claims import same
from itouch.scene import Scene
from itouch.scene.elements import DeviceElement, Fault
from itouch.schema import Place, Problem
from itouch.schema.diagnostics import did_you_mean, meant
from itouch.schema.fields import REQUIRED, default_of, specs, xml_name
from itouch.schema.plugin_errors import ReturnedError, error_text, failing, failure, gathering
from itouch.schema.quantities import QuantityError, parse_quantity
from itouch.world import class_queries
from itouch.world.limits import DeviceLimits, resolve
from itouch.world.safe_values import acting_at_rest, stale, too_slow, unmeasured_force, with_safe_values
from itouch.world.scene_files import SceneFiles
from itouch.world.state_fields import declared_by
from itouch.world.supervision import monitors_of, supervision, supervision_problems, watched

Vector = tuple[float, float, float]
#: Name of the field of State with a device's frame in the world.
FRAME = "frame"
#: Names of a device's fields beside channels and supervision: when readings were measured, and when commands left.
STAMPS = frozenset({"measured", "left", "gone", "goings"})
#: How many commands that have left are remembered of a surface.
GONE = 32


@dataclass(frozen=True, slots=True)
class DeviceModel:
    """What the loop needs to know of one device; all of it is read-only.

    ``mount`` is the pose of the device in its carrier (or the world), shape (7,) [m; quaternion]; ``mount_error`` is
    the written position minus the true one, in the same frame [m].
    """

    name: str
    plugin: str
    cls: type[Device]
    params: Any
    reads: tuple[Channel, ...]
    commands: tuple[Channel, ...]
    mount: tuple[float, ...]
    mount_error: Vector
    carrier: str
    limits: DeviceLimits
    twin: bool
    optional: bool
    touch_off: int
    ambient: float
    skin_temperature: float | None
    servo_period: float = 1e-3
    remote: bool = False
    faults: tuple[Injection, ...] = ()
    bound: Any = None
    monitors: tuple[Monitor, ...] = ()
    #: Where it stands in the scene's files.
    place: Place | None = field(default=None, compare=False)

    @property
    def duration(self) -> float:
        """How long its twin's own motion lasts [s]."""
        if not self.twin:
            return 0.0
        with failing(f"device '{self.name}'", "motion_duration", self.place):
            return class_queries.duration_of(self.cls, self.bound)

    @property
    def surface_half_extents(self) -> tuple[float, float] | None:
        """The half extents [m] of the face at its origin that a finger can touch, or None."""
        with failing(f"device '{self.name}'", "surface_half_extents", self.place):
            return class_queries.surface_half_extents_of(self.cls, self.params)

    @property
    def late(self) -> bool:
        """Whether its twin stands behind a simulated wire."""
        cls = self.cls
        return self.twin and cls.blocking and (cls.delay > 0.0 or cls.period > self.servo_period)

    @property
    def wire(self) -> bool:
        """Whether a wire, real or simulated, is between it and the loop."""
        return self.late or (self.cls.blocking and not self.twin)

    @property
    def wires(self) -> tuple[str, ...]:
        """The wires that no other device may use while this one is open; none for a twin, or without commands."""
        return () if self.twin or not self.commands else class_queries.wires_of(self.cls, self.params)

    def unavailable_reason(self) -> str:
        """Return why it cannot be opened, or in what its plugin fails when it is asked; empty: nothing is known."""
        try:
            return class_queries.unavailable_reason_of(self.cls, self.bound)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # a plugin that exits does not end the program
            return f"failed in unavailable_reason: {error_text(error)}"

    def command(self, of: str | Role) -> Channel | None:
        """Return the command channel of this name, or the first of this role; None: there is none."""
        return next((channel for channel in self.commands if of in (channel.name, channel.role)), None)

    def reading(self, of: str | Role) -> Channel | None:
        """Return the reading channel of this name, or the first of this role; None: there is none."""
        return next((channel for channel in self.reads if of in (channel.name, channel.role)), None)

    def field(self, of: Role, kind: str = "") -> str:
        """Return the State field of the first reading of a role, or of the first ``command`` or ``sent`` of one.

        Empty: the device has no such channel.
        """
        channel = self.command(of) if kind else self.reading(of)
        if channel is None:
            return ""
        return f"{self.name}.{kind}.{channel.name}" if kind else f"{self.name}.{channel.name}"

    def twin_fields(self) -> tuple[Field, ...]:
        """Return the fields of the State of its own twin, without simulated wire and faults."""
        return self.fields_of(self._bare_twin())

    def fields_of(self, twin: Twin) -> tuple[Field, ...]:
        """Return the fields that a twin of this device declares.

        Raises
        ------
        SceneError
            If they cannot be State, or it fails.
        """
        with failing(f"device '{self.name}'", "its twin's fields", self.place):
            return declared_by(twin.fields)

    def _bare_twin(self) -> Twin:
        cls = self.cls.Twin
        return IdealTwin(self.params, self.cls) if cls is None else cls(self.bound)

    def make_twin(self) -> Twin:
        """Return the plugin's twin, or else the ideal one, with its simulated wire and injected faults."""
        with failing(f"device '{self.name}'", "the making of its twin", self.place):
            twin = self._bare_twin()
            twin.set_environment(self.ambient, self.skin_temperature)
            if self.late:
                twin = LateTwin(twin, self.cls, self.servo_period)
            if self.faults:
                channels = (self.reads, self.commands)
                return FaultyTwin(twin, *channels, self.faults, period=self.servo_period, watchdog=self.limits.watchdog)
            return twin

    def make_device(self) -> Device:
        """Return the device itself, in a thread of its own if it makes its caller wait.

        Raises
        ------
        SceneError
            If the plugin fails in making it.
        """
        with failing(f"device '{self.name}'", "the making of its driver", self.place):
            device = self.cls(self.bound)
        device.limits = self.limits.table()
        made = device
        if self.cls.blocking:
            made = ThreadedDevice(
                device, patience=self.limits.watchdog, servo_period=self.servo_period, commands=self.commands
            )
        made.trace = trace.wanted(self.name)
        return made


def build_devices(
    scene: Scene, catalog: Catalog, problems: list[Problem], reader: SceneFiles | None = None
) -> dict[str, DeviceModel]:
    """Return the devices by name; faulty ones are left out, with problems."""
    devices: dict[str, DeviceModel] = {}
    reader = reader or SceneFiles(scene)
    for element in scene.devices:
        with gathering(problems):
            model = _build(scene, element, catalog, problems, reader)
            if model is not None:
                devices[element.name] = model
    with gathering(problems):
        problems += _shared_wires(scene, devices)
    return devices


def _shared_wires(scene: Scene, devices: Mapping[str, DeviceModel]) -> Iterator[Problem]:
    """Find hardware that would write to the wire of another device."""
    taken: dict[str, DeviceElement] = {}
    for element in scene.devices:
        model = devices.get(element.name)
        if model is None:
            continue
        with failing(f"device '{element.name}'", "wires", scene.places.of(element)):
            wires = [(wire, same(wire)) for wire in model.wires]
        for wire, key in wires:
            other = taken.setdefault(key, element)
            if other is element:
                continue
            sentence = (
                f"devices '{other.name}' and '{element.name}' would both write to '{wire}': they would take each "
                "other's answers, and one would go on driving what the other has stopped"
            )
            place = scene.places.of(other)
            related = ((place, "the other"),) if place else ()
            advice = "name the wire of each; several controllers on one wire need a driver that speaks to all of them"
            yield Problem("exclusive", sentence, scene.places.of(element), advice, related)


def _build(
    scene: Scene, element: DeviceElement, catalog: Catalog, problems: list[Problem], reader: SceneFiles
) -> DeviceModel | None:
    cls = catalog.device(element.plugin)
    if cls is None:
        problems.append(_missing(scene, element, catalog))
        return None
    params = _params(scene, element, cls, problems)
    bound = _bound(scene, element, cls, params, reader, problems) if params is not None else None
    if bound is None:
        return None
    place = scene.places.of(element)
    with failing(f"device '{element.name}'", "channels", place):
        reads, commands = class_queries.channels_of(cls, params)
    with failing(f"device '{element.name}'", "its declarations", place):
        class_queries.check_numbers(cls, params)
    if wrong := _wrong_channel(element, reads, commands, place):
        problems.append(wrong)
        return None
    limits, found = resolve(scene, element, reads, commands)
    problems += found
    problems += acting_at_rest(element.name, commands, place)
    commands = with_safe_values(commands, limits)
    if commands and (slow := too_slow(cls, limits.watchdog)):
        sentence = f"device '{element.name}': plugin '{element.plugin}' {slow}"
        advice = "its author must make it faster, or whoever tightened that limit (`watchdog`) must relax it"
        problems.append(Problem("plugin-failed", sentence, place, advice))
    elif commands:
        tick = 1.0 / scene.rates.servo
        problems += stale(element.name, cls, params, reads, limits.watchdog, tick, place, twin=bool(element.twin))
    if undriven := _not_driven(scene, element, cls, params, commands):
        problems.append(undriven)
    monitors = _monitors(element, (reads, commands), limits, params, catalog, problems, place)
    mount = (*element.mount.pos, *orientation(element.mount, scene, problems))
    calibration = element.calibration
    touch_off = calibration.points if calibration is not None and calibration.method == "touch-off" else 0
    problems += unmeasured_force(
        element.name, reads, commands, place, twin=bool(element.twin), touch_off=bool(touch_off)
    )
    model = DeviceModel(
        element.name, element.plugin, cls, params, reads, commands, mount, element.mount.mount_error, element.mount.on,
        limits, bool(element.twin), element.optional, touch_off, scene.world.temperature,
        _skin_at(scene, element), 1.0 / scene.rates.servo,
        element.twin == "remote", injections(scene, element, (*reads, *commands), problems), bound,
        monitors, place,
    )  # fmt: skip
    _ = model.duration, model.surface_half_extents  # what is wrong with them is told now, and not when they are needed
    return model


def carriers_of(devices: Mapping[str, DeviceModel], device: DeviceModel) -> Iterator[str]:
    """Yield the device that carries this one, the device that carries that, and so on."""
    while device.carrier and device.carrier in devices:
        yield device.carrier
        device = devices[device.carrier]


def _wrong_channel(
    element: DeviceElement, reads: tuple[Channel, ...], commands: tuple[Channel, ...], place: Place | None
) -> Problem | None:
    """Return what is wrong with the channels that a plugin declares: a size that its role does not have, or names."""
    for channel in (*reads, *commands):
        if SIZES.get(channel.role, channel.size) != channel.size:
            sentence = (
                f"device '{element.name}': plugin '{element.plugin}' has a channel '{channel.name}' of {channel.size} "
                f"numbers; a {channel.role.value} has {SIZES[channel.role]}"
            )
            return Problem("plugin-failed", sentence, place, "report it to the plugin's author")
    if clash := _clash(reads, commands):
        sentence = f"device '{element.name}': plugin '{element.plugin}' {clash}"
        return Problem("plugin-failed", sentence, place, "its author must rename that channel")
    return None


def _not_driven(
    scene: Scene, element: DeviceElement, cls: type[Device], params: Any, commands: Sequence[Channel]
) -> Problem | None:
    """Return why hardware cannot be driven: it has no driver, or nothing would stop it if this program died."""
    if element.twin:
        return None
    if cls.twin_only:
        sentence = f"device '{element.name}': plugin '{element.plugin}' has no working driver, it is twin only"
        return Problem("twin-only", sentence, scene.places.of(element, "twin"), 'write twin="yes", or omit --twin')
    if commands and cls.watchdog_for(params) is None and not cls.second_opener_for(params):
        sentence = f"device '{element.name}': nothing would stop it if this program died, so it is not driven"
        place = scene.places.of(element, "twin") or scene.places.of(element)
        advice = f"'{element.plugin}' must state its own `watchdog`, or that a `second_opener` can make it safe"
        return Problem("no-watchdog", sentence, place, advice)
    return None


def skins_of(scene: Scene) -> dict[str, float | None]:
    """Return the skin temperature [K] of each probe's finger: that of its operator; None: that finger has none.

    A finger is what one device tracks, however many probes it has.
    """
    trackers = {probe.name: probe.pose_from for probe in scene.probes}
    own = {one.probe: one.skin_temperature for one in reversed(scene.operators)}
    found: dict[str, float | None] = {}
    for name, tracker in trackers.items():
        same = (own[other] for other in (name, *trackers) if trackers[other] == tracker and other in own)
        found[name] = next(same, None)
    return found


def _skin_at(scene: Scene, element: DeviceElement) -> float | None:
    """Return the skin temperature [K] of the finger that a device is at; None: no operator has that finger.

    A device is at a finger if that finger's probe is bound to it, or to what carries it.  At no finger it is at that of
    the first operator.
    """
    on, mine = {one.name: one.mount.on for one in scene.devices}, [element.name]
    while (carrier := on.get(mine[-1])) and carrier not in mine:
        mine.append(carrier)
    skins = skins_of(scene)
    at = [skins[p.name] for p in scene.probes if {p.pose_from, p.force_to, p.surface_to} & set(mine)]
    if at:
        return next((skin for skin in at if skin is not None), None)
    return next((operator.skin_temperature for operator in scene.operators), None)


def _clash(reads: tuple[Channel, ...], commands: tuple[Channel, ...]) -> str:
    """Return what is wrong if a channel has the name of another one, or a reading that of a field of every device.

    Empty: nothing is.
    """
    kept = {field.name for field in supervision(())} | STAMPS | {FRAME}
    for index, channel in enumerate(reads):
        if channel.name in kept:
            return f"calls a reading '{channel.name}', as State calls what it keeps of every device"
        if any(channel.name == other.name for other in reads[:index]):
            return f"has two readings named '{channel.name}'"
    for index, channel in enumerate(commands):
        if any(channel.name == other.name for other in commands[:index]):
            return f"has two commands named '{channel.name}'"
    return ""


def _monitors(
    element: DeviceElement, channels: tuple[tuple[Channel, ...], tuple[Channel, ...]], limits: DeviceLimits,
    params: Any, catalog: Catalog, problems: list[Problem], place: Place | None,
) -> tuple[Monitor, ...]:  # fmt: skip
    """Return the monitors of a device; unmonitored drives, and monitors that can't be loaded, become problems."""
    seen = watched(element.name, element.plugin, params, channels, limits, twin=bool(element.twin))
    kinds = catalog.monitors()
    for fault in catalog.monitor_failures:
        advice = "remove the distribution, or report it to its author"
        severity = "warning" if element.twin else "error"
        problems.append(Problem("monitor-failed", str(fault), place, advice, severity=severity))
    with failing(f"device '{element.name}'", "its monitors", place):
        monitors = monitors_of(seen, kinds)
        problems += supervision_problems(seen, monitors, place)
    return monitors


def _missing(scene: Scene, element: DeviceElement, catalog: Catalog) -> Problem:
    severity = "warning" if element.optional else "error"
    place = scene.places.of(element, "plugin")
    failure = catalog.failure(element.plugin)
    if failure:
        return Problem("plugin-failed", failure, place, "`itouch-py devices` shows the whole reason", severity=severity)
    advice = did_you_mean(element.plugin, catalog.device_names, "installed device plugins are")
    sentence = f"there is no device plugin named '{element.plugin}'"
    mend = meant(element.plugin, catalog.device_names)
    return Problem("unknown-plugin", sentence, place, advice, severity=severity, mend=mend)


def _params(scene: Scene, element: DeviceElement, cls: type[Device], problems: list[Problem]) -> Any:
    own = [part for part in element.parts if part.plugin == element.plugin]
    for part in element.parts:
        if part.plugin != element.plugin:
            sentence = f"device '{element.name}' is driven by '{element.plugin}', not by '{part.plugin}'"
            advice = f"write <{element.plugin}:hardware>"
            problems.append(Problem("wrong-plugin", sentence, scene.places.of(part), advice))
    if own:
        return own[0].params
    missing = [xml_name(name) for name in specs(cls.Params) if default_of(cls.Params, name) is REQUIRED]
    if missing:
        sentence = f"device '{element.name}' needs <{element.plugin}:hardware> with {', '.join(missing)}"
        problems.append(Problem("missing-element", sentence, scene.places.of(element)))
        return None
    return default_params(element.name, cls, scene.places.of(element))


def default_params(name: str, cls: type[Device], place: Place | None) -> Any:
    """Return the parameters of a device that has no element for them.

    Raises
    ------
    SceneError
        If they cannot be made.
    """
    with failing(f"device '{name}'", "its parameters", place):
        return cls.Params()


def _bound(
    scene: Scene, element: DeviceElement, cls: type[Device], params: Any, reader: SceneFiles, problems: list[Problem]
) -> Any:
    """Return the parameters as the plugin binds them to the files that they name; None if these cannot be used."""
    try:
        bound = cls.bind(params, reader.read)
        class_queries.bound_of(cls, bound)
        return bound
    except ReturnedError as error:
        place = scene.places.of(params) or scene.places.of(element)
        problems.append(failure(f"device '{element.name}'", "bind", error, place))
        return None
    except MeshError as error:  # its file is missing, too large, or elsewhere
        place = scene.places.of(params, _file_of(params)) or scene.places.of(element)
        problems.append(Problem(error.code, f"device '{element.name}': {error.sentence}", place, error.advice))
        return None
    except ValueError as error:
        field = error.field if isinstance(error, ParameterError) else _file_of(params)
        place = scene.places.of(params, field) or scene.places.of(params) or scene.places.of(element)
        advice = error.advice if isinstance(error, ParameterError) else ""
        problems.append(Problem("device", f"device '{element.name}': {error}", place, advice))
        return None
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        place = scene.places.of(params) or scene.places.of(element)
        problems.append(failure(f"device '{element.name}'", "bind", error, place))
        return None


def _file_of(params: Any) -> str:
    return next((name for name, spec in specs(type(params)).items() if spec.kind == "file"), "")


def orientation(element: Any, scene: Scene, problems: list[Problem]) -> tuple[float, float, float, float]:
    """Return the unit quaternion of an element with ``quat`` or ``rpy``."""
    if element.rpy is not None:
        return poses.quaternion_from_rpy(element.rpy)
    if element.quat is None:
        return (1.0, 0.0, 0.0, 0.0)
    try:
        return poses.normalized(element.quat)
    except ValueError as error:
        problems.append(Problem("bad-value", str(error), scene.places.of(element, "quat"), "for example 1 0 0 0"))
        return (1.0, 0.0, 0.0, 0.0)


def injections(
    scene: Scene, device: DeviceElement, channels: Sequence[Channel], problems: list[Problem]
) -> tuple[Injection, ...]:
    """Return the faults to inject into a device, in file order; what is wrong with them becomes problems."""
    found = []
    for fault in scene.faults:
        if fault.device != device.name:
            continue
        if not device.twin:
            sentence = f"device '{device.name}' is hardware: a fault can only be injected into a twin"
            advice = "remove the fault, or run with --twin all"
            problems.append(Problem("fault-on-hardware", sentence, scene.places.of(fault, "device"), advice))
            continue
        found.append(injection(scene, fault, channels, problems))
    return tuple(found)


def injection(scene: Scene, fault: Fault, channels: Sequence[Channel], problems: list[Problem]) -> Injection:
    """Return one fault to inject; what is wrong with it becomes a problem."""
    rate = scene.rates.servo
    begin = round(fault.at * rate)
    end = FOREVER if fault.for_ is None else begin + max(1, round(fault.for_ * rate))
    amount = math.nan
    channel = next((channel for channel in channels if channel.name == fault.channel), None)
    if channel is None and fault.channel:
        names = [channel.name for channel in channels]
        sentence = f"device '{fault.device}' has no channel '{fault.channel}'"
        place = scene.places.of(fault, "channel")
        problems.append(Problem("missing-channel", sentence, place, did_you_mean(fault.channel, names, "it has")))
    elif channel is not None and fault.amount:
        amount = _amount(scene, fault, channel, problems)
    kind, where = Kind.of(fault.kind), fault.channel if channel is not None else ""
    try:
        return Injection(kind, begin, end, where, amount)
    except ValueError as error:
        place = scene.places.of(fault, "amount")
        problems.append(Problem("bad-value", f"<fault amount>: {error}", place, "remove it, or choose another kind"))
        return Injection(kind, begin, end, where)


def _amount(scene: Scene, fault: Fault, channel: Channel, problems: list[Problem]) -> float:
    try:
        value = parse_quantity(fault.amount, channel.unit)
    except QuantityError as error:
        problems.append(Problem("bad-value", f"<fault amount>: {error}", scene.places.of(fault, "amount")))
        return math.nan
    return value[0]
