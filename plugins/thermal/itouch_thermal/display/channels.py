"""The channels of the thermal display: its sensors' readings, and the commands that drive it."""

from __future__ import annotations

from itouch.plugin import (
    Channel,
    Role,
    current,
    heat_flux,
    plate_temperature,
    sink_temperature,
    skin_temperature,
    temperature_target,
)
from itouch_thermal.display.params import DisplayParams

#: Readings of every display; the last one has the full scale of the usual sensor.
READS = (
    skin_temperature(),
    Channel(
        "skin_valid", 1, "1", (0.0,), (1.0,), role=Role.SKIN_VALID, doc="1 while the infrared sensor sees the skin"
    ),
    plate_temperature(),
    sink_temperature(),
    heat_flux(full_scale=20e3),
)
#: Commands of a driver that holds a temperature: the temperature, and whether its output is on (off is safe).
TEMPERATURE_COMMAND = (
    temperature_target(),
    Channel("output", 1, "1", (0.0,), (1.0,), safe=(0.0,), role=Role.OUTPUT_SWITCH, doc="1 while the output is on"),
)


def channels(params: DisplayParams) -> tuple[tuple[Channel, ...], tuple[Channel, ...]]:
    """Return readings and commands, with the sensor's full scale and the driver's limit from the parameters."""
    reads = (*READS[:-1], heat_flux(full_scale=params.full_scale))
    if params.command == "current":
        return reads, (current(limit=params.max_current),)
    limit = 1.05 * params.max_current
    return (
        *reads,
        Channel(
            "actual_current",
            1,
            "A",
            (-limit,),
            (limit,),
            role=Role.DELIVERED_DRIVE,
            doc="current that flows",
        ),
    ), TEMPERATURE_COMMAND
