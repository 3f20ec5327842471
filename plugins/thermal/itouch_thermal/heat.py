"""The modality `heat`: live contact heat between the model finger and the virtual object.

The model finger stays in the simulation: between touches it is in air, and each object keeps the heat of earlier
touches.  At BEGIN the steady profile for the difference between measured and modelled skin temperature is added, so
that each touch starts from the finger as it is (the paper notes that this is missing there).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from contact_heat.layers import FINGER_FILM, Back, Film, Initial, Layer, Side, check_layers
from contact_heat.resistance import DEFAULT_RESISTANCE, SPREAD, ResistanceLaw, contact_area
from itouch.plugin import Bound, ContactArrays, ContactEvent, Field, Modality, Record, Role, World, schema
from itouch.plugin import Contact as ContactKind
from itouch.plugin.bound import bound_once
from itouch_thermal.boundary import Exchange, beyond
from itouch_thermal.curve_playback import CurvePlayback
from itouch_thermal.flux.object_curves import played_curves
from itouch_thermal.laws import KINDS, ForceLaw, check_laws, law_of, press_factor

if TYPE_CHECKING:
    from itouch_thermal.exchange import Contact, Given, Kept, Skin

Array = NDArray[np.float64]

#: Longest time [s] left out by a loop that is made up for.  Making up takes time itself, in which the loop is silent,
#: and a guardian lets less than this pass in a run.  If a curve is played, or two objects are touched at once, Python
#: does it, some thirty times slower.
LEFT_OUT, LEFT_OUT_IN_PYTHON = 10.0, 0.25

#: State has room for at least so many modes of an object; metals, glasses, woods and foams of 0.5 mm to 1 m take 16 to
#: 72.  A study may then change the material without changing State's fields: one recording holds all conditions.
ROOM_FOR = 72

#: The model finger, unless a scene has its own: epidermis as in the paper; dermis and subcutis, with perfusion, after
#: tissue models like that of Torvi and Dale.
FINGER: tuple[Layer, ...] = (
    Layer(name="epidermis", thickness=7e-4, conductivity=0.34, density=1200.0, specific_heat=3340.0),
    Layer(name="dermis", thickness=1.5e-3, conductivity=0.45, density=1200.0, specific_heat=3300.0, perfusion=5000.0),
    Layer(name="subcutis", thickness=4.4e-3, conductivity=0.19, density=1000.0, specific_heat=2500.0, perfusion=5000.0),
)


@dataclass(frozen=True, slots=True)
class ThermalMaterial:
    """The thermal properties of a material: what makes it feel warm or cold."""

    conductivity: float = schema.quantity("W/(m*K)", low=1e-4, high=1e4, doc="thermal conductivity")
    specific_heat: float = schema.quantity("J/(kg*K)", low=1.0, high=2e4, doc="specific heat")
    density: float = schema.quantity("kg/m^3", low=1e-2, high=3e4, doc="density")
    source: str = schema.text(default="", doc="where the values come from")

    def layer(self, thickness: float | None) -> Layer:
        """Return a layer of this material, of a thickness [m]; None: semi-infinite."""
        return Layer(
            thickness=thickness, conductivity=self.conductivity, density=self.density, specific_heat=self.specific_heat
        )

    @property
    def effusivity(self) -> float:
        """Thermal effusivity [W s^1/2 / m2K]."""
        return self.layer(None).effusivity


@dataclass(frozen=True, slots=True)
class HeatParams:
    """Computes the heat flux that the real object would draw from the finger."""

    probe: str = schema.ref("probe", doc="the finger")
    contact_resistance: float = schema.quantity(
        "m^2*K/W", low=0.0, high=1.0, default=DEFAULT_RESISTANCE, doc="contact resistance between skin and object"
    )
    arterial: float = schema.temperature(
        low=283.15, high=315.15, default=310.15, doc="temperature of the blood and of the core"
    )
    object_depth: float = schema.quantity("m", low=1e-4, high=1.0, default=0.02, doc="depth of the virtual objects")
    skin_from: str = schema.ref(
        "device",
        reads=(Role.SKIN_TEMPERATURE,),
        default="",
        doc="device that measures the skin; default: the one at this finger that can",
    )
    press: float = schema.quantity(
        "s",
        low=0.0,
        high=10.0,
        default=0.0,
        doc="time constant of the resistance after contact, R / (1 - exp(-t / press)); 0: constant at once",
    )
    expected_force: float = schema.quantity(
        "N", low=1e-3, high=20.0, default=1.0, doc="force that is expected of a touch, for what is computed before it"
    )
    layers: tuple[Layer, ...] = schema.children(Layer, doc="tissue from the skin inwards; default: a fingertip")
    laws: tuple[ForceLaw, ...] = schema.children(KINDS, doc="resistance as a function of the force")

    def __post_init__(self) -> None:
        schema.validate(self)
        check_laws(self.laws, self.contact_resistance)
        check_layers(self.layers, "layer")

    def law(self) -> ResistanceLaw:
        """Return the law from force to contact resistance."""
        return law_of(self.laws, self.contact_resistance)

    @property
    def expected_resistance(self) -> float:
        """Contact resistance [K m2/W] at the force expected of a touch."""
        return self.law().at(self.expected_force)


class Names(NamedTuple):
    """Names of the State fields that a tick uses, composed once."""

    desired: str
    finger: str
    objects: str
    object: str
    touched: str
    resistance: str
    skin_temperature: str
    skin_change: str
    skin_count: str
    since: str
    since_beside: str
    contact_area: str
    beside_part: str
    felt_force: str
    beside: str
    beside_distance: str
    primary: str

    @classmethod
    def of(cls, name: str, probe: str) -> Names:
        """Return the names for a modality and its probe."""
        own, seen = cls._fields[:-_SEEN], ("felt_force", "beside", "beside_distance", "object")
        return cls._make([*(f"{name}.{field}" for field in own), *(f"{probe}.{field}" for field in seen)])


#: How many of the names are the probe's.
_SEEN = 4


@dataclass(frozen=True, slots=True)
class HeatModel:
    """The packed models of finger and objects; None for an object without a thermal material."""

    name: str
    names: Names
    live: Any
    probe: str
    finger_number: int
    finger: Array
    finger_start: Array
    bodies: tuple[Array | None, ...]
    body_starts: tuple[Array | None, ...]
    widest: int
    law: ResistanceLaw
    table: Array
    area: tuple[float, float]
    press: float
    skin_from: str
    valid_from: str
    playing: CurvePlayback
    exchange: Exchange
    period: float
    real: bool


class Heat(Modality):
    """Computes the heat flux that the real object would draw from the finger."""

    Params = HeatParams
    Material: ClassVar[type | None] = ThermalMaterial
    subscribes_to = frozenset({ContactKind.BEGIN, ContactKind.END})
    persistent_fields = ("finger", "skin_change", "skin_count")
    removed_fields = frozenset({"skin_ring"})  # a tenth of a second of readings, which fills again
    extended_fields = frozenset({"objects"})

    def compile(self, name: str, params: HeatParams, world: World) -> HeatModel:
        """Build the modes of finger and objects."""
        from contact_heat import live

        finger = finger_side(params.layers or FINGER, params.arterial, world.skin_of(params.probe), world.ambient)
        period = world.period
        finest = min(period, world.servo_period)  # in which steps a controller looks ahead from these states
        bodies: list[Array | None] = []
        starts: list[Array | None] = []
        for element in world.objects:
            side = object_side(element.material, element.temperature, params.object_depth)
            bodies.append(None if side is None else live.side_model(side, period, finger=False, finest=finest))
            starts.append(None if side is None else live.initial_state(side, period, finger=False, finest=finest))
        skin_from, valid = _skin_source(params, world)
        packed, playing = (
            live.side_model(finger, period, finger=True, finest=finest),
            CurvePlayback(played_curves(name, world), period),
        )
        return HeatModel(
            name=name,
            names=Names.of(name, params.probe),
            live=live,
            probe=params.probe,
            finger_number=list(world.probes).index(params.probe),
            finger=packed,
            finger_start=live.initial_state(finger, period, finger=True, finest=finest),
            bodies=tuple(bodies),
            body_starts=tuple(starts),
            widest=max((ROOM_FOR, *(len(start) for start in starts if start is not None))),
            law=params.law(),
            table=table_of(bodies),
            area=params.laws[0].spread if params.laws else SPREAD,
            press=params.press,
            skin_from=skin_from,
            valid_from=valid,
            playing=playing,
            exchange=Exchange(live, packed, tuple(bodies), playing),
            period=period,
            real=_is_real(params.probe, world),
        )

    def fields(self, model: HeatModel) -> tuple[Field, ...]:
        """Return the State of finger and objects, and of what infrared sees."""
        count = max(1, len(model.bodies))
        return (
            Field(
                "desired",
                role=Role.HEAT_FLUX,
                unit="W/m^2",
                doc="flux that the real object would draw from the bare finger",
                show="wish: heat flux out of the finger",
            ),
            Field("in_contact", "i8", unit="1", doc="1 between BEGIN and END"),
            Field("object", "i8", low=-1, high=count - 1, unit="1", doc="number of the object, -1: none"),
            Field(
                "skin_temperature",
                role=Role.SKIN_TEMPERATURE,
                unit="K",
                doc="temperature that the skin would have on the real object",
                show="wish: | skin on the object",
            ),
            Field(
                "resistance",
                unit="m^2*K/W",
                doc="contact resistance at the force that is felt; infinite in air",
                show="no",
            ),
            Field("contact_area", unit="m^2", doc="contact area at that force", show="no"),
            Field("since", "i8", unit="tick", doc="time since the finger touched; a slide onto another object goes on"),
            Field("since_beside", "i8", unit="tick", doc="for how long it has touched the object beside that one"),
            Field("left_tick", "i8", low=-1, unit="tick", doc="when the last touch ended"),
            Field("beside_part", unit="1", doc="part of the contact disc that lies on the object beside", show="no"),
            Field("finger", "f8", len(model.finger_start), unit="K", doc="modes of the model finger"),
            Field("objects", "f8", (count, model.widest), unit="K", doc="modes of each object"),
            Field("touched", "i8", count, unit="1", doc="1 for each object that was touched: its own heat goes on"),
            Field(
                "skin_change",
                unit="K",
                doc="by how much infrared sees the skin warmer than the model finger's, a mean",
                show="no",  # a difference, among temperatures in degrees Celsius
            ),
            Field("skin_count", "i8", low=0, unit="1", doc="of how many ticks that is since the last touch"),
        )

    def reset(self, model: HeatModel, state: Record) -> None:
        """Start with a finger at rest in air and untouched objects."""
        state[f"{model.name}.finger"] = model.finger_start
        for index, start in enumerate(model.body_starts):
            if start is not None:
                state[f"{model.name}.objects"][index, : len(start)] = start
        state[f"{model.name}.object"] = state[f"{model.name}.left_tick"] = -1
        state[f"{model.name}.resistance"] = np.inf

    def on_contact(self, event: ContactEvent, model: HeatModel, state: Record) -> None:
        """Begin or end the exchange of heat with an object."""
        if event.probe == model.probe:
            self.bound_contact(model, state, ContactArrays.of(event, model.finger_number)).run()

    def bound_contact(self, model: HeatModel, state: Record, event: ContactArrays) -> Bound:
        """Return what is done with an event as one compiled call."""
        from itouch_thermal import exchange

        given, kept, skin, _ = _views(model, state, model.period)
        touch = exchange.Touch(*(state[f"{model.name}.{field}"] for field in exchange.Touch._fields))
        return Bound(exchange.hear, event, given, kept, skin, touch, model.finger_number)

    def _start(self, model: HeatModel, state: Record) -> None:
        """Bring the model finger to the measured skin temperature."""
        finger, change = state[f"{model.name}.finger"], state[f"{model.name}.skin_change"]
        model.live.shift_surface(model.finger, finger, change.item())
        change[...] = state[f"{model.name}.skin_count"] = 0

    def bound_update(self, model: HeatModel, state: Record, period: float) -> Bound:
        """Bind the update to these views as one compiled call, which leaves curves and boundaries to Python."""
        from itouch_thermal import exchange

        return Bound(exchange.exchange, *_views(model, state, period))

    def update(self, model: HeatModel, state: Record, period: float) -> None:
        """Advance the finger and every object that has been touched by one period [s]."""
        calls = () if self._unusual(model, state) else bound_once(self.bound_update, model, state, period)
        if not calls or any(call.run() for call in calls):
            self._advance(model, state, period)

    def on_skipped_time(self, model: HeatModel, state: Record, seconds: float) -> None:
        """Advance finger and objects over left-out time in unchanged contact; infrared readings do not count again."""
        if not model.real:
            return
        steps, names = min(round(seconds / model.period), round(LEFT_OUT / model.period)), model.names
        update, seen = self.bound_update(model, state, model.period), (names.skin_change, names.skin_count)
        before = [state[name].item() for name in seen]
        for done in range(steps):
            if self._unusual(model, state) or update.run():
                if done * model.period >= LEFT_OUT_IN_PYTHON:
                    break
                self._advance(model, state, model.period)
        for name, value in zip(seen, before, strict=True):
            state[name] = value

    def _unusual(self, model: HeatModel, state: Record) -> bool:
        """Tell whether compiled code would leave this tick to Python."""
        names, knows = model.names, model.exchange.knows
        index, force = state[names.object].item(), state[names.felt_force].item()
        if not force > 0.0 or model.playing.plays(index):
            return bool(force > 0.0)
        beside, distance = state[names.beside].item(), state[names.beside_distance].item()
        known = beside >= 0 and (knows(index) or knows(beside))
        return known and (beside == index or beyond(distance, contact_area(force, *model.area)) > 0.0)

    def _advance(self, model: HeatModel, state: Record, period: float) -> None:
        """Do the update in Python, for a curve that is played or two objects touched at once."""
        names, live, exchange = model.names, model.live, model.exchange
        finger, objects = state[names.finger], state[names.objects]
        index, force = state[names.object].item(), state[names.felt_force].item()
        beside, part = self._overlap(model, state, index, force)
        if index < 0 and part == 0.0:
            force = 0.0
        resistance = self._resistance(model, state, force, period) if force > 0.0 else np.inf
        counts = (state[names.since].item(), state[names.since_beside].item())
        if part > 0.0:
            parts = (min(1.0, state[names.beside_part].item()), part)
            flux = exchange.blend(finger, objects, (index, beside), parts, resistance, counts)
            state[names.touched][beside] = 1
        else:
            flux = exchange.step(finger, objects, index, resistance, counts[0])
        touching = (index if force > 0.0 else -1, beside if part > 0.0 else -1)
        for other, touched in enumerate(state[names.touched].tolist()):
            cooling = model.bodies[other] if touched else None
            if cooling is not None and (other not in touching or model.playing.plays(other)):
                live.air_step(cooling, objects[other])
        state[names.desired][...], state[names.beside_part][...] = flux, part
        state[names.resistance][...] = resistance
        if force > 0.0:
            state[names.contact_area][...] = contact_area(force, *model.area)
        state[names.skin_temperature][...] = live.surface_temperature(model.finger, finger)

    def _overlap(self, model: HeatModel, state: Record, index: int, force: float) -> tuple[int, float]:
        """Return the object beside the one in contact, and its share of the contact disc; -1 and 0 if none."""
        names = model.names
        beside, distance = state[names.beside].item(), state[names.beside_distance].item()
        known = model.exchange.knows(index) or model.exchange.knows(beside)
        part = beyond(distance, contact_area(force, *model.area)) if force > 0.0 and beside >= 0 and known else 0.0
        if force > 0.0 and known and beside == index:  # the contact is still with it, but most of the disc is not
            beside, part = state[names.primary].item(), 1.0 - part
        if part == 0.0:
            if model.press > 0.0 and index >= 0 and not model.playing.plays(index):  # as `exchange.press_on` does
                state[names.since][...] = max(state[names.since].item(), state[names.since_beside].item())
            state[names.since_beside][...] = 0
            return -1, 0.0
        if index < 0 and state[names.skin_count].item():  # the exchange begins with the object beside
            self._start(model, state)
            state[names.since][...] = 0
        state[names.since_beside] += 1
        return beside, part

    def _resistance(self, model: HeatModel, state: Record, force: float, period: float) -> float:
        """Count a tick of contact; return the contact resistance at its end [K m2/W] under a force [N]."""
        resistance = model.law.at(force)
        state[model.names.since] += 1
        since = max(state[model.names.since].item(), state[model.names.since_beside].item())
        if model.press > 0.0:
            resistance *= press_factor(since * period, model.press)
        return resistance


def _views(model: HeatModel, state: Record, period: float) -> tuple[Given, Kept, Skin, Contact]:
    """Return the views of model and State that a compiled tick takes."""
    from itouch_thermal.exchange import Contact, Given, Kept, Skin

    names, nothing = model.names, np.zeros(0)
    given = Given(
        model.finger, model.table, np.array([body is not None for body in model.bodies], np.int64),
        np.array([model.playing.plays(index) for index in range(len(model.bodies))], np.int64),
        np.array(model.law.numbers), np.array(model.area), np.array((model.press, period)),
    )  # fmt: skip
    kept = Kept(*(state[getattr(names, field)] for field in Kept._fields))
    skin = Skin(
        state[names.skin_change], state[names.skin_count], state[model.skin_from] if model.skin_from else nothing,
        state[model.valid_from] if model.valid_from else nothing,
    )  # fmt: skip
    contact = Contact(state[names.felt_force], state[names.beside], state[names.beside_distance])
    return given, kept, skin, contact


def table_of(bodies: Sequence[Array | None]) -> Array:
    """Return packed models as rows of one table, shape (n, widest); a row of zeros for a missing one.

    Each model (size,) is laid out as in `contact_heat.packing`, which has the units.
    """
    table = np.zeros((max(1, len(bodies)), max((len(body) for body in bodies if body is not None), default=1)))
    for row, body in zip(table, bodies, strict=False):
        if body is not None:
            row[: len(body)] = body
    table.setflags(write=False)
    return table


def _skin_source(params: HeatParams, world: World) -> tuple[str, str]:
    """Return the State fields of the infrared reading and of its validity; empty if there is no sensor.

    Without ``skin_from`` it is a sensor at this finger: one at another finger sees another skin.
    """
    named = world.devices.get(params.skin_from)
    for device in world.devices_at(params.probe) if named is None else [named]:
        if skin := device.read_field(Role.SKIN_TEMPERATURE):
            return skin, device.read_field(Role.SKIN_VALID)
    return "", ""


def _is_real(probe: str, world: World) -> bool:
    """Tell whether the finger goes on without ticks, since it is a real one on real hardware."""
    near = world.devices_at(probe)
    displays = [device for device in near if device.reading(Role.HEAT_FLUX) is not None]
    return any(not device.twin for device in displays or near)


def finger_side(layers: Sequence[Layer], arterial: float, skin: float, ambient: float) -> Side:
    """Return a finger at rest in air at a skin temperature [K]; its film is the one that keeps it there."""
    from contact_heat.steady import initial_profile

    start = Initial(kind="steady", surface=skin)
    back = Back(kind="temperature", temperature=arterial)
    bare = Side(layers=tuple(layers), initial=start, back=back, arterial=arterial)
    loss = -initial_profile(bare).flux_at(0.0)  # fluxes inside a side are positive inwards
    gap = skin - ambient
    coefficient = loss / gap if abs(gap) > 0.5 and loss / gap > 1.0 else FINGER_FILM
    air = Film(coefficient=coefficient, ambient=ambient)
    return Side(layers=tuple(layers), initial=start, back=back, arterial=arterial, air=air)


def object_side(material: ThermalMaterial | None, temperature: float, depth: float) -> Side | None:
    """Return an object at a temperature [K], with that temperature behind it; None without a thermal material."""
    if material is None:
        return None
    back = Back(kind="convection", temperature=temperature, coefficient=FINGER_FILM)
    return Side(layers=(material.layer(depth),), initial=Initial(kind="uniform", temperature=temperature), back=back)
