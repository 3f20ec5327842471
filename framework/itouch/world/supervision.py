"""What the supervisor remembers of a device: all of it is State, so that a restored session trips where it must."""

from __future__ import annotations

from collections.abc import Sequence

from itouch.plugin import Channel, Field

#: Seconds between two of the supervisor's slow checks.
SLOW = 0.010
#: Slow checks that the window of the plate's rate (T5) and that of the mean flux (T6) are long: 0.5 s and 1 s.
RATE_WINDOW, FLUX_WINDOW = 50, 100
#: Slow checks that a surface's speed (K5) is taken over: 50 ms.
SPEED_WINDOW = 5

_EVERY = (
    Field(
        "status", "i8", low=0, high=3, unit="1", doc="0 CLOSED, 1 OPEN (measures), 2 ENABLED (obeys), 3 FAULT"
    ),  # CLOSED, OPEN, ENABLED, FAULT
    Field("trip", "i8", unit="1", doc="number of the [trip](errors.md#while-running) that stopped it, 0: none"),
    Field("tripped", "i8", unit="tick", doc="when it was stopped"),
    Field(
        "ramp", low=0.0, high=1.0, unit="1", doc="share of its limits that it may use; grows to 1 after it was enabled"
    ),
    Field("age", "i8", low=0, unit="tick", doc="age of the reading"),
    Field("sequence", "i8", low=0, unit="1", doc="number of the reading: changes when there is a new one"),
    Field("clamped", "i8", low=0, unit="1", doc="how often a command was limited"),
    Field("dropped", "i8", low=0, unit="1", doc="how many commanded components of locked directions were zeroed"),
    Field("strayed", "i8", unit="1", doc="for how many checks it has been too far from its command"),
    Field("calibration", "f8", 7, unit="m", doc="correction of the mount that calibration found: position, quaternion"),
)

_CARRIED = (
    Field("contact_time", low=0.0, unit="s", doc="how long what it carries has been touched (T4)"),
    Field("withdrawn", "i8", unit="1", doc="1 while it is withdrawn because of T4"),
    Field("stopped", "i8", unit="1", doc="1 held, 2 driven back, in the safe sequence"),
    Field("doubted", unit="s", doc="for how long the force on it has been in doubt"),
    Field("near_since", "i8", unit="tick", doc="since when the finger has been near"),
    Field("compared", "i8", unit="tick", doc="when its readings were last compared"),
    Field("tracked", "i8", low=0, unit="1", doc="how many positions of the track have been noted"),
    Field("track", "f8", (SPEED_WINDOW + 1, 3), unit="m", doc="the last positions, from which its speed is taken (K5)"),
)

_HEAT = (
    Field(
        "touched", "i8", unit="1", doc="1 if what it heats or cools has been touched: heat is supervised as in contact"
    ),
    Field("heat.samples", "i8", low=0, unit="1", doc="slow checks of its heat so far"),
    Field("heat.touched", "i8", unit="tick", doc="when its touch was first looked at"),
    Field("heat.dose", low=0.0, unit="s", doc="thermal dose so far, in seconds at 43 degC (T3)"),
    Field("heat.share", low=0.0, high=1.0, unit="1", doc="share of the drive that T1 to T7 leave"),
    Field("heat.frozen", unit="K", doc="its last reading"),
    Field("heat.frozen_for", unit="s", doc="for how long that reading has been exactly the same (T8)"),
    Field("heat.frozen_drive", unit="s", doc="change of the drive's share since then, summed over time"),
    Field("heat.frozen_from", unit="1", doc="share of its drive when the reading became that"),
    Field("heat.driven_for", unit="s", doc="for how long it has been driven strongly one way, negative: heated (T9)"),
    Field("heat.driven_from", unit="K", doc="its temperature when it should have begun to follow"),
    Field(
        "heat.temperatures",
        "f8",
        RATE_WINDOW + 1,
        unit="K",
        doc="its temperatures of the last half second, from which its rate is taken (T5)",
    ),
    Field(
        "heat.fluxes",
        "f8",
        FLUX_WINDOW,
        unit="W/m^2",
        doc="the fluxes of the last second, from which their mean is taken (T6)",
    ),
)


def supervision(reads: Sequence[Channel], commands: Sequence[Channel]) -> tuple[Field, ...]:
    """Return the State that the supervision of a device with these channels needs."""
    fields: tuple[Field, ...] = _EVERY
    if any(channel.name == "pose_target" for channel in commands):
        fields += _CARRIED
    if heats(reads):
        fields += _HEAT
    return fields


def heats(reads: Sequence[Channel]) -> bool:
    """Tell whether a device has a plate that can be hot or cold."""
    return any(channel.name == "plate_temperature" for channel in reads)
