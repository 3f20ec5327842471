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
    Field("status", "i8", low=0, high=3),  # CLOSED, OPEN, ENABLED, FAULT
    Field("trip", "i8"),
    Field("tripped", "i8"),
    Field("ramp", low=0.0, high=1.0),
    Field("age", "i8", low=0),
    Field("sequence", "i8", low=0),
    Field("clamped", "i8", low=0),
    Field("dropped", "i8", low=0),
    Field("strayed", "i8"),
    Field("calibration", "f8", 7),
)

_CARRIED = (
    Field("contact_time", low=0.0),
    Field("withdrawn", "i8"),
    Field("stopped", "i8"),
    Field("doubted"),
    Field("near_since", "i8"),
    Field("compared", "i8"),
    Field("tracked", "i8", low=0),
    Field("track", "f8", (SPEED_WINDOW + 1, 3)),
)

_HEAT = (
    Field("touched", "i8"),
    Field("heat.samples", "i8", low=0),
    Field("heat.touched", "i8"),
    Field("heat.dose", low=0.0),
    Field("heat.share", low=0.0, high=1.0),
    Field("heat.frozen"),
    Field("heat.frozen_for"),
    Field("heat.frozen_drive"),
    Field("heat.frozen_from"),
    Field("heat.driven_for"),
    Field("heat.driven_from"),
    Field("heat.temperatures", "f8", RATE_WINDOW + 1),
    Field("heat.fluxes", "f8", FLUX_WINDOW),
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
