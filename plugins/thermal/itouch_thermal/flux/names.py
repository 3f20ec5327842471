"""Names of the fields that a tick of `flux-control` touches; put together once."""

from __future__ import annotations

from dataclasses import dataclass, fields

from itouch_thermal.flux.params import FluxControlParams

#: Fields of the display, and of the finger.
_DISPLAY = {
    "sink": "sink_temperature",
    "age": "age",
    "heat_flux": "heat_flux",
    "plate_temperature": "plate_temperature",
    "sequence": "sequence",
    "measured": "measured",
    "left": "left",
    "actual": "actual_current",
    "target": "command.temperature_target",
    "output": "command.output",
    "true_flux": "twin.true_flux",
    "true_skin": "twin.true_skin",
}
_FINGER = ("near_object", "below", "normal_force", "felt_force", "plate")
_HEAT = {"heat_desired": "desired", "resistance": "resistance", "finger": "finger", "bodies": "objects"}


@dataclass(frozen=True, slots=True)
class Names:
    """Names of State fields: the modality's own, the display's, the finger's, those of the modality that is followed.

    ``sent`` is the current that was sent last: the display's, or where it holds a temperature, what was asked of it.
    """

    open: str
    touching: str
    met: str
    object: str
    approached: str
    calm: str
    on_plate: str
    begun: str
    fresh: str
    pressing: str
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
    scale_before: str
    x: str
    theta: str
    memory: str
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
    preview_finger: str
    preview_object: str
    preview_index: str
    reached: str
    future: str
    wanted: str
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
    near_object: str
    below: str
    normal_force: str
    felt_force: str
    plate: str
    heat_desired: str
    resistance: str
    finger: str
    bodies: str
    sent: str
    command: str

    @classmethod
    def of(cls, name: str, params: FluxControlParams, probe: str, command: str) -> Names:
        """Return the names for a modality, its finger, and what its display's driver is told."""
        display, heat = params.display, params.desired_from
        found = {field.name: f"{name}.{field.name}" for field in fields(cls)}
        found |= {key: f"{display}.{field}" for key, field in _DISPLAY.items()}
        found |= {key: f"{probe}.{key}" for key in _FINGER}
        found |= {key: f"{heat}.{field}" for key, field in _HEAT.items()}
        found["met"] = f"{probe}.object"
        found["sent"] = f"{display}.sent.current" if command == "current" else f"{name}.asked"
        found["out"] = f"{display}.out.current"
        found["command"] = f"{display}.command.current"
        return cls(**found)
