"""What a number is: name, size, unit, meaning and role, the same for channels of devices and fields of State."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import Any

#: One number for all components, or one each.
Bound = float | tuple[float, ...]


class Role(enum.Enum):
    """What a quantity is for.  The framework acts on the role, never on the name.

    The set is closed: what supervises, draws or couples a device finds its channels by these words.
    """

    #: Nothing that the framework acts on: a number that is recorded, plotted and handed on.
    SIGNAL = "signal"

    # --- readings -----------------------------------------------------------------------------------------------
    #: Pose of the device's end: what the finger is attached to, or the surface that it touches.
    TRACKED_POSE = "tracked pose"
    #: Velocity of the device's end.
    TRACKED_TWIST = "tracked twist"
    #: Wrench or force between the device and the finger, as the device feels it.
    CONTACT_FORCE = "contact force"
    #: Temperature of the body of what the skin touches.
    SKIN_CONTACT_TEMPERATURE = "skin-contact temperature"
    #: Temperature of the skin itself, measured without touching it.
    SKIN_TEMPERATURE = "skin temperature"
    #: 1 while the reading of the skin's temperature is valid.
    SKIN_VALID = "skin reading valid"
    #: Temperature of the heat sink behind a thermal drive.
    HEAT_SINK_TEMPERATURE = "heat-sink temperature"
    #: Temperature that touches nobody: of a room, a motor, an amplifier.
    OTHER_TEMPERATURE = "other temperature"
    #: Heat flux out of the finger through the surface that it touches.
    HEAT_FLUX = "heat flux"
    #: What a drive really delivers, in the unit of its command.
    DELIVERED_DRIVE = "delivered drive"
    #: Dead-man's switch: not 0 while a person holds it.
    DEADMAN = "dead-man's switch"

    # --- commands -----------------------------------------------------------------------------------------------
    #: Wrench or force that the device exerts on the operator.
    FORCE_ON_OPERATOR = "force on the operator"
    #: Pose of a surface that meets the finger.
    SURFACE_POSE = "surface pose"
    #: Current, voltage or power that heats or cools, moves or shakes: its effect must be watched.
    DRIVE = "drive"
    #: Temperature that the device shall bring a surface to by its own control.
    TEMPERATURE_TARGET = "temperature target"
    #: Pressure of a fluid that pushes or squeezes.
    PRESSURE = "pressure"
    #: Current or voltage through the skin.
    ELECTRODE = "electrode drive"
    #: Sound pressure or drive of focused ultrasound.
    ULTRASOUND = "ultrasound drive"
    #: Switches the output of a device on or off; what it delivers is another command's.
    OUTPUT_SWITCH = "output switch"


#: Commands that can hurt by themselves, and may not be called harmless by anybody.
NEVER_HARMLESS = frozenset({Role.TEMPERATURE_TARGET, Role.ELECTRODE, Role.ULTRASOUND})
#: Commands that can hurt.
HURTING = NEVER_HARMLESS | {Role.DRIVE, Role.PRESSURE, Role.FORCE_ON_OPERATOR, Role.SURFACE_POSE}


@dataclass(frozen=True, slots=True)
class Quantity:
    """A named vector of numbers with a unit and a meaning.

    Attributes
    ----------
    name, size
        ``size`` numbers; for a field of State 0 is a plain scalar, and a tuple a shape.
    unit
        SI unit in the notation of scenes (``N*s/m``); ``"1"`` is a plain number, ``"tick"`` a number of ticks,
        ``"mixed"`` numbers each in an SI unit of its own; empty means that nobody said.  Of a pose or a wrench it is
        the unit of the linear part.
    low, high
        Bounds in that unit; what they do is said by what is derived from this.
    dtype
        NumPy scalar type.
    doc
        One sentence that says what is measured, commanded or remembered.
    role
        What it is for; the framework acts on this and on nothing else.
    show
        Where it is plotted: ``""`` by its unit, if it is a channel, or a single number of a twin or a modality that
        has a unit; ``"no"`` nowhere; any other words: in the chart of that title, with all others of the same title
        and unit.  ``"wish: TITLE"`` draws it dashed, as what is wanted and not measured; ``"page: TITLE"`` shows it on
        the report's page only.  The title may be left out: ``"wish:"``.
    """

    name: str
    size: int | tuple[int, ...] = 1
    unit: str = ""
    low: Any = ()
    high: Any = ()
    dtype: Any = field(default="f8", kw_only=True)
    doc: str = field(default="", kw_only=True)
    role: Role = field(default=Role.SIGNAL, kw_only=True)
    show: str = field(default="", kw_only=True)
