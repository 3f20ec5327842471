"""Roles: what a quantity is for, and the only thing that the framework acts on."""

from __future__ import annotations

import enum


class Role(enum.Enum):
    """What a quantity is for.  The framework acts on the role, never on the name.

    The set is closed: everything that supervises, draws or couples a device finds its channels by these roles.
    """

    #: A number that the framework does not act on: it is recorded, plotted and passed on.
    SIGNAL = "signal"

    # --- readings -----------------------------------------------------------------------------------------------
    #: Pose of the device's end: what the finger is attached to, or the surface that it touches.
    TRACKED_POSE = "tracked pose"
    #: Velocity of the device's end.
    TRACKED_TWIST = "tracked twist"
    #: Wrench or force between the device and the finger, as the device measures it.
    CONTACT_FORCE = "contact force"
    #: Temperature of the body that the skin touches.
    SKIN_CONTACT_TEMPERATURE = "skin-contact temperature"
    #: Temperature of the skin itself, measured without touching it.
    SKIN_TEMPERATURE = "skin temperature"
    #: 1 while the reading of the skin's temperature is valid.
    SKIN_VALID = "skin reading valid"
    #: Temperature of the heat sink behind a thermal drive.
    HEAT_SINK_TEMPERATURE = "heat-sink temperature"
    #: Temperature of something that nobody touches: a room, a motor, an amplifier.
    OTHER_TEMPERATURE = "other temperature"
    #: Heat flux out of the finger through the surface that it touches.
    HEAT_FLUX = "heat flux"
    #: What a drive actually delivers, in the unit of its command.
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
    #: Temperature to which the device brings a surface by its own control loop.
    TEMPERATURE_TARGET = "temperature target"
    #: Pressure of a fluid that pushes or squeezes.
    PRESSURE = "pressure"
    #: Current or voltage through the skin.
    ELECTRODE = "electrode drive"
    #: Sound pressure or drive of focused ultrasound.
    ULTRASOUND = "ultrasound drive"
    #: Switches the output of a device on or off; another command says what it delivers.
    OUTPUT_SWITCH = "output switch"

    # --- State of modalities ------------------------------------------------------------------------------------
    #: 1 while a display is ready for the next touch; a study waits for it.
    READY = "ready for a touch"


#: Commands that can hurt by themselves, and may never be declared harmless.
NEVER_HARMLESS = frozenset({Role.TEMPERATURE_TARGET, Role.ELECTRODE, Role.ULTRASOUND})
#: Commands that can hurt.
HURTING = NEVER_HARMLESS | {Role.DRIVE, Role.PRESSURE, Role.FORCE_ON_OPERATOR, Role.SURFACE_POSE}

#: How many numbers a quantity of a role has, where the framework works with it.
SIZES = {
    Role.TRACKED_POSE: 7, Role.TRACKED_TWIST: 6, Role.CONTACT_FORCE: 6, Role.FORCE_ON_OPERATOR: 6, Role.SURFACE_POSE: 7,
    Role.SKIN_CONTACT_TEMPERATURE: 1, Role.SKIN_TEMPERATURE: 1, Role.HEAT_SINK_TEMPERATURE: 1, Role.HEAT_FLUX: 1,
    Role.TEMPERATURE_TARGET: 1, Role.DEADMAN: 1,
}  # fmt: skip
