"""The framework's own way of carrying a surface as a stranger writes it, from what the contract tells and nothing else.

With s the height at which the finger would rest on the highest virtual surface below it, f the lowest point of the
finger and c the clearance, the top goes to max(s, f - c).  Everything is compiled, and joins the tick.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from itouch.plugin import Bound, Carries, Field, Modality, ParameterError, Record, Role, World, schema
from itouch.plugin.kernels import kernel

#: How fast it leaves a finger or comes to it, while it may be felt and while it is clear [m/s].
SOFTLY, QUICKLY = 0.015, 0.1
#: How near below the finger it may be felt soon, what it may be behind and ahead of its command, what is there [m].
SOON, BEHIND, SLACK, ABOUT, HAND_OVER = 1.5e-3, 2e-4, 3e-5, 3e-4, 1e-3
#: What its force stays below the scene's limit [N], how far ahead that is seen, and how fast it is learned [s].
ROOM, AHEAD, SETTLE = 0.15, 0.008, 0.02
#: How fast it yields above its greatest force [m/s per N], and how fast it comes back [m/s].
YIELD_RATE, YIELD_RETURN = 0.02, 0.005
#: How fast it is learned how far the device gives way and how late it is [1/s], the most of it [m/N], [s], what is
#: another error [m], and the speed up or down well below which it is no lag [m/s].
LEARNS, MOST_GIVE, MOST_LAG, ASTRAY, STILL = 80.0, 1e-4, 0.005, 1e-4, 0.01
#: The filter on the finger's height, and from what difference on it begins anew [m].
G, H, LOST = 0.3, 0.3**2 / (2.0 - 0.3), 2e-3
#: Forces from which on it is felt, and below which it is left [N].
TOUCH, LEFT = 0.05, 0.02
#: When it is missed: depth [m], part of the force, time; after what time it is tried again [s].
MISS_DEPTH, MISS_PART, MISS_TIME, TRY_AGAIN = 1e-3, 0.4, 0.04, 0.02
#: When it is too high: force [N], gap [m], time [s]; the same where it hovers.
EARLY_FORCE, EARLY_GAP, EARLY_TIME = 0.1, 1e-3, 0.010
HOVER_GAP, HOVER_FORCE, HOVER_TIME = 4e-3, 0.5, 0.05
#: How far below the finger it may be, by its height, and still be too high [m].
FAR, FAR_UNCALIBRATED = 0.004, 0.015
#: Why it renders no more.
LOW, HIGH = 1.0, 2.0


@dataclass(frozen=True, slots=True)
class Parameters:
    """Its element: ``<PLUGIN:carries-as-ours probe="..."/>``."""

    probe: str = schema.ref("probe", doc="the finger")


class Numbers(NamedTuple):
    """What never changes; lengths [m], forces [N]."""

    radius: float
    clearance: float
    cosine: float
    back: float
    period: float
    limit: float
    most: float
    stiffness: float
    has_load: bool
    reach: float
    early: float
    x: float
    y: float
    z: float


class Seen(NamedTuple):
    """What it reads of State: arrays, of one number where no shape is told."""

    #: Frame of the device (12,), its pose and what was sent to it (7,), its force (6,).
    frame: Any
    pose: Any
    sent: Any
    load: Any
    #: Finger and touched normal (3,); the surface below.
    hip: Any
    normal: Any
    height: Any
    upright: Any
    climb: Any
    #: What the framework makes of what it says: for how long there is a contact, is it there.
    pressed: Any
    present: Any
    object: Any
    withdrawn: Any
    ready: Any


#: Its own fields, of one number each and in this order: what it says of the surface, and what it remembers.
FIELDS = {
    "renders": "1", "present": "1", "distance": "m", "gap": "m", "coming": "m", "missed": "1", "yields": "m", "settled": "1",
    "press": "m", "free": "s", "unfelt": "s", "give": "m/N", "lag": "s", "level": "m", "sink": "m/s", "off": "m",
}  # fmt: skip
RENDERS, PRESENT, DISTANCE, GAP, COMING, MISSED, YIELDS = range(7)
SETTLED, PRESS, FREE, UNFELT, GIVE, LAG, LEVEL, SINK, OFF = range(7, 16)


@kernel
def along(frame: Any, normal: Any) -> float:
    """Return the cosine between a normal (3,) and the surface's."""
    cosine = 0.0
    for i in range(3):
        cosine += normal[i] * frame[5 + 3 * i]
    return cosine


@kernel
def top(c: Any, frame: Any, pose: Any) -> float:
    """Return the height of the face [m] in the world, for a pose (7,) of the device."""
    x, y, z = pose[0] + c.x, pose[1] + c.y, pose[2] + c.z
    return float(frame[9] * x + frame[10] * y + frame[11] * z + frame[2])


@kernel
def choose(c: Any, own: Any, upright: float, touching: bool, withdrawn: bool) -> None:
    """Say whose the contact is."""
    if touching:
        own[FREE] = 0.0
        if upright < c.cosine:
            own[RENDERS] = 0.0
        elif upright >= c.back:
            own[RENDERS] = 1.0
    else:
        own[RENDERS] = 1.0 if upright >= c.cosine else 0.0
        own[FREE] += c.period
        if own[FREE] > TRY_AGAIN and own[MISSED] == LOW:
            own[MISSED] = 0.0
    if own[MISSED] > 0.0 or withdrawn:
        own[RENDERS] = 0.0


@kernel
def doubt(c: Any, own: Any, depth: float, pressed: float, touching: bool) -> None:
    """Find that it is not where its height says."""
    hovers = depth < -HOVER_GAP
    what, patience = 0.0, MISS_TIME
    if pressed > (HOVER_FORCE if hovers else EARLY_FORCE) and -c.early < depth < -EARLY_GAP:
        what, patience = HIGH, HOVER_TIME if hovers else EARLY_TIME
    elif (
        touching and own[RENDERS] > 0.0 and own[SETTLED] > 0.0
        and depth - pressed / c.stiffness > MISS_DEPTH and pressed < MISS_PART * c.stiffness * depth
    ):  # fmt: skip
        what = LOW
    if what == 0.0:
        own[UNFELT] = 0.0
        return
    own[UNFELT] += c.period
    if own[UNFELT] >= patience:
        own[MISSED], own[RENDERS], own[UNFELT] = what, 0.0, 0.0


@kernel
def smooth(c: Any, own: Any, lowest: float) -> None:
    """Follow the finger's lowest point."""
    ahead = own[LEVEL] + own[SINK] * c.period
    off = lowest - ahead
    if abs(off) > LOST:
        own[LEVEL], own[SINK] = lowest, 0.0
        return
    own[LEVEL] = ahead + G * off
    own[SINK] += H * off / c.period


@kernel
def come(
    c: Any, own: Any, goal: float, last: float, depth: float, pressed: float, touching: bool, begins: bool
) -> None:  # fmt: skip
    """Bring it to the finger, until it is at its goal [m]."""
    felt = pressed > LEFT
    if not touching and not felt:
        own[SETTLED] = 1.0
        return
    if own[SETTLED] > 0.0 and begins and depth < -ABOUT:
        own[SETTLED], own[PRESS] = 0.0, depth
    if own[SETTLED] > 0.0:
        return
    own[PRESS] = min(own[PRESS], last - own[LEVEL] + own[SINK] * c.period + SLACK)
    if own[PRESS] < depth + BEHIND:
        own[PRESS] += (SOFTLY if felt or own[PRESS] > -SOON else QUICKLY) * c.period
    if own[LEVEL] + own[PRESS] >= goal:
        own[SETTLED] = 1.0


@kernel
def go(c: Any, own: Any, last: float, pressed: float, touching: bool) -> None:
    """Take it away from the finger."""
    full, felt, high = -c.clearance, pressed > LEFT, own[MISSED] == HIGH
    if own[SETTLED] > 0.0:
        own[SETTLED], own[PRESS] = 0.0, last if high else max(last, full)
    if not touching and not felt:
        own[PRESS] = min(own[PRESS], full) if high else full
        return
    way = (SOFTLY if not high and (felt or own[PRESS] > -SOON) else QUICKLY) * c.period
    own[PRESS] = own[PRESS] - way if felt and high else min(own[PRESS], max(full, own[PRESS] - way))


@kernel
def learn(c: Any, own: Any, speed: float, last: float, here: float, pressed: float) -> None:
    """Learn how far the device gives way, and how late it is."""
    off = last - here - own[GIVE] * pressed - own[LAG] * speed
    if abs(off) > ASTRAY:
        return
    moves = speed * speed / (speed * speed + STILL * STILL)
    step = LEARNS * c.period * off
    give = own[GIVE] + (1.0 - moves) * step * pressed / (pressed * pressed + 0.01)
    own[GIVE] = min(MOST_GIVE, max(0.0, give))
    lag = own[LAG] + moves * step * speed / (speed * speed + STILL * STILL)
    own[LAG] = min(MOST_LAG, max(-MOST_LAG, lag))


@kernel
def give_way(c: Any, own: Any, pressed: float) -> float:
    """Give way while it presses harder than it may."""
    if pressed > c.limit:
        own[YIELDS] += YIELD_RATE * (pressed - c.limit) * c.period
    elif pressed < 0.9 * c.limit:
        own[YIELDS] = max(0.0, own[YIELDS] - YIELD_RETURN * c.period)
    return float(own[YIELDS])


@kernel
def wanted(
    c: Any, own: Any, lowest: float, height: float, climb: float, here: float, last: float, pressed: float,
    touching: bool, begins: bool,
) -> float:  # fmt: skip
    """Return the height [m] at which it is wanted, and say how far it is still to come or to go."""
    away = lowest - c.clearance
    goal = height + climb * (c.period + own[LAG]) + (own[GIVE] * pressed if touching else 0.0)
    if own[RENDERS] > 0.0:
        come(c, own, goal, last, here - lowest, pressed, touching, begins)
        own[COMING] = 0.0 if own[SETTLED] > 0.0 else max(1e-6, goal - own[LEVEL] - own[PRESS])
    else:
        go(c, own, last - own[LEVEL], pressed, touching)
        own[COMING] = max(0.0, own[PRESS] + c.clearance)
    if own[SETTLED] > 0.0:
        return float(max(goal - give_way(c, own, pressed), away))
    own[YIELDS] = 0.0
    found = own[LEVEL] + own[PRESS]
    return float(max(goal, away) if height > -np.inf and found > goal else found)


@kernel
def bearable(c: Any, own: Any, climb: float, here: float, pressed: float) -> float:
    """Return the greatest height [m] at which it presses no harder than it may."""
    if pressed > TOUCH:
        off = here - own[LEVEL] - pressed / c.stiffness
        own[OFF] += c.period / SETTLE * (off - own[OFF])
    elif pressed < LEFT:
        own[OFF] = 0.0
    goes = min(0.0, climb) if own[RENDERS] > 0.0 and own[SETTLED] > 0.0 else 0.0
    soon = own[LEVEL] + min(0.0, own[SINK] - goes) * AHEAD
    return float(soon + own[OFF] + c.most / c.stiffness)


@kernel
def command(c: Any, frame: Any, sent: Any, hip: Any, goal: Any, height: float, touching: bool) -> None:
    """Write the command: the face under the finger at a height [m]; in touch it gives way first."""
    x, y, z = hip[0] - frame[0], hip[1] - frame[1], height - frame[2]
    goal[0] = frame[3] * x + frame[6] * y + frame[9] * z - c.x
    goal[1] = frame[4] * x + frame[7] * y + frame[10] * z - c.y
    goal[2] = frame[5] * x + frame[8] * y + frame[11] * z - c.z
    goal[3], goal[4], goal[5], goal[6] = 1.0, 0.0, 0.0, 0.0
    down = sent[2] - goal[2]
    aside = math.sqrt((goal[0] - sent[0]) ** 2 + (goal[1] - sent[1]) ** 2)
    left = math.sqrt(max(0.0, c.reach * c.reach - down * down))
    if touching and down > 0.0 and aside > left:
        for i in range(2):
            goal[i] = sent[i] + (goal[i] - sent[i]) * left / aside


@kernel
def there(own: Any, before: bool, depth: float, pressed: float) -> bool:
    """Tell whether it is at the finger, or about to be."""
    if depth > -ABOUT or (own[RENDERS] > 0.0 and (own[SETTLED] > 0.0 or own[PRESS] > -HAND_OVER)):
        return True
    return bool(pressed > (LEFT if before else TOUCH))


@kernel
def carry(c: Any, seen: Any, goal: Any, own: Any) -> int:
    """Say who renders the surface below the finger, and command the device.

    ``c``: `Numbers`; ``seen``: `Seen`, taken apart here, for a tuple of many arrays is dear to hand on; ``goal`` (7,):
    the command; ``own`` (16,): its own fields.
    """
    frame, sent, hip = seen.frame, seen.sent, seen.hip
    height, climb = seen.height[0], seen.climb[0]
    lowest, here, last = hip[2] - c.radius, top(c, frame, seen.pose), top(c, frame, sent)
    pressed, touching, withdrawn = max(0.0, -seen.load[2]), seen.object[0] >= 0, seen.withdrawn[0] != 0
    own[GAP] = height - here if height > -np.inf else np.inf
    own[DISTANCE] = lowest - here
    if withdrawn:
        own[MISSED] = 0.0
    choose(c, own, along(frame, seen.normal) if touching else seen.upright[0], touching, withdrawn)
    if seen.ready[0] != 0 and c.has_load and own[MISSED] == 0.0 and not withdrawn:
        doubt(c, own, here - lowest, pressed, touching)
    smooth(c, own, lowest)
    begins = touching and seen.pressed[0] == 0.0
    top_wanted = wanted(c, own, lowest, height, climb, here, last, pressed, touching, begins)
    most = bearable(c, own, climb, here, pressed)
    still = own[RENDERS] > 0.0 and own[SETTLED] > 0.0 and top_wanted <= most
    if still and touching and pressed >= TOUCH and own[YIELDS] <= 0.0:
        learn(c, own, climb, last, here, pressed)
    command(c, frame, sent, hip, goal, min(top_wanted, most), touching)
    own[PRESENT] = 1.0 if touching and there(own, seen.present[0] > 0.0, here - lowest, pressed) else 0.0
    return 0


class Plan(NamedTuple):
    """The read-only model."""

    name: str
    probe: str
    device: str
    channel: str
    pose: str
    load: str
    numbers: Numbers


class CarriesAsOurs(Modality):
    """Keeps the surface where the virtual one is, as the framework would."""

    Params = Parameters
    hears = frozenset()  # else each tick of a contact would call it from Python
    keeps_to = frozenset({"clearance", "plate-angle"})

    def compile(self, name: str, params: Any, world: World) -> Plan:
        """Take the facts of the probe's surface."""
        surface, radius = world.surfaces.get(params.probe), world.probes[params.probe]
        if surface is None:
            raise ParameterError("probe", f"'{params.probe}' has no surface-to")
        device = world.devices[surface.device]
        goal = device.command(Role.SURFACE_POSE)
        if goal is None:
            raise ValueError(f"device '{device.name}' brings no surface")
        load = device.read_field(Role.CONTACT_FORCE)
        force = world.devices[surface.arm].limits.get("force", math.inf) if surface.arm else math.inf
        numbers = Numbers(
            radius, surface.clearance, math.cos(surface.plate_angle),
            math.cos(max(0.0, surface.plate_angle - math.radians(2.0))), world.servo_period,
            surface.greatest_force, max(0.0, min(surface.greatest_force, force - ROOM)), surface.pad_stiffness, bool(load),
            device.limits.get("speed", math.inf) * world.servo_period, FAR if surface.touch_off else FAR_UNCALIBRATED,
            *surface.face,
        )  # fmt: skip
        return Plan(name, params.probe, device.name, goal.name, device.read_field(Role.TRACKED_POSE), load, numbers)

    def fields(self, model: Plan) -> tuple[Field, ...]:
        """Declare what it says of the surface, and what it remembers."""
        return tuple(Field(name, unit=unit, doc=f"{name} of the surface") for name, unit in FIELDS.items())

    def commands(self, model: Plan) -> tuple[str, ...]:
        """Command the device."""
        return (f"{model.device}.{model.channel}",)

    def carries(self, model: Plan) -> Carries:
        """Say that it brings the device's surface."""
        return Carries(model.probe, model.device, "renders", "present", "distance", "gap", "coming", "missed", "yields")

    def reset(self, model: Plan, state: Record) -> None:
        """Begin as the framework does."""
        state[f"{model.name}.renders"] = state[f"{model.name}.settled"] = 1.0

    def update(self, model: Plan, state: Record, period: float) -> None:
        """Do what joins, alone."""
        self.bound_update(model, state, period)()

    def bound_update(self, model: Plan, state: Record, period: float) -> Bound:
        """Return the whole way as one compiled call."""
        probe, device, nothing = model.probe, model.device, np.zeros(6)
        seen = Seen(
            state[f"{device}.frame"], state[model.pose], state[f"{device}.sent.{model.channel}"],
            state[model.load] if model.load else nothing,
            *(state[f"{probe}.{name}"] for name in ("hip", "normal", "surface_height")),
            *(state[f"{probe}.surface.{name}"] for name in ("upright", "climb", "pressed", "present")),
            state[f"{probe}.object"], state[f"{device}.surface.withdrawn"],
            state["ready"],
        )  # fmt: skip
        names = [f"{model.name}.{field}" for field in FIELDS]
        goal = state[f"{device}.command.{model.channel}"]
        return Bound(carry, model.numbers, seen, goal, state.flat(names[0], names[-1]))
