"""The modality 'voice-coil.render': the coil goes up and down as a finger that slides over the texture would."""

import math
from dataclasses import dataclass
from types import SimpleNamespace

from itouch.plugin import Contact, Field, Modality, schema

#: Above this [Hz] the coil is left alone: a current that is set a thousand times a second can't follow.
HIGHEST = 400.0


@dataclass(frozen=True)
class VoiceCoilRenderParams:
    """What <voice-coil:render .../> may hold."""

    probe: str = schema.ref("probe", doc="the probe that slides")
    coil: str = schema.ref("device", reads=("acceleration",), commands=("current",), doc="the coil that shakes")
    full_force: float = schema.quantity("N", low=0.01, high=5.0, default=0.5, doc="pressed so hard, all is felt")


@dataclass(frozen=True)
class VoiceCoilMaterial:
    """What <voice-coil:material .../> may hold: the texture of a surface."""

    wavelength: float = schema.quantity("m", low=1e-4, high=1e-2, doc="distance from ridge to ridge")
    height: float = schema.quantity("m", low=0.0, high=1e-3, doc="height of a ridge above the middle")


class VoiceCoilRender(Modality):
    """Vibration that the texture and the sliding speed give."""

    Params, Material = VoiceCoilRenderParams, VoiceCoilMaterial
    subscribes_to = frozenset((Contact.BEGIN, Contact.MOVE, Contact.END))

    def compile(self, name, params, world):
        """Return the read-only model: made once, from parameters, materials and the coil."""
        coil = world.devices[params.coil].params
        return SimpleNamespace(
            name=name,
            probe=params.probe,
            full_force=params.full_force,
            command=f"{params.coil}.command.current",
            textures=tuple((o.material.wavelength, o.material.height) if o.material else None for o in world.objects),
            amps_per_newton=1.0 / coil.force_per_amp,
            mass=coil.mass,
            natural=2.0 * math.pi * coil.resonance,
            damping=coil.damping,
            channel=f"{params.coil}.current",
        )

    def fields(self, model):
        """Return the State of the modality: all that changes, and nothing else."""
        return (
            Field("object", "i8", unit="1", doc="number of the touched object, -1: none"),
            Field("speed", unit="m/s", doc="speed of the finger along the surface"),
            Field("force", unit="N", doc="normal force of the contact"),
            Field("phase", unit="rad", doc="phase of the texture under the finger", show="no"),
            Field("acceleration", unit="m/s^2", doc="acceleration that is asked for"),
            Field("peak", unit="m/s^2", doc="greatest acceleration of the open contact", show="no"),
        )

    def commands(self, model):
        """Return the one command channel that it writes."""
        return (model.channel,)

    def reset(self, model, state):
        """Set every field to its start."""
        state[f"{model.name}.object"] = -1
        for field in ("speed", "force", "phase", "acceleration", "peak"):
            state[f"{model.name}.{field}"] = 0.0

    def on_contact(self, event, model, state):
        """Note what is touched, how hard, and how fast the finger slides over it."""
        if event.probe != model.probe:
            return
        touching = event.kind is not Contact.END
        state[f"{model.name}.object"] = event.object_index if touching else -1
        state[f"{model.name}.speed"] = math.hypot(*event.tangential_velocity) if touching else 0.0
        state[f"{model.name}.force"] = event.force if touching else 0.0
        if event.kind is Contact.BEGIN:
            state[f"{model.name}.peak"] = 0.0

    def update(self, model, state, period):
        """Turn the phase by speed over wavelength, and send the current that shakes the coil as the ridges would."""
        index = int(state[f"{model.name}.object"])
        texture = model.textures[index] if index >= 0 else None
        wavelength, height = texture or (1.0, 0.0)
        frequency = float(state[f"{model.name}.speed"]) / wavelength
        turning = 2.0 * math.pi * frequency
        phase = (float(state[f"{model.name}.phase"]) + turning * period) % (2.0 * math.pi)
        pressed = min(1.0, float(state[f"{model.name}.force"]) / model.full_force)
        felt = height * pressed * min(1.0, frequency / 5.0) if frequency < HIGHEST else 0.0
        stiffness = math.hypot(model.natural**2 - turning**2, 2.0 * model.damping * model.natural * turning)
        state[model.command] = model.amps_per_newton * model.mass * stiffness * felt * math.sin(phase)
        acceleration = felt * turning**2
        state[f"{model.name}.phase"] = phase
        state[f"{model.name}.acceleration"] = acceleration
        state[f"{model.name}.peak"] = max(float(state[f"{model.name}.peak"]), acceleration)

    def measures(self, model, state, probe, object_index):
        """Return what the report says of a contact: the strongest vibration in it."""
        return {"vibration_m_s2": float(state[f"{model.name}.peak"])} if probe == model.probe else {}
