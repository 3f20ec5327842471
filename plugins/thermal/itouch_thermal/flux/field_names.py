"""Names of the State fields that a tick of `flux-control` reads and writes, put together once."""

from __future__ import annotations

from dataclasses import dataclass, fields

from itouch.plugin import Role, WorldDevice

#: Fields that the framework keeps of every device.
_DEVICE = ("age", "sequence", "measured", "left")
#: Readings and commands of the display, by role, whatever their names.
_READS = {
    "sink": Role.HEAT_SINK_TEMPERATURE,
    "heat_flux": Role.HEAT_FLUX,
    "plate_temperature": Role.SKIN_CONTACT_TEMPERATURE,
    "actual": Role.DELIVERED_DRIVE,
}
_OBEYS = {"target": Role.TEMPERATURE_TARGET, "output": Role.OUTPUT_SWITCH}
#: True values that its twin knows, by role.
_TRUTHS = {"true_flux": Role.HEAT_FLUX, "true_skin": Role.SKIN_TEMPERATURE}
#: Fields that the framework keeps of every probe.
_FINGER = ("near_object", "below", "normal_force", "felt_force", "plate")
#: Fields of the modality `heat`: what the model finger on the virtual object is like now.
_HEAT = {"resistance": "resistance", "finger": "finger", "bodies": "objects", "beside_part": "beside_part"}


@dataclass(frozen=True, slots=True)
class Names:
    """Names of State fields that Python uses: the modality's own, those of display, finger and desired flux.

    ``sent`` is the current that was sent last: to the display or, where that holds a temperature, what was asked of it.
    What the display does not have is empty; ``truth`` is the name of ``true_flux`` in the twin's own State.
    """

    touching: str
    met: str
    object: str
    approached: str
    on_plate: str
    begun: str
    fresh: str
    tracked: str
    taken: str
    taken_at: str
    acting: str
    departed: str
    before: str
    waited: str
    interval: str
    sent_log: str
    force_before: str
    force_before_at: str
    came: str
    came_doubt: str
    theta: str
    preset_begun: str
    flux: str
    desired: str
    obtained: str
    start_temperature: str
    readiness: str
    plate_ready: str
    plate_limited: str
    unready: str
    condensation_time: str
    asked: str
    driver: str
    targets: str
    sink: str
    age: str
    sequence: str
    measured: str
    left: str
    out: str
    heat_flux: str
    plate_temperature: str
    actual: str
    target: str
    output: str
    true_flux: str
    true_skin: str
    truth: str
    near_object: str
    below: str
    normal_force: str
    felt_force: str
    plate: str
    heat_desired: str
    resistance: str
    finger: str
    bodies: str
    beside_part: str
    sent: str
    command: str

    @classmethod
    def of(cls, name: str, probe: str, display: WorldDevice, desired: str, heat: str) -> Names:
        """Return the names for a modality, its finger, and its display, whose channels are found by their roles.

        ``desired`` is the State field of the desired flux, ``heat`` the modality `heat`; empty: there is none.
        """
        found = {field.name: f"{name}.{field.name}" for field in fields(cls)}
        found |= {key: f"{display.name}.{key}" for key in _DEVICE}
        found |= {key: display.read_field(role) for key, role in _READS.items()}
        for key, role in _OBEYS.items():
            channel = display.command(role)
            found[key] = f"{display.name}.command.{channel.name}" if channel is not None else ""
        truths = {key: display.true_field(role) for key, role in _TRUTHS.items()}
        found |= {key: f"{display.name}.twin.{field}" if field else "" for key, field in truths.items()}
        found["truth"] = truths["true_flux"]
        found |= {key: f"{probe}.{key}" for key in _FINGER}
        found |= {key: f"{heat}.{field}" if heat else "" for key, field in _HEAT.items()}
        found["heat_desired"] = desired
        found["met"] = f"{probe}.object"
        drive = driven(display)
        found["sent"] = f"{display.name}.sent.{drive}" if drive else f"{name}.asked"
        found["out"] = f"{display.name}.out.{drive}" if drive else ""
        found["command"] = f"{display.name}.command.{drive}" if drive else ""
        return cls(**found)


def driven(display: WorldDevice) -> str:
    """Return the name of the command by which a display is told a current [A]; empty: it has none."""
    channel = display.command(Role.DRIVE, "A")
    return channel.name if channel is not None else ""
